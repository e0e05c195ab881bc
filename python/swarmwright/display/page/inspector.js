// The agent that is followed: state of its controller, sensors and actuators over time, a row for each.

const ROW = 20;
const MOST_DRAWN = 600; // points of a curve
const WIDE = 420; // pixels from which on limits are written

const limits = ({ low, high }) => (low === high ? words(low) : `${words(low, 3)} to ${words(high, 3)}`);

class Inspector {
  constructor(part) {
    this.part = part;
    part.timeline.addEventListener("pointerdown", (event) => this.scrub(event));
    part.timeline.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) this.scrub(event);
      this.hint(event.offsetY);
    });
  }

  // The whole name of a row, and its limits.
  hint(y) {
    const row = this.rows && this.rows[Math.floor((y - (this.hasStates() ? ROW + 6 : 0)) / ROW)];
    this.part.timeline.title = row ? `${row.name}: ${limits(row)}` : "";
  }

  // In the place of an agent that is not there.
  none(text) {
    const { part } = this;
    this.rows = [];
    part.timeline.style.height = "0";
    part.timeline.hidden = true;
    part.missing.hidden = false;
    part.missing.textContent = text;
  }

  scrub(event) {
    if (!this.episode) return;
    const share = (event.offsetX - this.left) / this.width;
    this.jump(Math.round(Math.min(Math.max(share, 0), 1) * this.episode.last));
  }

  // The numbers of an agent at the kept scenes, by row: name and values; none for agents that are not kept.
  choose(episode, body) {
    this.episode = episode;
    this.body = body;
    this.agent = episode.agents[body];
    const { trace } = episode;
    this.rows = [];
    this.left = 130;
    if (trace && this.agent < trace.agents) {
      // What the agent's kind does not have says nothing.
      const kind = episode.kindOf(this.agent);
      const named = (kind ? kind.names : trace.names).map((name, index) => [name, index]);
      this.rows = named.filter(([name]) => name !== null).map(([name, index]) => {
        const values = Float32Array.from(episode.keys, (_, kept) => trace.values[index][kept * trace.agents + this.agent]);
        const finite = values.filter((value) => !Number.isNaN(value));
        const [low, high] = finite.reduce(([l, h], value) => [Math.min(l, value), Math.max(h, value)], [0, 0]);
        const actuator = index >= trace.sensors;
        return { name, values, low, high: actuator ? Math.max(high, 1) : high, actuator };
      });
      this.sameLimits();
    }
    const { part } = this;
    part.missing.hidden = this.rows.length > 0;
    part.missing.textContent = trace
      ? `Sensors and actuators of the first ${trace.agents} agents are on this page.`
      : "This page has no sensors and actuators.";
    part.timeline.style.height = `${this.height()}px`;
    part.timeline.hidden = !this.height();
  }

  // Rows of one kind, such as proximity 0 and proximity 1, have the same limits. Numbers alone tell of no kind.
  sameLimits() {
    const kinds = new Map();
    for (const row of this.rows) {
      const kind = /^(sensor|actuator) \d+$/.test(row.name) ? row.name : row.name.replace(/[\s_]*\d+$/, "");
      kinds.set(kind, [...(kinds.get(kind) || []), row]);
    }
    for (const rows of kinds.values()) {
      const [low, high] = [Math.min(...rows.map((row) => row.low)), Math.max(...rows.map((row) => row.high))];
      for (const row of rows) [row.low, row.high] = [low, high];
    }
  }

  hasStates() {
    return this.episode.stateOf(0, this.agent) >= 0;
  }

  height() {
    const machine = this.hasStates() ? ROW + 6 : 0;
    return machine + this.rows.length * ROW + (machine || this.rows.length ? 4 : 0);
  }

  draw(time) {
    const { part, episode } = this;
    const [kept] = episode.moment(time);
    const canvas = part.timeline;
    const width = canvas.clientWidth;
    if (!width || canvas.hidden) return;
    const c = fit(canvas, width, this.height());
    const color = theme();
    c.font = FONT;
    // The limits of each row stand beside it where there is room.
    const ranges = width < WIDE ? 0 : Math.max(0, ...this.rows.map((row) => c.measureText(limits(row)).width + 10));
    const values = 52 + ranges;
    this.left = Math.min(Math.max(60, ...this.rows.map(({ name }) => c.measureText(name).width + 10)), width * 0.42);
    this.width = width - this.left - values;
    const x = (scene) => this.left + (this.width * scene) / Math.max(episode.last, 1);
    c.textBaseline = "middle";
    let top = 0;
    if (this.hasStates()) {
      this.text(c, color("soft"), "state", 0, ROW / 2, this.left - 6);
      this.band(c, color, x);
      c.textAlign = "right";
      c.fillStyle = color("ink");
      c.fillText(String(episode.stateOf(kept, this.agent)), width, ROW / 2);
      top = ROW + 6;
    }
    this.rows.forEach((row, index) => this.row(c, color, row, top + index * ROW, x, kept, width));
    c.strokeStyle = color("ink");
    c.lineWidth = 1;
    c.beginPath();
    c.moveTo(x(time), 0);
    c.lineTo(x(time), this.height());
    c.stroke();
  }

  // Shortened in the middle where it is too long, since names begin with kinds and end with numbers.
  text(c, color, text, x, y, most) {
    c.textAlign = "left";
    c.fillStyle = color;
    let [shown, kept] = [text, text.length];
    while (kept > 2 && c.measureText(shown).width > most) {
      kept -= 1;
      shown = `${text.slice(0, Math.floor(kept / 2))}…${text.slice(text.length - Math.ceil(kept / 2))}`;
    }
    c.fillText(shown, x, y);
  }

  // The states of the controller over time.
  band(c, color, x) {
    const { episode, agent } = this;
    const { keys } = episode;
    let from = 0;
    for (let kept = 1; kept <= keys.length; kept++) {
      const state = episode.stateOf(from, agent);
      if (kept < keys.length && episode.stateOf(kept, agent) === state) continue;
      c.fillStyle = color(stateColor(state));
      const end = kept < keys.length ? keys[kept] : episode.last;
      c.fillRect(x(keys[from]), 3, Math.max(x(end) - x(keys[from]), 0.6), ROW - 6);
      from = kept;
    }
  }

  row(c, color, row, top, x, kept, width) {
    const { name, values, low, high, actuator } = row;
    const y = (value) => top + ROW - 4 - ((ROW - 7) * (value - low)) / Math.max(high - low, 1e-30);
    this.text(c, color("soft"), name, 0, top + ROW / 2, this.left - 6);
    c.strokeStyle = color("grid");
    c.lineWidth = 1;
    c.beginPath();
    c.moveTo(this.left, y(0));
    c.lineTo(this.left + this.width, y(0));
    c.stroke();
    c.strokeStyle = color(actuator ? "defender" : "accent");
    c.lineWidth = 1.2;
    c.lineJoin = "round";
    c.beginPath();
    const { keys } = this.episode;
    const stride = Math.max(1, Math.floor(values.length / MOST_DRAWN));
    let pen = false;
    for (let k = 0; k < values.length; k += stride) {
      const value = values[k];
      if (Number.isNaN(value)) {
        pen = false;
        continue;
      }
      c[pen ? "lineTo" : "moveTo"](x(keys[k]), y(value));
      pen = true;
    }
    c.stroke();
    c.textAlign = "right";
    c.fillStyle = color("ink");
    const value = values[kept];
    c.fillText(Number.isNaN(value) ? "–" : words(+value.toFixed(3)), width, top + ROW / 2);
    if (width < WIDE) return;
    c.textAlign = "left";
    c.fillStyle = color("soft");
    c.fillText(limits(row), this.left + this.width + 8, top + ROW / 2);
  }
}
