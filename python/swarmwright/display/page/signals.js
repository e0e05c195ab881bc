// What bodies sense and hear: rays of sensors, and lines between bodies of which one hears the other.

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
    const { episode, context: c, kept } = world;
    const wanted = world.view.links;
    if (!episode.links || wanted === "none" || (wanted === "selected" && world.selected < 0)) return;
    const { ends, starts } = episode.links;
    c.beginPath();
    for (let i = starts[kept]; i < starts[kept + 1]; i++) {
      const [from, to] = [ends[2 * i], ends[2 * i + 1]];
      if (wanted === "selected" && from !== world.selected && to !== world.selected) continue;
      c.moveTo(world.px[from], world.py[from]);
      c.lineTo(world.px[to], world.py[to]);
    }
    this.haloed(wanted === "selected" ? 1.5 : 1, "soft", 0.85);
  }

  // The more a sensor reads, the stronger its ray.
  rays() {
    const { world } = this;
    const { episode, context: c, kept, camera } = world;
    const wanted = world.view.rays;
    if (!episode.rays || wanted === "none" || (wanted === "selected" && world.selected < 0)) return;
    const { body, angle, start, length, reading } = episode.rays;
    c.lineCap = "round";
    for (let i = 0; i < body.base.length; i++) {
      const owner = body.at(kept, i);
      if (owner < 0 || (wanted === "selected" && owner !== world.selected)) continue;
      if (!world.seen(owner, 100)) continue;
      const heading = world.heading(owner) || 0;
      const along = heading + angle.at(kept, i);
      const [dx, dy] = [Math.cos(along) * camera.scale, -Math.sin(along) * camera.scale];
      const near = Math.max(start.at(kept, i), 0);
      const far = near + length.at(kept, i);
      const strong = Math.min(Math.max(reading.at(kept, i) || 0, 0), 1);
      const [x, y] = [world.px[owner], world.py[owner]];
      c.beginPath();
      c.moveTo(x + near * dx, y + near * dy);
      c.lineTo(x + far * dx, y + far * dy);
      if (strong > 0.05) this.haloed(1 + 2 * strong, "defender", 0.5 + 0.5 * strong);
      else this.haloed(1, "soft", 0.7);
    }
  }

  // Strokes the path with an edge, so that it is seen on a floor of its own colour, too.
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
