// The drawing board: a mission of the arena as a picture that is edited, and as YAML, both at once.
import { ask, askWhether, change, color, h, problem } from "./dom.js";
import { FLOORS, LEDS, fields, leafField, leaves, nameOf, put, renderer, select } from "./draw_fields.js";
import { expressionOf, goalsPanel } from "./draw_goals.js";
import { describe, kindColor, kindsOf, paintRobot, robotsPanel } from "./draw_robots.js";
import { GRID_M, TOOLS, addVertex, contains, copyOf, corners, elements, handles, isNear, outline, paste, remove, rename, round, shift, vertices, wallsOf } from "./draw_shapes.js";
import { store } from "./store.js";
import { onTheme } from "./theme.js";

const HANDLE_PX = 8;
const REACH_PX = { mouse: 9, pen: 12, touch: 22 };
const MARGIN = 1.15;
// Least height of the board by its width.
const FLATTEST = 0.45;
const TRY_AFTER_MS = 600;
const SHOWN_KEYS = ["title", "duration"];
const COLOR_SPEC = { type: "choice", options: Object.keys(LEDS), value: "none", is_optional: true };
const height = { type: "number", unit: "m", value: 0.08, is_optional: true };
const OPTIONAL = {
  walls: { height },
  obstacle: { angle: { type: "number", unit: "°", value: 0, is_optional: true }, height, color: COLOR_SPEC },
  object: { friction: { type: "number", value: 0.3, is_optional: true }, angle: { type: "number", unit: "°", value: 0, is_optional: true }, height, color: COLOR_SPEC },
  "object area": { count: { type: "number", value: 1, is_optional: true }, friction: { type: "number", value: 0.3, is_optional: true }, height, color: COLOR_SPEC },
  light: { color: COLOR_SPEC },
};
let clipboard = null;

export function show(view, query) {
  const board = { mission: null, parts: null, start: null, expression: null, values: null, step: 0, edit, weigh: (expression) => track(divide(expression)) };
  let selection = null;
  let tool = null;
  let sketch = null;
  let drag = null;
  let saved = "";
  let opened = ""; // its name
  let shown = ""; // the text of what the board shows; another one is typed, and not read yet
  let kept = null; // what was opened or saved
  let comments = []; // of the text that was opened or typed
  let isWrong = false;
  let isGone = false;
  let checked = 0;
  let tried = 0;
  let first = null; // the step that the next player begins with
  let isPlaying = false;
  let timer = null;
  const past = [];
  const future = [];
  const requests = new Set(); // under way, whose answers change the mission or its text
  const canvas = h("canvas", { class: "board", tabindex: 0, role: "application", "aria-label": "The mission from above", "aria-describedby": "board-keys", pointerdown: press, pointermove: move, pointerup: release, pointercancel: release, dblclick: doubled, keydown: key });
  const choice = h("select", { "aria-label": "Mission", change: () => open(choice.value) });
  const tools = Object.keys(TOOLS).map((each) => h("button", { type: "button", click: () => take(tool === each ? null : each) }, each));
  const snap = h("input", { type: "checkbox", checked: true });
  const ranges = h("input", { type: "checkbox", checked: true, change: () => draw() });
  const undo = h("button", { type: "button", click: () => step(past, future), title: "Ctrl-Z" }, "Undo");
  const redo = h("button", { type: "button", click: () => step(future, past), title: "Ctrl-Y" }, "Redo");
  const properties = h("div", { class: "properties" });
  const wrong = h("ul", { class: "problems", role: "status" });
  const text = h("textarea", { class: "editor", rows: 18, spellcheck: "false", "aria-label": "Mission (YAML)", change: () => typed() });
  const seed = h("input", { type: "number", min: 0, step: 1, value: 1, "aria-label": "Seed", change: () => changed() });
  const run = h("select", { "aria-label": "Controller", change: () => later() }, h("option", { value: "" }, "a random controller"));
  const tryButton = h("button", { type: "button", class: "primary", click: () => tryOut() }, "Try");
  const live = h("input", { type: "checkbox", checked: true });
  const file = h("input", { "aria-label": "Name of the file", placeholder: "name", pattern: "[A-Za-z0-9_][A-Za-z0-9_.\\-]{0,99}" });
  const saveButton = h("button", { type: "button", click: save }, "Save");
  const message = h("span", { role: "status" });
  const notice = h("p", { class: "hint bad", role: "status" });
  const lost = h("p", { class: "hint", role: "status" });
  const frame = h("div", { class: "panes" });
  const showProperties = renderer(properties, buildProperties);
  const robots = robotsPanel(board);
  const goals = goalsPanel(board);
  const section = (title, isOpen, ...content) => h("details", { class: "section", open: isOpen }, h("summary", {}, h("h2", {}, title)), ...content);
  view.append(
    h("h1", {}, "Draw a mission"),
    h("div", { class: "tools" }, h("label", {}, "mission ", choice), undo, redo, h("label", {}, snap, ` snap to ${GRID_M} m`), h("label", {}, ranges, " ranges of sensors")),
    h("div", { class: "tools", role: "group", "aria-label": "Add" }, "Add: ", tools),
    h("div", { class: "columns" },
      h("div", {}, notice, canvas,
        h("p", { class: "hint", id: "board-keys" }, "Drag to move, drag the squares to change the shape. A polygon is drawn corner by corner; a click on its first corner or Enter closes it. Double-click a side to add a corner, Shift-click a corner to remove it. Arrow keys move, Delete removes, Ctrl-C, Ctrl-V and Ctrl-D copy, paste and duplicate. Alt drags without snapping."),
        h("div", { class: "tools" }, tryButton, " with ", run, h("label", {}, "seed ", seed), h("label", {}, live, " again after each change")),
        store.window.read_only ? null : h("div", { class: "tools" }, h("label", {}, "save as ", file), saveButton),
        lost, h("p", { class: "hint" }, message), frame),
      h("div", {}, properties, section("Robots", false, robots.element), section("Objective", true, goals.element), section("Check", true, wrong), section("As YAML", true, text))),
  );
  const observer = new ResizeObserver(() => draw());
  observer.observe(canvas);
  const endTheme = onTheme(() => {
    draw();
    robots.show();
  });
  addEventListener("message", follow);

  // The world on the canvas: pixels of its width and height, pixels a metre, metres from the middle to the edges.
  function scale() {
    const { mission } = board;
    const points = [...corners(mission.walls), ...(mission.lights ?? []).map((each) => each.at)];
    const [far, high] = [0, 1].map((axis) => Math.max(0.5, ...points.map((point) => Math.abs(point[axis]))) * MARGIN);
    const width = canvas.clientWidth;
    const unit = width / (2 * Math.max(far, high));
    const tall = Math.min(width, Math.max(FLATTEST * width, 2 * high * unit));
    return { width, height: tall, unit, reach: Math.max(far, high) };
  }
  const toScreen = ([x, y], { width, height: high, unit }) => [width / 2 + x * unit, high / 2 - y * unit];
  function toWorld(event, isExact = false) {
    const { width, height: high, unit } = drag?.view ?? scale();
    const bounds = canvas.getBoundingClientRect();
    const point = [(event.clientX - bounds.left - width / 2) / unit, (high / 2 - (event.clientY - bounds.top)) / unit];
    return isExact ? point : point.map((value) => (snap.checked && !event.altKey ? round(Math.round(value / GRID_M) * GRID_M) : round(value)));
  }

  function draw() {
    const { mission } = board;
    if (mission === null) canvas.width = canvas.clientWidth; // clears it
    if (mission === null || canvas.clientWidth === 0) return;
    // While something is dragged the scale stays: the arena does not grow away under the pointer.
    const at = drag?.view ?? scale();
    const ratio = devicePixelRatio;
    canvas.style.height = `${at.height}px`;
    canvas.width = at.width * ratio;
    canvas.height = at.height * ratio;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const walls = corners(mission.walls);
    grid(context, at);
    trace(context, walls, at);
    context.fillStyle = floorColor(mission.floor?.color ?? "grey");
    context.fill();
    context.save();
    context.clip();
    const list = elements(mission);
    for (const element of list) if (element.kind === "patch") paint(context, at, element, floorColor(element.value.color), null);
    context.restore();
    trace(context, walls, at);
    context.strokeStyle = color("--ink");
    context.lineWidth = 3;
    context.stroke();
    for (const stretch of mission.walls?.colors ?? []) wallColor(context, at, walls, stretch);
    paintStart(context, at);
    for (const element of list) {
      const shown = LEDS[element.value.color];
      if (element.kind === "obstacle") paint(context, at, element, shown ?? "#555555", "#222222");
      if (element.kind === "object") paint(context, at, element, shown ?? "#b3764a", "#5d3a1f");
      if (element.kind === "object area") paint(context, at, element, "rgb(179 118 74 / 0.15)", shown ?? "#b3764a", [2, 3]);
      if (element.kind === "light") light(context, at, element);
      if (element.kind === "formation") paint(context, at, element, "transparent", "#cc79a7", [3, 3]);
    }
    swarm(context, at);
    const chosen = selected();
    if (chosen) mark(context, at, chosen);
    if (sketch) outlineSketch(context, at);
  }

  function trace(context, points, at, isOpen = false) {
    context.beginPath();
    points.forEach((point) => context.lineTo(...toScreen(point, at)));
    if (!isOpen) context.closePath();
  }

  function grid(context, at) {
    const far = at.reach;
    const step = far > 5 ? 1 : far > 2 ? 0.5 : 0.25;
    context.strokeStyle = color("--line");
    context.lineWidth = 1;
    context.fillStyle = color("--soft");
    context.font = "11px system-ui, sans-serif";
    for (let number = -Math.ceil(far / step); number <= far / step; number += 1) {
      const [x, y] = toScreen([number * step, number * step], at);
      context.beginPath();
      context.moveTo(x, 0);
      context.lineTo(x, at.height);
      context.moveTo(0, y);
      context.lineTo(at.width, y);
      context.stroke();
      if (number % 2 === 0) {
        context.fillText(String(round(number * step)), x + 2, at.height - 3);
        if (number) context.fillText(String(round(number * step)), 2, y - 2);
      }
    }
  }

  function paint(context, at, { shape }, fill, stroke, dash = []) {
    if (shape.circle) {
      context.beginPath();
      context.arc(...toScreen(shape.circle.center ?? [0, 0], at), Math.max(0, shape.circle.radius) * at.unit, 0, 7);
    } else {
      const points = outline(shape);
      if (points === null) return;
      trace(context, points, at, shape.isOpen);
    }
    context.fillStyle = fill;
    if (!shape.isOpen) context.fill();
    if (stroke === null) return;
    context.setLineDash(dash);
    context.strokeStyle = stroke;
    context.lineWidth = 1.5;
    context.stroke();
    context.setLineDash([]);
  }

  /** Where robots begin: the disc, the rectangle, or what both have in common. */
  function paintStart(context, at) {
    const list = elements(board.mission).filter((element) => element.kind === "start");
    context.save();
    for (const { shape } of list) {
      context.beginPath();
      if (shape.circle) context.arc(...toScreen(shape.circle.center ?? [0, 0], at), Math.max(0, shape.circle.radius) * at.unit, 0, 7);
      else outline(shape).forEach((point) => context.lineTo(...toScreen(point, at)));
      context.closePath();
      context.clip();
    }
    context.fillStyle = "rgb(0 114 178 / 0.14)";
    if (list.length) context.fillRect(0, 0, at.width, at.height);
    context.restore();
    for (const element of list) paint(context, at, element, "transparent", color("--accent"), [6, 4]);
  }

  function wallColor(context, at, walls, { side, color: name, from = 0, to }) {
    const first = walls[side];
    if (!first) return;
    const second = walls[(side + 1) % walls.length];
    const length = Math.hypot(second[0] - first[0], second[1] - first[1]);
    const point = (far) => first.map((value, axis) => value + ((second[axis] - value) * far) / (length || 1));
    trace(context, [point(from), point(to ?? length)], at, true);
    context.strokeStyle = LEDS[name] ?? color("--ink");
    context.lineWidth = 6;
    context.stroke();
  }

  function light(context, at, { value }) {
    const [x, y] = toScreen(value.at, at);
    context.fillStyle = LEDS[value.color] ?? (value.intensity > 0 ? "#e69f00" : "#8a8a8a");
    context.strokeStyle = "#7a5500";
    context.beginPath();
    context.arc(x, y, 8, 0, 7);
    context.fill();
    context.stroke();
  }

  /** Robots where they begin with this seed; the first of each kind with what it senses. */
  function swarm(context, at) {
    const kinds = kindsOf(board.mission);
    const models = kinds.map(({ model }) => describe(model, board.parts));
    const seen = new Set();
    for (const [x, y, radius, heading, state] of board.start?.bodies ?? []) {
      const index = Math.max(0, kinds.findIndex(({ name }) => name !== "" && name === state));
      const isFirst = !seen.has(index);
      seen.add(index);
      const robot = ranges.checked && isFirst && models[index] ? models[index] : { radius };
      paintRobot(context, robot, toScreen([x, y], at), heading, at.unit, { fill: kindColor(index) });
    }
  }

  function mark(context, at, element) {
    context.strokeStyle = color("--accent");
    context.lineWidth = 2;
    const points = element.kind === "walls" ? corners(element.value) : outline(element.shape);
    if (points) trace(context, points, at, element.shape.isOpen);
    else {
      context.beginPath();
      const centre = element.shape.point?.at ?? element.shape.circle?.center ?? [0, 0];
      context.arc(...toScreen(centre, at), element.shape.point ? 12 : Math.max(0, element.shape.circle.radius) * at.unit, 0, 7);
    }
    context.stroke();
    context.fillStyle = color("--accent");
    for (const handle of handles(element)) {
      const [x, y] = toScreen(handle.at, at);
      context.beginPath();
      if (handle.isTurn) context.arc(x, y, HANDLE_PX / 2, 0, 7);
      else context.rect(x - HANDLE_PX / 2, y - HANDLE_PX / 2, HANDLE_PX, HANDLE_PX);
      context.fill();
    }
  }

  function outlineSketch(context, at) {
    trace(context, sketch.hover ? [...sketch.points, sketch.hover] : sketch.points, at, true);
    context.strokeStyle = color("--second");
    context.lineWidth = 2;
    context.stroke();
    context.fillStyle = color("--second");
    for (const point of sketch.points) {
      const [x, y] = toScreen(point, at);
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
    if (selection === null || board.mission === null) return null;
    if (selection[0] === "walls") return wallsOf(board.mission);
    return elements(board.mission).find((element) => String(element.path) === String(selection)) ?? null;
  }

  function take(name) {
    tool = name;
    sketch = name !== null && TOOLS[name].outline ? { points: [], hover: null } : null;
    buttons();
    draw();
  }

  function press(event) {
    if (board.mission === null || isTyped()) return;
    canvas.focus();
    canvas.setPointerCapture(event.pointerId);
    const point = toWorld(event);
    const exact = toWorld(event, true);
    const at = scale();
    const reach = (REACH_PX[event.pointerType] ?? REACH_PX.mouse) / at.unit;
    if (sketch) {
      const [first] = sketch.points;
      if (sketch.points.length > 2 && Math.hypot(first[0] - exact[0], first[1] - exact[1]) < reach) finish();
      else if (String(sketch.points.at(-1)) !== String(point)) sketch.points.push(point);
      draw();
      return;
    }
    if (tool !== null) {
      const { add } = TOOLS[tool];
      take(null);
      edit((mission) => { selection = add(mission, point); });
      return;
    }
    const chosen = selected();
    const handle = chosen && handles(chosen).find(({ at: [x, y] }) => Math.hypot(x - exact[0], y - exact[1]) < reach);
    if (handle && event.shiftKey && handle.vertex !== undefined) {
      removeVertex(handle.vertex);
      return;
    }
    if (handle) {
      remember();
      drag = { handle: handles(chosen).findIndex((each) => String(each.at) === String(handle.at)), view: at };
      return;
    }
    const hit = elements(board.mission).reverse().find((element) => contains(element, exact, reach));
    selection = hit && (hit.kind !== "start" || !isNear(exact, corners(board.mission.walls), reach)) ? hit.path : isNear(exact, corners(board.mission.walls), reach) ? ["walls"] : null;
    if (selection !== null && selection[0] !== "walls") {
      remember();
      drag = { from: point, view: at };
    }
    refresh();
  }

  function move(event) {
    if (sketch) {
      sketch.hover = toWorld(event);
      draw();
      return;
    }
    if (drag === null) return;
    const chosen = selected();
    if (chosen === null) return;
    const point = toWorld(event);
    if (drag.handle !== undefined) handles(chosen)[drag.handle]?.move(point);
    else {
      shift(chosen, [point[0] - drag.from[0], point[1] - drag.from[1]]);
      if (String(point) === String(drag.from)) return;
      drag.from = point;
    }
    drag.isMoved = true;
    draw();
    showProperties();
  }

  function release() {
    if (drag === null) return;
    const { isMoved } = drag;
    drag = null;
    if (isMoved) changed();
    else past.pop();
    refresh();
  }

  function doubled(event) {
    if (sketch) {
      finish();
      return;
    }
    const points = vertices(selected());
    if (!points) return;
    const exact = toWorld(event, true);
    edit(() => addVertex(points, exact, toWorld(event)));
  }

  /** Ends a shape that is drawn corner by corner. */
  function finish() {
    const { points } = sketch;
    const { outline: make } = TOOLS[tool];
    if (points.length < 3) return;
    take(null);
    edit((mission) => { selection = make(mission, points); });
  }

  function removeVertex(index) {
    const points = vertices(selected());
    if (points && points.length > 3) edit(() => points.splice(index, 1));
  }

  function key(event) {
    if (board.mission === null) return;
    const chosen = selected();
    const isCommand = event.ctrlKey || event.metaKey;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (isCommand && event.key === "z") step(past, future);
    else if (isCommand && event.key === "y") step(future, past);
    else if (isCommand && event.key === "c" && chosen) clipboard = copyOf(chosen) ?? clipboard;
    else if (isCommand && event.key === "v" && clipboard) edit((mission) => { selection = paste(mission, clipboard); });
    else if (isCommand && event.key === "d" && chosen) duplicate();
    else if (isCommand) return;
    else if (sketch && event.key === "Enter") finish();
    else if (tool !== null && event.key === "Escape") take(null);
    else if (selection !== null && event.key === "Escape") {
      selection = null;
      refresh();
    } else if (chosen && arrows[event.key]) edit(() => shift(chosen, arrows[event.key].map((value) => value * (snap.checked ? GRID_M : 0.005))));
    else if (chosen && ["Delete", "Backspace"].includes(event.key)) removeSelected();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  function duplicate() {
    const copy = copyOf(selected());
    if (copy) edit((mission) => { selection = paste(mission, copy); });
  }

  function removeSelected() {
    const chosen = selected();
    if (!chosen) return;
    edit((mission) => { if (remove(mission, chosen)) selection = null; });
  }

  function edit(act) {
    if (isTyped()) {
      refresh(); // what was typed would be lost
      return;
    }
    remember();
    act(board.mission);
    changed();
  }

  const moment = () => ({ mission: JSON.stringify(board.mission), text: shown });

  function remember() {
    past.push(moment());
    if (past.length > 200) past.shift();
    future.length = 0;
  }

  function step(from, to) {
    if (isTyped() && board.mission !== null) {
      text.value = shown;
      changed();
      return;
    }
    if (from.length === 0) return;
    to.push(moment());
    const { mission, text: former } = from.pop();
    board.mission = JSON.parse(mission);
    text.value = shown = former;
    if (selected() === null) selection = null;
    changed();
  }

  // Beside the board.
  function buttons() {
    tools.forEach((button, index) => button.setAttribute("aria-pressed", String(Object.keys(TOOLS)[index] === tool)));
    canvas.classList.toggle("adds", tool !== null);
  }

  function refresh() {
    draw();
    showProperties();
    robots.show();
    goals.show();
    undo.disabled = past.length === 0 && (board.mission === null || !isTyped());
    redo.disabled = future.length === 0;
  }

  function buildProperties() {
    const { mission } = board;
    if (mission === null) return [];
    const chosen = selected();
    const list = [wallsOf(mission), ...elements(mission)];
    const titles = list.map(({ kind, value, path }) => [String(path), `${kind} ${value?.name ?? (path.length > 1 ? path.filter((each) => !["floor", "patches", "obstacles", "objects", "lights", "shape"].includes(each)).map((each) => (typeof each === "number" ? each + 1 : each)).join(" ") : "")}`]);
    const button = (label, act) => h("button", { type: "button", "data-key": label, click: act }, label);
    return [
      h("div", { class: "tools" },
        select({ "aria-label": "Selected", "data-key": "selected" }, [["", "the mission"], ...titles], chosen ? String(chosen.path) : "", (now) => {
          selection = list.find((each) => String(each.path) === now)?.path ?? null;
          refresh();
        }),
        copyOf(chosen) ? button("Duplicate", duplicate) : null,
        chosen && !["walls", "formation"].includes(chosen.kind) && !(chosen.kind === "start" && Object.keys(mission.start).length < 2) ? button("Remove", removeSelected) : null,
        chosen && ["object", "object area"].includes(chosen.kind) ? placeButton(chosen, button) : null,
        vertices(chosen) ? button("Add a corner", () => edit(() => {
          const points = vertices(selected());
          const [[ax, ay], [bx, by]] = [points[0], points[1]];
          points.splice(1, 0, [round((ax + bx) / 2), round((ay + by) / 2)]);
        })) : null,
        vertices(chosen)?.length > 3 ? button("Remove its first corner", () => removeVertex(0)) : null),
      h("div", { class: "fields" }, chosen ? elementFields(chosen) : missionFields()),
      chosen?.kind === "walls" ? wallColors() : null,
    ];
  }

  function placeButton(chosen, button) {
    const isArea = chosen.kind === "object area";
    return button(isArea ? "Place at a point" : "Place at random in an area", () => edit(() => {
      const { value } = chosen;
      if (isArea) {
        const { disc, rectangle } = value.start;
        value.center = disc?.center ?? (rectangle ? ["x", "y"].map((axis) => round((rectangle[axis][0] + rectangle[axis][1]) / 2)) : [0, 0]);
        delete value.start;
        delete value.count;
        selection = chosen.path.slice(0, 2);
      } else {
        value.start = { disc: { center: value.center, radius: 0.3 } };
        delete value.center;
        delete value.angle;
        selection = [...chosen.path, "start", "disc"];
      }
    }));
  }

  function missionFields() {
    const { mission } = board;
    const set = (name, value) => edit((target) => put(target, name, value));
    const specs = { title: { type: "text", is_optional: true }, duration: { type: "number", unit: "s", value: 120, is_optional: true } };
    const shown = Object.fromEntries(SHOWN_KEYS.filter((name) => mission[name] !== undefined).map((name) => [name, mission[name]]));
    return [...fields(specs, shown, set, "mission"), floorField("floor", mission.floor?.color ?? "grey", (now) => edit((target) => {
      target.floor ??= {};
      target.floor.color = now;
    }), false)];
  }

  function elementFields(chosen) {
    const { kind, value } = chosen;
    const specs = OPTIONAL[kind] ?? {};
    const key = String(chosen.path);
    const set = (name, now) => edit(() => {
      if (name === "name" && ["patch", "object", "object area"].includes(kind)) rename(board.mission, kind === "patch" ? "patch" : "object", value.name, now);
      put(value, name, now);
    });
    if (kind === "patch") {
      return [
        ...leaves(value).filter(([path]) => path[0] !== "color").map(([path, leaf]) => leafField(value, path, leaf, set, key)),
        floorField("color", value.color, (now) => set("color", now), true),
      ];
    }
    if (kind === "walls") return [...fields(specs, value, set, key, {}, ["colors"]), wallChoice()];
    if (kind === "formation") return leaves(value).map(([path, leaf]) => leafField(value, path, leaf, set, key));
    return fields(specs, value, set, key);
  }

  function floorField(label, value, set, isPatch) {
    const isLevel = typeof value === "number";
    const options = Object.keys(FLOORS).filter((each) => isPatch || each !== "random").map((each) => [each, each]);
    return h("label", {}, h("span", {}, label), select({ "data-key": `floor.${label}` }, [...options, ["level", "a level, 0 to 1"]], isLevel ? "level" : value, (now) => set(now === "level" ? 0.5 : now)),
      isLevel ? h("input", { type: "number", step: "any", min: 0, max: 1, value, "data-key": `floor.${label}.level`, change: (event) => { if (event.target.value !== "") set(Number(event.target.value)); } }) : null);
  }

  function wallChoice() {
    const { walls } = board.mission;
    const now = walls.rectangle ? "rectangle" : walls.corners ? "corners" : "regular";
    return h("label", {}, h("span", {}, "shape"), select({ "data-key": "walls.shape" }, [["rectangle", "rectangle"], ["regular", "regular polygon"], ["corners", "any polygon"]], now, (next) => edit((mission) => {
      const { height: high, colors } = mission.walls;
      const points = corners(mission.walls).map((point) => point.map(round));
      const shape = { rectangle: { rectangle: [3, 2] }, regular: { sides: 12, apothem: 1.226 }, corners: { corners: points } }[next];
      mission.walls = { ...shape, ...(high === undefined ? {} : { height: high }), ...(colors === undefined ? {} : { colors }) };
    })));
  }

  /** Colored stretches of walls, for cameras. */
  function wallColors() {
    const list = board.mission.walls.colors ?? [];
    const specs = { side: { type: "number" }, color: { type: "choice", options: Object.keys(LEDS), value: "red" }, from: { type: "number", unit: "m", value: 0, is_optional: true }, to: { type: "number", unit: "m", is_optional: true } };
    return [
      list.map((stretch, index) => h("div", { class: "fields" },
        fields(specs, stretch, (name, value) => edit(() => put(stretch, name, value ?? (name === "color" ? "red" : undefined))), `walls.colors.${index}`),
        h("button", { type: "button", "data-key": `walls.colors.${index}.remove`, click: () => edit(({ walls }) => { walls.colors.splice(index, 1); if (!walls.colors.length) delete walls.colors; }) }, "Remove"))),
      h("button", { type: "button", "data-key": "walls.colors.add", click: () => edit(({ walls }) => { walls.colors = [...(walls.colors ?? []), { side: list.length % corners(walls).length, color: "red" }]; }) }, "Color a side (for cameras)"),
    ];
  }

  // The text, and what the engine says.
  const isTyped = () => text.value !== shown;
  const state = () => JSON.stringify([board.mission, board.expression]);
  const isChanged = () => kept !== null && (text.value !== kept.text || state() !== kept.state);

  function keep() {
    kept = { text: text.value, state: state() };
  }

  function track(request) {
    requests.add(request);
    request.finally(() => requests.delete(request));
    return request;
  }

  const changed = () => track(write());
  const typed = () => track(read());

  /** Resolves when the mission is what is on the screen. */
  async function settle() {
    if (isTyped()) typed();
    while (requests.size) await Promise.all(requests);
  }

  /** Writes the mission into the text, whose comments stay. */
  async function write() {
    refresh();
    if (board.mission === null) return;
    const number = ++checked;
    message.textContent = "";
    try {
      const answer = await change("mission_text", { mission: board.mission, text: shown, seed: Number(seed.value) });
      if (isGone || number !== checked || isTyped()) return;
      text.value = answer.text;
      shown = text.value;
      tell(answer);
    } catch (error) {
      if (!isGone && number === checked) tell({ problems: error.message.split("\n") });
    }
  }

  /** Reads the mission from the text. */
  async function read() {
    const number = ++checked;
    const source = text.value;
    try {
      const answer = await change("mission_parse", { text: source, seed: Number(seed.value) });
      if (isGone || number !== checked) return;
      if (answer.mission) {
        if (board.mission !== null) remember();
        board.mission = answer.mission;
        shown = source;
        comments = source.match(/(?<=^|\s)#.*$/gm) ?? [];
        if (selected() === null) selection = null;
      }
      tell(answer);
    } catch (error) {
      if (!isGone && number === checked) tell({ problems: error.message.split("\n") });
    }
  }

  function tell({ problems, start }) {
    // Robots stay where they were while something is wrong.
    board.start = start ?? board.start;
    isWrong = problems.length > 0;
    tryButton.disabled = saveButton.disabled = isWrong;
    wrong.replaceChildren(...(isWrong ? problems.map((each) => h("li", { class: "problem" }, each)) : [h("li", { class: "fine" }, "Nothing is wrong.")]));
    notice.textContent = !isTyped() ? "" : board.mission === null ? "This text cannot be drawn. Correct it beside the board." : "The board shows the last text that could be drawn. Correct the text, or undo.";
    const left = comments.filter((each) => !text.value.includes(each));
    lost.textContent = left.length === 0 ? "" : `Without ${left.length === 1 ? "a comment" : `${left.length} comments`} of the text: ${left.join(" ").slice(0, 200)}`;
    refresh();
    if (!isWrong) later();
  }

  /** Takes a fitness: into the mission if it is a weighted sum, else for the experiment. */
  async function divide(expression) {
    if (expression.trim() === "") {
      goals.show();
      return;
    }
    try {
      const { fitness } = await change("mission_fitness", { text: expression });
      if (isGone) return;
      board.expression = fitness === null ? expression : null;
      message.textContent = "";
      if (fitness === null) {
        refresh();
        later();
      } else if (expressionOf(fitness) === expressionOf(board.mission.fitness)) refresh();
      else edit((mission) => { mission.fitness = fitness; });
    } catch (error) {
      if (!isGone) message.replaceChildren(problem(error));
    }
  }

  // Episodes.
  function later() {
    clearTimeout(timer);
    if (live.checked && frame.firstChild) timer = setTimeout(() => tryOut(true), TRY_AFTER_MS);
  }

  async function tryOut(isAgain = false) {
    clearTimeout(timer);
    if (!isAgain) await settle();
    if (isWrong || isGone) return;
    const number = ++tried;
    if (!isAgain) tryButton.disabled = true;
    message.textContent = "simulating…";
    try {
      const { id, fitness, metrics } = await change("mission_try", { mission: board.mission, seed: Number(seed.value), run: run.value, fitness: board.expression ?? "" });
      if (isGone || number !== tried) return;
      board.values = { fitness, metrics };
      first = { step: isAgain ? Math.min(Math.floor(board.step), fitness.length - 1) : 0, play: !isAgain || isPlaying };
      frame.replaceChildren(h("figure", {}, h("iframe", { src: `try?id=${id}`, sandbox: "allow-scripts", title: "An episode of the mission" })));
      if (!isAgain) frame.scrollIntoView({ block: "nearest", behavior: "smooth" });
      message.textContent = "";
      goals.show();
    } catch (error) {
      if (!isGone && number === tried) message.replaceChildren(problem(error));
    }
    tryButton.disabled = isWrong;
  }

  /** Shows the values of the step that the player shows; see `remote.js` of the player. */
  function follow({ source, data }) {
    const player = frame.querySelector("iframe")?.contentWindow;
    if (!player || source !== player || data === null || typeof data !== "object") return;
    if (data.player === "ready" && first !== null) {
      player.postMessage(first, "*");
      first = null;
    } else if (data.player === "step" && Number.isFinite(data.step) && first === null) {
      board.step = data.step;
      isPlaying = data.playing === true;
      goals.mark(board.step);
    }
  }

  async function save() {
    await settle();
    if (isWrong || isGone) return;
    const now = { text: text.value, state: state() };
    try {
      const answer = await change("mission_save", { name: file.value, text: now.text, replace: saved === file.value });
      saved = file.value;
      kept = now;
      const fitness = board.expression === null ? "" : `&fitness=${encodeURIComponent(board.expression)}`;
      message.replaceChildren(`saved as ${answer.file}. `, h("a", { href: `#/new?mission=${encodeURIComponent(answer.file)}${fitness}` }, "Evolve on it"));
    } catch (error) {
      message.replaceChildren(problem(error));
    }
  }

  async function open(which) {
    if (isChanged() && !await askWhether("Open another mission? What is not saved of this one will be lost.", "Open", "Stay")) {
      choice.value = opened;
      return;
    }
    try {
      opened = which;
      const answer = await ask("mission", { name: which });
      if (isGone || opened !== which) return;
      board.mission = board.expression = board.values = board.start = null;
      past.length = future.length = comments.length = 0;
      selection = sketch = tool = null;
      frame.replaceChildren();
      shown = "";
      text.value = answer.text;
      saved = which.endsWith(".yaml") ? which.replace(/\.yaml$/, "") : "";
      file.value = saved || `my_${which}`;
      choice.value = which;
      kept = null;
      buttons();
      await typed();
      keep();
    } catch (error) {
      wrong.replaceChildren(h("li", {}, problem(error)));
    }
  }

  (async () => {
    const [names, parts] = await Promise.all([ask("missions"), ask("mission_parts")]);
    if (isGone) return;
    board.parts = parts;
    const group = (label, list) => (list.length ? h("optgroup", { label }, list.map((each) => h("option", { value: each }, each))) : null);
    choice.append(...[group("in this folder", names.files), group("built in", names.built_in)].filter(Boolean));
    for (const row of [...store.rows.values()].filter((each) => each.simulation === "arena" && each.best !== null).slice(0, 200)) {
      run.append(h("option", { value: row.id }, `the best of ${row.id}`));
    }
    await open(query.get("mission") ?? names.files[0] ?? "aggregation");
  })().catch((error) => wrong.replaceChildren(h("li", {}, problem(error))));
  return { trail: ["draw a mission"], isChanged, leave: () => {
    isGone = true;
    clearTimeout(timer);
    observer.disconnect();
    endTheme();
    removeEventListener("message", follow);
  } };
}
