// The map with everything on it, at a time in steps.

const MARGIN = { left: 30, right: 10, top: 8, bottom: 24 }; // pixels, for the numbers, at least
const FONT = "12px system-ui, 'DejaVu Sans', sans-serif";

class World {
  constructor(canvas, episode) {
    this.canvas = canvas;
    this.episode = episode;
    this.agents = episode.bodies.filter((body) => body.kind === "agent").length;
  }

  // `trail`: steps, -1 for all the way.
  draw(time, trail) {
    const { width, height, bodies } = this.episode;
    const room = this.canvas.parentElement.clientWidth;
    const highest = Math.max(240, window.innerHeight * 0.68);
    const margin = this.margin();
    const inside = [room - margin.left - margin.right, highest - MARGIN.top - MARGIN.bottom];
    this.scale = Math.min(inside[0] / width, inside[1] / height);
    const size = [width * this.scale, height * this.scale];
    const total = size[1] + MARGIN.top + MARGIN.bottom;
    this.canvas.style.height = `${total}px`;
    this.left = margin.left + (inside[0] - size[0]) / 2;
    this.top = MARGIN.top;
    this.color = theme();
    this.context = fit(this.canvas, room, total);
    this.ground(size);
    const scene = Math.floor(time);
    const places = bodies.map((body) => this.place(body, time));
    this.layer(bodies, places, scene, (body) => CELLS.has(body.kind));
    bodies.forEach((body, i) => body.radius > 0 && places[i] && this.disc(body, places[i], scene));
    if (trail !== 0) bodies.forEach((body, i) => MOVING.has(body.kind) && this.trail(body, places[i], scene, trail));
    this.layer(bodies, places, scene, (body) => !CELLS.has(body.kind) && !MOVING.has(body.kind));
    this.layer(bodies, places, scene, (body) => body.kind === "defender");
    // Those who are still on their way above those who are not.
    this.layer(bodies, places, scene, (body) => body.kind === "agent" && stateAt(body, scene) !== "free");
    this.layer(bodies, places, scene, (body) => body.kind === "agent" && stateAt(body, scene) === "free");
    this.context.strokeStyle = this.color("soft");
    this.context.lineWidth = 1.5;
    this.context.strokeRect(this.left, this.top, ...size);
  }

  // Pixels of a body; between two steps it is on the way.
  place(body, time) {
    const scene = Math.floor(time);
    const share = time - scene;
    const [x, y] = [at(body.x, scene), at(body.y, scene)];
    if (x === null || y === null) return null;
    const [nextX, nextY] = share > 0 ? [at(body.x, scene + 1), at(body.y, scene + 1)] : [x, y];
    if (nextX === null || nextY === null) return this.pixels(x, y);
    return this.pixels(x + share * (nextX - x), y + share * (nextY - y));
  }

  // Room for the longest numbers, which stand beside the map and half beside its last column.
  margin() {
    const { width, height } = this.episode;
    const c = this.canvas.getContext("2d");
    c.font = FONT;
    const step = this.spacing();
    const longest = (extent) => c.measureText(words(Math.floor(extent / step) * step)).width;
    return { left: Math.max(MARGIN.left, longest(height) + 10), right: Math.max(MARGIN.right, longest(width) / 2 + 4) };
  }

  // Distance between two numbers, in metres or cells.
  spacing() {
    const { width, height, grid } = this.episode;
    return Math.max(grid ? 1 : 0, spacing(Math.max(width, height), 12));
  }

  pixels(x, y) {
    return [this.left + x * this.scale, this.top + (this.episode.height - y) * this.scale];
  }

  ground([w, h]) {
    const { context: c, color } = this;
    const { width, height, grid } = this.episode;
    c.fillStyle = color("field");
    c.fillRect(this.left, this.top, w, h);
    const step = this.spacing();
    const lines = grid && Math.max(width, height) <= 64 ? 1 : step;
    c.strokeStyle = color("grid");
    c.lineWidth = 1;
    c.beginPath();
    for (let x = lines; x < width; x += lines) {
      c.moveTo(this.left + x * this.scale, this.top);
      c.lineTo(this.left + x * this.scale, this.top + h);
    }
    for (let y = lines; y < height; y += lines) {
      const line = grid ? this.top + y * this.scale : this.top + h - y * this.scale;
      c.moveTo(this.left, line);
      c.lineTo(this.left + w, line);
    }
    c.stroke();
    this.numbers(step, h);
  }

  // Metres from the bottom left; in a grid columns and rows from the top left, at the middle of their cells.
  numbers(step, h) {
    const { context: c } = this;
    const { width, height, grid } = this.episode;
    const middle = grid ? 0.5 : 0;
    c.fillStyle = this.color("soft");
    c.font = FONT;
    c.textAlign = "center";
    c.textBaseline = "top";
    for (let x = 0; x + middle <= width; x += step)
      c.fillText(words(x), this.left + (x + middle) * this.scale, this.top + h + 7);
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (let y = 0; y + middle <= height; y += step) {
      const line = grid ? this.top + (y + middle) * this.scale : this.top + h - y * this.scale;
      c.fillText(words(y), this.left - 6, line);
    }
  }

  layer(bodies, places, scene, wanted) {
    const { context: c } = this;
    const ratio = this.context.getTransform();
    bodies.forEach((body, i) => {
      if (!wanted(body) || !places[i]) return;
      const { shape, color } = look(body.kind, stateAt(body, scene));
      const r = this.radius(body.kind);
      c.save();
      c.translate(...places[i]);
      c.scale(r, r);
      c.fillStyle = this.color(color);
      c.fill(SHAPES[shape]);
      c.setTransform(ratio);
      c.translate(...places[i]);
      c.scale(r, r);
      c.strokeStyle = this.color("field");
      c.lineWidth = (CELLS.has(body.kind) ? 1 : 1.2) / r;
      c.stroke(SHAPES[shape]);
      c.restore();
    });
  }

  radius(kind) {
    if (CELLS.has(kind)) return this.scale / 2;
    const agent = Math.min(Math.max(52 / Math.sqrt(Math.max(this.agents, 1)), 2.5), 9);
    const inCell = this.episode.grid ? Math.max(this.scale * 0.36, 1.5) : Infinity;
    const r = Math.min(kind === "agent" ? Math.max(agent, this.episode.grid ? inCell : 0) : 9, inCell);
    return kind === "goal" ? r * 1.2 : r;
  }

  disc(body, [x, y], scene) {
    const { context: c } = this;
    c.beginPath();
    c.arc(x, y, body.radius * this.scale, 0, 2 * Math.PI);
    c.strokeStyle = c.fillStyle = this.color(look(body.kind, stateAt(body, scene)).color);
    c.lineWidth = 1;
    c.globalAlpha = 0.15;
    c.fill();
    c.globalAlpha = 0.9;
    c.stroke();
    c.globalAlpha = 1;
  }

  trail(body, place, scene, steps) {
    if (!place || !Array.isArray(body.x)) return;
    const { context: c } = this;
    const oldest = steps < 0 ? 0 : Math.max(0, scene - steps);
    const way = [];
    for (let i = oldest; i <= scene; i++)
      if (body.x[i] !== null && at(body.y, i) !== null) way.push(this.pixels(body.x[i], at(body.y, i)));
    way.push(place);
    c.strokeStyle = this.color(look(body.kind, stateAt(body, scene)).color);
    c.lineWidth = 2;
    c.lineJoin = "round";
    c.lineCap = steps < 0 ? "round" : "butt"; // round ends of transparent pieces would show where they meet
    if (steps < 0) {
      c.globalAlpha = 0.5;
      this.line(way);
    } else {
      for (let i = 1; i < way.length; i++) {
        c.globalAlpha = 0.1 + (0.6 * i) / way.length;
        this.line(way.slice(i - 1, i + 1));
      }
    }
    c.globalAlpha = 1;
  }

  line(points) {
    this.context.beginPath();
    points.forEach(([x, y], i) => (i ? this.context.lineTo(x, y) : this.context.moveTo(x, y)));
    this.context.stroke();
  }
}
