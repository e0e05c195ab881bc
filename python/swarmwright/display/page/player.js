// Plays the episode: what time it is, and what buttons, keys and the address say.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 32];

class Player {
  constructor(episode) {
    this.episode = episode;
    this.last = episode.fitness.length - 1;
    this.time = 0; // in steps
    this.playing = false;
    this.part = Object.fromEntries([...document.querySelectorAll("[id]")].map((part) => [part.id, part]));
    this.world = episode.pictures
      ? new Pictures(this.part.world, episode, () => this.shown !== undefined && this.show())
      : new World(this.part.world, episode);
    // Without bodies there is nothing to count, and nothing leaves a trail.
    for (const id of ["bodies", "trails", "trails-key"]) this.part[id].hidden = !episode.bodies.length;
    this.curve = new FitnessCurve(this.part.curve, episode.fitness);
    this.gliding = !window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.part.scrub.max = this.last;
    this.speeds(episode.speed);
    this.legend();
    this.listen();
    this.fromAddress();
  }

  speeds(first) {
    const all = SPEEDS.includes(first) ? SPEEDS : [...SPEEDS, first].sort((a, b) => a - b);
    this.part.speed.append(...all.map((factor) => new Option(`${words(factor)} ×`, factor, factor === first, factor === first)));
  }

  legend() {
    this.entries = new Map();
    for (const body of this.episode.bodies)
      for (const [, state] of body.states)
        if (!this.entries.has(label(body.kind, state))) this.entries.set(label(body.kind, state), this.entry(body.kind, state));
  }

  entry(kind, state) {
    const { shape, color } = look(kind, state);
    const item = document.createElement("li");
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("viewBox", "-1.3 -1.3 2.6 2.6");
    svg.setAttribute("aria-hidden", "true");
    const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
    path.setAttribute("d", EPISODE.shapes[shape]);
    path.setAttribute("style", `fill: var(--${color})`);
    svg.append(path);
    const [name, count] = [document.createElement("span"), document.createElement("span")];
    name.textContent = label(kind, state);
    item.append(svg, name, count);
    this.part.legend.append(item);
    return { item, count };
  }

  listen() {
    const { part } = this;
    part.play.addEventListener("click", () => this.toggle());
    part.first.addEventListener("click", () => this.go(0));
    part.last.addEventListener("click", () => this.go(this.last));
    part.back.addEventListener("click", () => this.go(Math.ceil(this.time) - 1));
    part.on.addEventListener("click", () => this.go(Math.floor(this.time) + 1));
    part.scrub.addEventListener("input", () => this.go(Number(part.scrub.value)));
    part.trail.addEventListener("change", () => this.show());
    part.theme.addEventListener("click", () => this.turnTheme());
    const scrub = (event) => event.buttons & 1 && this.go(this.curve.step(event.offsetX));
    part.curve.addEventListener("pointerdown", (event) => {
      part.curve.setPointerCapture(event.pointerId);
      scrub(event);
    });
    part.curve.addEventListener("pointermove", scrub);
    document.addEventListener("keydown", (event) => this.key(event));
    window.addEventListener("hashchange", () => this.fromAddress());
    new ResizeObserver(() => this.show()).observe(part.world.parentElement);
    window.addEventListener("resize", () => this.show());
    const dark = window.matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", () => this.showTheme());
    this.showTheme();
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === "SELECT") return;
    const onButton = event.target.tagName === "BUTTON" || event.target.type === "checkbox";
    const far = event.shiftKey ? 10 : 1;
    const actions = {
      " ": onButton ? null : () => this.toggle(),
      ArrowLeft: () => this.go(Math.ceil(this.time) - far),
      ArrowRight: () => this.go(Math.floor(this.time) + far),
      Home: () => this.go(0),
      End: () => this.go(this.last),
      "+": () => this.faster(1),
      "-": () => this.faster(-1),
      t: () => this.turn(this.part.trail, 1),
      r: () => (this.part.repeat.checked = !this.part.repeat.checked),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }

  turn(select, by) {
    select.selectedIndex = (select.selectedIndex + by + select.length) % select.length;
    this.show();
  }

  faster(by) {
    const { speed } = this.part;
    speed.selectedIndex = Math.min(Math.max(speed.selectedIndex + by, 0), speed.length - 1);
  }

  // page.html#step=12 opens at that step.
  fromAddress() {
    const found = /[#&]step=(\d+)/.exec(window.location.hash);
    this.go(found ? Number(found[1]) : this.time);
  }

  go(step) {
    this.pause();
    this.time = Math.min(Math.max(step, 0), this.last);
    this.show();
  }

  toggle() {
    if (this.playing) {
      this.go(Math.round(this.time));
      return;
    }
    if (this.time >= this.last) this.time = 0;
    this.playing = true;
    this.before = performance.now();
    this.showButton();
    this.wanted = requestAnimationFrame((now) => this.tick(now));
  }

  pause() {
    this.playing = false;
    cancelAnimationFrame(this.wanted);
    this.showButton();
  }

  tick(now) {
    const seconds = Math.max(0, now - this.before) / 1000;
    this.before = now;
    this.time += (seconds * Number(this.part.speed.value)) / this.episode.step_seconds;
    if (this.time >= this.last) {
      if (!this.part.repeat.checked || this.last === 0) {
        this.go(this.last);
        return;
      }
      this.time = 0;
    }
    this.show();
    this.wanted = requestAnimationFrame((later) => this.tick(later));
  }

  show() {
    const scene = Math.floor(this.time);
    const { part } = this;
    this.world.draw(this.gliding ? this.time : scene, Number(part.trail.value));
    this.curve.draw(this.gliding ? this.time : scene);
    if (this.shown === scene && this.playing) return;
    this.shown = scene;
    part.scrub.value = scene;
    part.now.textContent = `step ${scene} of ${this.last}`;
    part.scrub.setAttribute("aria-valuetext", part.now.textContent);
    part.fitness.textContent = words(this.episode.fitness[scene]);
    this.count(scene);
  }

  count(scene) {
    const counts = new Map();
    for (const body of this.episode.bodies) {
      if (at(body.x, scene) === null) continue;
      const name = label(body.kind, stateAt(body, scene));
      counts.set(name, (counts.get(name) || 0) + 1);
    }
    for (const [name, { item, count }] of this.entries) {
      count.textContent = counts.get(name) || 0;
      item.classList.toggle("none", !counts.has(name));
    }
    const said = [...counts].map(([name, count]) => `${count} ${name}`).join("; ");
    this.part.world.setAttribute("aria-label", `Step ${scene} of ${this.last}: ${said}`);
    this.part.curve.setAttribute("aria-label", `Fitness so far at step ${scene}: ${words(this.episode.fitness[scene])}`);
  }

  showButton() {
    this.part.play.textContent = this.playing ? "Pause" : "Play";
  }

  dark() {
    const chosen = document.documentElement.dataset.theme;
    return chosen ? chosen === "dark" : window.matchMedia("(prefers-color-scheme: dark)").matches;
  }

  turnTheme() {
    document.documentElement.dataset.theme = this.dark() ? "light" : "dark";
    this.showTheme();
  }

  showTheme() {
    this.part.theme.textContent = this.dark() ? "Light" : "Dark";
    if (this.part.now.textContent) this.show();
  }
}

const player = new Player(EPISODE);
