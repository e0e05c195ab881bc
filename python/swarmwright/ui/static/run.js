// The page of a run: its curve with every evaluation, replays by click, and tabs.
import { Newest, Refresher, ask, change, date, duration, figure, h, problem, tell, text } from "./dom.js";
import { LearningCurve } from "./curve.js";
import { Export } from "./export.js";
import { Panes } from "./panes.js";
import { store } from "./store.js";
import { Tabs } from "./tabs.js";
import { WhatIf } from "./what_if.js";

const MOST_EPISODES = 1000; // in the list to choose from
const PAUSE_MS = 500; // between two looks at a run that goes on

function facts(entries) {
  return h("dl", { class: "facts" }, entries
    .filter(([, value]) => value !== null && value !== undefined && value !== "")
    .map(([name, value, note]) => h("div", {}, h("dt", {}, name), h("dd", { title: note }, value))));
}

function heldOutWords(heldOut) {
  if (heldOut === null) return null;
  const interval = heldOut.low === null ? "" : ` (95 %: ${figure(heldOut.low)} to ${figure(heldOut.high)})`;
  const excluded = heldOut.is_reportable ? "" : " and are left out";
  const failed = heldOut.failed ? `, ${heldOut.failed} of ${heldOut.episodes} episodes failed${excluded}` : `, ${heldOut.episodes} episodes`;
  return `${figure(heldOut.mean)}${interval}${failed}`;
}

export function show(view, query, id) {
  const head = h("div", { class: "run-head" });
  const chart = h("div", { class: "chart" });
  const chosen = h("div", { class: "chosen" });
  const panes = new Panes(id, { changed: panesChanged });
  const whatIf = new WhatIf(id, { chosen: chosenCandidate, replayed: vary });
  const exporting = new Export(id, { chosen: chosenCandidate, episode: () => ({ ...panes.episode, parameters: variant?.parameters ?? {} }) });
  const run = { id, details: null, replay };
  const tabs = new Tabs(run);
  const curve = new LearningCurve(chart, { click: choose });
  const nearest = new Newest();
  const refresher = new Refresher(load, PAUSE_MS);
  let isGone = false;
  let variant = null; // the pane with other parameters

  const candidate = { generation: number("generation"), candidate: number("candidate") };
  const typed = () => Object.fromEntries(Object.entries(candidate).filter(([, input]) => input.value !== "").map(([key, input]) => [key, input.value]));
  const seed = number("seed");
  const episode = h("select", { "aria-label": "episode", change: () => {
    seed.value = "";
    panes.choose({ episode: episode.value });
  } }, h("option", { value: "0" }, "0"));
  seed.addEventListener("change", () => panes.choose(seed.value === "" ? { episode: episode.value } : { seed: seed.value }));
  const toggles = [whatIf, exporting].map((panel) => h("button", { type: "button", "aria-expanded": "false", click: () => {
    const isOpen = panel.element.hidden;
    if (isOpen) panel.open();
    else panel.close();
    toggles[[whatIf, exporting].indexOf(panel)].setAttribute("aria-expanded", String(isOpen));
  } }, panel === whatIf ? "What if…" : "Export…"));
  const form = h("form", { class: "tools", submit: (event) => {
    event.preventDefault();
    replay(typed(), event.submitter?.name === "beside");
  } },
  h("button", { type: "button", class: "primary", click: () => replay({}, false) }, "▶ Watch the best"),
  h("label", {}, "generation ", candidate.generation), h("label", {}, "candidate ", candidate.candidate),
  h("button", { type: "submit" }, "Watch"), h("button", { type: "submit", name: "beside" }, "Beside"),
  h("label", { title: "Of the run" }, "episode ", episode), h("label", { title: "Of another episode, the same in all replays" }, "seed ", seed),
  ...toggles,
  h("button", { type: "button", click: () => { panes.clear(); chosen.replaceChildren(); } }, "Close"));

  const generations = h("input", { type: "number", min: 1, step: 1, "aria-label": "generations in all", placeholder: "generations" });
  const message = h("span", { role: "status" });
  const actions = store.window.read_only ? null : h("div", { class: "tools" },
    h("a", { class: "button", href: `#/new?run=${encodeURIComponent(id)}` }, "New from this"),
    h("button", { type: "button", click: resume }, "Resume"), h("label", {}, "up to ", generations), message);

  async function resume() {
    if (!generations.reportValidity()) return;
    try {
      await change("resume", { runs: [id], generations: generations.value === "" ? null : Number(generations.value) });
      message.replaceChildren("in the queue: ", h("a", { href: "#/jobs" }, "Jobs"));
    } catch (error) {
      message.replaceChildren(problem(error));
    }
  }

  view.append(head, actions ?? "", chart, h("p", { class: "hint" }, "Every evaluation is a point: click one to watch it, shift-click to watch it beside the others. Drag to zoom, double-click to see all."),
    form, whatIf.element, exporting.element, chosen, panes.controls, panes.element, tabs.element);

  function number(name) {
    return h("input", { type: "number", min: 0, step: 1, name, "aria-label": name });
  }

  async function load() {
    try {
      const [details, density] = await Promise.all([ask("run", { run: id }), ask("density", { run: id, columns: 400, rows: 140 })]);
      if (isGone) return;
      run.details = details;
      drawHead();
      offerEpisodes();
      curve.update(details, density);
      await tabs.update();
    } catch (error) {
      if (!isGone) head.replaceChildren(h("h1", {}, id), problem(error));
    }
  }

  function drawHead() {
    const row = store.rows.get(id);
    if (row === undefined) return;
    const { details } = run;
    const best = details?.best;
    head.replaceChildren(
      h("h1", {}, id === "." ? row.name : id, " ", h("span", { class: `state ${row.state}` }, row.state)),
      facts([
        ["simulation", row.simulation], ["controller", row.controller], ["method", row.method], ["seed", text(row.seed)],
        ["generations", row.budget ? `${figure(row.generations)} of ${figure(row.budget)}` : figure(row.generations)],
        ["evaluations", figure(row.evaluations)],
        ["failed", row.failed ? `${figure(row.failed)} evaluations, ${figure(details?.failed_episodes)} episodes` : null],
        ["evaluations/s", row.rate === null ? null : figure(row.rate)], ["time left", row.left === null ? null : duration(row.left)],
        ["took", duration(row.seconds)], ["started", date(row.created)],
        ["champions", details?.champions ?? null, "The last match of each side's best: fitness depends on the opponents; see the tab Progress"],
        ["best recorded", best && !details.champions ? `${figure(best.fitness)} (generation ${best.generation}, candidate ${best.candidate})` : null,
          "The best of many evaluations: biased upwards where fitness depends on the seed"],
        ["on held-out seeds", heldOutWords(details?.held_out ?? null), "Seeds that evolution did not use: report this"],
      ]),
    );
  }

  async function choose(point, isBeside) {
    try {
      const found = await nearest.ask("nearest", { run: id, ...point });
      chosen.replaceChildren(facts([
        ["generation", text(found.generation)], ["candidate", text(found.candidate)], ["fitness", figure(found.fitness)],
        ["episodes", found.episodes.map(figure).join("  ")],
        ...Object.entries(found.metrics).map(([name, values]) => [name, values.map(figure).join("  ")]),
      ]));
      curve.mark(found);
      replay({ generation: found.generation, candidate: found.candidate }, isBeside);
    } catch (error) {
      tell(chosen, error);
    }
  }

  function offerEpisodes() {
    const episodes = Math.min(run.details.episodes, MOST_EPISODES);
    if (episode.length !== episodes) episode.replaceChildren(...Array.from({ length: episodes }, (_, index) => h("option", { value: index }, String(index))));
  }

  function replay(which, isBeside) {
    const subject = which.candidate === undefined ? "the best" : `candidate ${which.candidate}`;
    const name = which.match ? `generations ${which.match.replaceAll(",", " against ")}`
      : which.generation === undefined ? subject : `${subject} of generation ${which.generation}`;
    if (isBeside && variant) panes.remove(variant);
    const beside = panes.show(which, name, { isBeside });
    if (Object.keys(whatIf.parameters).length) vary(whatIf.parameters);
    if (panes.first === beside) panes.element.scrollIntoView({ block: "nearest", behavior: "smooth" });
    if (panes.first === beside && !whatIf.element.hidden) whatIf.compare();
  }

  /** The candidate that is exported and compared: the first that is watched, or the best. */
  function chosenCandidate() {
    return panes.first?.which ?? {};
  }

  function panesChanged() {
    if (variant && !panes.list.includes(variant)) variant = null;
  }

  /** Shows the first candidate with other parameters beside itself. */
  function vary(parameters) {
    const isChanged = Object.keys(parameters).length > 0;
    if (variant && !isChanged) panes.remove(variant);
    if (!isChanged) return;
    if (variant) {
      variant.parameters = parameters;
      variant.load();
      return;
    }
    if (!panes.first) panes.show({}, "the best");
    variant = panes.show(panes.first.which, "what if", { isBeside: true, parameters });
  }

  const stop = store.listen((changed) => {
    if (!changed.has(id)) return;
    drawHead();
    refresher.ask();
  });
  drawHead();
  refresher.ask();
  if (query.has("candidate")) replay(Object.fromEntries([...query].filter(([key]) => key in candidate)), false);
  return {
    trail: [id === "." ? "this folder" : id],
    isChanged: () => tabs.isChanged,
    leave: () => {
      isGone = true;
      stop();
      nearest.end();
      refresher.end();
      tabs.leave();
      exporting.leave();
      whatIf.leave();
      panes.leave();
      curve.destroy();
    },
  };
}
