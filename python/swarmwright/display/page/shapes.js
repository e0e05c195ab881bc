"use strict";
// The data of the page; shapes, colours and names of bodies.

const PAGE = JSON.parse(document.getElementById("episode").textContent);
const SHAPES = Object.fromEntries(Object.entries(PAGE.shapes).map(([name, path]) => [name, new Path2D(path)]));
const CELLS = new Set(PAGE.cells); // fill a cell of a grid
const MOVING = new Set(PAGE.moving); // leave trails
const isOff = (kind, state) => kind === PAGE.led && !state; // an LED that is off
const FONT = "12px system-ui, 'DejaVu Sans', sans-serif";
const STATES = PAGE.states; // names of the colours of controller states, in order

function look(kind, state) {
  return PAGE.looks[label(kind, state)];
}

function label(kind, state) {
  return state ? `${kind}, ${state}` : kind;
}

// Returns the name in the legend: kinds of agents without "agent".
function title(kind, state) {
  const ofKind = kind === "agent" && PAGE.kinds.some((name) => state === name || state.startsWith(`${name}, `));
  return ofKind ? state : label(kind, state);
}

// Names of the colours of several episodes, for captions and curves: colours that are visible as thin lines.
const EPISODES = [0, 1, 3, 4, 5, 12, 9, 18, 19, 21, 8, 11, 15, 13, 17, 20, 22].map(stateColor);

// index: the state, or in a team the index of the colour of the group's state.
function stateColor(index) {
  return STATES[index % STATES.length];
}

// Returns a function that looks up colours of the current theme.
function theme() {
  const style = getComputedStyle(document.documentElement);
  const cache = new Map();
  return (name) => {
    if (!cache.has(name)) cache.set(name, style.getPropertyValue(`--${name}`).trim());
    return cache.get(name);
  };
}

// Interpolates between a list of colours, "#rrggbb", by a share in 0..1.
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

// Formats a number with significant digits and a true minus sign.
function words(value, digits = 4) {
  if (value === null || Number.isNaN(value)) return "none";
  const size = Math.abs(value);
  const far = size !== 0 && (size >= 1e6 || size < 1e-3);
  const text = far ? value.toExponential(digits - 2) : String(+value.toPrecision(digits));
  return text.replace("-", "−");
}

// Formats a number with enough digits to distinguish numbers in a distance of `step`.
function wordsApart(value, step) {
  const needed = value === 0 || !(step > 0) ? 0 : Math.ceil(Math.log10(Math.abs(value) / step)) + 1;
  return words(value, Math.min(Math.max(needed, 4), 12));
}

// Gives a canvas the resolution of the screen; drawing uses CSS pixels.
function fit(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}

// Returns the distance between at most `most` numbers on an axis: 1, 2 or 5 times a power of ten.
function spacing(extent, most) {
  const power = 10 ** Math.floor(Math.log10(extent / most));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => extent / step <= most);
}

// Creates an element of HTML or SVG with attributes.
function element(name, attributes = {}, text = "") {
  const svg = ["svg", "path", "circle", "text", "g", "title", "rect", "line"].includes(name);
  const node = svg ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text) node.textContent = text;
  return node;
}
