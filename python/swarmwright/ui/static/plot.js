// A picture on a canvas with axes, that says what is below the pointer and is operated by keys, too.
import { color, figure, h } from "./dom.js";
import { css, viridis } from "./colors.js";
import { onTheme } from "./theme.js";

const FONT = "12px system-ui, sans-serif";
const TICK = 5;
const BAR = 14;

/** About `count` round numbers between two. */
export function ticks([low, high], count) {
  const span = high - low;
  if (!(span > 0) || !Number.isFinite(span)) return [low];
  const rough = span / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= rough);
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, index) => (first + index) * step);
}

/**
 * A frame with axes. Subclasses draw inside it (`paint`), find what is at a point (`pick`, null for nothing),
 * say what that is (`describe`), where it is (`locate`), whether it is there (`has`), and what the keys lead to (`move`).
 */
export class Plot {
  #canvas;
  #words;
  #observer;
  #endTheme;
  #picked = null;
  #height;

  /** act: called with what was clicked, and whether shift was pressed. */
  constructor(element, { label, height = 320, act = () => {} }) {
    this.#height = height;
    this.act = act;
    this.#canvas = h("canvas", {
      class: "plot", tabindex: 0, role: "application", "aria-label": `${label}: arrow keys move, Enter opens`,
      pointermove: (event) => this.#pick(this.pick(...this.#inside(event), event.pointerType)),
      pointerleave: () => this.#pick(null), blur: () => this.#pick(null),
      click: (event) => this.#open(this.pick(...this.#inside(event), event.pointerType), event.shiftKey),
      keydown: (event) => this.#key(event),
    });
    this.#words = h("p", { class: "hint words", role: "status" });
    element.append(this.#canvas, this.#words);
    this.#observer = new ResizeObserver(() => this.draw());
    this.#observer.observe(this.#canvas);
    this.#endTheme = onTheme(() => this.draw());
  }

  destroy() {
    this.#observer.disconnect();
    this.#endTheme();
  }

  /** Where the frame is: x, y, width and height in CSS pixels. */
  get frame() {
    const { left, right, bottom } = this.margins();
    return { x: left, y: 8, width: Math.max(20, this.#canvas.clientWidth - left - right), height: Math.max(20, this.height() - bottom - 8) };
  }

  height() {
    return this.#height;
  }

  margins() {
    return { left: 60, right: 12, bottom: 44 };
  }

  draw() {
    const width = this.#canvas.clientWidth;
    if (width === 0) return;
    const scale = devicePixelRatio || 1;
    this.#canvas.style.height = `${this.height()}px`;
    this.#canvas.width = Math.round(width * scale);
    this.#canvas.height = Math.round(this.height() * scale);
    const context = this.#canvas.getContext("2d");
    context.scale(scale, scale);
    context.font = FONT;
    context.save();
    this.paint(context, this.frame);
    context.restore();
    if (this.#picked !== null) this.mark(context, this.#picked);
  }

  /** Draws other data, of which what was picked may not be a part. */
  drawAnew() {
    if (this.#picked !== null && !this.has(this.#picked)) this.#picked = null;
    this.#words.textContent = this.#picked === null ? "" : this.describe(this.#picked);
    this.draw();
  }

  /** Marks what is picked. */
  mark(context, picked) {
    const { x, y, width, height } = this.locate(picked);
    context.lineWidth = 3;
    context.strokeStyle = color("--paper");
    context.strokeRect(x - 2, y - 2, width + 4, height + 4);
    context.lineWidth = 2;
    context.strokeStyle = color("--second");
    context.strokeRect(x - 2, y - 2, width + 4, height + 4);
  }

  axisBelow(context, range, label, place, { format = figure, whole = false } = {}) {
    const { x, y, width, height } = this.frame;
    context.fillStyle = color("--soft");
    context.strokeStyle = color("--line");
    context.textAlign = "center";
    context.textBaseline = "top";
    for (const value of ticks(range, Math.max(4, width / 90)).filter((each) => !whole || Number.isInteger(each))) {
      const at = place(value);
      context.beginPath();
      context.moveTo(at, y + height);
      context.lineTo(at, y + height + TICK);
      context.stroke();
      context.fillText(format(value), at, y + height + TICK + 2);
    }
    context.fillText(clip(context, label, width), x + width / 2, y + height + 24);
  }

  axisLeft(context, range, label, place, { format = figure, whole = false } = {}) {
    const { y, height } = this.frame;
    context.fillStyle = color("--soft");
    context.strokeStyle = color("--line");
    context.textAlign = "right";
    context.textBaseline = "middle";
    const { left } = this.margins();
    for (const value of ticks(range, Math.max(3, height / 50)).filter((each) => !whole || Number.isInteger(each))) {
      const at = place(value);
      context.beginPath();
      context.moveTo(left - TICK, at);
      context.lineTo(left, at);
      context.stroke();
      context.fillText(format(value), left - TICK - 3, at);
    }
    context.save();
    context.translate(10, y + height / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText(clip(context, label, height), 0, 0);
    context.restore();
  }

  border(context) {
    const { x, y, width, height } = this.frame;
    context.strokeStyle = color("--line");
    context.lineWidth = 1;
    context.strokeRect(x - 0.5, y - 0.5, width + 1, height + 1);
  }

  /** The colours and what they mean, to the right of the frame. */
  bar(context, range, label) {
    const { x, y, width, height } = this.frame;
    const left = x + width + 14;
    for (let row = 0; row < height; row += 1) {
      context.fillStyle = css(viridis(1 - row / height));
      context.fillRect(left, y + row, BAR, 1.5);
    }
    context.fillStyle = color("--soft");
    context.textAlign = "left";
    context.textBaseline = "middle";
    const place = (value) => y + height * (range[1] > range[0] ? 1 - (value - range[0]) / (range[1] - range[0]) : 0.5);
    for (const value of ticks(range, Math.max(2, height / 60))) context.fillText(figure(value), left + BAR + 4, place(value));
    context.save();
    context.translate(left + BAR + 52, y + height / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText(clip(context, label, height), 0, 0);
    context.restore();
  }

  #inside(event) {
    const bounds = this.#canvas.getBoundingClientRect();
    return [event.clientX - bounds.left, event.clientY - bounds.top];
  }

  #pick(picked) {
    this.#picked = picked;
    this.#words.textContent = picked === null ? "" : this.describe(picked);
    this.#canvas.style.cursor = picked === null ? "default" : "pointer";
    this.draw();
  }

  #open(picked, isBeside) {
    if (picked === null) return;
    this.#pick(picked);
    this.act(picked, isBeside);
  }

  #key(event) {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (event.key in steps) {
      this.#pick(this.move(this.#picked, ...steps[event.key]));
      event.preventDefault();
    } else if (event.key === "Enter" && this.#picked !== null) {
      this.#open(this.#picked, event.shiftKey);
      event.preventDefault();
    }
  }
}

/** A text, shortened to a width. */
export function clip(context, text, width) {
  if (context.measureText(text).width <= width) return text;
  let end = text.length;
  while (end > 1 && context.measureText(`${text.slice(0, end)}…`).width > width) end -= 1;
  return `${text.slice(0, end)}…`;
}
