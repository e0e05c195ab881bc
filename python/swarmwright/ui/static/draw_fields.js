// Fields for the values of a mission, by the descriptions in `ui/arena_parts.py`.
import { h } from "./dom.js";

export const FLOORS = { black: "#222222", grey: "#c9c8c1", white: "#ffffff", random: "#8d86a8" };
export const LEDS = { red: "#e02020", green: "#18a818", blue: "#2848e0", cyan: "#10b8c8", magenta: "#d020c0", yellow: "#d8c010" };

/**
 * Replaces what a container shows in the next frame, and keeps the focus on the field that has it. While somebody types
 * into a field, that waits: what is not entered yet would be lost.
 */
export function renderer(container, build) {
  let isAwaited = false;
  container.addEventListener("change", ({ target }) => {
    if (target.tagName === "INPUT") target.defaultValue = target.value;
  });
  const draw = () => {
    if (isAwaited) return;
    isAwaited = true;
    requestAnimationFrame(() => {
      isAwaited = false;
      const active = container.contains(document.activeElement) ? document.activeElement : null;
      if (active?.tagName === "INPUT" && active.value !== active.defaultValue) {
        active.addEventListener("blur", draw, { once: true });
        return;
      }
      const key = active?.dataset.key;
      const open = new Set([...container.querySelectorAll("details[open]")].map((each) => each.dataset.key));
      container.replaceChildren(...[build()].flat(3).filter(Boolean));
      for (const each of container.querySelectorAll("details")) if (open.has(each.dataset.key)) each.open = true;
      const fields = [...container.querySelectorAll("[data-key]")];
      if (active) (fields.find((each) => each.dataset.key === key) ?? fields[0])?.focus({ preventScroll: true });
    });
  };
  return draw;
}

const listOf = (value) => (Array.isArray(value) ? value : []);
const numbers = (text) => text.split(/[\s,;]+/).filter(Boolean).map(Number);

/** A labelled field. `set(undefined)` is called where an optional value is emptied. */
export function field(label, spec, value, set, key, names = {}) {
  const unit = spec.unit ? ` (${spec.unit})` : "";
  return h("label", {}, h("span", {}, `${label.replaceAll("_", " ")}${unit}`), input(spec, value, set, key, names, label));
}

function input(spec, value, set, key, names, label) {
  const data = { "data-key": key };
  const emptied = spec.is_optional ? "default" : null;
  switch (spec.type) {
    case "number":
      return h("input", { ...data, type: "number", step: "any", value: value ?? "", placeholder: spec.is_optional ? spec.value ?? "none" : "", change: (event) => {
        if (event.target.value !== "") set(Number(event.target.value));
        else if (spec.is_optional) set(undefined);
      } });
    case "flag":
      return h("input", { ...data, type: "checkbox", checked: value === true, change: (event) => set(event.target.checked || undefined) });
    case "choice":
      return select(data, [[ "", `${spec.value} (default)` ], ...spec.options.filter((each) => each !== spec.value || value === each).map((each) => [each, each])], value ?? "", (now) => set(now || undefined));
    case "several": {
      const present = Array.isArray(value) ? value : spec.value;
      return h("span", { class: "several", role: "group", "aria-label": label }, spec.options.map((each) => h("label", {}, h("input", { "data-key": `${key}.${each}`, type: "checkbox", checked: present.includes(each), change: (event) => {
        const chosen = spec.options.filter((other) => (other === each ? event.target.checked : present.includes(other)));
        set(chosen.length ? chosen : spec.is_optional ? undefined : []);
      } }), each)));
    }
    case "patch":
    case "object":
    case "kind":
      return select(data, [...(emptied ? [["", "all"]] : []), ...(names[spec.type] ?? []).map((each) => [each, each])], value ?? "", (now) => set(now || undefined));
    case "patches": {
      const chosen = listOf(value);
      return h("span", { class: "several", role: "group", "aria-label": label }, (names.patch ?? []).map((each) => h("label", {}, h("input", { "data-key": `${key}.${each}`, type: "checkbox", checked: chosen.includes(each), change: (event) => {
        const now = event.target.checked ? [...chosen, each] : chosen.filter((other) => other !== each);
        set(now.length || !spec.is_optional ? now : undefined);
      } }), each)));
    }
    case "factors":
      return h("input", { ...data, value: Object.entries(value ?? {}).map(([name, factor]) => `${name}: ${factor}`).join(", "), placeholder: "metric: factor, metric: factor", change: (event) => {
        const terms = event.target.value.split(/[,;]/).filter((each) => each.trim()).map((each) => each.split(":").map((part) => part.trim()));
        set(Object.fromEntries(terms.map(([name, factor]) => [name, Number.isNaN(Number(factor || 1)) ? factor : Number(factor || 1)])));
      } });
    case "numbers":
      return h("input", { ...data, value: listOf(value).join(", "), placeholder: "default", change: (event) => {
        const list = numbers(event.target.value);
        set(list.length ? list.map((each) => (Number.isNaN(each) ? event.target.value : each)) : undefined);
      } });
    case "points":
      return h("input", { ...data, value: listOf(value).map((point) => listOf(point).join(" ")).join(", "), placeholder: "x y, x y", change: (event) => {
        const list = event.target.value.split(/[,;]/).map(numbers).filter((point) => point.length);
        set(list.length ? list : undefined);
      } });
    case "shape":
      return select(data, ["circle", "polygon", "line", "points"].map((each) => [each, each]), Object.keys(value ?? {}).find((each) => each in SHAPES) ?? "circle", (now) => {
        const { fixed, turned } = value ?? {};
        set({ ...structuredClone(SHAPES[now]), ...(fixed === undefined ? {} : { fixed }), ...(turned === undefined ? {} : { turned }) });
      });
    default:
      return h("input", { ...data, value: String(value ?? ""), placeholder: spec.is_optional ? "default" : "", change: (event) => set(event.target.value === "" && spec.is_optional ? undefined : event.target.value) });
  }
}

const SHAPES = {
  circle: { circle: 0.5 },
  polygon: { polygon: [[-0.5, -0.5], [0.5, -0.5], [0, 0.5]] },
  line: { line: [[-0.5, 0], [0.5, 0]] },
  points: { points: [[-0.5, 0], [0, 0], [0.5, 0]] },
};

export function select(attributes, options, value, set) {
  const known = options.some(([each]) => each === value);
  return h("select", { ...attributes, change: (event) => set(event.target.value) },
    (known ? options : [[value, value === "" ? "choose" : `${value} (missing)`], ...options]).map(([each, text]) => h("option", { value: each, selected: each === value }, text)));
}

/** Fields of a mapping, by descriptions; keys that have none are shown as they are. */
export function fields(specs, target, set, key, names = {}, ignored = []) {
  const known = Object.entries(specs).map(([name, spec]) => field(name, spec, target[name], (now) => set(name, now), `${key}.${name}`, names));
  const others = leaves(target).filter(([path]) => !(path[0] in specs) && !ignored.includes(path[0])).map(([path, value]) => leafField(target, path, value, set, key));
  return [...known, ...others];
}

/** Numbers and texts of a value, with their paths; lists of lists have none: they are drawn. */
export function leaves(value, path = []) {
  if (Array.isArray(value) && value.some((each) => Array.isArray(each))) return [];
  if (value !== null && typeof value === "object") return Object.entries(value).flatMap(([name, each]) => leaves(each, [...path, Array.isArray(value) ? Number(name) : name]));
  return [[path, value]];
}

export function nameOf(path) {
  return path.map((each) => (typeof each === "number" ? `[${each}]` : each)).join(".").replaceAll(".[", "[");
}

export function leafField(target, path, value, set, key) {
  const type = typeof value === "number" ? "number" : typeof value === "boolean" ? "flag" : "text";
  return field(nameOf(path), { type }, value, (now) => {
    if (path.length === 1) return set(path[0], now);
    const copy = structuredClone(target[path[0]]);
    path.slice(1, -1).reduce((each, name) => each[name], copy)[path.at(-1)] = type === "flag" ? now === true : now;
    return set(path[0], copy);
  }, `${key}.${nameOf(path)}`);
}

/** Sets a key of a mapping, or removes it. */
export function put(target, name, value) {
  if (value === undefined) delete target[name];
  else target[name] = value;
}
