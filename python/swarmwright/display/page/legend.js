// What shapes and colours mean, and how many there are of each.

class Legend {
  constructor(list, episodes) {
    Object.assign(this, { list, episodes });
    this.entries = new Map();
    for (const episode of episodes.filter((one) => one.bodies))
      for (const [kind, state] of episode.bodies.looks) {
        if (isOff(kind, state)) continue;
        const name = label(kind, state);
        if (!this.entries.has(name)) this.entries.set(name, { ...this.add(name, look(kind, state)), counted: kind !== PAGE.stretch });
      }
    this.states = [];
    const machines = episodes.filter((one) => one.states).flatMap((one) => one.machines);
    const most = Math.max(0, ...machines.map(({ states }) => states.length));
    for (let state = 0; state < most; state++) {
      const words = [...new Set(machines.map(({ states }) => (states[state] || {}).name))];
      const only = words.length === 1 && words[0] ? `, ${words[0]}` : "";
      this.states.push(this.add(`controller in state ${state}${only}`, { shape: "circle", color: stateColor(state) }));
    }
    this.gradient();
    for (const [grey, name] of PAGE.floors) this.floor(grey, name);
    const grounds = episodes.flatMap((one) => (one.ground || []).map(([, ground]) => ground));
    if (grounds.some(({ walls }) => walls.length)) this.add("wall", { shape: "square", color: "blockade" });
    if (grounds.some(({ lights }) => lights.length)) this.add("light", { shape: "circle", color: "exit" });
  }

  item(mark, name) {
    const item = element("li");
    const [text, count] = [element("span", {}, name), element("span")];
    item.append(mark, text, count);
    this.list.append(item);
    return { item, count };
  }

  add(name, { shape, color }) {
    const svg = element("svg", { viewBox: "-1.3 -1.3 2.6 2.6", "aria-hidden": "true" });
    svg.append(element("path", { d: PAGE.shapes[shape], style: `fill: var(--${color})` }));
    return this.item(svg, name);
  }

  floor(grey, name) {
    const swatch = element("span", { class: "floor", "aria-hidden": "true" });
    const [from, to] = grey < 0.5 ? [0, 1] : [1, 2];
    const share = 100 * (grey < 0.5 ? 2 * grey : 2 * grey - 1);
    swatch.style.background = `color-mix(in srgb, var(--floor-${to}) ${share}%, var(--floor-${from}))`;
    this.item(swatch, name);
  }

  gradient() {
    if (!PAGE.scale) return;
    const { name, low, high } = PAGE.scale;
    const item = element("li", { class: "scale" });
    item.append(element("span", {}, name), element("span", {}, words(low)), element("i"), element("span", {}, words(high)));
    this.list.append(item);
    this.scale = item;
  }

  // Whether bodies of this look have other colours than the legend's.
  recolored(name, colors) {
    return this.episodes.some((episode) => {
      const { value, look: looks } = episode.series;
      for (let i = 0; i < episode.count; i++) {
        if (label(...episode.bodies.looks[looks.at(0, i)]) !== name) continue;
        return colors === "controller" ? episode.stateOf(0, episode.agents[i]) >= 0 : value.changes(i) || !Number.isNaN(value.at(0, i));
      }
      return false;
    });
  }

  // Counts what there is at a time; colors: what gives bodies their colours. Returns it in words.
  show(time, colors) {
    const counts = new Map();
    const inState = this.states.map(() => 0);
    for (const episode of this.episodes) {
      const [kept] = episode.moment(Math.min(time, episode.last));
      const of = new Array(episode.bodies.looks.length).fill(0);
      const { look: looks } = episode.series;
      for (let i = 0; i < episode.count; i++) {
        if (!episode.exists(kept, i)) continue;
        of[looks.at(kept, i)] += 1;
        const state = episode.stateOf(kept, episode.agents[i]);
        if (state >= 0) inState[state] += 1;
      }
      of.forEach((count, index) => {
        const name = label(...episode.bodies.looks[index]);
        if (count) counts.set(name, (counts.get(name) || 0) + count);
      });
    }
    for (const [name, { item, count, counted }] of this.entries) {
      count.textContent = counted ? counts.get(name) || 0 : "";
      item.classList.toggle("none", !counts.has(name));
      item.classList.toggle("outlined", colors !== "state" && this.recolored(name, colors));
    }
    this.states.forEach(({ item, count }, state) => {
      item.hidden = colors !== "controller";
      count.textContent = inState[state];
      item.classList.toggle("none", !inState[state]);
    });
    if (this.scale) this.scale.hidden = colors !== "value";
    const there = [...this.entries].filter(([name]) => counts.has(name));
    return there.map(([name, { counted }]) => (counted ? `${counts.get(name)} ${name}` : name)).join("; ");
  }
}
