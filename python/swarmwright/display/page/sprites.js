// Draws thousands of bodies, each copied from a small picture of its colour and heading.

const TURNS = 48; // number of headings with a picture
const COLUMNS = 64;
const SMALL = 2.2; // radius in pixels below which discs and squares look the same

class Sprites {
  constructor() {
    this.canvas = document.createElement("canvas");
  }

  draw(world, bodies) {
    const ratio = window.devicePixelRatio || 1;
    // All pictures have the size of the largest body; smaller bodies are scaled.
    let r = 0;
    for (const i of bodies) r = Math.max(r, world.robotRadius(i));
    if (r < SMALL) {
      this.squares(world, bodies);
      return;
    }
    if (r > 24) {
      for (const i of bodies) world.robot(i);
      return;
    }
    this.prepare(r, ratio, world);
    const { context: c } = world;
    const { side } = this;
    const half = side / ratio / 2;
    const turns = r < 2.5 ? 1 : TURNS; // smaller bodies have no line for their heading
    for (const i of bodies) {
      const turn = turns === 1 ? 0 : Math.round((world.heading(i) / (2 * Math.PI)) * turns);
      const cell = this.cell(world.colorOf(i), ((turn % turns) + turns) % turns, turns);
      const part = world.robotRadius(i) / r;
      const size = half * part;
      const [sx, sy] = [(cell % COLUMNS) * side, Math.floor(cell / COLUMNS) * side];
      c.drawImage(this.canvas, sx, sy, side, side, world.px[i] - size, world.py[i] - size, 2 * size, 2 * size);
    }
  }

  // Draws squares with the area of discs, five times faster than copying pictures.
  squares(world, bodies) {
    const { context: c, px, py } = world;
    for (const i of bodies) {
      const half = 0.886 * world.robotRadius(i);
      c.fillStyle = world.colorOf(i);
      c.fillRect(px[i] - half, py[i] - half, 2 * half, 2 * half);
    }
  }

  // Clears the pictures if size, resolution or theme changed.
  prepare(r, ratio, world) {
    const key = [r.toFixed(3), ratio, world.color("paper")].join();
    if (key === this.key) return;
    this.key = key;
    this.radius = r * ratio;
    this.side = 2 * Math.ceil(this.radius + 1.5);
    this.cells = new Map();
    [this.paper, this.ink] = [world.color("paper"), world.color("ink")];
    this.canvas.width = this.side * COLUMNS;
    this.canvas.height = this.side;
    this.context = this.canvas.getContext("2d");
  }

  // Returns the index of the picture of a colour and heading.
  cell(color, turn, turns) {
    const name = `${color} ${turn}`;
    const cached = this.cells.get(name);
    if (cached !== undefined) return cached;
    const cell = this.cells.size;
    const row = Math.floor(cell / COLUMNS);
    if ((row + 1) * this.side > this.canvas.height) this.grow();
    const { side } = this;
    const [x, y] = [((cell % COLUMNS) + 0.5) * side, (row + 0.5) * side];
    drawRobot(this.context, x, y, this.radius, (turn / turns) * 2 * Math.PI, color, this.paper, this.ink);
    this.cells.set(name, cell);
    return cell;
  }

  grow() {
    const before = document.createElement("canvas");
    [before.width, before.height] = [this.canvas.width, this.canvas.height];
    before.getContext("2d").drawImage(this.canvas, 0, 0);
    this.canvas.height = Math.max(2 * before.height, this.side);
    this.context = this.canvas.getContext("2d");
    this.context.drawImage(before, 0, 0);
  }
}
