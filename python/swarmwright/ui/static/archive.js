// The archive of a run of map_elites, at any generation, over any two of its measures.
import { figure, h } from "./dom.js";
import { rangeOf } from "./colors.js";
import { choice, showElites } from "./elites.js";
import { HeatMap } from "./heatmap.js";
import { words } from "./scatter.js";

const NONE = "nothing";

export function show(element, run) {
  let across = null;
  let up = null;
  let cells = new Map();
  const picture = h("div");
  const map = new HeatMap(picture, { label: "Archive", height: 420, act: ({ column, row }, isBeside) => {
    const index = cells.get(`${column} ${row}`);
    if (index !== undefined) page.watch(index, isBeside);
  } });
  const page = showElites(element, run, { states: "archive", state: "archive_cells" }, {
    picture, options, draw, hint: "Colours are the fitness of each cell's elite. Click a cell to watch it, shift-click to watch it beside the others.",
  });

  function options({ axes }, redraw) {
    const names = Object.keys(axes);
    across = choice("across", names, names[0], redraw);
    up = choice("up", [NONE, ...names], names[1] ?? NONE, redraw);
    return [across.element, up.element];
  }

  function draw(states, elites) {
    const [name, other] = [across.list.value, up.list.value];
    const names = Object.keys(states.axes);
    // A raster of Voronoi cells has the first measure across.
    const raster = states.raster !== null && name === names[0] && other === names[1] ? states.raster : null;
    const withBins = (axis) => (raster === null ? axis : { ...axis, bins: raster.size });
    const horizontal = withBins(states.axes[name]);
    const vertical = other === NONE || other === name ? null : withBins(states.axes[other]);
    const [columns, rows] = [horizontal.bins, vertical?.bins ?? 1];
    const values = new Float32Array(columns * rows).fill(NaN);
    cells = new Map();
    const place = (column, row, index) => {
      const key = `${column} ${row}`;
      if (index === undefined || cells.has(key)) return;
      cells.set(key, index);
      values[column * rows + row] = elites.columns.fitness[index];
    };
    if (raster === null) {
      // The best are first: cells of other measures are projected by their best.
      elites.born.forEach((_, index) => place(elites.bins[name][index], vertical ? elites.bins[other][index] : 0, index));
    } else {
      const elite = new Map(elites.cells.map((cell, index) => [cell, index]));
      raster.cells.forEach((cell, point) => place(Math.floor(point / rows), point % rows, elite.get(cell)));
    }
    const hidden = names.filter((each) => each !== name && each !== (vertical ? other : null));
    map.show({
      columns, rows, values, range: rangeOf(elites.columns.fitness), isUpward: true,
      below: { label: name, range: [horizontal.low, horizontal.high] },
      left: vertical ? { label: other, range: [vertical.low, vertical.high] } : { label: "", labels: [""] },
      bar: hidden.length ? `fitness, best over ${hidden.join(", ")}` : "fitness (more is better)",
      words: (column, row) => {
        const index = cells.get(`${column} ${row}`);
        const bin = (axis, position) => `${figure(axis.low + (axis.high - axis.low) * position / axis.bins)} to ${figure(axis.low + (axis.high - axis.low) * (position + 1) / axis.bins)}`;
        const where = `${name} ${bin(horizontal, column)}${vertical ? `, ${other} ${bin(vertical, row)}` : ""}`;
        return index === undefined ? `${where}: no elite`
          : `${where}: generation ${elites.born[index]}, candidate ${elites.candidate[index]}, ${words(elites.columns, index)}`;
      },
    });
  }

  return { update: page.update, leave: () => {
    page.leave();
    map.destroy();
  } };
}
