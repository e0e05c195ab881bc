"use strict";
// How bodies look: shape, colour, name. Shapes are SVG paths around (0, 0) with radius 1, drawn on the map and
// in the legend alike.

const PATHS = {
  circle: "M1 0A1 1 0 1 1-1 0A1 1 0 1 1 1 0Z",
  cross: "M-.95-.55-.55-.95 0-.4 .55-.95 .95-.55 .4 0 .95 .55 .55 .95 0 .4-.55 .95-.95 .55-.4 0Z",
  triangle: "M0-1.1 1 .8-1 .8Z",
  star: "M0-1.2 .27-.37 1.14-.37 .44 .14 .71 .97 0 .46-.71 .97-.44 .14-1.14-.37-.27-.37Z",
  diamond: "M0-1.1 1.1 0 0 1.1-1.1 0Z",
  square: "M-1-1H1V1H-1Z",
};
const SHAPES = Object.fromEntries(Object.entries(PATHS).map(([name, path]) => [name, new Path2D(path)]));

const CELLS = new Set(["blockade", "exit"]); // fill a cell of a grid
const MOVING = new Set(["agent", "defender"]); // leave trails

function look(kind, state) {
  if (kind === "agent") {
    if (state === "caught" || state === "crashed") return { shape: "cross", color: "lost" };
    return { shape: "circle", color: state === "arrived" || state === "out" ? "good" : "free" };
  }
  const known = {
    defender: { shape: "triangle", color: "defender" },
    goal: { shape: "star", color: "good" },
    exit: { shape: "square", color: "exit" },
    blockade: { shape: "square", color: "blockade" },
    obstacle: { shape: "circle", color: "blockade" },
  };
  return known[kind] || { shape: "diamond", color: "other" };
}

function label(kind, state) {
  return kind === "agent" && state ? `${kind}, ${state}` : kind;
}

// A value of a body at a scene; what never moves has one for all.
function at(series, scene) {
  return Array.isArray(series) ? series[scene] : series;
}

function stateAt(body, scene) {
  let state = "";
  for (const [from, name] of body.states) {
    if (from > scene) break;
    state = name;
  }
  return state;
}

// The colours of the theme that holds now.
function theme() {
  const style = getComputedStyle(document.documentElement);
  return (name) => style.getPropertyValue(`--${name}`).trim();
}

// A number as people read it: four significant digits, a true minus sign.
function words(value) {
  if (value === null) return "none";
  const size = Math.abs(value);
  const text = size !== 0 && (size >= 1e6 || size < 1e-3) ? value.toExponential(2) : String(+value.toPrecision(4));
  return text.replace("-", "−");
}

// Makes a canvas as fine as the screen; what is drawn counts CSS pixels.
function fit(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}

// Distances between numbers on an axis: 1, 2 or 5 times a power of ten, `most` numbers at most.
function spacing(extent, most) {
  const power = 10 ** Math.floor(Math.log10(extent / most));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => extent / step <= most);
}
