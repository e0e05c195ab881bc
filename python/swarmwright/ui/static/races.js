// How many candidates remained after how many episodes or instances of a race; those of a race, to watch.
import { Newest, ask, figure, h, table, tell } from "./dom.js";
import { rangeOf } from "./colors.js";
import { HeatMap } from "./heatmap.js";
import { Scatter } from "./scatter.js";

const MOST_ROWS = 300;

export function show(element, run) {
  const newest = new Newest();
  let isGone = false;
  let races = null;
  let chosen = null;
  let shown = [];
  const message = h("div");
  const survival = h("div");
  const heading = h("h2");
  const picture = h("div");
  const note = h("p", { class: "hint" });
  const rows = h("div");
  element.append(message, survival, note, heading, picture, h("details", { open: true }, h("summary", {}, "As a table"), rows));
  const map = new HeatMap(survival, { label: "Candidates that remain", act: ({ column }) => open(races.numbers[column]) });
  const plot = new Scatter(picture, { label: "Candidates of a race", act: watch });

  function nameOf(number) {
    return races.unit === "episodes" ? `generation ${number}` : `race ${number}`;
  }

  /** Reads the races; the last one is shown until another is chosen. */
  async function update() {
    try {
      const isLast = races === null || chosen === races.numbers.at(-1);
      const answer = await ask("races", { run: run.id });
      if (isGone) return;
      races = answer;
      message.replaceChildren();
      note.textContent = [
        races.numbers.length < races.count ? `${figure(races.numbers.length)} of ${figure(races.count)} races.` : null,
        races.unit === "episodes" ? "Each generation is a race: candidates that are clearly worse than the best get no more episodes."
          : "A race takes several generations, each of which is an instance. Elites of earlier races are only evaluated on instances that are new to them.",
        "Click a race to see its candidates.",
      ].filter(Boolean).join(" ");
      if (isLast) await open(races.numbers.at(-1));
      else draw();
    } catch (error) {
      tell(message, error);
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
      const answer = await newest.ask("race_entrants", { run: run.id, race: number });
      message.replaceChildren();
      shown = answer.entrants;
      drawEntrants(answer.count);
    } catch (error) {
      tell(message, error);
    }
  }

  function words(entrant) {
    const after = { dropped: `dropped after ${entrant.steps}`, remained: `remained with ${entrant.steps}`, failed: `failed after ${entrant.steps}` };
    return `${after[entrant.state] ?? `${entrant.state}, ${entrant.steps}`} ${races.unit}`;
  }

  function drawEntrants(count) {
    heading.textContent = `${nameOf(chosen)}: ${figure(count)} candidates`;
    const finite = shown.filter((entrant) => entrant.fitness !== null);
    const [across, up] = [finite.map((entrant) => entrant.steps), finite.map((entrant) => entrant.fitness)];
    plot.show({
      x: { label: races.unit, values: across }, y: { label: "fitness", values: up }, shade: null, ranges: { x: rangeOf(across), y: rangeOf(up) },
      steps: null,
      words: (index) => `generation ${finite[index].generation}, candidate ${finite[index].candidate}: ${words(finite[index])}, fitness ${figure(finite[index].fitness)}`,
    });
    rows.replaceChildren(table([races.unit, "state", "fitness", "generation", "candidate", ""], shown.slice(0, MOST_ROWS).map((entrant) => [
      entrant.steps, words(entrant), entrant.fitness, entrant.generation, entrant.candidate,
      h("button", { type: "button", click: (event) => replay(entrant, event.shiftKey) }, "Watch"),
    ])));
  }

  function replay(entrant, isBeside) {
    run.replay({ generation: entrant.generation, candidate: entrant.candidate }, isBeside);
  }

  function watch(index, isBeside) {
    replay(shown.filter((entrant) => entrant.fitness !== null)[index], isBeside);
  }

  update();
  return { update, leave: () => {
    isGone = true;
    newest.end();
    map.destroy();
    plot.destroy();
  } };
}
