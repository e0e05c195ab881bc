// The robots of a mission: their kinds, bodies, drives, sensors and actuators, as fields and as pictures.
import { color, h } from "./dom.js";
import { fields, put, renderer, select } from "./draw_fields.js";
import { rename } from "./draw_shapes.js";

const DEFAULT = "e-puck-rm1.1";
const OWN = "a robot of your own";
const KINDS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const RADIAL = { range_and_bearing: ["messages", "#0072b2", [6, 4]], neighbours: ["neighbours", "#009e73", [2, 3]], camera: ["camera", "#cc79a7", [9, 3, 2, 3]] };
const CLOSE_UP_PX = 240;

/** The kinds of robots: what each is called, its model, and how many there are. */
export function kindsOf(mission) {
  if (Array.isArray(mission.robots)) return mission.robots.map((kind) => ({ name: kindName(kind), model: kind.robot ?? DEFAULT, count: kind.count, kind }));
  return [{ name: "", model: mission.robot ?? DEFAULT, count: mission.robots ?? 20, kind: null }];
}

function kindName(kind) {
  return kind.name ?? (typeof kind.robot === "string" ? kind.robot.replace(/\.[^.]+$/, "") : kind.robot?.preset ?? "");
}

/** A color for each kind, in order. */
export function kindColor(index) {
  return KINDS[index % KINDS.length];
}

/** The description of a model, that of a built-in one by its name; null for a file. */
export function describe(model, parts) {
  const builtIn = (name) => (Object.hasOwn(parts.robots, name) ? parts.robots[name] : null);
  if (typeof model === "string") return builtIn(model);
  if (model.preset === undefined) return model;
  const base = structuredClone(builtIn(model.preset));
  if (base === null) return null;
  for (const key of ["radius", "height", "mass"]) if (model[key] !== undefined) base[key] = model[key];
  for (const sensor of base.sensors ?? []) Object.assign(sensor, model.sensors?.[sensor.kind]);
  Object.assign(base.drive, model.drive);
  return base;
}

function directions({ count, angles }) {
  return (angles ?? Array.from({ length: Math.min(128, count ?? 0) }, (_, index) => (360 * index) / count)).map((each) => (each * Math.PI) / 180);
}

/** Draws a robot and what it senses; `far` also where that ends in all directions. `unit` is in pixels a metre. */
export function paintRobot(context, robot, [x, y], heading, unit, { isFar = true, fill = KINDS[0] } = {}) {
  const at = (angle, far) => [x + far * unit * Math.cos(heading + angle), y - far * unit * Math.sin(heading + angle)];
  const line = (from, to, stroke, width = 1) => {
    context.strokeStyle = stroke;
    context.lineWidth = width;
    context.beginPath();
    context.moveTo(...from);
    context.lineTo(...to);
    context.stroke();
  };
  const radius = Number(robot.radius) || 0;
  for (const sensor of robot.sensors ?? []) {
    const [label, stroke, dash] = RADIAL[sensor.kind] ?? [];
    if (label && isFar) {
      context.setLineDash(dash);
      context.strokeStyle = stroke;
      context.lineWidth = 1.5;
      context.beginPath();
      context.arc(x, y, Math.max(0, Number(sensor.range) || 0) * unit, 0, 7);
      context.stroke();
      context.setLineDash([]);
    }
    if (sensor.kind === "proximity") for (const angle of directions(sensor)) line(at(angle, radius), at(angle, radius + (Number(sensor.range) || 0)), color("--second"), 1.5);
  }
  context.beginPath();
  context.arc(x, y, Math.max(3, radius * unit), 0, 7);
  context.fillStyle = fill;
  context.globalAlpha = 0.85;
  context.fill();
  context.globalAlpha = 1;
  line([x, y], at(0, Math.max(3 / unit, radius)), "#ffffff", 2);
  for (const sensor of robot.sensors ?? []) {
    if (sensor.kind === "light") for (const angle of directions(sensor)) line(at(angle, radius * 0.8), at(angle, radius * 1.12), "#e69f00", 3);
    if (sensor.kind === "ground") for (const [px, py] of sensor.points ?? [[0, 0]]) {
      context.fillStyle = "#f0e442";
      context.beginPath();
      context.arc(...at(Math.atan2(py, px), Math.hypot(px, py)), 2.5, 0, 7);
      context.fill();
    }
  }
}

/** What reaches farther than a close-up shows, in words. */
function words(robot) {
  const reach = (robot.sensors ?? []).filter((each) => RADIAL[each.kind]).map((each) => `${RADIAL[each.kind][0]} to ${each.range} m`);
  return [`${robot.drive?.kind ?? "no"} drive, ${robot.drive?.max_speed ?? 0} m/s`, ...reach].join(" · ");
}

function closeUp(robot, fill) {
  const canvas = h("canvas", { class: "close-up", role: "img", "aria-label": `The robot from above: ${words(robot)}` });
  canvas.width = canvas.height = CLOSE_UP_PX * devicePixelRatio;
  const context = canvas.getContext("2d");
  context.scale(devicePixelRatio, devicePixelRatio);
  const radius = Number(robot.radius) || 0.05;
  const rays = Math.max(0, ...(robot.sensors ?? []).filter((each) => each.kind === "proximity").map((each) => Number(each.range) || 0));
  const unit = CLOSE_UP_PX / (2.1 * (radius + Math.min(Math.max(rays, radius * 0.3), radius * 4)));
  paintRobot(context, robot, [CLOSE_UP_PX / 2, CLOSE_UP_PX / 2], Math.PI / 2, unit, { fill, isFar: false });
  return h("figure", { class: "close-up" }, canvas, h("figcaption", { class: "hint" }, words(robot)));
}

/** The panel. `board` has the mission, `parts`, `start` and `edit`. */
export function robotsPanel(board) {
  const element = h("div", { class: "robots" });
  const draw = renderer(element, build);
  return { element, show: draw };

  function build() {
    const { mission, parts, start } = board;
    if (mission === null || parts === null) return [];
    const kinds = kindsOf(mission);
    const isList = Array.isArray(mission.robots);
    return [
      kinds.map((kind, index) => kindFields(kind, index, isList)),
      h("div", { class: "tools" },
        h("button", { type: "button", "data-key": "kinds.add", click: () => board.edit(addKind) }, "Add a kind of robots"),
        isList && kinds.length === 1 ? h("button", { type: "button", "data-key": "kinds.merge", click: () => board.edit(mergeKinds) }, "All alike") : null),
      start ? h("p", { class: "hint" }, `Controllers have ${start.sensors.length} inputs and ${start.actuators.length} outputs.`) : null,
      start ? h("details", { "data-key": "kinds.names" }, h("summary", {}, "Names of inputs and outputs"), h("p", { class: "hint" }, `${start.sensors.join(", ")} → ${start.actuators.join(", ")}`)) : null,
    ];
  }

  function kindFields({ name, model, count, kind }, index, isList) {
    const { parts } = board;
    const own = typeof model === "object";
    const robot = describe(model, parts);
    const key = `kind.${index}`;
    const options = [...Object.keys(parts.robots).map((each) => [each, each]), [OWN, OWN]];
    const choice = own ? (model.preset === undefined ? OWN : `changed ${model.preset}`) : model;
    return h("fieldset", {},
      h("legend", {}, h("span", { class: "dot", "data-color": index % KINDS.length }), isList ? name || `kind ${index}` : "all robots"),
      h("div", { class: "kind" },
        h("div", { class: "fields" },
          isList ? h("label", {}, h("span", {}, "name"), h("input", { "data-key": `${key}.name`, value: kind.name ?? "", placeholder: name, change: (event) => board.edit((mission) => renameKind(mission, index, event.target.value)) })) : null,
          h("label", {}, h("span", {}, "how many"), h("input", { "data-key": `${key}.count`, type: "number", min: 1, step: 1, value: count ?? "", change: (event) => {
            if (event.target.value !== "") board.edit((mission) => { if (isList) mission.robots[index].count = Number(event.target.value); else mission.robots = Number(event.target.value); });
          } })),
          h("label", {}, h("span", {}, "model"), select({ "data-key": `${key}.model` }, own && model.preset !== undefined ? [[choice, choice], ...options] : options, choice, (now) => board.edit((mission) => choose(mission, index, now === OWN ? ownFrom(robot, parts) : now)))),
          own && model.preset === undefined ? fields(parts.body, model, (part, value) => editModel(index, (target) => put(target, part, value)), key, {}, ["drive", "sensors", "actuators"]) : null,
          own && model.preset !== undefined ? fields({}, model, (part, value) => editModel(index, (target) => put(target, part, value)), key, {}, ["preset"]) : null),
        robot ? closeUp(robot, kindColor(index)) : h("p", { class: "hint" }, "This robot is described in a file beside the mission.")),
      own && model.preset === undefined ? ownFields(model, index, key) : null,
      isList && board.mission.robots.length > 1 ? h("button", { type: "button", "data-key": `${key}.remove`, click: () => board.edit((mission) => { mission.robots.splice(index, 1); }) }, "Remove this kind") : null,
    );
  }

  function ownFields(model, index, key) {
    const { parts } = board;
    const drive = model.drive ?? {};
    return [
      h("details", { "data-key": `${key}.drive` }, h("summary", {}, `Drive: ${drive.kind ?? "none"}`), h("div", { class: "fields" },
        h("label", {}, h("span", {}, "kind"), select({ "data-key": `${key}.drive.kind` }, Object.keys(parts.drives).map((each) => [each, each]), drive.kind ?? "", (now) => editModel(index, (target) => { target.drive = changedDrive(drive, now); }))),
        fields(parts.drives[drive.kind] ?? {}, drive, (name, value) => editModel(index, (target) => put(target.drive, name, value)), `${key}.drive`, {}, ["kind"]))),
      partList("sensors", model, index, key),
      partList("actuators", model, index, key),
    ];
  }

  /** Sensors or actuators: each with its fields, and what can be added, as a robot has each kind once. */
  function partList(noun, model, index, key) {
    const specs = board.parts[noun];
    const list = model[noun] ?? [];
    const left = Object.keys(specs).filter((kind) => !list.some((each) => each.kind === kind));
    return h("div", { class: "parts" },
      list.map((part, number) => h("details", { "data-key": `${key}.${noun}.${part.kind}` },
        h("summary", {}, `${noun.slice(0, -1)}: ${String(part.kind).replaceAll("_", " ")}`),
        h("div", { class: "fields" },
          fields(specs[part.kind] ?? {}, part, (name, value) => editModel(index, (target) => setPart(target[noun][number], name, value)), `${key}.${noun}.${part.kind}`, {}, ["kind"])),
        h("button", { type: "button", "data-key": `${key}.${noun}.${part.kind}.remove`, click: () => editModel(index, (target) => { target[noun].splice(number, 1); if (!target[noun].length) delete target[noun]; }) }, "Remove"))),
      left.length ? h("select", { "data-key": `${key}.${noun}.add`, "aria-label": `Add one of the ${noun}`, change: (event) => editModel(index, (target) => addPart(target, noun, event.target.value)) },
        [["", `Add one of the ${noun}…`], ...left.map((each) => [each, each.replaceAll("_", " ")])].map(([value, text]) => h("option", { value }, text))) : null);
  }

  function addPart(model, noun, kind) {
    if (!kind) return;
    model[noun] ??= [];
    const part = { kind };
    for (const [name, spec] of Object.entries(board.parts[noun][kind])) {
      if (!spec.is_optional || name === "count") part[name] = structuredClone(spec.value);
    }
    model[noun].push(part);
  }

  function editModel(index, change) {
    board.edit((mission) => change(Array.isArray(mission.robots) ? mission.robots[index].robot : mission.robot));
  }

  /** Directions are either counted or listed. */
  function setPart(part, name, value) {
    put(part, name, value);
    if (value !== undefined && name === "angles") delete part.count;
    if (value !== undefined && name === "count") delete part.angles;
  }

  function changedDrive(drive, kind) {
    const specs = board.parts.drives[kind];
    const result = { kind };
    for (const [name, spec] of Object.entries(specs)) {
      if (drive[name] !== undefined) result[name] = drive[name];
      else if (!spec.is_optional) result[name] = spec.value;
    }
    return result;
  }

  function ownFrom(robot, parts) {
    return structuredClone(robot ?? parts.robots[DEFAULT]);
  }

  function choose(mission, index, model) {
    if (Array.isArray(mission.robots)) {
      const kind = mission.robots[index];
      if (typeof model === "object") kind.name ??= kindName(kind);
      kind.robot = model;
    } else if (model === DEFAULT) delete mission.robot;
    else mission.robot = model;
  }

  function addKind(mission) {
    if (!Array.isArray(mission.robots)) {
      mission.robots = [{ name: "robot_1", robot: mission.robot ?? DEFAULT, count: mission.robots ?? 20 }];
      delete mission.robot;
    }
    const names = new Set(mission.robots.map(kindName));
    let number = mission.robots.length + 1;
    while (names.has(`robot_${number}`)) number += 1;
    mission.robots.push({ name: `robot_${number}`, robot: DEFAULT, count: 5 });
  }

  function mergeKinds(mission) {
    const [kind] = mission.robots;
    mission.robots = kind.count;
    mission.robot = kind.robot ?? DEFAULT;
  }

  function renameKind(mission, index, now) {
    const kind = mission.robots[index];
    const before = kindName(kind);
    put(kind, "name", now === "" ? undefined : now);
    rename(mission, "kind", before, kindName(kind));
  }
}
