// The drawing board: a mission of the arena as a picture that is edited, and as YAML, both at once.
import { ask, change, color, h, problem } from "./dom.js";
import { store } from "./store.js";

const GRID_M = 0.05;
const HANDLE_PX = 7;
const FLOORS = { black: "#222222", grey: "#c9c8c1", white: "#ffffff", random: "#8d86a8" };
const MARGIN = 1.15;

/** Elements of a mission: where they are in it, and their shapes. */
function elements(mission) {
  const list = [];
  (mission.floor?.patches ?? []).forEach((patch, index) => list.push({ path: ["floor", "patches", index], kind: "patch", shape: shapeOf(patch), value: patch }));
  if (mission.start?.disc) list.push({ path: ["start"], kind: "start", shape: { circle: mission.start.disc, of: mission.start.disc }, value: mission.start });
  if (mission.start?.rectangle) list.push({ path: ["start"], kind: "start", shape: { rectangle: mission.start.rectangle }, value: mission.start });
  (mission.obstacles ?? []).forEach((box, index) => list.push({ path: ["obstacles", index], kind: "obstacle", shape: { box }, value: box }));
  (mission.objects ?? []).forEach((object, index) => list.push({
    path: ["objects", index], kind: "object", value: object,
    shape: !object.center ? {} : object.size ? { box: object } : { circle: object, of: object },
  }));
  (mission.lights ?? []).forEach((light, index) => list.push({ path: ["lights", index], kind: "light", shape: { point: light }, value: light }));
  return list;
}

function shapeOf(patch) {
  if (patch.circle) return { circle: patch.circle, of: patch.circle };
  if (patch.rectangle) return { rectangle: patch.rectangle };
  return { polygon: patch.polygon ?? [] };
}

function corners(walls) {
  if (walls?.rectangle) {
    const [x, y] = walls.rectangle.map((side) => side / 2);
    return [[-x, -y], [x, -y], [x, y], [-x, y]];
  }
  if (walls?.corners) return walls.corners;
  const sides = walls?.sides ?? 4;
  const radius = (walls?.apothem ?? 1) / Math.cos(Math.PI / sides);
  return Array.from({ length: sides }, (_, index) => {
    const angle = (2 * Math.PI * (index + 0.5)) / sides;
    return [radius * Math.cos(angle), radius * Math.sin(angle)];
  });
}

/** Points that are dragged to change a shape: where they are, and what moving them does. */
function handles(element) {
  const { shape, kind } = element;
  if (kind === "walls") return wallHandles(element.value);
  if (shape.circle) {
    const [x, y] = shape.circle.center ?? [0, 0];
    return [{ at: [x + shape.circle.radius, y], move: ([to]) => { shape.of.radius = Math.max(GRID_M, round(to - x)); } }];
  }
  if (shape.rectangle) {
    const { x, y } = shape.rectangle;
    return [0, 1].flatMap((i) => [0, 1].map((j) => ({ at: [x[i], y[j]], move: ([px, py]) => { x[i] = px; y[j] = py; x.sort(order); y.sort(order); } })));
  }
  if (shape.polygon) return shape.polygon.map((point, index) => ({ at: point, vertex: index, move: (to) => { shape.polygon[index] = to; } }));
  if (shape.box) {
    const at = turned([shape.box.size[0] / 2, shape.box.size[1] / 2], shape.box);
    return [{ at, move: (to) => { shape.box.size = turnedBack(to, shape.box).map((side) => Math.max(GRID_M, round(2 * Math.abs(side)))); } }];
  }
  return [];
}

function wallHandles(walls) {
  if (walls.rectangle) {
    const [x, y] = walls.rectangle;
    return [{ at: [x / 2, y / 2], move: (to) => { walls.rectangle = to.map((side) => Math.max(0.2, round(2 * Math.abs(side)))); } }];
  }
  if (walls.corners) return walls.corners.map((point, index) => ({ at: point, vertex: index, move: (to) => { walls.corners[index] = to; } }));
  return [{ at: [walls.apothem, 0], move: ([x]) => { walls.apothem = Math.max(0.1, round(Math.abs(x))); } }];
}

const order = (one, other) => one - other;
const round = (value) => Math.round(value * 1000) / 1000;

function turned([x, y], box) {
  const angle = ((box.angle ?? 0) * Math.PI) / 180;
  const [cx, cy] = box.center;
  return [cx + x * Math.cos(angle) - y * Math.sin(angle), cy + x * Math.sin(angle) + y * Math.cos(angle)];
}

function turnedBack([x, y], box) {
  const angle = (-(box.angle ?? 0) * Math.PI) / 180;
  const [dx, dy] = [x - box.center[0], y - box.center[1]];
  return [dx * Math.cos(angle) - dy * Math.sin(angle), dx * Math.sin(angle) + dy * Math.cos(angle)];
}

function outline(shape) {
  if (shape.rectangle) {
    const { x, y } = shape.rectangle;
    return [[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]];
  }
  if (shape.polygon) return shape.polygon;
  if (shape.box) {
    const [x, y] = shape.box.size.map((side) => side / 2);
    return [[-x, -y], [x, -y], [x, y], [-x, y]].map((point) => turned(point, shape.box));
  }
  return null;
}

function isInside([x, y], points) {
  let inside = false;
  points.forEach(([ax, ay], index) => {
    const [bx, by] = points[(index + 1) % points.length];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
  });
  return inside;
}

function contains(element, point, reach) {
  const { shape } = element;
  if (shape.point) return Math.hypot(point[0] - shape.point.at[0], point[1] - shape.point.at[1]) < reach;
  if (shape.circle) {
    const [x, y] = shape.circle.center ?? [0, 0];
    return Math.hypot(point[0] - x, point[1] - y) <= shape.circle.radius;
  }
  const points = outline(shape);
  return points !== null && isInside(point, points);
}

function shift(element, [dx, dy]) {
  const { shape } = element;
  const moved = (values) => [round(values[0] + dx), round(values[1] + dy), ...values.slice(2)];
  if (shape.point) shape.point.at = moved(shape.point.at);
  else if (shape.circle) shape.of.center = moved(shape.circle.center ?? [0, 0]);
  else if (shape.box) shape.box.center = moved(shape.box.center);
  else if (shape.polygon) shape.polygon.forEach((point, index) => { shape.polygon[index] = moved(point); });
  else if (shape.rectangle) {
    shape.rectangle.x = shape.rectangle.x.map((value) => round(value + dx));
    shape.rectangle.y = shape.rectangle.y.map((value) => round(value + dy));
  }
}

const TOOLS = {
  "spot": (mission, [x, y]) => add(mission, ["floor", "patches"], { name: free(mission, "spot"), circle: { center: [x, y], radius: 0.3 }, color: "black" }),
  "rectangle": (mission, [x, y]) => add(mission, ["floor", "patches"], { name: free(mission, "zone"), rectangle: { x: [round(x - 0.3), round(x + 0.3)], y: [round(y - 0.2), round(y + 0.2)] }, color: "white" }),
  "polygon": (mission, [x, y]) => add(mission, ["floor", "patches"], { name: free(mission, "area"), polygon: [[round(x - 0.3), round(y - 0.2)], [round(x + 0.3), round(y - 0.2)], [x, round(y + 0.3)]], color: "black" }),
  "obstacle": (mission, at) => add(mission, ["obstacles"], { center: at, size: [0.05, 0.6], angle: 0 }),
  "disc to push": (mission, at) => add(mission, ["objects"], { name: free(mission, "disc"), radius: 0.1, mass: 0.3, center: at }),
  "box to push": (mission, at) => add(mission, ["objects"], { name: free(mission, "box"), size: [0.2, 0.2], mass: 0.3, center: at }),
  "light": (mission, [x, y]) => add(mission, ["lights"], { at: [x, y, 0.4], intensity: 3 }),
};

function add(mission, path, value) {
  let list = mission;
  path.forEach((key, index) => {
    list[key] ??= index === path.length - 1 ? [] : {};
    list = list[key];
  });
  list.push(value);
  return [...path, list.length - 1];
}

function free(mission, stem) {
  const names = new Set([...(mission.floor?.patches ?? []), ...(mission.objects ?? [])].map((each) => each.name));
  let number = 1;
  while (names.has(`${stem}_${number}`)) number += 1;
  return `${stem}_${number}`;
}

export function show(view, query) {
  let mission = null;
  let name = "";
  let selection = null;
  let tool = null;
  let drag = null;
  let saved = "";
  let isGone = false;
  let checked = 0;
  const past = [];
  const future = [];
  const canvas = h("canvas", { class: "board", tabindex: 0, "aria-label": "The mission from above", pointerdown: press, pointermove: move, pointerup: release, dblclick: doubled, keydown: key });
  const choice = h("select", { "aria-label": "Mission", change: () => open(choice.value) });
  const tools = Object.keys(TOOLS).map((each) => h("button", { type: "button", click: () => { tool = tool === each ? null : each; buttons(); } }, each));
  const snap = h("input", { type: "checkbox", checked: true });
  const undo = h("button", { type: "button", click: () => step(past, future), title: "Ctrl-Z" }, "Undo");
  const redo = h("button", { type: "button", click: () => step(future, past), title: "Ctrl-Y" }, "Redo");
  const properties = h("div", { class: "properties" });
  const wrong = h("ul", { class: "problems", role: "status" });
  const text = h("textarea", { class: "editor", rows: 18, spellcheck: "false", "aria-label": "Mission (YAML)", change: () => typed() });
  const seed = h("input", { type: "number", min: 0, step: 1, value: 1, "aria-label": "Seed" });
  const run = h("select", { "aria-label": "Controller" }, h("option", { value: "" }, "a random controller"));
  const tryButton = h("button", { type: "button", class: "primary", click: tryOut }, "Try");
  const file = h("input", { "aria-label": "Name of the file", placeholder: "name", pattern: "[A-Za-z0-9_][A-Za-z0-9_.\\-]{0,99}" });
  const saveButton = h("button", { type: "button", click: save }, "Save");
  const message = h("span", { role: "status" });
  const frame = h("div", { class: "panes" });
  view.append(
    h("h1", {}, "Draw a mission"),
    h("div", { class: "tools" }, h("label", {}, "mission ", choice), undo, redo, h("label", {}, snap, ` snap to ${GRID_M} m`)),
    h("div", { class: "tools", role: "toolbar" }, "Add: ", tools),
    h("div", { class: "columns" }, h("div", {}, canvas, h("p", { class: "hint" },
      "Drag to move, drag the squares to change the shape. Double-click a side of a polygon to add a corner, Shift-click a corner to remove it. Arrow keys move, Delete removes. Alt drags without snapping.")),
    h("div", {}, properties, h("h2", {}, "Check"), wrong, h("h2", {}, "As YAML"), text)),
    h("div", { class: "tools" }, tryButton, " with ", run, h("label", {}, "seed ", seed),
      store.window.read_only ? null : h("label", {}, "save as ", file), store.window.read_only ? null : saveButton, message),
    frame,
  );
  const observer = new ResizeObserver(() => draw());
  observer.observe(canvas);

  // The world on the canvas.
  function scale() {
    const points = corners(mission.walls);
    const lights = (mission.lights ?? []).map((light) => light.at);
    const reach = Math.max(0.5, ...[...points, ...lights].flatMap(([x, y]) => [Math.abs(x), Math.abs(y)])) * MARGIN;
    const side = canvas.clientWidth;
    return { side, unit: side / (2 * reach), reach };
  }
  const toScreen = ([x, y], { side, unit }) => [side / 2 + x * unit, side / 2 - y * unit];
  function toWorld(event, free = false) {
    const { side, unit } = scale();
    const bounds = canvas.getBoundingClientRect();
    const point = [(event.clientX - bounds.left - side / 2) / unit, (side / 2 - (event.clientY - bounds.top)) / unit];
    return free ? point : point.map((value) => (snap.checked && !event.altKey ? round(Math.round(value / GRID_M) * GRID_M) : round(value)));
  }

  function draw() {
    if (mission === null || canvas.clientWidth === 0) return;
    const view = scale();
    const ratio = devicePixelRatio;
    canvas.width = canvas.height = view.side * ratio;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const trace = (points) => {
      context.beginPath();
      points.forEach((point) => context.lineTo(...toScreen(point, view)));
      context.closePath();
    };
    grid(context, view);
    trace(corners(mission.walls));
    context.fillStyle = floorColor(mission.floor?.color ?? "grey");
    context.fill();
    context.save();
    context.clip();
    for (const element of elements(mission)) if (element.kind === "patch") paint(context, view, element, floorColor(element.value.color), null);
    context.restore();
    trace(corners(mission.walls));
    context.strokeStyle = color("--ink");
    context.lineWidth = 3;
    context.stroke();
    for (const element of elements(mission)) {
      if (element.kind === "start") paint(context, view, element, "rgb(0 114 178 / 0.06)", color("--accent"), [6, 4]);
      if (element.kind === "obstacle") paint(context, view, element, "#555555", "#222222");
      if (element.kind === "object") paint(context, view, element, "#b3764a", "#5d3a1f");
      if (element.kind === "light") light(context, view, element);
    }
    const chosen = selected();
    if (chosen) mark(context, view, chosen);
  }

  function grid(context, view) {
    const step = view.reach > 5 ? 1 : view.reach > 2 ? 0.5 : 0.25;
    context.strokeStyle = color("--line");
    context.lineWidth = 1;
    context.fillStyle = color("--soft");
    context.font = "11px system-ui, sans-serif";
    for (let at = -Math.ceil(view.reach / step) * step; at <= view.reach; at += step) {
      const [x, y] = toScreen([at, at], view);
      context.beginPath();
      context.moveTo(x, 0);
      context.lineTo(x, view.side);
      context.moveTo(0, y);
      context.lineTo(view.side, y);
      context.stroke();
      if (Math.abs(at % (2 * step)) < 1e-9) {
        context.fillText(String(round(at)), x + 2, view.side - 3);
        context.fillText(String(round(at)), 2, y - 2);
      }
    }
  }

  function paint(context, view, { shape }, fill, stroke, dash = []) {
    context.beginPath();
    if (shape.circle) context.arc(...toScreen(shape.circle.center ?? [0, 0], view), Math.max(0, shape.circle.radius) * view.unit, 0, 7);
    else {
      const points = outline(shape);
      if (points === null) return;
      points.forEach((point) => context.lineTo(...toScreen(point, view)));
      context.closePath();
    }
    context.fillStyle = fill;
    context.fill();
    if (stroke === null) return;
    context.setLineDash(dash);
    context.strokeStyle = stroke;
    context.lineWidth = 1.5;
    context.stroke();
    context.setLineDash([]);
  }

  function light(context, view, { value }) {
    const [x, y] = toScreen(value.at, view);
    context.fillStyle = "#e69f00";
    context.strokeStyle = "#7a5500";
    context.beginPath();
    context.arc(x, y, 8, 0, 7);
    context.fill();
    context.stroke();
  }

  function mark(context, view, element) {
    context.strokeStyle = color("--accent");
    context.lineWidth = 2;
    const points = element.kind === "walls" ? corners(element.value) : outline(element.shape);
    context.beginPath();
    if (points) {
      points.forEach((point) => context.lineTo(...toScreen(point, view)));
      context.closePath();
    } else {
      const centre = element.shape.point?.at ?? element.shape.circle?.center ?? [0, 0];
      context.arc(...toScreen(centre, view), element.shape.point ? 12 : element.shape.circle.radius * view.unit, 0, 7);
    }
    context.stroke();
    context.fillStyle = color("--accent");
    for (const handle of handles(element)) {
      const [x, y] = toScreen(handle.at, view);
      context.fillRect(x - HANDLE_PX / 2, y - HANDLE_PX / 2, HANDLE_PX, HANDLE_PX);
    }
  }

  function floorColor(value) {
    if (typeof value !== "number") return FLOORS[value] ?? FLOORS.grey;
    const shade = Math.round(255 * value);
    return `rgb(${shade} ${shade} ${shade})`;
  }

  // What is selected, and how it changes.
  function selected() {
    if (selection === null || mission === null) return null;
    if (selection[0] === "walls") return { path: ["walls"], kind: "walls", shape: {}, value: mission.walls };
    return elements(mission).find((element) => String(element.path) === String(selection)) ?? null;
  }

  function press(event) {
    canvas.focus();
    canvas.setPointerCapture(event.pointerId);
    const point = toWorld(event);
    if (tool !== null) {
      remember();
      selection = TOOLS[tool](mission, point);
      tool = null;
      buttons();
      changed();
      return;
    }
    const exact = toWorld(event, true);
    const reach = 9 / scale().unit;
    const chosen = selected();
    const handle = chosen && handles(chosen).find(({ at }) => Math.hypot(at[0] - exact[0], at[1] - exact[1]) < reach);
    if (handle && event.shiftKey && handle.vertex !== undefined) {
      remember();
      const points = chosen.shape.polygon ?? chosen.value.corners;
      if (points.length > 3) points.splice(handle.vertex, 1);
      changed();
      return;
    }
    if (handle) {
      remember();
      drag = { handle: handle.vertex ?? handles(chosen).indexOf(handle) };
      return;
    }
    const hit = elements(mission).reverse().find((element) => contains(element, exact, reach));
    selection = hit ? hit.path : nearWall(exact, reach) ? ["walls"] : null;
    if (hit) {
      remember();
      drag = { from: point };
    }
    show();
  }

  function nearWall([x, y], reach) {
    const points = corners(mission.walls);
    return points.some(([ax, ay], index) => {
      const [bx, by] = points[(index + 1) % points.length];
      return distance([x, y], [ax, ay], [bx, by]) < reach;
    });
  }

  function distance([x, y], [ax, ay], [bx, by]) {
    const length = (bx - ax) ** 2 + (by - ay) ** 2 || 1;
    const along = Math.max(0, Math.min(1, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length));
    return Math.hypot(x - ax - along * (bx - ax), y - ay - along * (by - ay));
  }

  function move(event) {
    if (drag === null) return;
    const chosen = selected();
    if (chosen === null) return;
    const point = toWorld(event);
    if (drag.handle !== undefined) handles(chosen)[drag.handle]?.move(point);
    else {
      shift(chosen, [point[0] - drag.from[0], point[1] - drag.from[1]]);
      drag.from = point;
    }
    drag.moved = true;
    draw();
    showProperties();
  }

  function release() {
    if (drag === null) return;
    if (drag.moved) changed();
    else past.pop();
    drag = null;
  }

  function doubled(event) {
    const chosen = selected();
    const points = chosen?.shape.polygon ?? chosen?.value.corners;
    if (!points) return;
    const exact = toWorld(event, true);
    let best = 0;
    points.forEach((point, index) => {
      if (distance(exact, point, points[(index + 1) % points.length]) < distance(exact, points[best], points[(best + 1) % points.length])) best = index;
    });
    remember();
    points.splice(best + 1, 0, toWorld(event));
    changed();
  }

  function key(event) {
    const chosen = selected();
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if ((event.ctrlKey || event.metaKey) && event.key === "z") step(past, future);
    else if ((event.ctrlKey || event.metaKey) && event.key === "y") step(future, past);
    else if (chosen && arrows[event.key]) {
      remember();
      shift(chosen, arrows[event.key].map((value) => value * (snap.checked ? GRID_M : 0.005)));
      changed();
    } else if (chosen && ["Delete", "Backspace"].includes(event.key)) remove();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  function remove() {
    if (selection === null || ["walls", "start"].includes(selection[0])) return;
    remember();
    const list = selection.slice(0, -1).reduce((value, each) => value[each], mission);
    list.splice(selection.at(-1), 1);
    if (list.length === 0) {
      const parent = selection.slice(0, -2).reduce((value, each) => value[each], mission);
      delete parent[selection.at(-2)];
    }
    selection = null;
    changed();
  }

  function remember() {
    past.push(JSON.stringify(mission));
    if (past.length > 200) past.shift();
    future.length = 0;
  }

  function step(from, to) {
    if (from.length === 0) return;
    to.push(JSON.stringify(mission));
    mission = JSON.parse(from.pop());
    if (selected() === null) selection = null;
    changed();
  }

  // Beside the board.
  function buttons() {
    tools.forEach((button, index) => button.setAttribute("aria-pressed", String(Object.keys(TOOLS)[index] === tool)));
    canvas.classList.toggle("adds", tool !== null);
  }

  function show() {
    draw();
    showProperties();
    undo.disabled = past.length === 0;
    redo.disabled = future.length === 0;
  }

  function showProperties() {
    const chosen = selected();
    const target = chosen ?? { kind: "mission", value: mission, path: [] };
    const rows = leaves(target.value).filter(([path]) => chosen || ["title", "robots", "duration", "fitness"].includes(path[0]) && path.length === 1);
    properties.replaceChildren(
      h("h2", {}, chosen ? `${chosen.kind} ${chosen.value.name ?? ""}` : "mission", chosen && !["walls", "start"].includes(chosen.kind) ? h("button", { type: "button", click: remove }, "Remove") : null),
      h("div", { class: "fields" }, rows.map(([path, value]) => field(target.value, path, value)),
        chosen?.kind === "walls" ? wallChoice() : null),
    );
  }

  function wallChoice() {
    return h("label", {}, "shape ", h("select", { change: (event) => {
      remember();
      const points = corners(mission.walls).map((point) => point.map(round));
      mission.walls = { rectangle: { rectangle: [3, 2] }, regular: { sides: 12, apothem: 1.226 }, corners: { corners: points } }[event.target.value];
      changed();
    } }, ["rectangle", "regular", "corners"].map((each) => h("option", { value: each, selected: each === (mission.walls.rectangle ? "rectangle" : mission.walls.corners ? "corners" : "regular") }, each))));
  }

  function leaves(value, path = []) {
    if (Array.isArray(value) && value.some((each) => Array.isArray(each))) return [];
    if (value !== null && typeof value === "object") return Object.entries(value).flatMap(([name, each]) => leaves(each, [...path, Array.isArray(value) ? Number(name) : name]));
    return [[path, value]];
  }

  function field(root, path, value) {
    const label = path.map((each) => (typeof each === "number" ? `[${each}]` : each)).join(".").replaceAll(".[", "[");
    const isColor = path.at(-1) === "color" && typeof value === "string" && value in FLOORS;
    const set = (now) => {
      remember();
      path.slice(0, -1).reduce((each, name) => each[name], root)[path.at(-1)] = now;
      changed();
    };
    const input = isColor
      ? h("select", { change: (event) => set(event.target.value) }, Object.keys(FLOORS).map((each) => h("option", { value: each, selected: each === value }, each)))
      : typeof value === "number"
        ? h("input", { type: "number", step: "any", value, change: (event) => { if (event.target.value !== "") set(Number(event.target.value)); } })
        : h("input", { value: String(value), change: (event) => set(event.target.value) });
    return h("label", {}, `${label} `, input);
  }

  async function changed() {
    show();
    const number = ++checked;
    try {
      const answer = await change("mission_text", { mission });
      if (isGone || number !== checked) return;
      text.value = answer.text;
      tell(answer.problems);
    } catch (error) {
      if (!isGone) wrong.replaceChildren(h("li", {}, problem(error)));
    }
  }

  async function typed() {
    try {
      const answer = await change("mission_parse", { text: text.value });
      if (isGone) return;
      if (answer.mission) {
        remember();
        mission = answer.mission;
        selection = null;
        show();
      }
      tell(answer.problems);
    } catch (error) {
      wrong.replaceChildren(h("li", {}, problem(error)));
    }
  }

  function tell(problems) {
    tryButton.disabled = saveButton.disabled = problems.length > 0;
    wrong.replaceChildren(...(problems.length ? problems.map((each) => h("li", { class: "problem" }, each)) : [h("li", { class: "fine" }, "Nothing is wrong.")]));
  }

  async function tryOut() {
    tryButton.disabled = true;
    message.textContent = "simulating…";
    try {
      const { id } = await change("mission_try", { mission, seed: Number(seed.value), run: run.value });
      frame.replaceChildren(h("figure", {}, h("iframe", { src: `try?id=${id}`, sandbox: "allow-scripts", title: "An episode of the mission" })));
      frame.scrollIntoView({ block: "nearest", behavior: "smooth" });
      message.textContent = "";
    } catch (error) {
      message.replaceChildren(problem(error));
    }
    tryButton.disabled = false;
  }

  async function save() {
    try {
      const answer = await change("mission_save", { name: file.value, mission, replace: saved === file.value });
      saved = file.value;
      message.replaceChildren(`saved as ${answer.file}. `, h("a", { href: `#/new?mission=${encodeURIComponent(answer.file)}` }, "Evolve on it"));
    } catch (error) {
      message.replaceChildren(problem(error));
    }
  }

  async function open(which) {
    name = which;
    try {
      const answer = await ask("mission", { name: which });
      if (isGone) return;
      mission = answer.mission;
      past.length = future.length = 0;
      selection = null;
      saved = which.endsWith(".yaml") ? which.replace(/\.yaml$/, "") : "";
      file.value = saved || `my_${which}`;
      choice.value = which;
      changed();
    } catch (error) {
      wrong.replaceChildren(h("li", {}, problem(error)));
    }
  }

  (async () => {
    const names = await ask("missions");
    if (isGone) return;
    const group = (label, list) => (list.length ? h("optgroup", { label }, list.map((each) => h("option", { value: each }, each))) : null);
    choice.append(...[group("in this folder", names.files), group("built in", names.built_in)].filter(Boolean));
    for (const row of [...store.rows.values()].filter((each) => each.simulation === "arena" && each.best !== null).slice(0, 200)) {
      run.append(h("option", { value: row.id }, `the best of ${row.id}`));
    }
    await open(query.get("mission") ?? names.files[0] ?? "aggregation");
  })().catch((error) => wrong.replaceChildren(h("li", {}, problem(error))));
  return { trail: ["draw a mission"], leave: () => { isGone = true; observer.disconnect(); } };
}
