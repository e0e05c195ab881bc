// The floor, lights and walls of a map below all bodies, and the numbers beside the map.

class Ground {
  constructor(world) {
    this.world = world;
    Object.assign(this, { c: world.context, color: world.color, camera: world.camera, box: world.box });
  }

  // Returns whether the map has no walls, so that only its border shows the limits.
  draw(ground) {
    const { c, box, color } = this;
    c.fillStyle = color("field");
    c.fillRect(box.left, box.top, box.width, box.height);
    if (!ground.floor) this.lines();
    c.save();
    if (ground.floor) {
      this.fill(ground.floor);
      c.clip();
    }
    for (const patch of ground.patches) this.fill(patch);
    c.restore();
    for (const light of ground.lights) this.light(light);
    for (const wall of ground.walls) this.wall(wall);
    return !ground.walls.length;
  }

  fill(patch) {
    const { c, camera } = this;
    c.beginPath();
    if (patch.points.length === 1) {
      c.arc(...camera.pixels(...patch.points[0]), patch.radius * camera.scale, 0, 2 * Math.PI);
    } else this.path(patch.points);
    c.closePath();
    c.fillStyle = floorColor(this.color, patch.grey);
    c.fill();
  }

  path(points) {
    points.forEach((point, i) => this.c[i ? "lineTo" : "moveTo"](...this.camera.pixels(...point)));
  }

  wall({ points, solid }) {
    const { c } = this;
    c.beginPath();
    this.path(points);
    c.lineJoin = "round";
    c.strokeStyle = c.fillStyle = this.color("blockade");
    if (solid) {
      c.closePath();
      c.fill();
    }
    c.lineWidth = solid ? 1 : 3;
    c.stroke();
  }

  light({ x, y, on }) {
    const { c, camera } = this;
    const [px, py] = camera.pixels(x, y);
    if (on) {
      const glow = 0.06 * Math.max(camera.width, camera.height) * camera.scale;
      const shine = c.createRadialGradient(px, py, 0, px, py, glow);
      shine.addColorStop(0, `${this.color("exit")}b0`);
      shine.addColorStop(1, `${this.color("exit")}00`);
      c.fillStyle = shine;
      c.beginPath();
      c.arc(px, py, glow, 0, 2 * Math.PI);
      c.fill();
    }
    c.beginPath();
    const lamp = Math.min(Math.max(0.5 * MARK * Math.max(camera.width, camera.height) * camera.scale, 2), 15);
    c.arc(px, py, lamp, 0, 2 * Math.PI);
    c.fillStyle = this.color(on ? "exit" : "field");
    c.strokeStyle = this.color("soft");
    c.lineWidth = 1.2;
    c.fill();
    c.stroke();
  }

  // Draws the lines between the cells of a grid, or at the numbers beside the map.
  lines() {
    const { c, world, box } = this;
    const { width, height, grid } = world.episode;
    const step = grid && Math.max(width, height) <= 64 * this.camera.zoom ? 1 : world.spacing();
    c.strokeStyle = this.color("grid");
    c.lineWidth = 1;
    c.beginPath();
    const [left, bottom] = world.corner();
    for (const x of this.inside(0, width, step)) {
      const [px] = this.camera.pixels(x - left, 0);
      c.moveTo(px, box.top);
      c.lineTo(px, box.top + box.height);
    }
    for (const y of this.inside(1, height, step)) {
      const [, py] = this.camera.pixels(0, grid ? height - y : y - bottom);
      c.moveTo(box.left, py);
      c.lineTo(box.left + box.width, py);
    }
    c.stroke();
  }

  // Returns the visible multiples of a step on the map; axis: 0 for x, 1 for y.
  inside(axis, extent, step) {
    const { box, camera, world } = this;
    const [low, high] = [camera.position(box.left, box.top + box.height)[axis], camera.position(box.left + box.width, box.top)[axis]];
    // Rows of a grid are numbered from the top.
    const [from, to] = axis === 1 && world.episode.grid ? [extent - high, extent - low] : [low, high];
    const corner = world.corner()[axis];
    const last = Math.min(to, extent) + corner + 1e-9;
    const multiples = [];
    for (let i = Math.ceil((Math.max(from, 0) + corner) / step - 1e-9); i * step <= last && multiples.length < 200; i++)
      multiples.push(i * step);
    return multiples;
  }

  // Draws metres in the simulation's coordinates; in a grid columns and rows from the top left, centred on cells.
  numbers() {
    const { c, world, box } = this;
    const { width, height, grid } = world.episode;
    const step = world.spacing();
    const middle = grid ? 0.5 : 0;
    const [left, bottom] = world.corner();
    c.fillStyle = this.color("soft");
    c.font = FONT;
    c.textAlign = "center";
    c.textBaseline = "top";
    let first = Infinity; // pixel, left end of the numbers of x
    for (const x of this.inside(0, width - middle, step)) {
      const [px] = this.camera.pixels(x - left + middle, 0);
      if (px < box.left - 1 || px > box.left + box.width + 1) continue;
      c.fillText(words(x), px, box.top + box.height + 7);
      first = Math.min(first, px - c.measureText(words(x)).width / 2);
    }
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const y of this.inside(1, height - middle, step)) {
      const [, py] = this.camera.pixels(0, grid ? height - y - middle : y - bottom);
      if (py >= box.top - 1 && py <= box.top + box.height + 1) c.fillText(words(y), box.left - 6, py);
    }
    if (grid) return;
    // The unit, at the corner of both axes.
    c.textBaseline = "top";
    c.fillText("m", Math.min(box.left - 6, first - 5), box.top + box.height + 7);
  }
}
