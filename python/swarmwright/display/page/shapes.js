"use strict";
// How bodies look: what the episode says of their shapes, colours and names.

const EPISODE = JSON.parse(document.getElementById("episode").textContent);
const SHAPES = Object.fromEntries(Object.entries(EPISODE.shapes).map(([name, path]) => [name, new Path2D(path)]));
const CELLS = new Set(EPISODE.cells); // fill a cell of a grid
const MOVING = new Set(EPISODE.moving); // leave trails

function look(kind, state) {
  return EPISODE.looks[label(kind, state)];
}

function label(kind, state) {
  return state ? `${kind}, ${state}` : kind;
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
