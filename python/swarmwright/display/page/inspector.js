// The followed agent: state of its controller, sensors and actuators over time, a row for each.

const ROW = 20;
const MOST_DRAWN = 600; // points of a curve
const WIDE = 420; // pixels; wider timelines show limits

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

  // Shows the full name of a row and its limits as a tooltip.
  hint(y) {
    const row = this.rows && this.rows[Math.floor((y - (this.hasStates() ? ROW + 6 : 0)) / ROW)];
    this.part.timeline.title = row ? `${row.name}: ${limits(row)}` : "";
  }

  // Shows a text instead of a missing agent.
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

  // Selects an agent: rows with name and values at the recorded scenes; no rows for agents without a record.
  choose(episode, body) {
    this.episode = episode;
    this.body = body;
    this.agent = episode.agents[body];
    const { trace } = episode;
    this.rows = [];
    this.left = 130;
    if (trace && this.agent < trace.agents) {
      // Skip names that the kind of the agent does not have.
      const kind = episode.kindOf(this.agent);
      const named = (kind ? kind.names : trace.names).map((name, index) => [name, index]);
      this.rows = named.filter(([name]) => name !== null).map(([name, index]) => {
        const traced = episode.tracedValues(index);
        const values = Float32Array.from(episode.keys, (_, frame) => traced[frame * trace.agents + this.agent]);
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

  // Gives rows of a kind, such as proximity 0 and proximity 1, the same limits. A bare number is not a kind.
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
    const [frame] = episode.moment(time);
    const canvas = part.timeline;
    const width = canvas.clientWidth;
    if (!width || canvas.hidden) return;
    const c = fit(canvas, width, this.height());
    const color = theme();
    c.font = FONT;
    // Show the limits beside each row if there is room.
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
      c.fillText(String(episode.stateOf(frame, this.agent)), width, ROW / 2);
      top = ROW + 6;
    }
    this.rows.forEach((row, index) => this.row(c, color, row, top + index * ROW, x, frame, width));
    c.strokeStyle = color("ink");
    c.lineWidth = 1;
    c.beginPath();
    c.moveTo(x(time), 0);
    c.lineTo(x(time), this.height());
    c.stroke();
  }

  // Draws a text, shortened in the middle: names begin with kinds and end with numbers.
  text(c, color, text, x, y, most) {
    c.textAlign = "left";
    c.fillStyle = color;
    let [label, length] = [text, text.length];
    while (length > 2 && c.measureText(label).width > most) {
      length -= 1;
      label = `${text.slice(0, Math.floor(length / 2))}…${text.slice(text.length - Math.ceil(length / 2))}`;
    }
    c.fillText(label, x, y);
  }

  // Draws the states of the controller over time.
  band(c, color, x) {
    const { episode, agent } = this;
    const { keys } = episode;
    let from = 0;
    for (let frame = 1; frame <= keys.length; frame++) {
      const state = episode.stateOf(from, agent);
      if (frame < keys.length && episode.stateOf(frame, agent) === state) continue;
      c.fillStyle = color(stateColor(state));
      const end = frame < keys.length ? keys[frame] : episode.last;
      c.fillRect(x(keys[from]), 3, Math.max(x(end) - x(keys[from]), 0.6), ROW - 6);
      from = frame;
    }
  }

  row(c, color, row, top, x, frame, width) {
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
    const value = values[frame];
    c.fillText(Number.isNaN(value) ? "–" : words(+value.toFixed(3)), width, top + ROW / 2);
    if (width < WIDE) return;
    c.textAlign = "left";
    c.fillStyle = color("soft");
    c.fillText(limits(row), this.left + this.width + 8, top + ROW / 2);
  }
}
