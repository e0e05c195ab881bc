// Plays the episodes: the time, buttons, keys and the address.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 32];
const MOST_METRICS = 8; // charts
const MOST_LABELLED = 100; // bodies; with more, labels are off by default
const PAN = 40; // pixels per key
const CONTROLS = 130; // pixels, height of the controls below a map

class Player {
  constructor(page, remote) {
    this.page = page;
    this.remote = remote;
    this.episodes = page.episodes.map((data) => new Episode(data));
    [this.episode] = this.episodes;
    this.last = Math.max(...this.episodes.map((episode) => episode.last));
    this.time = 0; // in steps
    this.playing = false;
    this.part = Object.fromEntries([...document.querySelectorAll("[id]")].map((part) => [part.id, part]));
    this.view = { labels: page.shown.labels, colors: "state" };
    this.tall();
    this.worlds = this.episodes.map((episode, index) => this.world(episode, index));
    [this.world] = this.worlds;
    this.focus = 0; // index of the world with the followed agent
    this.curves();
    this.gliding = !window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.part.scrub.max = this.last;
    this.speeds(page.speed);
    this.choices();
    this.listen();
    this.fromAddress();
  }

  // Creates the map of an episode; several maps have captions.
  world(episode, index) {
    const { worlds } = this.part;
    const several = this.episodes.length > 1;
    let canvas = this.part.world;
    if (index) {
      const copy = worlds.firstElementChild.cloneNode(true);
      copy.querySelectorAll("[id]").forEach((part) => part.removeAttribute("id"));
      worlds.append(copy);
      canvas = copy.querySelector("canvas");
    }
    const figure = canvas.closest("figure");
    const caption = figure.querySelector("figcaption");
    caption.hidden = !several;
    if (several) {
      const mark = element("span", { class: "swatch" });
      mark.style.background = `var(--${EPISODES[index % EPISODES.length]})`;
      episode.fitnessOutput = element("output");
      caption.replaceChildren(mark, element("b", {}, String(index + 1)), element("span", {}, episode.name), episode.fitnessOutput);
      worlds.style.setProperty("--columns", this.episodes.length > 4 ? 3 : 2);
    }
    if (episode.pictures) {
      figure.querySelector(".zoom").hidden = true;
      return new Pictures(canvas, episode, () => this.shown !== undefined && this.show());
    }
    const world = new World(canvas, episode, (body) => {
      if (body !== undefined) this.follow(index, body);
      else this.show();
    });
    const [nearer, farther, whole] = figure.querySelectorAll(".zoom button");
    nearer.addEventListener("click", () => this.zoom(index, 1.5));
    farther.addEventListener("click", () => this.zoom(index, 1 / 1.5));
    whole.addEventListener("click", () => this.reset(index));
    return world;
  }

  // Computes the largest height of a map in pixels: the controls below a single map remain visible.
  tall() {
    const { innerHeight } = window;
    const count = this.episodes.length;
    const top = this.part.world.getBoundingClientRect().top + window.scrollY;
    const room = Math.min(Math.max(innerHeight - top - CONTROLS, 0.45 * innerHeight), 0.68 * innerHeight);
    this.view.highest = count === 1 ? room : (count > 2 ? 0.4 : 0.6) * innerHeight;
  }

  speeds(first) {
    const all = SPEEDS.includes(first) ? SPEEDS : [...SPEEDS, first].sort((a, b) => a - b);
    this.part.speed.replaceChildren(...all.map((factor) => new Option(`${words(factor)} ×`, factor, factor === first, factor === first)));
  }

  setSpeed(factor) {
    if (Number(this.part.speed.value) !== factor) this.speeds(factor);
  }

  curves() {
    const colors = this.episodes.length > 1 ? EPISODES : ["accent"];
    this.charts = [{ name: "", curve: new Curve(this.part.curve, this.episodes.map(({ fitness }) => fitness), colors) }];
    const names = [...new Set(this.episodes.flatMap(({ metrics }) => Object.keys(metrics)))];
    this.part.metrics.hidden = !names.length;
    for (const { curve } of this.charts) this.scrubs(curve);
    for (const name of names.slice(0, MOST_METRICS)) this.chart(name, colors);
    const further = names.slice(MOST_METRICS);
    if (!further.length) return;
    const more = element("button", { type: "button", id: "more" }, `Show ${further.length} more`);
    more.addEventListener("click", (event) => {
      more.remove();
      const [first] = further.map((name) => this.chart(name, colors));
      this.show(true);
      // Move the focus of the removed button after a click by the keyboard, whose detail is 0.
      if (event.detail > 0) return;
      first.tabIndex = -1;
      first.focus();
    });
    this.part.metrics.append(more);
  }

  // Adds the curve of a metric; returns its heading.
  chart(name, colors) {
    const heading = element("h3", {}, name.replaceAll("_", " "));
    const value = element("output");
    heading.append(value);
    const canvas = element("canvas", { class: "metric", role: "img" });
    this.part.metrics.append(heading, canvas);
    const several = this.episodes.map(({ metrics, fitness }) => metrics[name] || fitness.map(() => null));
    const curve = new Curve(canvas, several, colors);
    this.charts.push({ name, curve, value });
    this.scrubs(curve);
    return heading;
  }

  // Goes to the step of a click on a curve.
  scrubs(curve) {
    const scrub = (event) => event.buttons & 1 && this.go(curve.step(event.offsetX));
    curve.canvas.addEventListener("pointerdown", (event) => {
      curve.canvas.setPointerCapture(event.pointerId);
      scrub(event);
    });
    curve.canvas.addEventListener("pointermove", scrub);
  }

  // Offers the choices that the episodes support.
  choices() {
    const { part, page } = this;
    const drawn = this.episodes.filter((episode) => !episode.pictures);
    const any = (has) => drawn.some(has);
    this.legend = drawn.length ? new Legend(part.legend, drawn) : null;
    // Without bodies, there are no counts and no trails.
    for (const id of ["bodies", "trails", "trails-key"]) part[id].hidden = !any((episode) => episode.count);
    part["rays-choice"].hidden = !any((episode) => episode.rays);
    part["links-choice"].hidden = !any((episode) => episode.links);
    part["labels-choice"].hidden = !any((episode) => episode.bodies.labels.length);
    part["zoom-keys"].hidden = !drawn.length;
    part["agent-keys"].hidden = !any((episode) => episode.bodyOf.size);
    const colors = [["state", "kind and state"]];
    if (page.scale) colors.unshift(["value", page.scale.name]);
    const ofController = ["controller", "state of the controller"];
    // In a team, colour by kind first.
    if (any((episode) => episode.machine)) colors.unshift(ofController);
    else if (any((episode) => episode.states)) colors.push(ofController);
    part.colors.append(...colors.map(([value, text]) => new Option(text, value)));
    if (colors.some(([value]) => value === page.shown.colors)) part.colors.value = page.shown.colors;
    part["colors-choice"].hidden = colors.length < 2;
    // In long episodes, bodies move little in a step.
    part.trail.value = !page.shown.trails ? "0" : this.last > 300 ? "100" : "12";
    if (page.shown.rays) part.rays.value = "all";
    if (page.shown.links) part.links.value = "all";
    const labelled = drawn.flatMap(({ bodies }) => bodies.labels.map(([, texts]) => texts.filter(Boolean).length));
    part.labels.checked = page.shown.labels ?? Math.max(0, ...labelled) <= MOST_LABELLED;
    part.counted.textContent = drawn.length > 1 ? `counts of all ${drawn.length} maps` : "";
    this.inspector = new Inspector(part);
    this.inspector.jump = (step) => this.go(step);
    this.drawMachines(this.episode);
  }

  // Draws the state machine of an episode's agents, or that of the first group.
  drawMachines(episode) {
    const { part } = this;
    const { groups } = episode;
    const machine = episode.machine || (groups && groups[0].machine);
    if (this.drawnOf === episode) return;
    if (this.drawnOf && !machine) return;
    this.drawnOf = episode;
    part.controller.hidden = !machine;
    part.group.hidden = !groups;
    part.group.replaceChildren(...(groups || []).map(({ name }) => new Option(name, name)));
    if (machine) this.drawMachine(machine);
  }

  drawMachine(machine) {
    if (this.machine && this.machine.machine === machine) return;
    const Drawing = machine.form === "tree" ? Tree : Machine;
    this.machine = new Drawing(this.part.diagram, this.part.states, machine);
  }

  chooseGroup(name) {
    this.part.group.value = name;
    this.drawMachine(this.drawnOf.groups.find((group) => group.name === name).machine);
    if (this.part.now.textContent) this.describeMachine(Math.floor(this.time));
  }

  listen() {
    const { part } = this;
    part.play.addEventListener("click", () => this.toggle());
    part.first.addEventListener("click", () => this.go(0));
    part.last.addEventListener("click", () => this.go(this.last));
    part.back.addEventListener("click", () => this.go(Math.ceil(this.time) - 1));
    part.on.addEventListener("click", () => this.go(Math.floor(this.time) + 1));
    part.scrub.addEventListener("input", () => this.go(Number(part.scrub.value)));
    for (const id of ["trail", "rays", "links", "labels", "colors"]) part[id].addEventListener("change", () => this.show(true));
    part.group.addEventListener("change", () => this.chooseGroup(part.group.value));
    part.leave.addEventListener("click", () => this.follow(this.focus, -1));
    part.theme.addEventListener("click", () => this.turnTheme());
    document.addEventListener("keydown", (event) => this.key(event));
    this.release();
    window.addEventListener("hashchange", () => this.fromAddress());
    new ResizeObserver(() => this.show()).observe(part.worlds);
    window.addEventListener("resize", () => {
      this.tall();
      this.show();
    });
    const dark = window.matchMedia("(prefers-color-scheme: dark)");
    dark.addEventListener("change", () => this.showTheme());
    this.showTheme();
  }

  // Removes the focus from a control after a choice with the mouse, so that keys control the player.
  release() {
    let pointed = null;
    document.addEventListener("pointerdown", (event) => (pointed = event.target.closest("label, select")));
    document.addEventListener("keydown", () => (pointed = null));
    document.addEventListener("change", ({ target }) => {
      if (pointed && pointed.contains(target) && target.matches("select, [type=checkbox]")) target.blur();
    });
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.target.tagName === "SELECT") {
      if (event.key === "Escape") event.target.blur();
      return;
    }
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
      i: () => this.zoom(this.focus, 1.25),
      o: () => this.zoom(this.focus, 0.8),
      0: () => this.reset(this.focus),
      a: () => this.pan(PAN, 0),
      d: () => this.pan(-PAN, 0),
      w: () => this.pan(0, PAN),
      s: () => this.pan(0, -PAN),
      n: () => this.next(1),
      p: () => this.next(-1),
      Escape: () => this.follow(this.focus, -1),
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
    const index = Math.min(Math.max(speed.selectedIndex + by, 0), speed.length - 1);
    if (this.remote.asks({ speed: Number(speed.options[index].value) })) return;
    speed.selectedIndex = index;
  }

  zoom(index, factor) {
    const { camera, box } = this.worlds[index];
    if (!camera) return;
    camera.zoomBy(factor, box.left + box.width / 2, box.top + box.height / 2);
    this.show();
  }

  pan(dx, dy) {
    const world = this.worlds[this.focus];
    if (!world.camera) return;
    world.following = false;
    world.camera.moveBy(dx, dy);
    this.show();
  }

  reset(index) {
    const { camera } = this.worlds[index];
    if (!camera) return;
    camera.reset();
    this.show();
  }

  // body: its index, -1 for none.
  follow(index, body) {
    for (const world of this.worlds) world.selected = -1;
    const world = this.worlds[index];
    world.selected = body;
    world.following = body >= 0;
    this.focus = index;
    this.part.agent.hidden = body < 0;
    const { episode } = world;
    if (body >= 0) {
      const kind = episode.kindOf(episode.agents[body]);
      this.part.who.textContent = `Agent ${episode.agents[body]}${kind ? `, ${kind.name}` : ""}${this.episodes.length > 1 ? ` of ${episode.name}` : ""}`;
      this.inspector.choose(episode, body);
    }
    this.drawMachines(episode);
    const group = body >= 0 && episode.groups && episode.groupOf(body);
    if (group) this.chooseGroup(group.name);
    this.show(true);
  }

  // Follows the next agent.
  next(by) {
    const { episode, selected } = this.worlds[this.focus];
    const agents = [...(episode.bodyOf || new Map()).keys()].sort((a, b) => a - b);
    if (!agents.length) return;
    const at = selected < 0 ? (by > 0 ? -1 : 0) : agents.indexOf(episode.agents[selected]);
    this.follow(this.focus, episode.bodyOf.get(agents[(at + by + agents.length) % agents.length]));
  }

  // Opens a step and follows an agent, as in page.html#step=12&agent=3.
  fromAddress() {
    const parameter = (name) => {
      const match = new RegExp(`[#&]${name}=(\\d+)`).exec(window.location.hash);
      return match ? Number(match[1]) : null;
    };
    const [step, agent, zoom] = ["step", "agent", "zoom"].map(parameter);
    this.go(step === null ? this.time : step);
    const body = agent === null || !this.episode.bodyOf ? undefined : this.episode.bodyOf.get(agent);
    if (body !== undefined) this.follow(0, body);
    else if (agent !== null && this.episode.bodyOf) this.noAgent(agent);
    if (zoom && this.world.camera) {
      this.world.camera.zoom = Math.min(Math.max(zoom, 1), LARGEST_ZOOM);
      this.show();
    }
  }

  noAgent(agent) {
    this.follow(0, -1);
    const { part } = this;
    const agents = [...this.episode.bodyOf.keys()];
    part.agent.hidden = false;
    part.who.textContent = `Agent ${agent}`;
    this.inspector.none(agents.length ? `No such agent. Agents are ${Math.min(...agents)} to ${Math.max(...agents)}.` : "There are no agents.");
  }

  go(step) {
    if (this.remote.asks({ step, playing: false })) return;
    this.pause();
    this.seek(step);
  }

  // Shows a time in steps, whether it plays or not.
  seek(step) {
    this.time = Math.min(Math.max(step, 0), this.last);
    this.show();
  }

  toggle() {
    if (this.remote.asks({ playing: !this.playing })) return;
    if (this.playing) this.go(Math.round(this.time));
    else this.begin();
  }

  begin() {
    if (this.time >= this.last) this.time = 0;
    this.playing = true;
    this.before = performance.now();
    this.showButton();
    this.request = requestAnimationFrame((now) => this.tick(now));
  }

  pause() {
    this.playing = false;
    cancelAnimationFrame(this.request);
    this.showButton();
  }

  tick(now) {
    const seconds = Math.max(0, now - this.before) / 1000;
    this.before = now;
    this.time += (seconds * Number(this.part.speed.value)) / this.page.step_seconds;
    if (this.time >= this.last) {
      if (!this.part.repeat.checked || this.last === 0) {
        this.go(this.last);
        return;
      }
      this.time = 0;
    }
    this.show();
    this.request = requestAnimationFrame((later) => this.tick(later));
  }

  // anew: update all elements, even if the step is unchanged.
  show(anew = false) {
    const scene = Math.floor(this.time);
    const { part, view } = this;
    const time = this.gliding ? this.time : scene;
    view.trail = Number(part.trail.value);
    view.rays = part.rays.value;
    view.links = part.links.value;
    view.labels = part.labels.checked;
    view.colors = part.colors.value;
    this.worlds.forEach((world, index) => world.draw(Math.min(time, this.episodes[index].last), view));
    this.charts.forEach(({ curve }, index) => curve.draw(time, index > 0));
    const followed = this.worlds[this.focus];
    if (followed.selected >= 0) this.inspector.draw(Math.min(time, followed.episode.last));
    if (this.shown === scene && (this.playing || this.remote.driven) && !anew) return;
    this.shown = scene;
    this.remote.report(this);
    part.scrub.value = scene;
    const seconds = this.page.known_seconds ? `, ${words(scene * this.page.known_seconds)} s` : "";
    part.now.textContent = `step ${scene} of ${this.last}${seconds}`;
    part.scrub.setAttribute("aria-valuetext", part.now.textContent);
    this.describe(scene);
  }

  // Updates the texts beside the maps.
  describe(scene) {
    const { part, episodes } = this;
    const at = (values) => values[Math.min(scene, values.length - 1)];
    const alone = episodes.length === 1;
    part.fitness.textContent = alone ? words(at(this.episode.fitness)) : "";
    for (const episode of alone ? [] : episodes) episode.fitnessOutput.textContent = words(at(episode.fitness));
    for (const { curve, value } of this.charts.slice(1)) {
      value.textContent = alone ? words(at(curve.several[0])) : "";
      curve.canvas.setAttribute("aria-label", `${value.parentElement.textContent} at step ${scene}`);
    }
    const counts = this.legend ? this.legend.show(scene, this.view.colors, this.drawn()) : "";
    part.world.setAttribute("aria-label", `Step ${scene} of ${this.last}: ${counts}`);
    part.curve.setAttribute("aria-label", `Fitness so far at step ${scene}: ${words(at(this.episode.fitness))}`);
    this.describeMachine(scene);
  }

  // Returns whether sensor rays and messages are drawn, of all agents or the followed agent.
  drawn() {
    const followed = this.worlds[this.focus].selected >= 0;
    const is = (choice) => choice === "all" || (choice === "selected" && followed);
    return { rays: is(this.view.rays), links: is(this.view.links) };
  }

  describeMachine(scene) {
    const { episode, selected } = this.worlds[this.focus];
    const { machine, part } = this;
    if (!machine || !episode.machines.includes(machine.machine)) return;
    if (!episode.states) {
      part.which.textContent = "the states of agents are not recorded";
      return;
    }
    const [frame] = episode.moment(Math.min(scene, episode.last));
    const { groups } = episode;
    const group = groups && groups.find((candidate) => candidate.machine === machine.machine);
    const ofGroup = (body) => !groups || episode.groupOf(body) === group;
    const counts = machine.machine.states.map(() => 0);
    for (const [agent, body] of episode.bodyOf) if (ofGroup(body)) counts[episode.stateOf(frame, agent)] += 1;
    // The followed agent, if this is its machine.
    const agent = selected >= 0 && ofGroup(selected) ? episode.agents[selected] : -1;
    const before = agent >= 0 && frame > 0 ? episode.stateOf(frame - 1, agent) : -1;
    machine.show(agent < 0 ? -1 : episode.stateOf(frame, agent), before, counts);
    part.which.textContent = agent < 0 ? "agents in each state" : `of agent ${agent}`;
  }

  showButton() {
    this.part.play.textContent = this.playing ? "Pause" : "Play";
    this.remote.report(this);
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
