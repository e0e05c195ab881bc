// Replays side by side. Their frames are documents of another origin: all goes by messages, see `remote.js` of the player.
import { askParts, figure, h, problem } from "./dom.js";
import { isDark, onTheme } from "./theme.js";

export const MOST_PANES = 4;
const REFUSAL = 2; // kind of a part of an episode: a message
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 16, 32];
const LONGEST_WAIT_MS = 100; // between two frames; a longer pause, as of a hidden tab, is not made up for

const number = (value, fallback) => (Number.isFinite(value) ? value : fallback);

/** The player in a frame. `told` is called with what it says: waiting, ready, step, asks. */
class Frame {
  constructor(told) {
    this.told = told;
    this.isWaiting = false;
    this.element = h("iframe", { src: "player", sandbox: "allow-scripts", title: "Replay" });
    this.hear = (event) => this.take(event);
    addEventListener("message", this.hear);
  }

  take({ source, data }) {
    if (source !== this.element.contentWindow || source === null || data === null || typeof data !== "object") return;
    if (data.player === "waiting") this.isWaiting = true;
    if (typeof data.player === "string") this.told(data.player, data);
  }

  tell(values, transfer = []) {
    this.element.contentWindow?.postMessage(values, "*", transfer);
  }

  close() {
    removeEventListener("message", this.hear);
    this.element.closest("figure").remove();
  }
}

/** One replay: which candidate, with which parameters. */
class Pane {
  constructor(panes, which, parameters, name) {
    Object.assign(this, { panes, which, parameters, name });
    this.asked = 0;
    this.frame = null; // what is on the screen
    this.next = null; // what will be, once it is drawn
    this.abort = new AbortController();
    this.last = 0;
    this.stepSeconds = 0.1;
    this.seed = null;
    this.error = null;
  }

  /** Gets the episode and shows it, after those of other panes; the newest call wins. */
  load() {
    const asked = ++this.asked;
    this.abort.abort();
    this.abort = new AbortController();
    this.failed(null);
    return this.panes.afterOthers(() => this.fetch(asked));
  }

  async fetch(asked) {
    const isOld = () => asked !== this.asked || this.isClosed;
    if (isOld()) return;
    let newest = null;
    try {
      await askParts("episode", { ...this.panes.query(this), ...this.which, parameters: JSON.stringify(this.parameters) }, this.abort.signal, (kind, content, headers) => {
        if (isOld()) return;
        if (kind === REFUSAL) throw new Error(new TextDecoder().decode(content));
        this.seed = headers.get("x-seed");
        newest = content;
        this.put(content, () => isOld() || newest !== content);
      });
    } catch (error) {
      if (!isOld() && error.name !== "AbortError") this.failed(error);
    }
  }

  /** Puts an episode into the frame that waits for one; it is shown once it is drawn. */
  async put(content, isOld) {
    const frame = await this.panes.takeSpare();
    if (isOld()) {
      frame.close();
      return;
    }
    if (this.next) this.next.close();
    this.next = frame;
    frame.told = (kind, data) => this.told(frame, kind, data);
    this.panes.place(this, frame);
    frame.tell({ theme: this.panes.theme(), episode: content }, [content]);
    this.panes.makeSpare();
  }

  told(frame, kind, data) {
    if (frame !== this.frame && frame !== this.next) return;
    if (kind === "ready") {
      this.last = Math.max(0, Math.floor(number(data.last, 0)));
      this.stepSeconds = Math.max(number(data.stepSeconds, 0.1), 1e-3);
      const isFocused = this.frame && document.activeElement === this.frame.element;
      if (this.frame && this.frame !== frame) this.frame.close();
      [this.frame, this.next] = [frame, null];
      if (isFocused) frame.element.focus({ preventScroll: true });
      frame.element.title = `Replay of ${this.name}`;
      this.panes.ready(this);
    } else if (kind === "step" && frame === this.frame) {
      this.panes.stepped(this, number(data.step, 0), data.playing === true, number(data.speed, 1));
    } else if (kind === "asks" && frame === this.frame) {
      this.panes.wanted(data);
    }
  }

  failed(error) {
    this.error?.remove();
    this.error = error && h("figure", { class: "refused" }, this.panes.caption(this), problem(error));
    if (!error) return;
    for (const frame of [this.frame, this.next]) frame?.close();
    [this.frame, this.next] = [null, null];
    this.panes.element.append(this.error);
    this.panes.arrange();
  }

  close() {
    this.isClosed = true;
    this.abort.abort();
    this.error?.remove();
    for (const frame of [this.frame, this.next]) frame?.close();
  }
}

export class Panes {
  /** run: its id. changed: called when there are other panes, or other episodes in them. */
  constructor(run, { changed = () => {} } = {}) {
    this.run = run;
    this.changed = changed;
    this.list = [];
    this.fetches = Promise.resolve();
    this.element = h("div", { class: "panes" });
    this.time = 0;
    this.playing = false;
    this.isPlayed = false; // the single replay, by its own controls
    this.speed = 1;
    this.episode = { episode: "0" };
    this.play = h("button", { type: "button", class: "primary", click: () => this.toggle() }, "Play");
    this.scrub = h("input", { type: "range", min: 0, max: 0, step: 1, value: 0, "aria-label": "Step of all replays", input: () => this.seek(Number(this.scrub.value)) });
    this.now = h("output", {});
    this.speeds = h("select", { "aria-label": "Speed of all replays", change: () => this.setSpeed(Number(this.speeds.value)) },
      SPEEDS.map((factor) => h("option", { value: factor, selected: factor === 1 }, `${figure(factor)} ×`)));
    this.controls = h("div", { class: "tools in-step", hidden: true, role: "group", "aria-label": "All replays in step" }, this.play, this.scrub, this.now, h("label", {}, "speed ", this.speeds));
    this.endTheme = onTheme(() => {
      for (const pane of this.list) for (const frame of [pane.frame, pane.next]) frame?.tell({ theme: this.theme() });
    });
    this.makeSpare();
  }

  get first() {
    return this.list[0];
  }

  /** Fetches when the fetches before have ended: browsers have few connections, and the server few processors. */
  afterOthers(fetch) {
    this.fetches = this.fetches.then(fetch);
    return this.fetches;
  }

  theme() {
    return isDark() ? "dark" : "light";
  }

  /** Which episode a pane plays: the seed of the first one for all others. */
  query(pane) {
    if (pane === this.first || this.episode.seed || !this.first.seed) return { run: this.run, ...this.episode };
    return { run: this.run, seed: this.first.seed };
  }

  /** Shows a candidate alone, or beside the others; the last one makes room. */
  show(which, name, { isBeside = false, parameters = {} } = {}) {
    if (!isBeside) this.clear();
    const pane = new Pane(this, which, parameters, name);
    if (this.list.length >= MOST_PANES) this.list.pop().close();
    this.list.push(pane);
    this.arrange();
    pane.load();
    this.changed();
    return pane;
  }

  remove(pane) {
    pane.close();
    this.list = this.list.filter((each) => each !== pane);
    this.arrange();
    this.changed();
  }

  clear() {
    this.pause();
    for (const pane of this.list) pane.close();
    this.list = [];
    this.time = 0;
    this.isPlayed = false;
    this.arrange();
    this.changed();
  }

  /** Plays another episode in all panes: { episode } of the run, or { seed }. */
  async choose(episode) {
    this.episode = episode;
    this.pause();
    this.time = 0;
    this.isPlayed = false;
    if (!this.first) return;
    this.first.seed = null;
    await this.first.load();
    for (const pane of this.list.slice(1)) pane.load();
    this.changed();
  }

  // A frame takes a process of its own and its scripts, so that one waits for the next click.
  makeSpare() {
    if (this.spare) return;
    this.spare = new Frame(() => {});
    this.element.append(h("figure", { class: "spare", "aria-hidden": "true" }, this.spare.element));
  }

  async takeSpare() {
    if (!this.spare) this.makeSpare();
    const { spare } = this;
    this.spare = null;
    if (!spare.isWaiting) await new Promise((resolve) => (spare.told = (kind) => kind === "waiting" && resolve()));
    return spare;
  }

  place(pane, frame) {
    const box = frame.element.closest("figure");
    box.className = pane.frame ? "coming" : "";
    box.removeAttribute("aria-hidden");
    box.prepend(this.caption(pane));
    this.arrange();
  }

  caption(pane) {
    return h("figcaption", {}, h("b", {}, pane.name),
      h("button", { type: "button", title: "Close this replay", "aria-label": `Close ${pane.name}`, click: () => this.remove(pane) }, "×"));
  }

  arrange() {
    const { length } = this.list;
    this.element.className = `panes n${length}`;
    this.list.forEach((pane, index) => {
      for (const box of [pane.frame?.element.closest("figure"), pane.next?.element.closest("figure"), pane.error]) {
        if (box) box.style.order = String(index);
      }
    });
    this.controls.hidden = length < 2;
    if (length < 2) this.pause();
    for (const pane of this.list) this.drive(pane);
    this.draw();
  }

  drive(pane) {
    const isDriven = this.list.length > 1;
    if (!pane.frame || pane.isDriven === isDriven) return;
    pane.isDriven = isDriven;
    pane.frame.tell({ driven: isDriven, step: this.time });
  }

  ready(pane) {
    pane.isDriven = false;
    pane.frame.element.closest("figure").className = "";
    if (this.list.length > 1) this.drive(pane);
    else pane.frame.tell({ step: this.time, speed: this.speed, play: this.isPlayed });
    this.draw();
    this.changed();
  }

  // A single replay has its own controls, and says where it is: others that come beside it begin there.
  stepped(pane, step, playing, speed) {
    if (this.list.length > 1) return;
    this.isPlayed = playing;
    this.time = Math.min(Math.max(step, 0), pane.last);
    if (speed > 0) this.speed = speed;
  }

  wanted({ step, playing, speed }) {
    if (Number.isFinite(speed) && speed > 0) this.setSpeed(speed);
    if (Number.isFinite(step)) this.seek(step);
    if (playing === true && !this.playing) this.toggle();
    if (playing === false) this.pause();
  }

  get last() {
    return Math.max(0, ...this.list.map((pane) => pane.last));
  }

  setSpeed(speed) {
    this.speed = speed;
    if (![...this.speeds.options].some((option) => Number(option.value) === speed)) this.speeds.append(h("option", { value: speed }, `${figure(speed)} ×`));
    this.speeds.value = String(speed);
  }

  seek(step) {
    this.pause();
    this.go(step);
  }

  go(step) {
    this.time = Math.min(Math.max(step, 0), this.last);
    for (const pane of this.list) pane.frame?.tell({ step: this.time });
    this.draw();
  }

  toggle() {
    if (this.playing) {
      this.seek(Math.round(this.time));
      return;
    }
    if (this.time >= this.last) this.time = 0;
    this.playing = true;
    this.before = performance.now();
    this.request = requestAnimationFrame((now) => this.tick(now));
    this.draw();
  }

  pause() {
    this.playing = false;
    cancelAnimationFrame(this.request);
    this.draw();
  }

  tick(now) {
    const passed = Math.min(Math.max(now - this.before, 0), LONGEST_WAIT_MS) / 1000;
    this.before = now;
    this.go(this.time + (passed * this.speed) / (this.first?.stepSeconds ?? 0.1));
    if (this.time >= this.last) this.pause();
    else this.request = requestAnimationFrame((later) => this.tick(later));
  }

  draw() {
    this.play.textContent = this.playing ? "Pause" : "Play";
    this.scrub.max = String(this.last);
    this.scrub.value = String(Math.floor(this.time));
    this.now.textContent = `step ${Math.floor(this.time)} of ${this.last}`;
  }

  leave() {
    this.endTheme();
    this.clear();
    this.spare?.close();
    this.spare = null;
  }
}
