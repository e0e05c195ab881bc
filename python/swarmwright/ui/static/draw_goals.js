// The objective of a mission: its metrics, their weights in the fitness, and their values while robots move.
import { color, figure, h } from "./dom.js";
import { fields, put, renderer } from "./draw_fields.js";

const SPARK_PX = [132, 30];

/** The constant and the weights of a mission's fitness. */
export function weightsOf(fitness) {
  if (typeof fitness === "string") return { offset: 0, factors: { [fitness]: 1 } };
  return { offset: fitness?.offset ?? 0, factors: fitness?.factors ?? {} };
}

/** The fitness of a mission as an expression. */
export function expressionOf(fitness) {
  const { offset, factors } = weightsOf(fitness);
  const terms = Object.entries(factors).map(([name, factor]) => [factor, Math.abs(factor) === 1 ? name : `${Math.abs(factor)} * ${name}`]);
  if (offset || !terms.length) terms.unshift([offset, String(Math.abs(offset))]);
  return terms.map(([factor, text], index) => (index ? `${factor < 0 ? " - " : " + "}${text}` : `${factor < 0 ? "-" : ""}${text}`)).join("");
}

/** The panel. `board` has the mission, `parts`, `edit`, the `expression` of the experiment, and `values` over time. */
export function goalsPanel(board) {
  const element = h("div", { class: "goals" });
  const sparks = new Map();
  const draw = renderer(element, build);
  return { element, show: draw, mark };

  function build() {
    const { mission, parts } = board;
    if (mission === null || parts === null) return [];
    sparks.clear();
    const metrics = Object.entries(mission.metrics ?? {});
    const { factors } = weightsOf(mission.fitness);
    const general = parts.general_metrics.filter((name) => name in factors && mission.metrics?.[name] === undefined);
    const left = parts.general_metrics.filter((name) => !(name in factors) && mission.metrics?.[name] === undefined);
    requestAnimationFrame(() => mark(board.step));
    return [
      metrics.map(([name, metric]) => metricRow(name, metric, factors[name])),
      general.map((name) => h("fieldset", {}, h("legend", {}, `${name.replaceAll("_", " ")} at the end (general)`), h("div", { class: "tools" }, weight(name, factors[name]), live(name)))),
      h("div", { class: "tools" },
        h("select", { "data-key": "metrics.add", "aria-label": "Add a metric", change: (event) => { if (event.target.value) board.edit((target) => add(target, event.target.value, parts)); } },
          h("option", { value: "" }, "Add a metric…"),
          h("optgroup", { label: "measured as you define" }, Object.keys(parts.metrics).map((kind) => h("option", { value: kind }, kind.replaceAll("_", " ")))),
          h("optgroup", { label: "general, at the end" }, left.map((name) => h("option", { value: `:${name}` }, name.replaceAll("_", " ")))))),
      h("label", { class: "expression" }, h("span", {}, "fitness = "), h("input", {
        "data-key": "fitness", value: board.expression ?? expressionOf(mission.fitness), "aria-label": "Fitness", change: (event) => board.weigh(event.target.value) }), live("")),
      board.expression === null ? null : h("p", { class: "hint" }, "A mission's fitness is a weighted sum of metrics. This expression is used by Try, and by the experiment that “Evolve on it” makes. ",
        h("button", { type: "button", "data-key": "fitness.back", click: () => board.weigh(expressionOf(mission.fitness)) }, "Use the weighted sum")),
    ];
  }

  function metricRow(name, metric, factor) {
    const { parts, mission } = board;
    const key = `metric.${name}`;
    const names = {
      patch: (mission.floor?.patches ?? []).map((each) => each.name),
      object: [...new Set((mission.objects ?? []).map((each) => each.name))],
      kind: Array.isArray(mission.robots) ? mission.robots.map((each) => each.name ?? each.robot).filter((each) => typeof each === "string") : [],
    };
    const set = (field, value) => board.edit((target) => put(target.metrics[name], field, value));
    const shape = metric.shape ? h("label", {}, h("span", {}, "shape may be turned"), h("input", { type: "checkbox", "data-key": `${key}.turned`, checked: metric.shape.turned === true, change: (event) => board.edit((target) => put(target.metrics[name].shape, "turned", event.target.checked || undefined)) })) : null;
    const fixed = metric.shape ? h("label", {}, h("span", {}, "shape stays in place"), h("input", { type: "checkbox", "data-key": `${key}.fixed`, checked: metric.shape.fixed === true, change: (event) => board.edit((target) => put(target.metrics[name].shape, "fixed", event.target.checked || undefined)) })) : null;
    return h("fieldset", {},
      h("legend", {}, String(metric.kind).replaceAll("_", " ")),
      h("div", { class: "fields" },
        h("label", {}, h("span", {}, "name"), h("input", { "data-key": `${key}.name`, value: name, change: (event) => board.edit((target) => renameMetric(target, name, event.target.value)) })),
        fields(parts.metrics[metric.kind] ?? {}, metric, set, key, names, ["kind"]), shape, fixed),
      h("div", { class: "tools" }, weight(name, factor), live(name),
        h("button", { type: "button", "data-key": `${key}.remove`, click: () => board.edit((target) => removeMetric(target, name)) }, "Remove")));
  }

  function weight(name, factor) {
    return h("label", {}, h("span", {}, "weight "), h("input", {
      type: "number", step: "any", "data-key": `weight.${name}`, value: factor ?? "", placeholder: "none",
      change: (event) => board.edit((target) => weigh(target, name, event.target.value === "" ? undefined : Number(event.target.value))) }));
  }

  /** A place for the values over time of a metric; of the fitness for "". */
  function live(name) {
    const series = name === "" ? board.values?.fitness : board.values?.metrics[name];
    if (!series) return null;
    const [width, height] = SPARK_PX;
    const canvas = h("canvas", { class: "live-spark", "aria-hidden": "true" });
    canvas.width = width * devicePixelRatio;
    canvas.height = height * devicePixelRatio;
    const value = h("output", { "data-metric": name || "fitness" });
    sparks.set(name, { canvas, value, series });
    return h("span", { class: "live-value" }, canvas, value);
  }

  /** Shows the values at a step of the episode that is played. */
  function mark(step) {
    for (const { canvas, value, series } of sparks.values()) {
      const at = Math.min(Math.max(0, Math.floor(step)), series.length - 1);
      value.textContent = figure(series[at]);
      spark(canvas, series, at);
    }
  }
}

function spark(canvas, series, at) {
  const [width, height] = SPARK_PX;
  const context = canvas.getContext("2d");
  context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
  context.clearRect(0, 0, width, height);
  const numbers = series.filter((each) => each !== null);
  if (!numbers.length) return;
  const low = numbers.reduce((one, other) => Math.min(one, other));
  const high = numbers.reduce((one, other) => Math.max(one, other));
  const x = (index) => 1 + ((width - 2) * index) / Math.max(1, series.length - 1);
  const y = (value) => height - 3 - ((height - 6) * (value - low)) / (high - low || 1);
  const stride = Math.max(1, Math.floor(series.length / (2 * width)));
  context.strokeStyle = color("--accent");
  context.lineWidth = 1.5;
  context.beginPath();
  for (let index = 0; index < series.length; index += stride) if (series[index] !== null) context.lineTo(x(index), y(series[index]));
  context.stroke();
  context.strokeStyle = color("--second");
  context.beginPath();
  context.moveTo(x(at), 0);
  context.lineTo(x(at), height);
  context.stroke();
}

function add(mission, kind, parts) {
  if (kind.startsWith(":")) {
    weigh(mission, kind.slice(1), 1);
    return;
  }
  mission.metrics ??= {};
  let name = kind;
  for (let number = 2; name in mission.metrics; number += 1) name = `${kind}_${number}`;
  const metric = { kind };
  const patches = (mission.floor?.patches ?? []).map((each) => each.name);
  let used = 0;
  for (const [field, spec] of Object.entries(parts.metrics[kind])) {
    if (spec.is_optional && !(kind === "time_until" && field === "at_least")) continue;
    if (spec.type === "patch") metric[field] = patches[used++] ?? patches.at(-1) ?? "";
    else if (spec.type === "patches") metric[field] = patches.slice(0, 1);
    else if (spec.value !== undefined) metric[field] = structuredClone(spec.value);
  }
  if (kind === "returns" && patches.length > 1) metric.nest = patches[1];
  mission.metrics[name] = metric;
}

function weigh(mission, name, factor) {
  const { offset, factors } = weightsOf(mission.fitness);
  const now = { ...factors };
  put(now, name, factor);
  mission.fitness = compact(offset, now);
}

/** The fitness as short as a mission has it. */
function compact(offset, factors) {
  const entries = Object.entries(factors);
  if (!offset && entries.length === 1 && entries[0][1] === 1) return entries[0][0];
  return offset ? { offset, factors } : { factors };
}

function renameMetric(mission, name, now) {
  if (now === "" || now === name || now in mission.metrics) return;
  mission.metrics = Object.fromEntries(Object.entries(mission.metrics).map(([key, value]) => [key === name ? now : key, value]));
  const { offset, factors } = weightsOf(mission.fitness);
  if (name in factors) mission.fitness = compact(offset, Object.fromEntries(Object.entries(factors).map(([key, value]) => [key === name ? now : key, value])));
}

function removeMetric(mission, name) {
  delete mission.metrics[name];
  if (!Object.keys(mission.metrics).length) delete mission.metrics;
  const { factors } = weightsOf(mission.fitness);
  if (name in factors && Object.keys(factors).length > 1) weigh(mission, name, undefined);
}
