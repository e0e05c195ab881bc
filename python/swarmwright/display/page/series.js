// Numbers of the episode, packed by `__init__.py`.

// Returns the bytes of packed numbers: in base64 in a page, or a part of the bytes that were sent.
function bytes({ data, at, size }) {
  if (data === undefined) return new Uint8Array(PAGE.sent, PAGE.start + at, size);
  const raw = atob(data);
  const result = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) result[i] = raw.charCodeAt(i);
  return result;
}

const ARRAYS = { f4: Float32Array, i4: Int32Array, u2: Uint16Array, q2: Uint16Array, u1: Uint8Array, q1: Uint8Array };
const NO_STATE = 255;

// Unpacks numbers to an array; numbers of 1 or 2 bytes are shares of a range, the largest is NaN.
function unpack(packed) {
  const { type, low, high } = packed;
  const { buffer, byteOffset, byteLength } = bytes(packed);
  const Kind = ARRAYS[type];
  const parts = new Kind(buffer, byteOffset, byteLength / Kind.BYTES_PER_ELEMENT);
  if (type !== "q2" && type !== "q1") return parts;
  const none = type === "q2" ? 65535 : 255;
  const values = new Float32Array(parts.length);
  const step = (high - low) / (none - 1);
  for (let i = 0; i < parts.length; i++) values[i] = parts[i] === none ? NaN : low + parts[i] * step;
  return values;
}

// A number of each body at each recorded scene; constant numbers are stored once.
class Series {
  constructor({ base, which, data }) {
    this.base = unpack(base);
    const changing = unpack(which);
    this.width = changing.length;
    this.slot = new Int32Array(this.base.length).fill(-1);
    changing.forEach((index, slot) => (this.slot[index] = slot));
    this.data = this.width ? unpack(data) : null;
  }

  at(frame, index) {
    const slot = this.slot[index];
    return slot < 0 ? this.base[index] : this.data[frame * this.width + slot];
  }

  changes(index) {
    return this.slot[index] >= 0;
  }

  // Interpolates between two scenes.
  between(frame, share, index) {
    const here = this.at(frame, index);
    if (share === 0 || this.slot[index] < 0) return here;
    const next = this.at(frame + 1, index);
    return Number.isNaN(next) ? here : here + share * (next - here);
  }

  // Interpolates angles in the shorter direction.
  turned(frame, share, index) {
    const here = this.at(frame, index);
    if (share === 0 || this.slot[index] < 0) return here;
    const turn = this.at(frame + 1, index) - here;
    return here + share * (turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI)) || 0);
  }
}

// An episode with its bodies and their record.
class Episode {
  constructor(data) {
    Object.assign(this, data);
    this.last = data.fitness.length - 1;
    if (data.pictures) {
      this.count = 0;
      return;
    }
    const { bodies, rays, links, states } = data;
    this.count = bodies.count;
    this.series = Object.fromEntries(Object.entries(bodies.series).map(([name, packed]) => [name, new Series(packed)]));
    this.agents = unpack(bodies.agents);
    this.keys = unpack(data.keys);
    this.bodyOf = new Map();
    this.agents.forEach((agent, body) => agent >= 0 && this.bodyOf.set(agent, body));
    this.rays = rays && Object.fromEntries(Object.entries(rays).map(([name, packed]) => [name, new Series(packed)]));
    this.links = links && { ends: unpack(links.ends), starts: unpack(links.starts) };
    this.states = states && { ...states, at: unpack(states.at) };
    this.traced = [];
    this.agentCount = bodies.looks.reduce((sum, [kind], index) => sum + (kind === "agent" ? bodies.most[index] : 0), 0);
    this.directed = [...this.series.heading.base].some((heading) => !Number.isNaN(heading)) || this.series.heading.width > 0;
  }

  // Returns the values of a sensor or an actuator, unpacked when an agent is first followed.
  tracedValues(index) {
    this.traced[index] ??= unpack(this.trace.values[index]);
    return this.traced[index];
  }

  // Returns the last recorded scene at a time in steps, and the share of the time to the next scene.
  moment(time) {
    const { keys } = this;
    let frame = Math.min(Math.floor(time / this.stride), keys.length - 1);
    while (frame > 0 && keys[frame] > time) frame -= 1;
    if (frame === keys.length - 1) return [frame, 0];
    return [frame, (time - keys[frame]) / (keys[frame + 1] - keys[frame])];
  }

  lookAt(frame, body) {
    return this.bodies.looks[this.series.look.at(frame, body)];
  }

  exists(frame, body) {
    return !Number.isNaN(this.series.x.at(frame, body)) && !Number.isNaN(this.series.y.at(frame, body));
  }

  // Returns the state of an agent's state machine; -1 without a state.
  stateOf(frame, agent) {
    const { states } = this;
    if (!states || agent < 0) return -1;
    const state = agent < states.agents ? states.at[frame * states.agents + agent] : 0;
    return state === NO_STATE ? -1 : state;
  }

  // Returns the kind of an agent, with its names of sensors and actuators; undefined if all agents are alike.
  kindOf(agent) {
    return this.trace ? this.trace.kinds.find(({ end }) => agent < end) : undefined;
  }

  // The state machine of all agents, or those of the groups of a team.
  get machines() {
    if (this.groups) return this.groups.map(({ machine }) => machine);
    return this.machine ? [this.machine] : [];
  }

  // Returns the group of a body in a team, by its kind or state, or else its index; undefined without a machine.
  groupOf(body) {
    const agent = this.agents[body];
    const named = this.groups.find(({ name }) => this.lookAt(0, body).includes(name));
    return named || this.groups.find(({ first, end }) => first !== null && agent >= first && (end === null || agent < end));
  }

  // Returns the index of the colour of state 0 of a body's controller: each group of a team has its own colours.
  firstColorOf(body) {
    if (!this.groups) return 0;
    this.firstColors ??= Array.from({ length: this.count }, (_, index) => (this.groupOf(index) || { machine: { first_color: 0 } }).machine.first_color);
    return this.firstColors[body];
  }

  groundAt(scene) {
    let current = this.ground[0][1];
    for (const [from, ground] of this.ground) if (from <= scene) current = ground;
    return current;
  }

  // Returns the number that colours a body, as a share of the range; NaN for none.
  share(frame, body) {
    const { low, high } = PAGE.scale;
    return (this.series.value.at(frame, body) - low) / (high - low);
  }
}
