// What the tabs of fronts and archives share: a slider over generations, a picture, its table, and the indicators.
import { Newest, ask, figure, h, table, tell } from "./dom.js";
import { drawLines } from "./lines.js";

const MOST_ROWS = 200;

/**
 * names: the requests of the states and of one of them; options(states): elements that choose what is drawn;
 * draw(states, elites): draws it. Returns what a tab returns, and `watch`.
 */
export function showElites(element, run, names, { picture, options, draw, hint }) {
  const newest = new Newest();
  let isGone = false;
  let states = null;
  let elites = null;
  let reading = null; // while the states are read
  let removeLines = () => {};
  const slider = h("input", { type: "range", min: 0, step: 1, "aria-label": "generation", input: () => load() });
  const at = h("output");
  const tools = h("div", { class: "tools" });
  const message = h("div");
  const notes = h("p", { class: "hint" });
  const lines = h("div", { class: "lines" });
  const rows = h("div");
  const more = h("p", { class: "hint" });
  const details = h("details", { toggle: () => drawTable() }, h("summary", {}, "As a table"), rows, more);
  element.append(message, tools, picture, h("p", { class: "hint" }, hint), lines, notes, details);

  /** Shows the generation that the slider is at. */
  async function load() {
    const generation = states.generations[slider.value];
    at.value = `after generation ${figure(generation)} of ${figure(states.generations.at(-1))}`;
    try {
      elites = await newest.ask(names.state, { run: run.id, generation });
      message.replaceChildren();
      redraw();
    } catch (error) {
      tell(message, error);
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
    if (!details.open || elites === null) return;
    const columns = Object.keys(elites.columns);
    rows.replaceChildren(table(["generation", "candidate", ...columns, ""], elites.born.slice(0, MOST_ROWS).map((generation, index) => [
      generation, elites.candidate[index], ...columns.map((name) => elites.columns[name][index]),
      h("button", { type: "button", click: (event) => watch(index, event.shiftKey) }, "Watch"),
    ]), { empty: "There is none yet." }));
    more.textContent = elites.count > MOST_ROWS ? `The best ${MOST_ROWS} of ${figure(elites.count)}.` : "";
  }

  function watch(index, isBeside) {
    run.replay({ generation: elites.born[index], candidate: elites.candidate[index] }, isBeside);
  }

  function update() {
    reading ??= read().finally(() => { reading = null; });
    return reading;
  }

  /** Reads the states, which takes a while in long runs; the slider stays where it is, or at the end. */
  async function read() {
    try {
      let answer = null;
      do {
        answer = await ask(names.states, { run: run.id });
        if (isGone) return;
        if (answer.share !== undefined) message.replaceChildren(h("p", { class: "hint" }, `reading all evaluations: ${Math.floor(100 * answer.share)} %`));
      } while (answer.share !== undefined);
      message.replaceChildren();
      const isFirst = states === null;
      const chosen = isFirst || Number(slider.value) === states.generations.length - 1 ? Infinity : states.generations[slider.value];
      states = answer;
      slider.max = states.generations.length - 1;
      slider.value = states.generations.findLastIndex((generation) => generation <= chosen);
      if (isFirst) tools.replaceChildren(h("label", {}, "generation ", slider), at, ...options(states, redraw));
      removeLines();
      removeLines = drawLines(lines, states.generations, states.indicators, (index) => {
        slider.value = index;
        load();
      });
      await load();
    } catch (error) {
      tell(message, error);
    }
  }

  update();
  return { watch, update, leave: () => {
    isGone = true;
    newest.end();
    removeLines();
  } };
}

/** A list to choose from, with what is chosen first. */
export function choice(label, values, chosen, act) {
  const list = h("select", { change: act }, values.map((value) => h("option", { value }, value)));
  list.value = chosen;
  return { list, element: h("label", {}, `${label} `, list) };
}
