// Small charts of figures over generations; a click chooses the nearest.
import uPlot from "./vendor/uPlot.esm.js";
import { color, figure, h } from "./dom.js";

/** Draws each of `lines` ({name: values}) into a chart of its own; returns what removes them. */
export function drawLines(element, generations, lines, act) {
  const charts = Object.entries(lines).filter(([, values]) => values.some((value) => value !== null)).map(([name, values]) => {
    const holder = h("div", { class: "line" });
    element.append(holder);
    const ink = color("--soft");
    const axis = { stroke: ink, grid: { stroke: color("--line"), width: 1 }, ticks: { stroke: color("--line") }, values: (_plot, each) => each.map(figure) };
    const size = () => ({ width: Math.max(holder.clientWidth, 120), height: 170 });
    const chart = new uPlot({
      ...size(), scales: { x: { time: false } }, axes: [{ ...axis, label: "generation", labelSize: 20 }, { ...axis, label: name, size: 64, labelSize: 20 }],
      series: [{ label: "generation", value: (_plot, value) => figure(value) },
        { label: name, stroke: color("--accent"), width: 2, value: (_plot, value) => figure(value) }],
      cursor: { drag: { x: false, y: false } },
    }, [generations, values], holder);
    chart.over.addEventListener("click", () => {
      if (chart.cursor.idx !== null && chart.cursor.idx !== undefined) act(chart.cursor.idx);
    });
    const observer = new ResizeObserver(() => chart.setSize(size()));
    observer.observe(holder);
    return () => {
      observer.disconnect();
      chart.destroy();
    };
  });
  return () => charts.forEach((remove) => remove());
}
