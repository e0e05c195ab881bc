// Numbers of the episode, as `_series.py` packs them.

function bytes(text) {
  const raw = atob(text);
  const found = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) found[i] = raw.charCodeAt(i);
  return found;
}

const NO_STATE = 255;

// Packed numbers as an array; numbers of 1 or 2 bytes are parts of a range, the largest one is none.
function unpack({ type, data, low, high }) {
  const buffer = bytes(data).buffer;
  if (type === "f4") return new Float32Array(buffer);
  if (type === "i4") return new Int32Array(buffer);
  const parts = type === "q2" ? new Uint16Array(buffer) : new Uint8Array(buffer);
  if (type === "u1") return parts;
  const none = type === "q2" ? 65535 : 255;
  const found = new Float32Array(parts.length);
  const step = (high - low) / (none - 1);
  for (let i = 0; i < parts.length; i++) found[i] = parts[i] === none ? NaN : low + parts[i] * step;
  return found;
}

// A number of each of many things at each scene that is kept; what never changes is there once.
class Series {
  constructor({ base, which, data }) {
    this.base = unpack(base);
    const changing = unpack(which);
    this.width = changing.length;
    this.slot = new Int32Array(this.base.length).fill(-1);
    changing.forEach((index, slot) => (this.slot[index] = slot));
    this.data = this.width ? unpack(data) : null;
  }

  at(kept, index) {
    const slot = this.slot[index];
    return slot < 0 ? this.base[index] : this.data[kept * this.width + slot];
  }

  changes(index) {
    return this.slot[index] >= 0;
  }

  // Between two scenes.
  between(kept, share, index) {
    const here = this.at(kept, index);
    if (share === 0 || this.slot[index] < 0) return here;
    const next = this.at(kept + 1, index);
    return Number.isNaN(next) ? here : here + share * (next - here);
  }

  // The same for angles, the shorter way around.
  turned(kept, share, index) {
    const here = this.at(kept, index);
    if (share === 0 || this.slot[index] < 0) return here;
    const turn = this.at(kept + 1, index) - here;
    return here + share * (turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI)) || 0);
  }
}

// An episode: its bodies and all that is known of them.
class Episode {
  constructor(data) {
    Object.assign(this, data);
    this.last = data.fitness.length - 1;
    if (data.pictures) {
      this.count = 0;
      return;
    }
    const { bodies, rays, links, trace, states } = data;
    this.count = bodies.count;
    this.series = Object.fromEntries(Object.entries(bodies.series).map(([name, packed]) => [name, new Series(packed)]));
    this.agents = unpack(bodies.agents);
    this.keys = unpack(data.keys);
    this.bodyOf = new Map();
    this.agents.forEach((agent, body) => agent >= 0 && this.bodyOf.set(agent, body));
    this.rays = rays && Object.fromEntries(Object.entries(rays).map(([name, packed]) => [name, new Series(packed)]));
    this.links = links && { ends: unpack(links.ends), starts: unpack(links.starts) };
    this.states = states && { ...states, at: unpack(states.at) };
    this.trace = trace && { ...trace, values: trace.values.map(unpack) };
    this.agentCount = bodies.looks.reduce((sum, [kind], index) => sum + (kind === "agent" ? bodies.most[index] : 0), 0);
    this.directed = [...this.series.heading.base].some((heading) => !Number.isNaN(heading)) || this.series.heading.width > 0;
  }

  // The last scene that is kept until a time in steps, and the share of the way to the next one.
  moment(time) {
    const { keys } = this;
    let kept = Math.min(Math.floor(time / this.stride), keys.length - 1);
    while (kept > 0 && keys[kept] > time) kept -= 1;
    if (kept === keys.length - 1) return [kept, 0];
    return [kept, (time - keys[kept]) / (keys[kept + 1] - keys[kept])];
  }

  lookAt(kept, body) {
    return this.bodies.looks[this.series.look.at(kept, body)];
  }

  exists(kept, body) {
    return !Number.isNaN(this.series.x.at(kept, body)) && !Number.isNaN(this.series.y.at(kept, body));
  }

  // The number of the state of an agent's state machine; -1 without one.
  stateOf(kept, agent) {
    const { states } = this;
    if (!states || agent < 0) return -1;
    const state = agent < states.agents ? states.at[kept * states.agents + agent] : 0;
    return state === NO_STATE ? -1 : state;
  }

  // The kind of an agent with its own names of sensors and actuators; none where all are alike.
  kindOf(agent) {
    return this.trace ? this.trace.kinds.find(({ end }) => agent < end) : undefined;
  }

  // The state machines of its agents: that of all, or those of the groups of a team.
  get machines() {
    if (this.groups) return this.groups.map(({ machine }) => machine);
    return this.machine ? [this.machine] : [];
  }

  // The group of a team that a body belongs to, by its kind or state, else by its number; none for one without a machine.
  groupOf(body) {
    const agent = this.agents[body];
    const named = this.groups.find(({ name }) => this.lookAt(0, body).includes(name));
    return named || this.groups.find(({ first, end }) => first !== null && agent >= first && (end === null || agent < end));
  }

  // The index of the colour of state 0 of the controller of a body: each group of a team has its own colours.
  firstColorOf(body) {
    if (!this.groups) return 0;
    this.firstColors ??= Array.from({ length: this.count }, (_, one) => (this.groupOf(one) || { machine: { first_color: 0 } }).machine.first_color);
    return this.firstColors[body];
  }

  groundAt(scene) {
    let found = this.ground[0][1];
    for (const [from, ground] of this.ground) if (from <= scene) found = ground;
    return found;
  }

  // A number that gives a body its colour, as a share of the range; NaN for none.
  share(kept, body) {
    const { low, high } = PAGE.scale;
    return (this.series.value.at(kept, body) - low) / (high - low);
  }
}
