// Small charts of figures over generations; a click chooses the nearest.
import uPlot from "./vendor/uPlot.esm.js";
import { bounded, color, figure, h } from "./dom.js";
import { onTheme } from "./theme.js";

/** Draws each of `lines` ({name: values}) into a chart of its own; returns what removes them. */
export function drawLines(element, generations, lines, act) {
  const charts = Object.entries(lines).filter(([, values]) => values.some((value) => value !== null)).map(([name, values]) => {
    const holder = h("div", { class: "line" });
    element.append(holder);
    let chart = null;
    const size = () => ({ width: Math.max(holder.clientWidth, 120), height: 170 });
    const draw = () => {
      chart?.destroy();
      const grid = { stroke: color("--line"), width: 1 };
      const axis = { stroke: color("--soft"), grid, ticks: grid, values: (_plot, each) => each.map(figure) };
      chart = new uPlot({
        ...size(), scales: { x: { time: false } }, axes: [{ ...axis, label: "generation", labelSize: 20 }, { ...axis, label: name, size: 64, labelSize: 20 }],
        series: [{ label: "generation", value: (_plot, value) => figure(value) },
          { label: name, stroke: color("--accent"), width: 2, value: (_plot, value) => figure(value) }],
        cursor: { drag: { x: false, y: false } },
      }, [generations, values.map(bounded)], holder);
      chart.over.addEventListener("click", () => {
        if (chart.cursor.idx !== null && chart.cursor.idx !== undefined) act(chart.cursor.idx);
      });
    };
    draw();
    const endTheme = onTheme(draw);
    const observer = new ResizeObserver(() => chart.setSize(size()));
    observer.observe(holder);
    return () => {
      observer.disconnect();
      endTheme();
      chart.destroy();
      holder.remove();
    };
  });
  return () => charts.forEach((remove) => remove());
}
