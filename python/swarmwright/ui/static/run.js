// The page of a run: its curve with every evaluation, replays by click, experiment, servers, journal.
import { ask, change, date, duration, figure, h, problem } from "./dom.js";
import { LearningCurve } from "./curve.js";
import { Export } from "./export.js";
import { Panes } from "./panes.js";
import { store } from "./store.js";
import { WhatIf } from "./what_if.js";

function facts(entries) {
  return h("dl", { class: "facts" }, entries
    .filter(([, value]) => value !== null && value !== undefined && value !== "")
    .map(([name, value, note]) => h("div", {}, h("dt", {}, name), h("dd", { title: note }, value))));
}

function table(heads, rows, empty) {
  if (rows.length === 0) return h("p", { class: "empty" }, empty);
  return h("div", { class: "wide" }, h("table", {},
    h("thead", {}, h("tr", {}, heads.map((head) => h("th", { scope: "col" }, head)))),
    h("tbody", {}, rows.map((row) => h("tr", {}, row.map((value) => h("td", { class: typeof value === "number" ? "number" : null },
      typeof value === "number" ? figure(value) : value)))))));
}

/** Rows of `key.path: value`, as `--set` takes them. */
function flat(values, prefix = "") {
  return Object.entries(values).flatMap(([key, value]) => {
    const path = prefix ? `${prefix}.${key}` : key;
    const isGroup = value !== null && typeof value === "object" && !Array.isArray(value) && Object.keys(value).length > 0;
    return isGroup ? flat(value, path) : [[path, JSON.stringify(value)]];
  });
}

function heldOutWords(heldOut) {
  if (heldOut === null) return null;
  const interval = heldOut.low === null ? "" : ` (95 %: ${figure(heldOut.low)} to ${figure(heldOut.high)})`;
  const failed = heldOut.failed ? `, ${heldOut.failed} of ${heldOut.episodes} episodes failed` : `, ${heldOut.episodes} episodes`;
  return `${figure(heldOut.mean)}${interval}${failed}`;
}

export function show(view, query, id) {
  const head = h("div", { class: "run-head" });
  const chart = h("div", { class: "chart" });
  const chosen = h("div", { class: "chosen" });
  const panes = new Panes(id, { changed: panesChanged });
  const whatIf = new WhatIf(id, { chosen: chosenCandidate, replayed: vary });
  const exporting = new Export(id, { chosen: chosenCandidate, episode: () => ({ ...panes.episode, parameters: variant?.parameters ?? {} }) });
  const tabs = h("div", { class: "tabs" });
  const curve = new LearningCurve(chart, { click: choose });
  let details = null;
  let isGone = false;
  let isTabbed = false;
  let leaveTab = () => {};
  let version = 0;

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
    try {
      await change("resume", { runs: [id], generations: generations.value === "" ? null : Number(generations.value) });
      message.replaceChildren("in the queue: ", h("a", { href: "#/jobs" }, "Jobs"));
    } catch (error) {
      message.replaceChildren(problem(error));
    }
  }

  view.append(head, actions ?? "", chart, h("p", { class: "hint" }, "Every evaluation is a point: click one to watch it, shift-click to watch it beside the others. Drag to zoom, double-click to see all."),
    form, whatIf.element, exporting.element, chosen, panes.controls, panes.element, tabs);

  function number(name) {
    return h("input", { type: "number", min: 0, step: 1, name, "aria-label": name });
  }

  async function load() {
    const asked = ++version;
    try {
      const [now, density] = await Promise.all([ask("run", { run: id }), ask("density", { run: id, columns: 400, rows: 140 })]);
      if (isGone || asked !== version) return;
      details = now;
      drawHead();
      offerEpisodes();
      curve.update(now, density);
      if (!isTabbed) {
        isTabbed = true;
        await drawTabs();
      }
    } catch (error) {
      if (!isGone) head.replaceChildren(h("h1", {}, id), problem(error));
    }
  }

  function drawHead() {
    const row = store.rows.get(id);
    if (row === undefined) return;
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
        ["best recorded", best ? `${figure(best.fitness)} (generation ${best.generation}, candidate ${best.candidate})` : null,
          "The best of many evaluations: biased upwards where fitness depends on the seed"],
        ["on held-out seeds", heldOutWords(details?.held_out ?? null), "Seeds that evolution did not use: report this"],
      ]),
    );
  }

  function text(value) {
    return value === null || value === undefined ? "" : String(value);
  }

  async function choose(point, isBeside) {
    try {
      const found = await ask("nearest", { run: id, ...point });
      if (isGone) return;
      chosen.replaceChildren(facts([
        ["generation", text(found.generation)], ["candidate", text(found.candidate)], ["fitness", figure(found.fitness)],
        ["episodes", found.episodes.map(figure).join("  ")],
        ...Object.entries(found.metrics).map(([name, values]) => [name, values.map(figure).join("  ")]),
      ]));
      curve.mark(found);
      replay({ generation: found.generation, candidate: found.candidate }, isBeside);
    } catch (error) {
      chosen.replaceChildren(problem(error));
    }
  }

  function offerEpisodes() {
    if (episode.length !== details.episodes) episode.replaceChildren(...Array.from({ length: details.episodes }, (_, index) => h("option", { value: index }, String(index))));
  }

  function replay(which, isBeside) {
    const name = which.candidate === undefined ? "the best" : `${which.generation ?? "last"}:${which.candidate}`;
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

  async function drawTabs() {
    const content = h("div", { class: "tab", role: "tabpanel" });
    const pages = {
      Experiment: () => experiment(),
      "Servers and failures": async () => {
        const journal = await ask("journal", { run: id });
        return h("div", {},
          h("h2", {}, "Failures"), table(["reason", "attempts"], journal.failures.map((entry) => [entry.reason, entry.attempts]), "Nothing failed."),
          h("h2", {}, "Servers"), table(["server", "episodes", "failed", "seconds"],
            journal.servers.map((entry) => [entry.server < 0 ? "this process" : String(entry.server), entry.evaluations, entry.failed, entry.seconds]),
            "Evaluated in the process of the tool."),
          h("h2", {}, "Warnings"), table(["time", "warning"], journal.events.map((event) => [date(event.time), event.text]), "No warnings."));
      },
      Sessions: () => table(["started", "where", "host", "took", "ended"],
        details.sessions.map((session) => [date(session.started), session.place, session.host, duration(session.seconds), session.outcome ?? ""]), ""),
    };
    const { tabs: offered } = await ask("tabs", { run: id });
    if (isGone) return;
    for (const each of store.window.views.filter((entry) => offered.includes(entry.name))) {
      pages[each.title] = async () => {
        const { show: draw } = await import(new URL(each.script, document.baseURI));
        const element = h("div");
        leaveTab = (await draw(element, { id, details, replay }))?.leave ?? (() => {});
        return element;
      };
    }
    const buttons = Object.entries(pages).map(([name, page]) => h("button", { type: "button", role: "tab", click: async (event) => {
      for (const button of buttons) button.setAttribute("aria-selected", String(button === event.currentTarget));
      leaveTab();
      leaveTab = () => {};
      try {
        content.replaceChildren(await page());
      } catch (error) {
        content.replaceChildren(problem(error));
      }
    } }, name));
    tabs.replaceChildren(h("div", { class: "tools", role: "tablist" }, buttons), content);
    buttons[0].click();
  }

  function experiment() {
    const rows = flat(details.experiment);
    const body = h("div");
    const filter = h("input", { type: "search", placeholder: "Filter keys", "aria-label": "Filter keys", input: draw });
    function draw() {
      body.replaceChildren(table(["key", "value"], rows.filter(([key]) => key.includes(filter.value)), "No key has this in its name."));
    }
    draw();
    return h("div", {}, h("p", { class: "hint" }, "As it was run, every default written out."), filter, body);
  }

  const stop = store.listen((changed) => {
    if (changed.has(id)) load();
  });
  drawHead();
  load();
  if (query.has("candidate")) replay(Object.fromEntries([...query].filter(([key]) => key in candidate)), false);
  return {
    trail: [id === "." ? "this folder" : id],
    leave: () => {
      isGone = true;
      stop();
      leaveTab();
      whatIf.leave();
      panes.leave();
      curve.destroy();
    },
  };
}
