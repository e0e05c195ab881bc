// The map with all bodies at a time in steps.

const MARGIN = { left: 30, right: 10, top: 8, bottom: 24 }; // pixels, smallest room for the numbers
const EDGE = 8; // pixels beside the map for bodies at its border; the smallest margin
const MANY = 400; // bodies; more are drawn as sprites
const MOST_TRAILS = 1500; // moving bodies; with more, only the followed agent has a trail
const MOST_PIECES = 60000; // segments of trails that fade
const MOST_LABELS = 200;
const MARK = 0.013; // radius of a mark, as a share of the map's longer side

// Radius in pixels of an agent's mark, which decreases with the number of agents.
const markRadius = (count) => Math.min(Math.max(52 / Math.sqrt(Math.max(count, 1)), 2.5), 9);

class World {
  constructor(canvas, episode, changed) {
    this.canvas = canvas;
    this.episode = episode;
    this.camera = new Camera(episode.width, episode.height);
    this.sprites = new Sprites();
    this.selected = -1; // the followed body
    this.following = false;
    const moved = (dragged) => {
      if (dragged) this.following = false;
      changed();
    };
    this.pointer = new Pointer(canvas, this.camera, moved, (x, y) => changed(this.bodyAt(x, y)));
  }

  // view: trail in steps (-1: since the start), rays and links ("none", "selected", "all"), labels, and colors, the source
  // of the colours of bodies ("state", "value", "controller").
  draw(time, view) {
    const { episode, camera } = this;
    const { width, height } = episode;
    const room = this.canvas.parentElement.clientWidth;
    const highest = Math.max(240, view.highest);
    const margin = this.margin();
    const inside = [room - margin.left - margin.right, highest - MARGIN.top - MARGIN.bottom];
    const scale = Math.min(inside[0] / width, inside[1] / height);
    const size = [width * scale, height * scale];
    const total = size[1] + MARGIN.top + MARGIN.bottom;
    this.canvas.style.height = `${total}px`;
    this.box = { left: margin.left + (inside[0] - size[0]) / 2, top: MARGIN.top, width: size[0], height: size[1] };
    camera.fitInto(this.box);
    this.color = theme();
    this.context = fit(this.canvas, room, total);
    this.view = view;
    [this.frame, this.part] = episode.moment(time);
    this.scene = Math.floor(time);
    if (this.selected >= 0 && this.following && camera.zoom > 1) {
      const at = this.worldPosition(this.selected);
      if (at) camera.center(...at);
    }
    const c = this.context;
    let bare = false;
    this.within(0, () => (bare = new Ground(this).draw(episode.groundAt(this.scene))));
    if (bare) {
      c.strokeStyle = this.color("soft");
      c.lineWidth = 1.5;
      c.strokeRect(this.box.left, this.box.top, this.box.width, this.box.height);
    }
    // Draw whole bodies at the border of the map, but not at the border of a zoomed part.
    this.within(camera.zoom === 1 ? EDGE : 0, () => {
      this.updatePixels();
      this.trails();
      new Signals(this).draw();
      this.bodies();
      this.labels();
      this.mark();
    });
    new Ground(this).numbers();
  }

  // Draws on the map and up to `beside` pixels around it.
  within(beside, draw) {
    const { context: c, box } = this;
    c.save();
    c.beginPath();
    c.rect(box.left - beside, box.top - beside, box.width + 2 * beside, box.height + 2 * beside);
    c.clip();
    draw();
    c.restore();
  }

  // Returns the room for the longest numbers, beside the map and below its last column.
  margin() {
    const { width, height } = this.episode;
    const c = this.canvas.getContext("2d");
    c.font = FONT;
    const step = this.spacing();
    const [left, bottom] = this.corner();
    // Numbers between the first and the last one may have more digits: −0.5 is wider than −1.
    const digits = (/\.(\d+)$/.exec(words(step)) || ["", ""])[1].length;
    const wide = (number) => {
      const fixed = Math.abs(number) < 1e6 ? number.toFixed(digits).replace("-", "−") : words(number);
      return Math.max(c.measureText(fixed).width, c.measureText(words(number)).width);
    };
    const last = (corner, extent) => wide(Math.floor((corner + extent) / step) * step);
    const rows = Math.max(wide(Math.ceil(bottom / step) * step), last(bottom, height));
    return { left: Math.max(MARGIN.left, rows + 10), right: Math.max(MARGIN.right, last(left, width) / 2 + 4) };
  }

  // Returns the offset of the numbers beside the map; in a grid, numbers are indices of cells.
  corner() {
    return this.episode.grid ? [0, 0] : this.episode.origin;
  }

  // Returns the distance between two numbers, in metres or cells.
  spacing() {
    const { width, height, grid } = this.episode;
    return Math.max(grid ? 1 : 0, spacing(Math.max(width, height) / this.camera.zoom, 12));
  }

  // Returns the position of a body in the world; null if it does not exist now.
  worldPosition(body) {
    const { x, y } = this.episode.series;
    const at = [x.between(this.frame, this.part, body), y.between(this.frame, this.part, body)];
    return Number.isNaN(at[0]) || Number.isNaN(at[1]) ? null : at;
  }

  place(body) {
    const at = this.worldPosition(body);
    return at && this.camera.pixels(...at);
  }

  // Computes the pixels of all bodies; NaN for bodies that do not exist now.
  updatePixels() {
    const { count, series } = this.episode;
    if (!this.px || this.px.length !== count) [this.px, this.py] = [new Float64Array(count), new Float64Array(count)];
    const { camera, box, frame, part } = this;
    const { scale } = camera;
    const [left, top] = [box.left + box.width / 2 - camera.x * scale, box.top + box.height / 2 + camera.y * scale];
    for (let i = 0; i < count; i++) {
      this.px[i] = left + series.x.between(frame, part, i) * scale;
      this.py[i] = top - series.y.between(frame, part, i) * scale;
    }
  }

  // Returns whether a part of a disc is visible.
  seen(i, radius) {
    const { box, px, py } = this;
    return (
      px[i] > box.left - radius && px[i] < box.left + box.width + radius && py[i] > box.top - radius && py[i] < box.top + box.height + radius
    );
  }

  // Returns the colour of a body for a canvas.
  colorOf(i) {
    const { episode, view, frame } = this;
    if (view.colors === "controller") {
      const state = episode.stateOf(frame, episode.agents[i]);
      if (state >= 0) return this.color(stateColor(episode.firstColorOf(i) + state));
    }
    if (view.colors === "value") {
      const share = episode.share(frame, i);
      // Few different colours, to limit the number of sprites.
      if (!Number.isNaN(share)) return valueColor(this.color, Math.round(Math.min(Math.max(share, 0), 1) * 40) / 40);
    }
    return this.color(look(...episode.lookAt(frame, i)).color);
  }

  bodies() {
    const { episode, frame } = this;
    const { count, series } = episode;
    const layers = [[], [], [], [], []];
    const [robots, leds, stretches] = [[], [], []];
    for (let i = 0; i < count; i++) {
      const radius = Math.max(series.radius.at(frame, i) * this.camera.scale || 0, 14);
      if (!this.seen(i, radius)) continue;
      const [kind, state] = episode.lookAt(frame, i);
      const directed = !Number.isNaN(series.heading.at(frame, i));
      if (isOff(kind, state)) continue;
      if (kind === PAGE.led) leds.push(i);
      else if (kind === PAGE.stretch && directed) stretches.push(i);
      else if (directed) robots.push(i);
      else if (CELLS.has(kind)) layers[0].push(i);
      else if (!MOVING.has(kind)) layers[1].push(i);
      else if (kind !== "agent") layers[2].push(i);
      // Draw moving agents above those that have arrived.
      else layers[state === "free" ? 4 : 3].push(i);
    }
    for (const i of stretches) this.stretch(i);
    layers.flat().forEach((i) => series.radius.at(frame, i) > 0 && !CELLS.has(episode.lookAt(frame, i)[0]) && this.disc(i));
    for (const layer of layers) this.layer(layer);
    if (robots.length > MANY) this.sprites.draw(this, robots);
    else for (const i of robots) this.robot(i);
    for (const i of leds) this.led(i);
  }

  // Draws a coloured part of a wall, as thick as a wall with its edge.
  stretch(i) {
    const { context: c, px, py } = this;
    const far = this.episode.series.radius.at(this.frame, i) * this.camera.scale;
    const heading = this.heading(i);
    const [dx, dy] = [far * Math.cos(heading), -far * Math.sin(heading)];
    c.strokeStyle = this.colorOf(i);
    c.lineWidth = 5;
    c.lineCap = "butt";
    this.line([[px[i] - dx, py[i] - dy], [px[i] + dx, py[i] + dy]]);
  }

  // Draws an LED in the middle of its robot, whose colour remains visible around it.
  led(i) {
    const { context: c } = this;
    const r = Math.max(this.episode.series.radius.at(this.frame, i) * this.camera.scale, 0.8);
    c.beginPath();
    c.arc(this.px[i], this.py[i], r, 0, 2 * Math.PI);
    c.fillStyle = this.color(look(...this.episode.lookAt(this.frame, i)).color);
    c.fill();
    if (r < 1.5) return;
    c.strokeStyle = this.color("paper");
    c.lineWidth = Math.min(r / 3, 1.5);
    c.stroke();
  }

  layer(bodies) {
    const { context: c, episode } = this;
    const ratio = c.getTransform();
    const field = this.color("field");
    for (const i of bodies) {
      const [kind, state] = episode.lookAt(this.frame, i);
      const r = this.radius(kind);
      const shape = SHAPES[look(kind, state).shape];
      c.setTransform(ratio);
      c.translate(this.px[i], this.py[i]);
      c.scale(r, r);
      c.fillStyle = this.colorOf(i);
      c.fill(shape);
      c.strokeStyle = field;
      c.lineWidth = (CELLS.has(kind) ? 1 : 1.2) / r;
      c.stroke(shape);
    }
    c.setTransform(ratio);
  }

  radius(kind) {
    const { grid, agentCount, width, height } = this.episode;
    const { scale } = this.camera;
    if (CELLS.has(kind)) return scale / 2;
    const agent = markRadius(agentCount);
    const inCell = grid ? Math.max(scale * 0.36, 1.5) : Infinity;
    // Marks of other bodies grow with the map and the zoom.
    const mark = Math.min(Math.max(MARK * Math.max(width, height) * scale, 3), 30);
    const r = Math.min(kind === "agent" ? Math.max(agent, grid ? inCell : 0) : mark, inCell);
    return kind === "goal" ? r * 1.2 : r;
  }

  disc(i) {
    const { context: c } = this;
    const solid = this.episode.lookAt(this.frame, i)[0] === "obstacle";
    c.beginPath();
    c.arc(this.px[i], this.py[i], this.episode.series.radius.at(this.frame, i) * this.camera.scale, 0, 2 * Math.PI);
    c.strokeStyle = c.fillStyle = this.colorOf(i);
    c.lineWidth = 1;
    c.globalAlpha = solid ? 0.5 : 0.15;
    c.fill();
    c.globalAlpha = 0.9;
    c.stroke();
    c.globalAlpha = 1;
  }

  // Returns the radius in pixels of a body with a heading: at least a visible size; that of a mark without a radius.
  robotRadius(i) {
    return Math.max(this.episode.series.radius.at(this.frame, i) * this.camera.scale || markRadius(this.episode.count), 1.6);
  }

  robot(i) {
    drawRobot(this.context, this.px[i], this.py[i], this.robotRadius(i), this.heading(i), this.colorOf(i), this.color("paper"), this.color("ink"));
  }

  heading(i) {
    return this.episode.series.heading.turned(this.frame, this.part, i);
  }

  trails() {
    const { episode, view } = this;
    if (view.trail === 0) return;
    const { series } = episode;
    const moving = [];
    for (let i = 0; i < episode.count; i++) {
      const leaves = MOVING.has(episode.lookAt(this.frame, i)[0]) || !Number.isNaN(series.heading.at(this.frame, i));
      if (leaves && (series.x.changes(i) || series.y.changes(i)) && !Number.isNaN(this.px[i])) moving.push(i);
    }
    const drawn = moving.length > MOST_TRAILS ? moving.filter((i) => i === this.selected) : moving;
    const steps = view.trail < 0 ? this.frame : Math.ceil(view.trail / episode.stride);
    const fades = view.trail > 0 && drawn.length * steps <= MOST_PIECES;
    for (const i of drawn) this.trail(i, steps, fades);
  }

  trail(i, steps, fades) {
    const { context: c, camera, frame } = this;
    const { x, y } = this.episode.series;
    const way = [];
    const oldest = Math.max(0, frame - steps);
    // Limit the resolution to what is visible.
    const stride = fades ? 1 : Math.max(1, Math.floor((frame - oldest) / 2000));
    for (let k = oldest; k <= frame; k += stride) {
      const at = [x.at(k, i), y.at(k, i)];
      if (!Number.isNaN(at[0]) && !Number.isNaN(at[1])) way.push(camera.pixels(...at));
    }
    way.push([this.px[i], this.py[i]]);
    c.strokeStyle = this.colorOf(i);
    c.lineWidth = i === this.selected ? 2.5 : this.episode.directed ? 1.2 : 2;
    c.lineJoin = "round";
    c.lineCap = fades ? "butt" : "round"; // round ends of transparent pieces would show where they meet
    if (fades) {
      for (let k = 1; k < way.length; k++) {
        c.globalAlpha = 0.1 + (0.6 * k) / way.length;
        this.line(way.slice(k - 1, k + 1));
      }
    } else {
      c.globalAlpha = i === this.selected ? 0.9 : 0.4;
      this.line(way);
    }
    c.globalAlpha = 1;
  }

  line(points) {
    this.context.beginPath();
    points.forEach(([x, y], i) => (i ? this.context.lineTo(x, y) : this.context.moveTo(x, y)));
    this.context.stroke();
  }

  // Draws labels beside bodies that do not overlap; that of the selected body first.
  labels() {
    const { episode, context: c } = this;
    const entry = episode.bodies.labels.filter(([from]) => from <= this.frame).pop();
    if (!this.view.labels || !entry) return;
    const texts = entry[1];
    const order = [...texts.keys()].filter((i) => texts[i] && this.seen(i, 0));
    if (texts[this.selected]) order.unshift(this.selected);
    const boxes = [];
    c.font = FONT;
    c.textAlign = "left";
    c.textBaseline = "middle";
    for (const i of new Set(order)) {
      if (boxes.length >= MOST_LABELS) break;
      const r = Math.max((episode.series.radius.at(this.frame, i) || 0) * this.camera.scale, 4);
      const text = texts[i].slice(0, 24);
      const wide = c.measureText(text).width;
      // Above on the right, or on the other side at the edge of the map.
      const x = this.px[i] + 0.75 * r + 5 + wide > this.box.left + this.box.width ? this.px[i] - 0.75 * r - 3 - wide : this.px[i] + 0.75 * r + 3;
      const y = this.py[i] - 0.75 * r - 13 < this.box.top ? this.py[i] + 0.75 * r + 5 : this.py[i] - 0.75 * r - 5;
      const box = [x - 2, y - 8, x + wide + 2, y + 8];
      if (boxes.some((b) => box[0] < b[2] && b[0] < box[2] && box[1] < b[3] && b[1] < box[3])) continue;
      boxes.push(box);
      // An edge around the letters hides less of the map than a box.
      c.strokeStyle = this.color("paper");
      c.lineWidth = 3;
      c.lineJoin = "round";
      c.strokeText(text, x, y);
      c.fillStyle = this.color("ink");
      c.fillText(text, x, y);
    }
  }

  // Draws a ring around the followed body.
  mark() {
    const { context: c, selected: i } = this;
    if (i < 0 || Number.isNaN(this.px[i])) return;
    const r = Math.max((this.episode.series.radius.at(this.frame, i) || 0) * this.camera.scale, 6) + 5;
    for (const [color, width] of [["paper", 5], ["accent", 2.5]]) {
      c.beginPath();
      c.arc(this.px[i], this.py[i], r, 0, 2 * Math.PI);
      c.strokeStyle = this.color(color);
      c.lineWidth = width;
      c.stroke();
    }
  }

  // Returns the nearest agent close to a pixel; -1 for none.
  bodyAt(x, y) {
    let [body, nearest] = [-1, Infinity];
    for (let i = 0; i < this.episode.count; i++) {
      if (this.episode.agents[i] < 0) continue;
      const far = Math.hypot(this.px[i] - x, this.py[i] - y);
      const r = Math.max((this.episode.series.radius.at(this.frame, i) || 0) * this.camera.scale, 12);
      if (far <= r && far < nearest) [body, nearest] = [i, far];
    }
    return body;
  }
}

// Draws a disc with a line for the heading.
function drawRobot(c, x, y, r, heading, color, paper, ink) {
  c.beginPath();
  c.arc(x, y, r, 0, 2 * Math.PI);
  c.fillStyle = color;
  c.fill();
  if (r < 2.5) return;
  c.lineWidth = Math.min(Math.max(r / 8, 0.6), 1.5);
  c.strokeStyle = paper;
  c.stroke();
  c.beginPath();
  c.moveTo(x, y);
  c.lineTo(x + r * 0.95 * Math.cos(heading), y - r * 0.95 * Math.sin(heading));
  c.strokeStyle = bright(color) ? dark(ink, paper) : light(ink, paper);
  c.lineWidth = Math.min(Math.max(r / 4, 0.9), 4);
  c.lineCap = "round";
  c.stroke();
}

const LUMINANCE = new Map();

function luminance(color) {
  if (!LUMINANCE.has(color)) {
    const hex = /^#(..)(..)(..)$/.exec(color);
    const parts = hex ? hex.slice(1).map((part) => parseInt(part, 16)) : color.match(/\d+/g).map(Number);
    LUMINANCE.set(color, (0.3 * parts[0] + 0.59 * parts[1] + 0.11 * parts[2]) / 255);
  }
  return LUMINANCE.get(color);
}

function bright(color) {
  return luminance(color) > 0.6;
}

function dark(first, second) {
  return luminance(first) < luminance(second) ? first : second;
}

function light(first, second) {
  return luminance(first) < luminance(second) ? second : first;
}
