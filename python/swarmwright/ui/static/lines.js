// Small charts of figures over generations; a click chooses the nearest.
import uPlot from "./vendor/uPlot.esm.js";
import { bounded, color, figure, h } from "./dom.js";
import { onTheme } from "./theme.js";

const value = (_plot, each) => figure(each);

/** A line of a chart: how it is called, its colour, and its width; 0 for one that only bounds an area. */
export function series(label, stroke, width = 2) {
  return { label, stroke: width ? stroke : "transparent", width, points: { show: false }, value };
}

/**
 * Draws a chart that follows the width of its place and the theme; returns what removes it.
 *
 * chart.x, chart.y: labels; chart.series: called for `series` of each of `data` but the first, the generations, anew for each
 * theme; chart.bands: areas between them; act: called with the index of what was clicked.
 */
export function drawChart(element, height, chart, data, act) {
  const holder = h("div", { class: "line" });
  element.append(holder);
  let plot = null;
  const size = () => ({ width: Math.max(holder.clientWidth, 120), height });
  const draw = () => {
    plot?.destroy();
    const grid = { stroke: color("--line"), width: 1 };
    const axis = { stroke: color("--soft"), grid, ticks: grid, labelSize: 20, values: (_plot, each) => each.map(figure) };
    plot = new uPlot({
      ...size(), scales: { x: { time: false } }, axes: [{ ...axis, label: chart.x }, { ...axis, label: chart.y, size: 64 }],
      series: [{ label: "generation", value }, ...chart.series()], bands: chart.bands, cursor: { drag: { x: false, y: false } },
    }, [data[0], ...data.slice(1).map((values) => values.map(bounded))], holder);
    plot.over.addEventListener("click", () => {
      if (plot.cursor.idx !== null && plot.cursor.idx !== undefined) act(plot.cursor.idx);
    });
  };
  draw();
  const endTheme = onTheme(draw);
  const observer = new ResizeObserver(() => plot.setSize(size()));
  observer.observe(holder);
  return () => {
    observer.disconnect();
    endTheme();
    plot.destroy();
    holder.remove();
  };
}

/** Draws each of `lines` ({name: values}) into a chart of its own; returns what removes them. */
export function drawLines(element, generations, lines, act) {
  const removers = Object.entries(lines).filter(([, values]) => values.some((each) => each !== null)).map(([name, values]) =>
    drawChart(element, 170, { x: "generation", y: name, series: () => [series(name, color("--accent"))] }, [generations, values], act));
  return () => removers.forEach((remove) => remove());
}
