// Files of a candidate to take along: code, a bundle, its replay.
import { ask, change, h, problem } from "./dom.js";

const FORMS = {
  c: "C", cpp: "C++", fmu: "FMU (FMI 2)", fmu3: "FMU (FMI 3)", machine: "state machine", micropython: "MicroPython", onnx: "ONNX",
  python: "Python", ros1: "ROS 1", ros2: "ROS 2", scxml: "SCXML",
};
const MEDIA = { ".html": "page", ".mp4": "film (MP4)", ".gif": "animation (GIF)", ".png": "picture (PNG)" };
const BYTES = 1024;

function size(bytes) {
  return bytes < BYTES * BYTES ? `${Math.max(1, Math.round(bytes / BYTES))} KiB` : `${(bytes / BYTES / BYTES).toFixed(1)} MiB`;
}

export class Export {
  /** chosen: returns the candidate; episode: which episode is shown, with the parameters that differ. */
  constructor(run, { chosen, episode }) {
    Object.assign(this, { run, chosen, episode });
    this.element = h("section", { class: "panel", hidden: true, "aria-label": "Export" });
    this.exports = Promise.resolve(); // the server makes one file at a time
    this.abort = new AbortController();
    this.results = h("div", { "aria-live": "polite" });
  }

  async open() {
    this.element.hidden = false;
    if (this.listed) return;
    try {
      this.listed = await ask("exports", { run: this.run });
    } catch (error) {
      this.element.replaceChildren(problem(error));
      return;
    }
    const { forms, media, groups, has_bundle: hasBundle } = this.listed;
    const group = h("select", { "aria-label": "Group" }, groups.map((name) => h("option", { value: name }, name)));
    const verify = h("input", { type: "checkbox", checked: true });
    const speed = h("input", { type: "number", min: 0.1, max: 100, step: "any", value: 1, "aria-label": "Speed of films" });
    const button = (title, to, values) => h("button", { type: "button", click: () => this.make(title, { to, ...values() }) }, title);
    this.element.replaceChildren(
      h("h2", {}, "Export"),
      h("div", { class: "tools", role: "group", "aria-label": "Code" }, h("span", { class: "count" }, "controller"),
        groups.length ? h("label", {}, "of ", group) : "",
        ...forms.map((form) => button(FORMS[form] ?? form, form, () => ({ verify: verify.checked, group: groups.length ? group.value : null }))),
        hasBundle ? button("all in a bundle", "bundle", () => ({})) : "",
        h("label", { title: "Compile and run it in 10,000 random sequences and in the run's episodes, and compare it with the simulation" }, verify, " verify")),
      h("div", { class: "tools", role: "group", "aria-label": "Replay" }, h("span", { class: "count" }, "replay"),
        ...media.map((ending) => button(MEDIA[ending] ?? ending, ending, () => ({ ...this.episode(), speed: Number(speed.value) }))), h("label", {}, "speed ", speed)),
      this.results);
  }

  close() {
    this.element.hidden = true;
  }

  make(title, values) {
    const line = h("div", { class: "export" }, h("span", { class: "count" }, `${title} …`));
    this.results.prepend(line);
    const wanted = { run: this.run, ...this.chosen(), ...values };
    this.exports = this.exports.then(() => this.fetch(title, wanted, line));
  }

  async fetch(title, wanted, line) {
    try {
      const made = await change("export", wanted, this.abort.signal);
      const link = h("a", { class: "button", download: made.name, href: `api/export_file?${new URLSearchParams({ id: made.id })}` }, `⬇ ${made.name}`);
      const state = made.verified === null ? "" : h("span", { class: made.verified ? "fine" : "bad" }, made.verified ? "✓ verified" : "✗ differs from the simulation");
      line.replaceChildren(link, h("span", { class: "count" }, ` ${size(made.bytes)} `), state,
        ...made.lines.map((text) => h("div", { class: "hint" }, text)));
      link.click();
    } catch (error) {
      line.replaceChildren(h("b", {}, title), problem(error));
    }
  }

  leave() {
    this.abort.abort();
  }
}
