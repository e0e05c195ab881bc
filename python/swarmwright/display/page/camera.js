// The visible part of a map: zoomed by the wheel, two fingers, keys or buttons, and dragged.

const LARGEST_ZOOM = 400;

class Camera {
  constructor(width, height) {
    [this.width, this.height] = [width, height];
    this.reset();
  }

  reset() {
    this.zoom = 1;
    [this.x, this.y] = [this.width / 2, this.height / 2];
  }

  // box: the part of the canvas with the map; left, top, width and height in pixels.
  fitInto(box) {
    this.box = box;
    this.whole = Math.min(box.width / this.width, box.height / this.height);
    this.keepInside();
  }

  get scale() {
    return this.whole * this.zoom;
  }

  pixels(x, y) {
    const { box, scale } = this;
    return [box.left + box.width / 2 + (x - this.x) * scale, box.top + box.height / 2 - (y - this.y) * scale];
  }

  // Returns the position in the world at a pixel.
  position(px, py) {
    const { box, scale } = this;
    return [this.x + (px - box.left - box.width / 2) / scale, this.y - (py - box.top - box.height / 2) / scale];
  }

  // Zooms and keeps the position at a pixel.
  zoomBy(factor, px, py) {
    const [x, y] = this.position(px, py);
    this.zoom = Math.min(Math.max(this.zoom * factor, 1), LARGEST_ZOOM);
    const [nowX, nowY] = this.position(px, py);
    this.x += x - nowX;
    this.y += y - nowY;
    this.keepInside();
  }

  moveBy(dx, dy) {
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
    this.keepInside();
  }

  center(x, y) {
    [this.x, this.y] = [x, y];
    this.keepInside();
  }

  // Limits the view to the map; centres the map if it is smaller than the box.
  keepInside() {
    const half = [this.box.width / 2 / this.scale, this.box.height / 2 / this.scale];
    const within = (at, extent, part) => (2 * part >= extent ? extent / 2 : Math.min(Math.max(at, part), extent - part));
    this.x = within(this.x, this.width, half[0]);
    this.y = within(this.y, this.height, half[1]);
  }
}

// Moves a camera by the pointer. Calls `moved` after each change, and `clicked` with the pixel of a click.
class Pointer {
  constructor(canvas, camera, moved, clicked) {
    Object.assign(this, { canvas, camera, moved, clicked, down: new Map(), way: 0 });
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this.release(event));
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 30 : 1;
    const factor = Math.exp(-Math.min(Math.max(event.deltaY * lines, -300), 300) / 400);
    this.camera.zoomBy(factor, event.offsetX, event.offsetY);
    this.moved(false);
  }

  press(event) {
    if (event.button !== 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.down.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (this.down.size === 1) this.way = 0;
  }

  move(event) {
    const before = this.down.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    this.way += Math.hypot(dx, dy);
    const others = [...this.down].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    this.down.set(event.pointerId, now);
    if (others.length) {
      const apart = (at) => Math.hypot(at[0] - others[0][0], at[1] - others[0][1]);
      const middle = [(now[0] + others[0][0]) / 2, (now[1] + others[0][1]) / 2];
      this.camera.moveBy(dx / 2, dy / 2);
      this.camera.zoomBy(apart(now) / Math.max(apart(before), 1), ...middle);
      this.moved(true);
    } else if (this.way > 4) {
      this.camera.moveBy(dx, dy);
      this.moved(true);
    }
  }

  release(event) {
    if (!this.down.delete(event.pointerId)) return;
    if (event.type === "pointerup" && !this.down.size && this.way <= 4) this.clicked(event.offsetX, event.offsetY);
  }
}
