// What the tabs of fronts and archives share: a slider over generations, a picture, its table, and the indicators.
import { ask, figure, h, problem } from "./dom.js";
import { drawLines } from "./lines.js";

const MOST_ROWS = 200;

/**
 * names: the requests of the states and of one of them; options(states): elements that choose what is drawn;
 * draw(states, elites): draws it. Returns what removes it all.
 */
export function showElites(element, run, names, { picture, options, draw, hint }) {
  let isGone = false;
  let states = null;
  let elites = null;
  let asked = 0;
  let removeLines = () => {};
  const slider = h("input", { type: "range", min: 0, step: 1, "aria-label": "generation", input: () => load(Number(slider.value)) });
  const at = h("output");
  const tools = h("div", { class: "tools" });
  const message = h("div", {}, h("p", { class: "hint" }, "reading all evaluations…"));
  const notes = h("p", { class: "hint" });
  const lines = h("div", { class: "lines" });
  const rows = h("tbody");
  const heads = h("tr");
  const more = h("p", { class: "hint" });
  const table = h("details", {}, h("summary", {}, "As a table"), h("div", { class: "wide" }, h("table", {}, h("thead", {}, heads), rows)), more);
  table.addEventListener("toggle", () => drawTable());
  element.append(message, tools, picture, h("p", { class: "hint" }, hint), lines, notes, table);

  async function load(index) {
    const number = ++asked;
    at.value = `after generation ${figure(states.generations[index])} of ${figure(states.generations[states.generations.length - 1])}`;
    try {
      const answer = await ask(names.state, { run: run.id, generation: states.generations[index] });
      if (isGone || number !== asked) return;
      elites = answer;
      message.replaceChildren();
      redraw();
    } catch (error) {
      if (!isGone) message.replaceChildren(problem(error));
    }
  }

  function redraw() {
    if (elites === null) return;
    draw(states, elites);
    const shown = elites.born.length;
    notes.textContent = [
      shown < elites.count ? `The best ${figure(shown)} of ${figure(elites.count)} by fitness.` : null, ...states.notes,
    ].filter(Boolean).join(" ");
    drawTable();
  }

  function drawTable() {
    if (!table.open || elites === null) return;
    const columns = Object.keys(elites.columns);
    heads.replaceChildren(...["generation", "candidate", ...columns, ""].map((head) => h("th", { scope: "col" }, head)));
    rows.replaceChildren(...elites.born.slice(0, MOST_ROWS).map((generation, index) => h("tr", {},
      [generation, elites.candidate[index], ...columns.map((name) => elites.columns[name][index])].map((value) => h("td", { class: "number" }, figure(value))),
      h("td", {}, h("button", { type: "button", click: (event) => watch(index, event.shiftKey) }, "Watch")))));
    more.textContent = elites.count > MOST_ROWS ? `The best ${MOST_ROWS} of ${figure(elites.count)}.` : "";
  }

  function watch(index, isBeside) {
    run.replay({ generation: elites.born[index], candidate: elites.candidate[index] }, isBeside);
  }

  async function start() {
    try {
      for (;;) {
        states = await ask(names.states, { run: run.id });
        if (isGone) return;
        if (states.share === undefined) break;
        message.replaceChildren(h("p", { class: "hint" }, `reading all evaluations: ${Math.floor(100 * states.share)} %`));
      }
      const last = states.generations.length - 1;
      slider.max = last;
      slider.value = last;
      tools.replaceChildren(h("label", {}, "generation ", slider), at, ...options(states, redraw));
      removeLines = drawLines(lines, states.generations, states.indicators, (index) => {
        slider.value = index;
        load(index);
      });
      await load(last);
    } catch (error) {
      if (!isGone) message.replaceChildren(problem(error));
    }
  }

  start();
  return { watch, leave: () => {
    isGone = true;
    removeLines();
  } };
}

/** A list to choose from, with what is chosen first. */
export function choice(label, values, chosen, act) {
  const list = h("select", { change: act }, values.map((value) => h("option", { value }, value)));
  list.value = chosen;
  return { list, element: h("label", {}, `${label} `, list) };
}
