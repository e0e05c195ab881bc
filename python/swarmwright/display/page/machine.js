// A diagram of the state machine of controllers: states on a circle, arrows for transitions, the active state highlighted.

const STATE_RADIUS = 19;

class Machine {
  constructor(host, list, machine) {
    Object.assign(this, { host, list, machine });
    const count = machine.states.length;
    // pixels, radius with room for states and their names
    this.far = count < 2 ? 0 : Math.max(Math.min(95, 48 + 9 * count), 9.5 * count);
    this.positions = machine.states.map((_, index) => this.position(index));
    this.svg = element("svg", { viewBox: this.size().join(" "), role: "img", class: count > 8 ? "machine large" : "machine" });
    this.arrows();
    this.states = machine.states.map((state, index) => this.state(state, index));
    host.replaceChildren(this.svg);
    this.lines();
  }

  size() {
    const [wide, high] = [this.far * 1.25 + 62, this.far + 44];
    return [-wide, -high, 2 * wide, 2 * high];
  }

  position(index) {
    const angle = (2 * Math.PI * index) / this.machine.states.length - Math.PI / 2;
    return [this.far * 1.25 * Math.cos(angle), this.far * Math.sin(angle)];
  }

  // Draws an arrow for all transitions between two states.
  arrows() {
    const pairs = new Map();
    this.machine.transitions.forEach(([from, to]) => pairs.set(`${from} ${to}`, [from, to]));
    this.paths = [...pairs.values()].map(([from, to]) => {
      const path = element("path", { d: this.arrow(from, to), class: "arrow" });
      const head = element("path", { d: this.head, class: "head" });
      this.svg.append(path, head);
      return { from, to, parts: [path, head] };
    });
  }

  arrow(from, to) {
    const r = STATE_RADIUS;
    const [[ax, ay], [bx, by]] = [this.positions[from], this.positions[to]];
    if (from === to) {
      const out = Math.hypot(ax, ay) || 1;
      const [ux, uy] = ax || ay ? [ax / out, ay / out] : [0, -1];
      const [x, y] = [ax + ux * r, ay + uy * r];
      const side = (sign, far) => `${x + ux * far - sign * uy * 14} ${y + uy * far + sign * ux * 14}`;
      this.tip(x - uy * 4, y + ux * 4, -ux, -uy);
      return `M${x + uy * 5} ${y - ux * 5}C${side(-1, 24)} ${side(1, 24)} ${x - uy * 5} ${y + ux * 5}`;
    }
    const way = Math.hypot(bx - ax, by - ay);
    const [ux, uy] = [(bx - ax) / way, (by - ay) / way];
    // Bend to the right, so that the arrows of both directions are visible.
    const bend = Math.min(way * 0.16, 18);
    const [mx, my] = [(ax + bx) / 2 - uy * bend, (ay + by) / 2 + ux * bend];
    const towards = (x, y) => {
      const far = Math.hypot(mx - x, my - y);
      return [(mx - x) / far, (my - y) / far];
    };
    const [sx, sy] = towards(ax, ay);
    const [ex, ey] = towards(bx, by);
    const end = [bx + ex * (r + 2), by + ey * (r + 2)];
    this.tip(...end, -ex, -ey);
    return `M${ax + sx * r} ${ay + sy * r}Q${mx} ${my} ${end[0] + ex * 4} ${end[1] + ey * 4}`;
  }

  tip(x, y, dx, dy) {
    this.head = `M${x} ${y}L${x - dx * 8 - dy * 4} ${y - dy * 8 + dx * 4}L${x - dx * 8 + dy * 4} ${y - dy * 8 - dx * 4}Z`;
  }

  color(index) {
    return stateColor((this.machine.first_color || 0) + index);
  }

  state(state, index) {
    const [x, y] = this.positions[index];
    const group = element("g", { class: "state" });
    const circle = element("circle", { cx: x, cy: y, r: STATE_RADIUS });
    circle.style.setProperty("--state", `var(--${this.color(index)})`);
    const number = element("text", { x, y, class: "number" }, String(index));
    group.append(circle, number, this.name(x, y, state), element("title", {}, state.words));
    this.svg.append(group);
    return { group, number };
  }

  name(x, y, state) {
    const below = y >= -1 ? y + STATE_RADIUS + 13 : y - STATE_RADIUS - 6;
    return element("text", { x, y: below, class: "name" }, state.name);
  }

  // Lists states and transitions as text.
  lines() {
    this.list.replaceChildren();
    this.rows = this.machine.states.map((_, index) => {
      const row = element("li");
      const mark = element("span", { class: "swatch" });
      mark.style.background = `var(--${this.color(index)})`;
      row.append(mark);
      this.words(row, index);
      this.list.append(row);
      return row;
    });
  }

  words(row, index) {
    const { states, transitions } = this.machine;
    const own = transitions.filter(([from]) => from === index);
    const inner = element("ul");
    for (const [, to, text] of own) inner.append(element("li", {}, `to ${to}: ${text}`));
    row.append(element("b", {}, `${index} ${states[index].words}`.replace(/^(\d+) state \d+$/, "state $1")), inner);
  }

  // active: state of the followed agent, -1 for none. before: its previous state. counts: number of agents in each state.
  show(active, before, counts) {
    const all = counts.reduce((sum, count) => sum + count, 0);
    this.states.forEach(({ group, number }, index) => {
      const share = active >= 0 ? Number(index === active) : all ? counts[index] / all : 0;
      group.classList.toggle("active", active >= 0 ? index === active : counts[index] > 0);
      group.style.setProperty("--share", share);
      number.classList.toggle("long", active < 0 && counts[index] > 999);
      number.textContent = active >= 0 ? String(index) : String(counts[index]);
      this.rows[index].classList.toggle("active", index === active);
    });
    for (const { from, to, parts } of this.paths)
      for (const part of parts) part.classList.toggle("taken", active >= 0 && to === active && from === before && from !== to);
    this.svg.setAttribute(
      "aria-label",
      active >= 0 ? `In state ${active}` : counts.map((count, index) => `${count} in state ${index}`).join("; "),
    );
  }
}
