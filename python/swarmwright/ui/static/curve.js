// The learning curve over a map of all evaluations, which the server has counted into cells.
import uPlot from "./vendor/uPlot.esm.js";
import { bounded, color, figure } from "./dom.js";
import { onTheme } from "./theme.js";

const MOST_DOTS = 3000;

export class LearningCurve {
  #element;
  #click;
  #plot = null;
  #image = null;
  #density = null;
  #marked = null;
  #heldOut = null;
  #bestWords = "";
  #observer;
  #endTheme;

  /** click: called with a point and whether shift was pressed. */
  constructor(element, { click }) {
    this.#element = element;
    this.#click = click;
    this.#observer = new ResizeObserver(() => this.#plot?.setSize(this.#size()));
    this.#observer.observe(element);
    this.#endTheme = onTheme(() => this.#drawAnew());
  }

  update(details, density) {
    this.#density = density;
    this.#heldOut = details.held_out;
    this.#image = picture(density);
    const data = [
      details.curve.evaluations, details.curve.upper_quartile, details.curve.lower_quartile,
      details.curve.median, details.curve.best_so_far,
    ];
    if (this.#plot) this.#plot.setData(data, this.#isWhole());
    else if (data[0].length > 0) {
      this.#bestWords = details.best_words;
      this.#make(data);
    }
  }

  #make(data) {
    this.#plot = new uPlot(this.#options(), data, this.#element);
    this.#plot.over.addEventListener("click", (event) => this.#clicked(event));
  }

  /** Draws the same in other colours: the library keeps those of the beginning. */
  #drawAnew() {
    if (!this.#plot) return;
    const { data } = this.#plot;
    const { min, max } = this.#plot.scales.x;
    const isWhole = this.#isWhole();
    this.#plot.destroy();
    this.#image = picture(this.#density);
    this.#make(data);
    if (!isWhole) this.#plot.setScale("x", { min, max });
  }

  mark(evaluation) {
    this.#marked = evaluation;
    this.#plot?.redraw(false);
  }

  destroy() {
    this.#observer.disconnect();
    this.#endTheme();
    this.#plot?.destroy();
  }

  #size() {
    const width = this.#element.clientWidth;
    return { width, height: Math.max(240, Math.min(440, Math.round(width * 0.42))) };
  }

  #isWhole() {
    const { min, max } = this.#plot.scales.x;
    const x = this.#plot.data[0];
    return min === undefined || (min <= x[0] && max >= x[x.length - 1]);
  }

  #options() {
    const ink = color("--soft");
    const axis = { stroke: ink, grid: { stroke: color("--line"), width: 1 }, ticks: { stroke: color("--line") } };
    const line = (label, stroke, width, more = {}) => ({
      label, stroke, width, points: { show: false }, value: (_plot, value) => figure(value), ...more,
    });
    return {
      ...this.#size(),
      scales: { x: { time: false, range: (_plot, low, high) => [Math.min(low, 0), high] }, y: { range: (_plot, low, high) => this.#range(low, high) } },
      axes: [
        { ...axis, label: "evaluations", values: (_plot, values) => values.map(figure) },
        { ...axis, label: "fitness", size: 70, values: (_plot, values) => values.map(figure) },
      ],
      series: [
        { label: "evaluations", value: (_plot, value) => figure(value) },
        line("upper quartile", "transparent", 0), line("lower quartile", "transparent", 0),
        line("median", color("--second"), 1.5), line(this.#bestWords, color("--accent"), 2.5),
      ],
      bands: [{ series: [1, 2], fill: color("--band") }],
      cursor: { drag: { x: true, y: false, dist: 6 }, focus: { prox: -1 } },
      hooks: { drawClear: [(plot) => this.#drawBelow(plot)], draw: [(plot) => this.#drawAbove(plot)] },
    };
  }

  #range(low, high) {
    const values = [low, high, this.#heldOut?.mean, this.#heldOut?.low, this.#heldOut?.high].filter((value) => Number.isFinite(value));
    if (this.#density?.evaluations) values.push(this.#density.lowest, this.#density.highest);
    if (values.length === 0) return [0, 1];
    const [least, most] = [Math.min(...values), Math.max(...values)].map(bounded);
    const margin = (most - least || Math.abs(most) || 1) * 0.05;
    return [least - margin, most + margin];
  }

  #drawBelow(plot) {
    if (!this.#image || !this.#density.evaluations) return;
    const { ctx, bbox } = plot;
    const [left, right] = [0, this.#density.evaluations].map((value) => plot.valToPos(value, "x", true));
    const [bottom, top] = [this.#density.lowest, this.#density.highest].map((value) => plot.valToPos(value, "y", true));
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    if (this.#image.few) {
      // Dots, as long as single evaluations can be told apart.
      const { columns, rows } = this.#density;
      const radius = 2.2 * devicePixelRatio;
      ctx.fillStyle = `rgb(${color("--points")} / 0.8)`;
      for (const [column, row] of this.#image.few) {
        ctx.beginPath();
        ctx.arc(left + ((column + 0.5) / columns) * (right - left), bottom + ((row + 0.5) / rows) * (top - bottom), radius, 0, 7);
        ctx.fill();
      }
    } else {
      ctx.imageSmoothingEnabled = false;
      ctx.drawImage(this.#image.canvas, left, Math.min(top, bottom - 1), right - left, Math.max(bottom - top, 2));
    }
    ctx.restore();
  }

  #drawAbove(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    if (this.#heldOut?.mean !== null && this.#heldOut?.mean !== undefined) {
      const y = plot.valToPos(this.#heldOut.mean, "y", true);
      ctx.strokeStyle = ctx.fillStyle = color("--held-out");
      ctx.lineWidth = 2;
      ctx.setLineDash([8, 6]);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
      ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
      ctx.textAlign = "right";
      ctx.fillText("best on held-out seeds", bbox.left + bbox.width - 6, y - 6);
      ctx.setLineDash([]);
    }
    if (this.#marked && this.#marked.fitness !== null) {
      ctx.strokeStyle = color("--ink");
      ctx.lineWidth = 2 * devicePixelRatio;
      ctx.beginPath();
      ctx.arc(plot.valToPos(this.#marked.number + 0.5, "x", true), plot.valToPos(this.#marked.fitness, "y", true), 6 * devicePixelRatio, 0, 7);
      ctx.stroke();
    }
    ctx.restore();
  }

  #clicked(event) {
    const plot = this.#plot;
    const bounds = plot.over.getBoundingClientRect();
    const [x, y] = [event.clientX - bounds.left, event.clientY - bounds.top];
    const width = Math.abs(plot.posToVal(1, "x") - plot.posToVal(0, "x"));
    const height = Math.abs(plot.posToVal(1, "y") - plot.posToVal(0, "y"));
    this.#click({ number: plot.posToVal(x, "x"), fitness: plot.posToVal(y, "y"), width, height }, event.shiftKey);
  }
}

/** The cells as an image: columns from the left, rows from the top. */
function picture(density) {
  if (!density.evaluations) return null;
  const cells = Uint8Array.from(atob(density.cells), (sign) => sign.charCodeAt(0));
  const few = [];
  const image = new ImageData(density.columns, density.rows);
  const [red, green, blue] = color("--points").split(/\s+/).map(Number);
  for (let column = 0; column < density.columns; column += 1) {
    for (let row = 0; row < density.rows; row += 1) {
      const shade = cells[column * density.rows + row];
      if (shade === 0) continue;
      if (few.length < MOST_DOTS) few.push([column, row]);
      const at = 4 * ((density.rows - 1 - row) * density.columns + column);
      image.data.set([red, green, blue, 60 + 0.7 * shade], at);
    }
  }
  const canvas = document.createElement("canvas");
  canvas.width = density.columns;
  canvas.height = density.rows;
  canvas.getContext("2d").putImageData(image, 0, 0);
  return { canvas, few: few.length < MOST_DOTS ? few : null };
}
