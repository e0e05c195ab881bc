// Lets the page around this one play several episodes in step. Without one, nothing here does anything.
//
// Messages of the parent, an object with any of these keys; what is none of them, or of another window, is ignored:
//   episode: ArrayBuffer of `pack_page`, once, for a page without an episode
//   driven: true: the parent has the controls; it gets what is asked for here
//   play: true, pause: true, step: number in steps (not rounded), speed: number
//   theme: "light" or "dark"
// Messages to the parent, { player: .. }:
//   "waiting": without an episode; "ready": with `last`, `stepSeconds` and `speed`, and the step is drawn
//   "step": with `step`, `playing` and `speed`, when it has changed, unless driven
//   "asks": with `step`, `playing` or `speed`, what a person wants of a player that is driven

let player; // set once an episode is shown

class Remote {
  constructor() {
    this.parent = window.parent === window ? null : window.parent;
    this.driven = false;
    window.addEventListener("message", ({ source, data }) => {
      if (this.parent && source === this.parent && data !== null && typeof data === "object") this.take(data);
    });
  }

  tell(kind, values = {}) {
    if (this.parent) this.parent.postMessage({ player: kind, ...values }, "*");
  }

  start() {
    if (PAGE.episodes) this.play();
    else this.tell("waiting");
  }

  play() {
    player = new Player(PAGE, this);
    const { last, page, part } = player;
    this.tell("ready", { last, stepSeconds: page.step_seconds, speed: Number(part.speed.value) });
  }

  take({ episode, driven, play, pause, step, speed, theme: chosen }) {
    if (chosen === "light" || chosen === "dark") {
      document.documentElement.dataset.theme = chosen;
      if (player) player.showTheme();
    }
    if (!player) {
      if (episode instanceof ArrayBuffer) this.open(episode);
      return;
    }
    if (typeof driven === "boolean") this.drive(driven);
    if (Number.isFinite(speed) && speed > 0) player.setSpeed(speed);
    if (Number.isFinite(step)) player.seek(step);
    if (play === true && !player.playing) player.begin();
    if (pause === true && player.playing) player.pause();
  }

  open(sent) {
    const length = new DataView(sent).getUint32(0, true);
    Object.assign(PAGE, JSON.parse(new TextDecoder().decode(new Uint8Array(sent, 4, length))), { sent, start: 4 + length });
    document.title = PAGE.title;
    document.querySelector("h1").textContent = PAGE.title;
    document.querySelector(".facts").replaceChildren(...PAGE.facts.map(([name, value]) => {
      const fact = element("div");
      fact.append(element("dt", {}, name), element("dd", {}, value));
      return fact;
    }));
    if (PAGE.style) document.head.querySelector("style").prepend(PAGE.style);
    this.play();
  }

  drive(driven) {
    this.driven = driven;
    document.body.classList.toggle("driven", driven);
    if (driven) player.pause();
    player.tall();
    player.show();
  }

  // Returns whether the parent has the controls, and tells it what is asked for.
  asks(values) {
    if (this.driven) this.tell("asks", values);
    return this.driven;
  }

  report({ time, playing, part }) {
    if (player && !this.driven) this.tell("step", { step: time, playing, speed: Number(part.speed.value) });
  }
}

const remote = new Remote();
remote.start();
