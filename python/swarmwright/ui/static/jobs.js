// What was started here: the queue, what each job prints, and how to stop it.
import { ask, change, date, h, problem } from "./dom.js";
import { runAddress } from "./runs.js";
import { store } from "./store.js";

const EVERY_MS = 1500;

export function show(view) {
  const list = h("div");
  const opened = new Set();
  let timer = null;
  let shown = "";
  view.append(h("h1", {}, "Jobs"), h("p", { class: "hint" }, "Commands that were started here. They go on when this window is closed."), list);

  function card(job) {
    const isOpen = opened.has(job.id) || job.state === "failed";
    const output = h("details", { open: isOpen, toggle: (event) => { event.target.open ? opened.add(job.id) : opened.delete(job.id); } },
      h("summary", {}, "output"), h("pre", { class: "report" }, job.output));
    return h("section", { class: "job" },
      h("div", { class: "tools" },
        h("span", { class: `state ${job.state}` }, job.state),
        store.rows.has(job.run) ? h("a", { href: runAddress(job.run) }, job.run) : h("span", {}, job.run),
        h("code", {}, `swarmwright ${job.arguments.join(" ")}`),
        h("span", { class: "hint" }, date(job.created * 1000)),
        ["running", "waiting"].includes(job.state) && !store.window.read_only
          ? h("button", { type: "button", click: () => stop(job) }, job.state === "running" ? "Stop" : "Cancel") : null),
      output);
  }

  async function stop(job) {
    try {
      await change("stop", { job: job.id });
      load();
    } catch (error) {
      list.prepend(problem(error));
    }
  }

  async function load() {
    clearTimeout(timer);
    try {
      const { jobs } = await ask("jobs");
      const now = JSON.stringify(jobs);
      if (now !== shown) list.replaceChildren(...(jobs.length ? jobs.map(card) : [h("p", { class: "empty" }, "Nothing was started here yet. ", h("a", { href: "#/new" }, "New experiment"))]));
      shown = now;
    } catch (error) {
      list.replaceChildren(problem(error));
      shown = "";
    }
    timer = setTimeout(load, EVERY_MS);
  }

  load();
  return { trail: ["jobs"], leave: () => clearTimeout(timer) };
}
