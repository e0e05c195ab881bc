// How the genes develop: a map of generations and genes; a click watches the best of that generation.
import { Newest, figure, h, tell } from "./dom.js";
import { decode, rangeOf } from "./colors.js";
import { HeatMap } from "./heatmap.js";

const MOST_IGNORED = 0.01;
const WORDS = { best: "best candidate", mean: "mean of the candidates", spread: "standard deviation of the candidates" };

export function show(element, run) {
  const newest = new Newest();
  let history = null;
  const of = h("select", { change: load }, Object.entries(WORDS).map(([value, words]) => h("option", { value }, words)));
  const scale = h("select", { change: draw }, h("option", { value: "all" }, "for all genes"), h("option", { value: "each" }, "for each gene"));
  const message = h("div");
  const picture = h("div");
  const note = h("p", { class: "hint" });
  element.append(h("div", { class: "tools" }, h("label", {}, "genes of the ", of), h("label", {}, "one scale of colours ", scale)), message, picture, note);
  const map = new HeatMap(picture, { label: "Genes over generations", height: 420, act: ({ column }, isBeside) => {
    run.replay({ generation: history.generations[column], candidate: history.candidates[column] }, isBeside);
  } });

  async function load() {
    try {
      const answer = await newest.ask("genes", { run: run.id, of: of.value });
      message.replaceChildren();
      history = { ...answer, values: decode(answer.values) };
      draw();
    } catch (error) {
      tell(message, error);
    }
  }

  function nameOf(row) {
    if (history.names.length) return history.names[row];
    const first = history.first_genes[row];
    const last = (history.first_genes[row + 1] ?? history.genes) - 1;
    return last > first ? `genes ${first} to ${last}` : `gene ${first}`;
  }

  function draw() {
    if (history === null) return;
    const columns = history.generations.length;
    const rows = history.first_genes.length;
    const isEach = scale.value === "each";
    const rangeOfRow = (row) => rangeOf(Array.from({ length: columns }, (_, column) => history.values[column * rows + row]));
    const last = history.generations[columns - 1];
    const isWhole = last + 1 === columns;
    map.show({
      columns, rows, values: history.values, ...(isEach ? { ranges: Array.from({ length: rows }, (_, row) => rangeOfRow(row)) } : { range: rangeOf(history.values, MOST_IGNORED) }),
      below: isWhole ? { label: "generation", range: [-0.5, last + 0.5], whole: true } : { label: "generation", range: [0, last] },
      left: history.names.length ? { label: "", labels: history.names } : { label: "gene", range: [-0.5, history.genes - 0.5], whole: true },
      bar: isEach ? "lowest to highest of each gene" : WORDS[of.value],
      words: (column, row) => `generation ${history.generations[column]}, ${nameOf(row)}: ${figure(history.values[column * rows + row])} `
        + `(best: candidate ${history.candidates[column]})`,
    });
    note.textContent = [
      isWhole ? null : `${figure(columns)} of ${figure(last + 1)} generations.`,
      rows < history.genes ? `${figure(history.genes)} genes in ${figure(rows)} rows, each the mean of neighbours.` : null,
      "Click a generation to watch its best candidate, shift-click to watch it beside the others.",
    ].filter(Boolean).join(" ");
  }

  load();
  return { update: load, leave: () => {
    newest.end();
    map.destroy();
  } };
}
