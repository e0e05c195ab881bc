// Fields that are varied in a sweep: their values, and how many runs they make.
import { change, figure, h } from "./dom.js";
import { keyOf, nameOf } from "./form.js";

const AFTER_MS = 300;

const count = (number, noun) => `${figure(number)} ${noun}${number === 1 ? "" : "s"}`;

/** Makes the list of varied fields. `host` has `text()` and `seeds()`; `changed(runs)` and `removed(path)` say what is chosen. */
export function makeSweep(host) {
  const list = h("div", { class: "varied" });
  const sum = h("p", { class: "hint", role: "status" });
  const element = h("section", { class: "sweep", hidden: true, "aria-label": "Sweep" }, h("h2", {}, "Sweep"), list, sum);
  const chosen = [];
  let timer = null;
  let asked = 0;

  /** Varies a field, or does so no more. `node` is what the text has for it: `{text, yaml}`. */
  function toggle(field, node) {
    const index = chosen.findIndex((entry) => keyOf(entry.field.path) === keyOf(field.path));
    if (index >= 0) {
      chosen[index].row.remove();
      chosen.splice(index, 1);
    } else {
      const entry = makeEntry(field, node);
      chosen.push(entry);
      list.append(entry.row);
      entry.row.querySelector("input").focus();
    }
    element.hidden = chosen.length === 0;
    plan();
  }

  function makeEntry(field, node) {
    const name = nameOf(field.path);
    const message = h("p", { class: "problem", role: "status" });
    const number = h("span", { class: "count" });
    const takes = field.takes ?? [];
    const isChoice = takes.length === 0 || (takes.length === 1 && takes[0] === "boolean");
    const remove = h("button", { type: "button", "aria-label": `Do not vary ${name}`, title: "Do not vary this field", click: () => { toggle(field); host.removed(field.path); } }, "×");
    const entry = { field, message, number };
    if (isChoice) {
      const boxes = (field.choices ?? ["true", "false"]).map((choice) => h("input", { type: "checkbox", value: choice, checked: choice === (node?.text || field.default), change: plan }));
      entry.values = () => boxes.filter((box) => box.checked).map((box) => box.value).join(", ");
      entry.row = h("fieldset", { class: "vary-entry" }, h("legend", {}, name, " ", number, " ", remove), boxes.map((box) => h("label", {}, box, " ", box.value)), message);
      return entry;
    }
    const first = node?.yaml ?? (node?.text || field.default || "");
    const value = first.startsWith("[") && !takes.includes("list") ? `[${first}]` : first; // a single value
    const input = h("input", { type: "text", value, "aria-label": `Values of ${name}`, placeholder: "10, 20, 50", autocomplete: "off", spellcheck: "false", input: later });
    entry.values = () => input.value;
    const isNumber = takes.includes("integer") || takes.includes("number");
    entry.row = h("fieldset", { class: "vary-entry" }, h("legend", {}, name, " ", number, " ", remove), h("label", {}, "values ", input), isNumber ? makeRange(name, takes, input) : null, message);
    return entry;
  }

  function makeRange(name, takes, input) {
    const [from, to, steps] = ["from", "to", "number"].map((label) => h("input", { type: "number", step: "any", "aria-label": `${label} (${name})` }));
    const isLog = h("input", { type: "checkbox" });
    const fill = () => {
      const [low, high, count] = [from, to, steps].map((each) => each.valueAsNumber);
      if (![low, high, count].every(Number.isFinite) || count < 2 || count > 1000 || (isLog.checked && !(low > 0 && high > 0))) return;
      const values = Array.from({ length: Math.round(count) }, (_, index) => {
        const share = index / (Math.round(count) - 1);
        const value = isLog.checked ? low * (high / low) ** share : low + (high - low) * share;
        return takes.includes("number") ? Number(value.toPrecision(4)) : Math.round(value);
      });
      input.value = [...new Set(values)].join(", ");
      plan();
    };
    for (const each of [from, to, steps, isLog]) each.addEventListener("input", fill);
    return h("span", { class: "range" }, h("label", {}, "or from ", from), h("label", {}, "to ", to), h("label", {}, "in ", steps, " values"), h("label", {}, isLog, " by factors"));
  }

  function later() {
    clearTimeout(timer);
    timer = setTimeout(plan, AFTER_MS);
  }

  const entered = () => chosen.map((entry) => ({ path: entry.field.path, values: entry.values() }));

  async function plan() {
    const mine = ++asked;
    if (chosen.length === 0) return host.changed(null);
    host.changed(0);
    try {
      const answer = await change("sweep_plan", { text: host.text(), vary: entered(), seeds: host.seeds() });
      if (mine !== asked) return;
      chosen.forEach((entry, index) => {
        entry.message.textContent = answer.errors[index] ?? "";
        entry.number.textContent = answer.errors[index] ? "" : count(answer.counts[index], "value");
      });
      const isRight = Object.keys(answer.errors).length === 0;
      const variants = answer.counts.reduce((product, each) => product * each, 1);
      const product = answer.counts.length > 1 ? `${answer.counts.map(figure).join(" × ")} = ` : "";
      sum.textContent = isRight ? `${product}${count(variants, "variant")} with ${count(host.seeds(), "seed")} each: ${count(answer.runs, "run")}, compared at the end.` : "";
      sum.classList.remove("bad");
      host.changed(isRight ? answer.runs : 0);
    } catch (error) {
      if (mine !== asked) return;
      sum.textContent = error.message;
      sum.classList.add("bad");
    }
  }

  return { element, toggle, plan, entered, isVaried: (path) => chosen.some((entry) => keyOf(entry.field.path) === keyOf(path)), leave: () => clearTimeout(timer) };
}
