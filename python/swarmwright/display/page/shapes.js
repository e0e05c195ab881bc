"use strict";
// What the page shows, and how things look: their shapes, colours and names.

const PAGE = JSON.parse(document.getElementById("episode").textContent);
const SHAPES = Object.fromEntries(Object.entries(PAGE.shapes).map(([name, path]) => [name, new Path2D(path)]));
const CELLS = new Set(PAGE.cells); // fill a cell of a grid
const MOVING = new Set(PAGE.moving); // leave trails
const isOff = (kind, state) => kind === PAGE.led && !state; // an LED that is not shown
const FONT = "12px system-ui, 'DejaVu Sans', sans-serif";
const STATES = PAGE.states; // names of colours of the states of controllers, in their order

function look(kind, state) {
  return PAGE.looks[label(kind, state)];
}

function label(kind, state) {
  return state ? `${kind}, ${state}` : kind;
}

// What the legend calls it: kinds of agents stand alone.
function title(kind, state) {
  const ofKind = kind === "agent" && PAGE.kinds.some((name) => state === name || state.startsWith(`${name}, `));
  return ofKind ? state : label(kind, state);
}

// Names of colours of episodes beside each other, on their captions and curves: those that are seen as thin lines, too.
const EPISODES = [0, 1, 3, 4, 5, 12, 9, 18, 19, 21, 8, 11, 15, 13, 17, 20, 22].map(stateColor);

// index: of the colour, which is the state but in a team, where each group has its own colours.
function stateColor(index) {
  return STATES[index % STATES.length];
}

// The colours of the theme that holds now.
function theme() {
  const style = getComputedStyle(document.documentElement);
  const known = new Map();
  return (name) => {
    if (!known.has(name)) known.set(name, style.getPropertyValue(`--${name}`).trim());
    return known.get(name);
  };
}

// The colour between colours that a share (0..1) of the way through them leads to; all "#rrggbb".
function between(colors, share) {
  const at = Math.min(Math.max(share, 0), 1) * (colors.length - 1);
  const [from, to] = [colors[Math.floor(at)], colors[Math.ceil(at)]].map((color) => parseInt(color.slice(1), 16));
  const part = at - Math.floor(at);
  const channel = (shift) => Math.round(((from >> shift) & 255) * (1 - part) + ((to >> shift) & 255) * part);
  return `rgb(${channel(16)} ${channel(8)} ${channel(0)})`;
}

function floorColor(color, grey) {
  return between([color("floor-0"), color("floor-1"), color("floor-2")], grey);
}

function valueColor(color, share) {
  return between([0, 1, 2, 3, 4].map((index) => color(`value-${index}`)), share);
}

// A number as people read it: four significant digits or as many as given, a true minus sign.
function words(value, digits = 4) {
  if (value === null || Number.isNaN(value)) return "none";
  const size = Math.abs(value);
  const far = size !== 0 && (size >= 1e6 || size < 1e-3);
  const text = far ? value.toExponential(digits - 2) : String(+value.toPrecision(digits));
  return text.replace("-", "−");
}

// The same with digits enough to tell it from numbers that are `step` away.
function wordsApart(value, step) {
  const needed = value === 0 || !(step > 0) ? 0 : Math.ceil(Math.log10(Math.abs(value) / step)) + 1;
  return words(value, Math.min(Math.max(needed, 4), 12));
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

// An element of HTML or SVG with attributes.
function element(name, attributes = {}, text = "") {
  const svg = ["svg", "path", "circle", "text", "g", "title", "rect", "line"].includes(name);
  const made = svg ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text) made.textContent = text;
  return made;
}
