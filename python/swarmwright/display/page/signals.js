// Rays of sensors, and lines between bodies that hear each other's messages.

class Signals {
  constructor(world) {
    this.world = world;
  }

  draw() {
    this.links();
    this.rays();
  }

  links() {
    const { world } = this;
    const { episode, context: c, frame } = world;
    const choice = world.view.links;
    if (!episode.links || choice === "none" || (choice === "selected" && world.selected < 0)) return;
    const { ends, starts } = episode.links;
    c.beginPath();
    for (let i = starts[frame]; i < starts[frame + 1]; i++) {
      const [from, to] = [ends[2 * i], ends[2 * i + 1]];
      if (choice === "selected" && from !== world.selected && to !== world.selected) continue;
      c.moveTo(world.px[from], world.py[from]);
      c.lineTo(world.px[to], world.py[to]);
    }
    this.haloed(choice === "selected" ? 1.5 : 1, "soft", 0.85);
  }

  // Draws rays; higher readings are thicker.
  rays() {
    const { world } = this;
    const { episode, context: c, frame, camera } = world;
    const choice = world.view.rays;
    if (!episode.rays || choice === "none" || (choice === "selected" && world.selected < 0)) return;
    const { body, angle, start, length, reading } = episode.rays;
    c.lineCap = "round";
    for (let i = 0; i < body.base.length; i++) {
      const owner = body.at(frame, i);
      if (owner < 0 || (choice === "selected" && owner !== world.selected)) continue;
      if (!world.seen(owner, 100)) continue;
      const heading = world.heading(owner) || 0;
      const along = heading + angle.at(frame, i);
      const [dx, dy] = [Math.cos(along) * camera.scale, -Math.sin(along) * camera.scale];
      const innerRadius = Math.max(start.at(frame, i), 0);
      const outerRadius = innerRadius + length.at(frame, i);
      const strong = Math.min(Math.max(reading.at(frame, i) || 0, 0), 1);
      const [x, y] = [world.px[owner], world.py[owner]];
      c.beginPath();
      c.moveTo(x + innerRadius * dx, y + innerRadius * dy);
      c.lineTo(x + outerRadius * dx, y + outerRadius * dy);
      if (strong > 0.05) this.haloed(1 + 2 * strong, "defender", 0.5 + 0.5 * strong);
      else this.haloed(1, "soft", 0.7);
    }
  }

  // Strokes the path with an edge, so that it is visible on a floor of the same colour.
  haloed(width, color, alpha) {
    const { world } = this;
    const { context: c } = world;
    for (const [name, share, wide] of [["paper", 0.6, width + 1.2], [color, alpha, width]]) {
      c.strokeStyle = world.color(name);
      c.globalAlpha = share;
      c.lineWidth = wide;
      c.stroke();
    }
    c.globalAlpha = 1;
  }
}
