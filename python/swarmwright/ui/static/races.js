// How many candidates remained after how many episodes or instances of a race; those of a race, to watch.
import { ask, figure, h, problem } from "./dom.js";
import { rangeOf } from "./colors.js";
import { HeatMap } from "./heatmap.js";
import { Scatter } from "./scatter.js";

const MOST_ROWS = 300;

export function show(element, run) {
  let isGone = false;
  let races = null;
  let chosen = null;
  let shown = [];
  const message = h("div");
  const survival = h("div");
  const heading = h("h2");
  const picture = h("div");
  const note = h("p", { class: "hint" });
  const rows = h("tbody");
  const steps = h("th", { scope: "col" });
  const table = h("details", { open: true }, h("summary", {}, "As a table"), h("div", { class: "wide" }, h("table", {},
    h("thead", {}, h("tr", {}, steps, ["state", "fitness", "generation", "candidate", ""].map((head) => h("th", { scope: "col" }, head)))), rows)));
  element.append(message, survival, note, heading, picture, table);
  const map = new HeatMap(survival, { label: "Candidates that remain", act: ({ column }) => open(races.numbers[column]) });
  const plot = new Scatter(picture, { label: "Candidates of a race", act: watch });

  function nameOf(number) {
    return races.unit === "episodes" ? `generation ${number}` : `race ${number}`;
  }

  async function start() {
    try {
      races = await ask("races", { run: run.id });
      if (isGone) return;
      note.textContent = [
        races.numbers.length < races.count ? `${figure(races.numbers.length)} of ${figure(races.count)} races.` : null,
        races.unit === "episodes" ? "Each generation is a race: candidates that are clearly worse than the best get no more episodes."
          : "A race takes several generations, each of which is an instance. Elites of earlier races are only evaluated on instances that are new to them.",
        "Click a race to see its candidates.",
      ].filter(Boolean).join(" ");
      await open(races.numbers[races.numbers.length - 1]);
    } catch (error) {
      if (!isGone) message.replaceChildren(problem(error));
    }
  }

  function draw() {
    const [columns, count] = [races.numbers.length, races.steps.length];
    const values = Float32Array.from(races.remaining.flatMap((row, column) => row.map((number) => number === null ? NaN : number / races.candidates[column])));
    const isAll = columns === races.count;
    const last = races.numbers[columns - 1];
    map.show({
      columns, rows: count, values, range: [0, 1], isUpward: true, marked: races.numbers.indexOf(chosen),
      below: isAll ? { label: races.unit === "episodes" ? "generation" : "race", range: [-0.5, last + 0.5], whole: true }
        : { label: races.unit === "episodes" ? "generation" : "race", range: [0, last] },
      left: { label: races.unit, range: [0.5, races.steps[count - 1] + 0.5], whole: true },
      bar: races.unit === "episodes" ? "share that remains" : "share that is evaluated",
      words: (column, row) => {
        const remaining = races.remaining[column][row];
        const where = nameOf(races.numbers[column]);
        return remaining === null ? `${where} ended after fewer than ${races.steps[row]} ${races.unit}`
          : `${where}: ${figure(remaining)} of ${figure(races.candidates[column])} candidates have ${races.steps[row]} ${races.unit}`;
      },
    });
  }

  async function open(number) {
    chosen = number;
    draw();
    try {
      const answer = await ask("race_entrants", { run: run.id, race: number });
      if (isGone || chosen !== number) return;
      shown = answer.entrants;
      drawEntrants(answer.count);
    } catch (error) {
      if (!isGone) message.replaceChildren(problem(error));
    }
  }

  function words(entrant) {
    const after = { dropped: `dropped after ${entrant.steps}`, remained: `remained with ${entrant.steps}`, failed: `failed after ${entrant.steps}` };
    return `${after[entrant.state] ?? `${entrant.state}, ${entrant.steps}`} ${races.unit}`;
  }

  function drawEntrants(count) {
    heading.textContent = `${nameOf(chosen)}: ${figure(count)} candidates`;
    steps.textContent = races.unit;
    const finite = shown.filter((entrant) => entrant.fitness !== null);
    const [across, up] = [finite.map((entrant) => entrant.steps), finite.map((entrant) => entrant.fitness)];
    plot.show({
      x: { label: races.unit, values: across }, y: { label: "fitness", values: up }, shade: null, ranges: { x: rangeOf(across), y: rangeOf(up) },
      steps: null,
      words: (index) => `generation ${finite[index].generation}, candidate ${finite[index].candidate}: ${words(finite[index])}, fitness ${figure(finite[index].fitness)}`,
    });
    rows.replaceChildren(...shown.slice(0, MOST_ROWS).map((entrant) => h("tr", {},
      h("td", { class: "number" }, figure(entrant.steps)), h("td", {}, words(entrant)),
      [entrant.fitness, entrant.generation, entrant.candidate].map((value) => h("td", { class: "number" }, figure(value))),
      h("td", {}, h("button", { type: "button", click: (event) => replay(entrant, event.shiftKey) }, "Watch")))));
  }

  function replay(entrant, isBeside) {
    run.replay({ generation: entrant.generation, candidate: entrant.candidate }, isBeside);
  }

  function watch(index, isBeside) {
    replay(shown.filter((entrant) => entrant.fitness !== null)[index], isBeside);
  }

  start();
  return { leave: () => {
    isGone = true;
    map.destroy();
    plot.destroy();
  } };
}
