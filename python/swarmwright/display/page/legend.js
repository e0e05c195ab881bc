// The meaning of shapes and colours, and the count of each.

class Legend {
  constructor(list, episodes) {
    Object.assign(this, { list, episodes });
    this.entries = new Map();
    for (const episode of episodes.filter(({ bodies }) => bodies))
      for (const [kind, state] of episode.bodies.looks) {
        if (isOff(kind, state)) continue;
        const name = label(kind, state);
        if (this.entries.has(name)) continue;
        const words = title(kind, state);
        const { shape, directed } = look(kind, state);
        const drawn = this.add(words, look(kind, state));
        this.entries.set(name, { ...drawn, words, shape: directed ? "directed" : shape, counted: kind !== PAGE.stretch });
      }
    this.states = [];
    const names = [];
    for (const { groups, machines } of episodes.filter(({ states }) => states))
      machines.forEach(({ states, first_color: first = 0 }, index) =>
        states.forEach(({ name }, state) => {
          names[first + state] ??= new Set();
          names[first + state].add(`${groups ? groups[index].name : "controller"} in state ${state}${name ? `, ${name}` : ""}`);
        }),
      );
    names.forEach((words, index) => {
      const only = `controller in state ${index}`;
      const all = words.size > 1 && [...words].every((text) => text.startsWith(only)) ? only : [...words].join(" / ");
      this.states.push(this.add(all, { shape: "circle", color: stateColor(index) }));
    });
    this.signals = {};
    const line = (kind, name, color) => {
      if (episodes.some((episode) => episode[kind])) this.signals[kind] = this.line(name, color).item;
    };
    line("rays", "sensor ray", "defender");
    line("links", "message heard", "soft");
    this.gradient();
    for (const [grey, name] of PAGE.floors) this.floor(grey, name);
    const grounds = episodes.flatMap((episode) => (episode.ground || []).map(([, ground]) => ground));
    if (grounds.some(({ walls }) => walls.length)) this.add("wall", { shape: "square", color: "blockade" });
    if (grounds.some(({ lights }) => lights.length)) this.add("lamp", { shape: "circle", color: "exit" });
  }

  item(mark, name) {
    const item = element("li");
    const [text, count] = [element("span", {}, name), element("span")];
    item.append(mark, text, count);
    this.list.append(item);
    return { item, count };
  }

  // directed: draw a disc with a line in the direction of the heading.
  add(name, { shape, color, directed }) {
    const svg = element("svg", { viewBox: "-1.3 -1.3 2.6 2.6", "aria-hidden": "true" });
    svg.append(element("path", { d: PAGE.shapes[directed ? "circle" : shape], style: `fill: var(--${color})` }));
    if (directed) svg.append(element("path", { d: "M0 0H1", class: "heading" }));
    return this.item(svg, name);
  }

  line(name, color) {
    const svg = element("svg", { viewBox: "-1.3 -1.3 2.6 2.6", "aria-hidden": "true" });
    svg.append(element("line", { x1: -1.1, y1: 0.7, x2: 1.1, y2: -0.7, style: `stroke: var(--${color}); stroke-width: 0.25` }));
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

  // Returns whether bodies of this look differ in colour from the legend.
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

  // Shows the counts at a time, and returns them as text.
  // colors: source of the colours of bodies. drawn: whether rays and links are drawn.
  show(time, colors, drawn) {
    const counts = new Map();
    const inState = this.states.map(() => 0);
    for (const episode of this.episodes) {
      const [frame] = episode.moment(Math.min(time, episode.last));
      const lookCounts = new Array(episode.bodies.looks.length).fill(0);
      const { look: looks } = episode.series;
      for (let i = 0; i < episode.count; i++) {
        if (!episode.exists(frame, i)) continue;
        lookCounts[looks.at(frame, i)] += 1;
        const state = episode.stateOf(frame, episode.agents[i]);
        if (state >= 0) inState[episode.firstColorOf(i) + state] += 1;
      }
      lookCounts.forEach((count, index) => {
        const name = label(...episode.bodies.looks[index]);
        if (count) counts.set(name, (counts.get(name) || 0) + count);
      });
    }
    const shapes = new Map();
    for (const [name, { item, count, counted, shape }] of this.entries) {
      count.textContent = counted ? counts.get(name) || 0 : "";
      item.classList.toggle("none", !counts.has(name));
      const outlined = colors !== "state" && this.recolored(name, colors);
      item.classList.toggle("outlined", outlined);
      if (outlined) shapes.set(shape, [...(shapes.get(shape) || []), item]);
      item.classList.remove("alike");
    }
    // Outlines of the same shape cannot be distinguished.
    for (const items of shapes.values()) if (items.length > 1) for (const item of items) item.classList.add("alike");
    this.states.forEach(({ item, count }, state) => {
      item.hidden = colors !== "controller";
      count.textContent = inState[state];
      item.classList.toggle("none", !inState[state]);
    });
    for (const [kind, item] of Object.entries(this.signals)) item.hidden = !drawn[kind];
    if (this.scale) this.scale.hidden = colors !== "value";
    const visible = [...this.entries].filter(([name]) => counts.has(name));
    return visible.map(([name, { counted, words }]) => (counted ? `${counts.get(name)} ${words}` : words)).join("; ");
  }
}
