// What is drawn on the board: the elements of a mission, where they are, and how dragging changes them.

export const GRID_M = 0.05;
export const round = (value) => Math.round(value * 1000) / 1000;
const order = (one, other) => one - other;

/** Elements of a mission: the path of each in it, its kind, its shape, and the values that its fields show. */
export function elements(mission) {
  const list = [];
  (mission.floor?.patches ?? []).forEach((patch, index) => list.push({ path: ["floor", "patches", index], kind: "patch", shape: shapeOf(patch), value: patch }));
  for (const { part, shape } of areas(mission.start)) list.push({ path: ["start", part], kind: "start", shape, value: mission.start });
  (mission.obstacles ?? []).forEach((box, index) => list.push({ path: ["obstacles", index], kind: "obstacle", shape: { box }, value: box }));
  (mission.objects ?? []).forEach((object, index) => {
    const path = ["objects", index];
    if (object.center) list.push({ path, kind: "object", value: object, shape: object.size ? { box: object } : { circle: object } });
    for (const { part, shape } of areas(object.start)) list.push({ path: [...path, "start", part], kind: "object area", shape, value: object });
  });
  (mission.lights ?? []).forEach((light, index) => list.push({ path: ["lights", index], kind: "light", shape: { point: light }, value: light }));
  for (const [name, metric] of Object.entries(mission.metrics ?? {})) {
    if (metric?.shape) list.push({ path: ["metrics", name, "shape"], kind: "formation", shape: formation(metric.shape), value: metric.shape });
  }
  return list;
}

/** The walls as an element. */
export function wallsOf(mission) {
  return { path: ["walls"], kind: "walls", shape: {}, value: mission.walls };
}

function areas(start) {
  return ["disc", "rectangle"].filter((part) => start?.[part]).map((part) => ({ part, shape: part === "disc" ? { circle: start.disc } : { rectangle: start.rectangle } }));
}

function shapeOf(patch) {
  if (patch.circle) return { circle: patch.circle };
  if (patch.rectangle) return { rectangle: patch.rectangle };
  return { polygon: patch.polygon ?? [] };
}

function formation(shape) {
  if (shape.circle !== undefined) return { circle: { isFixed: true, get radius() { return shape.circle; }, set radius(value) { shape.circle = value; } } };
  return { polygon: shape.polygon ?? shape.line ?? shape.points ?? [], isOpen: !shape.polygon };
}

/** The corners of walls, counter-clockwise. */
export function corners(walls) {
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

/** Corners that can be added and removed one by one; null for other shapes. */
export function vertices(element) {
  return element?.shape.polygon ?? element?.value?.corners ?? null;
}

/** Points that are dragged to change a shape: where they are, and what moving them does. */
export function handles(element) {
  const { shape, kind } = element;
  if (kind === "walls") return wallHandles(element.value);
  if (shape.circle) {
    const [x, y] = shape.circle.center ?? [0, 0];
    return [{ at: [x + shape.circle.radius, y], move: ([to]) => { shape.circle.radius = Math.max(GRID_M, round(to - x)); } }];
  }
  if (shape.rectangle) {
    const { x, y } = shape.rectangle;
    return [0, 1].flatMap((i) => [0, 1].map((j) => ({ at: [x[i], y[j]], move: ([px, py]) => { x[i] = px; y[j] = py; x.sort(order); y.sort(order); } })));
  }
  if (shape.polygon) return shape.polygon.map((point, index) => ({ at: point, vertex: index, move: (to) => { shape.polygon[index] = to; } }));
  if (shape.box) {
    const { box } = shape;
    const size = turned([box.size[0] / 2, box.size[1] / 2], box);
    const turn = turned([box.size[0] / 2 + 0.15, 0], box);
    return [
      { at: size, move: (to) => { box.size = turnedBack(to, box).map((side) => Math.max(0.01, round(2 * Math.abs(side)))); } },
      { at: turn, isTurn: true, move: ([x, y]) => { box.angle = Math.round((Math.atan2(y - box.center[1], x - box.center[0]) * 36) / Math.PI) * 5; } },
    ];
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

/** The corners of a shape; null for circles and points. */
export function outline(shape) {
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

export function contains(element, point, reach) {
  const { shape, kind } = element;
  if (shape.point) return Math.hypot(point[0] - shape.point.at[0], point[1] - shape.point.at[1]) < reach;
  if (shape.circle) {
    const [x, y] = shape.circle.center ?? [0, 0];
    const far = Math.hypot(point[0] - x, point[1] - y);
    return kind === "formation" ? Math.abs(far - shape.circle.radius) < reach : far <= shape.circle.radius;
  }
  const points = outline(shape);
  if (points === null) return false;
  return kind === "formation" ? isNear(point, points, reach) : isInside(point, points);
}

export function isNear(point, points, reach) {
  return points.some((corner, index) => distance(point, corner, points[(index + 1) % points.length]) < reach);
}

export function distance([x, y], [ax, ay], [bx, by]) {
  const length = (bx - ax) ** 2 + (by - ay) ** 2 || 1;
  const along = Math.max(0, Math.min(1, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length));
  return Math.hypot(x - ax - along * (bx - ax), y - ay - along * (by - ay));
}

/** Adds a corner in the middle of the side that is nearest to a point, or at the point. */
export function addVertex(points, near, at) {
  let best = 0;
  points.forEach((point, index) => {
    if (distance(near, point, points[(index + 1) % points.length]) < distance(near, points[best], points[(best + 1) % points.length])) best = index;
  });
  points.splice(best + 1, 0, at);
}

export function shift(element, [dx, dy]) {
  const { shape, kind, value } = element;
  const moved = (values) => [round(values[0] + dx), round(values[1] + dy), ...values.slice(2)];
  const moveAll = (points) => points.forEach((point, index) => { points[index] = moved(point); });
  if (kind === "walls") {
    if (value.corners) moveAll(value.corners);
  } else if (shape.point) shape.point.at = moved(shape.point.at);
  else if (shape.circle && !shape.circle.isFixed) shape.circle.center = moved(shape.circle.center ?? [0, 0]);
  else if (shape.box) shape.box.center = moved(shape.box.center);
  else if (shape.polygon) moveAll(shape.polygon);
  else if (shape.rectangle) {
    shape.rectangle.x = shape.rectangle.x.map((each) => round(each + dx));
    shape.rectangle.y = shape.rectangle.y.map((each) => round(each + dy));
  }
}

/** The corners of a new patch or of new walls, which are drawn click by click, become these; `y` points north. */
export function counterClockwise(points) {
  const area = points.reduce((sum, [x, y], index) => {
    const [nx, ny] = points[(index + 1) % points.length];
    return sum + x * ny - nx * y;
  }, 0);
  return area < 0 ? [...points].reverse() : points;
}

const area = ([x, y]) => ({ x: [round(x - 0.3), round(x + 0.3)], y: [round(y - 0.2), round(y + 0.2)] });

/** What is added where one clicks. Tools with `outline` are drawn corner by corner. */
export const TOOLS = {
  "circle": { add: (mission, at) => add(mission, ["floor", "patches"], { name: free(mission, "spot"), circle: { center: at, radius: 0.3 }, color: "black" }) },
  "rectangle": { add: (mission, at) => add(mission, ["floor", "patches"], { name: free(mission, "zone"), rectangle: area(at), color: "white" }) },
  "polygon": { outline: (mission, points) => add(mission, ["floor", "patches"], { name: free(mission, "area"), polygon: points, color: "black" }) },
  "obstacle": { add: (mission, at) => add(mission, ["obstacles"], { center: at, size: [0.05, 0.6], angle: 0 }) },
  "disc to push": { add: (mission, at) => add(mission, ["objects"], { name: free(mission, "disc"), radius: 0.1, mass: 0.3, center: at }) },
  "box to push": { add: (mission, at) => add(mission, ["objects"], { name: free(mission, "box"), size: [0.2, 0.2], mass: 0.3, center: at }) },
  "light": { add: (mission, at) => add(mission, ["lights"], { at: [...at, 0.4], intensity: 3 }) },
  "start disc": { add: (mission, at) => { mission.start = { ...mission.start, disc: { center: at, radius: 0.5 } }; return ["start", "disc"]; } },
  "start rectangle": { add: (mission, at) => { mission.start = { ...mission.start, rectangle: area(at) }; return ["start", "rectangle"]; } },
  "walls": { outline: (mission, points) => {
    const { height } = mission.walls ?? {};
    mission.walls = { corners: counterClockwise(points), ...(height === undefined ? {} : { height }) };
    return ["walls"];
  } },
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

const LISTS = { patch: ["floor", "patches"], obstacle: ["obstacles"], object: ["objects"], "object area": ["objects"], light: ["lights"] };

/** A copy of an element, to be pasted; null for what a mission has once. */
export function copyOf(element) {
  return element && LISTS[element.kind] ? { kind: element.kind, value: structuredClone(element.value) } : null;
}

/** Adds a copy a little beside what it was copied from; returns its path. */
export function paste(mission, { kind, value }) {
  const copy = structuredClone(value);
  if (copy.name !== undefined) copy.name = free(mission, String(copy.name).replace(/_\d+$/, "") || "copy");
  const list = LISTS[kind];
  const path = add(mission, list, copy);
  const at = elements(mission).filter((each) => String(each.path.slice(0, path.length)) === String(path));
  for (const element of at) shift(element, [0.1, -0.1]);
  return at[0]?.path ?? path;
}

/** Removes an element, and lists that are empty then. Returns whether it could be removed. */
export function remove(mission, element) {
  if (["walls", "formation"].includes(element.kind)) return false;
  if (element.kind === "start") {
    if (Object.keys(mission.start).length < 2) return false;
    delete mission.start[element.path[1]];
    return true;
  }
  const isArea = element.kind === "object area";
  if (isArea && Object.keys(element.value.start).length > 1) {
    delete element.value.start[element.path[3]];
    return true;
  }
  const path = isArea ? element.path.slice(0, 2) : element.path;
  const list = path.slice(0, -1).reduce((value, key) => value[key], mission);
  list.splice(path.at(-1), 1);
  if (list.length === 0) delete path.slice(0, -2).reduce((value, key) => value[key], mission)[path.at(-2)];
  return true;
}

const REFERENCES = { patch: ["patch", "patches", "sources", "nest", "from", "to", "outside"], object: ["object"], kind: ["robots"] };

/** Renames a patch, an object or a kind of robots also where metrics, failures and batteries name it. */
export function rename(mission, kind, from, to) {
  const renamed = (value) => (Array.isArray(value) ? value.map(renamed) : value === from ? to : value);
  for (const metric of [...Object.values(mission.metrics ?? {}), ...(kind === "kind" ? mission.failures ?? [] : [])]) {
    for (const key of REFERENCES[kind]) if (metric?.[key] !== undefined) metric[key] = renamed(metric[key]);
  }
  if (kind !== "patch") return;
  for (const robot of [mission.robot, ...(Array.isArray(mission.robots) ? mission.robots.map((each) => each.robot) : [])]) {
    const charging = robot?.battery?.charging;
    if (charging?.patch === from) charging.patch = to;
  }
}
