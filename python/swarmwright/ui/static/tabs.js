// The tabs on the page of a run: what the run itself tells, and those of other views that it has.
import { ask, askToLeave, date, duration, h, table, tell } from "./dom.js";
import { store } from "./store.js";

/** Rows of `key.path: value`, as `--set` takes them. */
function flat(values, prefix = "") {
  return Object.entries(values).flatMap(([key, value]) => {
    const path = prefix ? `${prefix}.${key}` : key;
    const isGroup = value !== null && typeof value === "object" && !Array.isArray(value) && Object.keys(value).length > 0;
    return isGroup ? flat(value, path) : [[path, JSON.stringify(value)]];
  });
}

function showExperiment(element, { details }) {
  const rows = flat(details.experiment);
  const body = h("div");
  const filter = h("input", { type: "search", placeholder: "Filter keys", "aria-label": "Filter keys", input: draw });
  function draw() {
    body.replaceChildren(table(["key", "value"], rows.filter(([key]) => key.includes(filter.value)), { empty: "No key has this in its name." }));
  }
  draw();
  element.append(h("p", { class: "hint" }, "As it was run, every default written out."), filter, body);
}

async function showJournal(element, run) {
  async function update() {
    const journal = await ask("journal", { run: run.id });
    element.replaceChildren(
      h("h2", {}, "Failures"), table(["reason", "attempts"], journal.failures.map((entry) => [entry.reason, entry.attempts]), { empty: "Nothing failed." }),
      h("h2", {}, "Servers"), table(["server", "episodes", "failed", "seconds"],
        journal.servers.map((entry) => [entry.server < 0 ? "this process" : String(entry.server), entry.evaluations, entry.failed, entry.seconds]),
        { empty: "Evaluated in the process of the tool." }),
      h("h2", {}, "Warnings"), table(["time", "warning"], journal.events.map((event) => [date(event.time), event.text]), { empty: "No warnings." }));
  }
  await update();
  return { update };
}

function showSessions(element, run) {
  function update() {
    element.replaceChildren(table(["started", "where", "host", "took", "ended"],
      run.details.sessions.map((session) => [date(session.started), session.place, session.host, duration(session.seconds), session.outcome ?? ""])));
  }
  update();
  return { update };
}

const OWN = { Experiment: showExperiment, "Servers and failures": showJournal, Sessions: showSessions };

export class Tabs {
  #run;
  #names = null; // of the views that the run has, once they are known
  #isEmpty = true; // whether the run had no generation then
  #buttons = h("div", { class: "tools", role: "tablist", "aria-label": "About the run", keydown: (event) => this.#move(event) });
  #message = h("div");
  #content = h("div", { class: "tab", role: "tabpanel" });
  #chosen = null;
  #shown = {}; // what the tab that is shown returned
  #isGone = false;

  /** run: `{ id, details, replay }`, of which `details` changes. */
  constructor(run) {
    this.#run = run;
    this.element = h("div", { class: "tabs" });
  }

  /** Shows the tabs, and what has changed in the one that was chosen. */
  async update() {
    try {
      const isEmpty = this.#run.details.curve.generation.length === 0;
      if (this.#names === null || this.#isEmpty !== isEmpty) {
        this.#names = (await ask("tabs", { run: this.#run.id })).tabs;
        if (this.#isGone) return;
        this.#isEmpty = isEmpty;
        this.#offer();
      }
      if (this.#chosen === null) await this.#choose("Experiment");
      else await this.#shown.update?.();
      this.#message.replaceChildren();
    } catch (error) {
      tell(this.#message, error);
    }
  }

  #offer() {
    const views = store.window.views.filter((view) => this.#names.includes(view.name));
    const titles = [...Object.keys(OWN), ...views.map((view) => view.title)];
    for (const title of titles.slice(this.#buttons.childElementCount)) {
      this.#buttons.append(h("button", { type: "button", role: "tab", "aria-selected": "false", click: () => this.#choose(title) }, title));
    }
    if (!this.element.hasChildNodes()) this.element.append(this.#buttons, this.#message, this.#content);
  }

  /** Shows a tab in an element of its own: one that was chosen before may still load, and then goes unseen. */
  async #choose(title) {
    if (this.isChanged && !await askToLeave()) return;
    this.#leave();
    this.#chosen = title;
    for (const button of this.#buttons.children) button.setAttribute("aria-selected", String(button.textContent === title));
    const element = h("div");
    this.#content.replaceChildren(element);
    try {
      const view = store.window.views.find((each) => each.title === title && each.is_tab);
      const show = OWN[title] ?? (await import(new URL(view.script, document.baseURI))).show;
      if (!element.isConnected) return;
      const shown = (await show(element, this.#run)) ?? {};
      if (element.isConnected && !this.#isGone) this.#shown = shown;
      else shown.leave?.();
    } catch (error) {
      tell(element, error);
    }
  }

  #move(event) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step === undefined) return;
    const buttons = [...this.#buttons.children];
    const next = buttons[(buttons.indexOf(document.activeElement) + step + buttons.length) % buttons.length];
    next.focus();
    next.click();
  }

  get isChanged() {
    return this.#shown.isChanged?.() ?? false;
  }

  #leave() {
    this.#shown.leave?.();
    this.#shown = {};
  }

  leave() {
    this.#isGone = true;
    this.#leave();
  }
}
