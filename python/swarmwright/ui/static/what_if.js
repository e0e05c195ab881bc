// What if the simulation were another one: its parameters as fields and sliders, what the candidate then reaches on
// the same seeds, and its replay beside that of the run.
import { Newest, ask, change, figure, h, problem, table, tell } from "./dom.js";

const PAUSE_MS = 200; // after the last change, before anything is computed
const MOST_OFFERED = 6; // parameters that are shown at once; others are chosen from a list
const MORE = 10; // times as many seeds
const MOST_SEEDS = 1000;

const isNumber = (parameter) => parameter.kind === "number" || parameter.kind === "integer";

/** The ends of a slider: what is declared, or around the value of the run. */
function ends({ kind, value, minimum, maximum }) {
  const span = value === 0 ? 1 : Math.abs(value) * 3;
  const low = minimum ?? (value < 0 ? -span : 0);
  const high = maximum !== null && maximum <= span * 10 ? maximum : Math.max(span, low + 1);
  const step = kind === "integer" ? 1 : 10 ** Math.floor(Math.log10((high - low) / 50));
  return { min: low, max: high, step };
}

/** Fields for a parameter; `changed` is called with its value, undefined for that of the run. */
function row(parameter, changed) {
  const { key, kind, value, choices, description } = parameter;
  const id = `what-if-${key}`;
  const label = h("label", { for: id, title: description }, key);
  let set;
  let fields;
  if (isNumber(parameter)) {
    const { min, max, step } = ends(parameter);
    const slider = h("input", { type: "range", min, max, step, value, "aria-label": `${key}, slider`, input: () => take(slider.value) });
    const input = h("input", { type: "number", id, step: kind === "integer" ? 1 : "any", value, input: () => take(input.value) });
    const take = (text) => {
      const chosen = text === "" ? value : Number(text);
      if (slider.value !== text) slider.value = String(chosen);
      if (input.value !== text) input.value = String(chosen);
      changed(chosen === value ? undefined : chosen);
    };
    set = () => [slider.value, input.value] = [String(value), String(value)];
    fields = [slider, input];
  } else if (kind === "boolean" || choices.length) {
    const offered = kind === "boolean" ? [true, false] : choices.includes(value) ? choices : [value, ...choices];
    const select = h("select", { id, change: () => changed(offered[select.selectedIndex] === value ? undefined : offered[select.selectedIndex]) },
      offered.map((choice) => h("option", { selected: choice === value }, String(choice))));
    set = () => { select.selectedIndex = offered.indexOf(value); };
    fields = [select];
  } else {
    const input = h("input", { type: "text", id, value, input: () => changed(input.value === value ? undefined : input.value) });
    set = () => { input.value = value; };
    fields = [input];
  }
  const back = h("button", { type: "button", title: `Back to ${value}, as in the run`, "aria-label": `Back to ${value}`, click: () => {
    set();
    changed(undefined);
  } }, "↺");
  return { element: h("div", { class: "what-if-row" }, label, ...fields, back), reset: set };
}

const interval = ({ low, high }) => (low === null ? "" : ` (${figure(low)} to ${figure(high)})`);
const words = (mean) => (mean ? `${figure(mean.mean)}${interval(mean)}` : "–");

export class WhatIf {
  /** chosen: returns the candidate; replayed: called with the parameters that differ, to show their replay. */
  constructor(run, { chosen, replayed }) {
    Object.assign(this, { run, chosen, replayed });
    this.parameters = {};
    this.episodes = null;
    this.caller = crypto.randomUUID?.() ?? String(Math.random());
    this.number = 0;
    this.newest = new Newest();
    this.rows = h("div", { class: "what-if-rows" });
    this.more = h("select", { "aria-label": "Another parameter", change: () => this.add(this.more.selectedIndex - 1) });
    this.result = h("div", { "aria-live": "polite" });
    this.element = h("section", { class: "panel", hidden: true, "aria-label": "What if" });
  }

  async open() {
    this.element.hidden = false;
    if (this.listed) return;
    this.element.replaceChildren(h("p", { class: "empty" }, "…"));
    try {
      ({ parameters: this.listed, episodes: this.episodes } = await ask("parameters", { run: this.run }));
      this.controls = new Map();
      this.element.replaceChildren(
        h("div", { class: "tools" }, h("h2", {}, "What if"), this.more,
          h("button", { type: "button", click: () => this.reset() }, "As in the run")),
        this.listed.length ? this.rows : h("p", { class: "empty" }, "This simulation has no parameters that can be changed here."), this.result);
      this.listed.slice(0, MOST_OFFERED).forEach((_, index) => this.add(index));
      this.offer();
      this.compare();
    } catch (error) {
      this.listed = null;
      this.element.replaceChildren(problem(error));
    }
  }

  close() {
    this.element.hidden = true;
    this.reset();
  }

  offer() {
    this.more.replaceChildren(h("option", {}, "another parameter…"),
      ...this.listed.map((parameter) => h("option", { disabled: this.controls.has(parameter.key) }, parameter.key)));
    this.more.hidden = this.listed.every(({ key }) => this.controls.has(key));
  }

  add(index) {
    const parameter = this.listed[index];
    if (parameter === undefined || this.controls.has(parameter.key)) return;
    const control = row(parameter, (value) => this.set(parameter.key, value));
    this.controls.set(parameter.key, control);
    this.rows.append(control.element);
    this.offer();
  }

  set(key, value) {
    if (value === undefined) delete this.parameters[key];
    else this.parameters[key] = value;
    this.later();
  }

  reset() {
    if (!this.listed) return;
    for (const control of this.controls.values()) control.reset();
    const had = Object.keys(this.parameters).length > 0;
    this.parameters = {};
    if (had) this.later();
  }

  later() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.replayed({ ...this.parameters });
      this.compare();
    }, PAUSE_MS);
  }

  /** Computes the means; what was asked before is given up. */
  async compare() {
    if (this.element.hidden || !this.listed) return;
    const number = ++this.number;
    this.result.classList.add("old");
    try {
      this.draw(await change("what_if", {
        run: this.run, ...this.chosen(), parameters: this.parameters, episodes: this.episodes, caller: this.caller, number,
      }, this.newest.next()));
    } catch (error) {
      tell(this.result, error);
    }
    if (number === this.number) this.result.classList.remove("old");
  }

  draw({ label, seeds, unchanged, changed }) {
    const names = Object.keys(unchanged.metrics);
    const lines = [["fitness", unchanged.fitness, changed?.fitness], ...names.map((name) => [name, unchanged.metrics[name], changed?.metrics[name]])];
    for (const name of Object.keys(changed?.metrics ?? {})) if (!names.includes(name)) lines.push([name, null, changed.metrics[name]]);
    const failed = (changed ?? unchanged).fitness.failed;
    this.result.replaceChildren(
      table(["mean (95 % interval)", "as in the run", ...(changed ? ["what if"] : [])],
        lines.map(([name, before, after]) => [name, words(before), ...(changed ? [words(after)] : [])]), { hasNames: true, isNumeric: true }),
      h("p", { class: "hint" }, `Candidate ${label} on ${seeds.length} seeds that evolution did not use, ${seeds[0]} to ${seeds.at(-1)}, the same for both.`,
        failed ? ` ${failed} episodes failed.` : "", " ",
        seeds.length * MORE <= MOST_SEEDS ? h("button", { type: "button", click: () => {
          this.episodes = seeds.length * MORE;
          this.compare();
        } }, `${seeds.length * MORE} seeds`) : ""));
  }

  leave() {
    clearTimeout(this.timer);
    this.newest.end();
  }
}
