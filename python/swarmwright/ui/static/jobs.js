// What was started here: the queue, what each job prints, and how to stop it.
import { ask, change, date, h, problem } from "./dom.js";
import { runAddress } from "./runs.js";
import { store } from "./store.js";

const EVERY_MS = 1500;

/** Jobs with their commands, outputs and buttons. `opened` has the ids of those whose output is shown; `load` asks anew. */
export function makeJobList(load) {
  const list = h("div");
  const failure = h("div");
  const cards = new Map();
  const opened = new Set();

  function makeCard(job) {
    const state = h("span");
    const run = h("span");
    const line = h("summary");
    const output = h("pre", { class: "report" });
    const button = h("button", { type: "button", click: () => stop(job.id) });
    const details = h("details", { toggle: () => {
      if (!details.open) opened.delete(job.id);
      else if (!opened.has(job.id)) {
        opened.add(job.id);
        load();
      }
    } }, line, output);
    const element = h("section", { class: "job" },
      h("div", { class: "tools" }, state, run, h("code", {}, `swarmwright ${job.arguments.join(" ")}`), h("span", { class: "hint" }, date(job.created * 1000)), button),
      details);
    let isShown = false;

    function update(now, printed, isNewest) {
      state.textContent = now.host ? `${now.state} on ${now.host}` : now.state;
      state.className = `state ${now.state}`;
      run.replaceChildren(store.rows.has(now.run) ? h("a", { href: runAddress(now.run) }, now.run) : now.run);
      line.textContent = now.line || "output";
      if (printed !== undefined && printed !== output.textContent) output.textContent = printed;
      button.textContent = now.state === "running" ? "Stop" : "Cancel";
      button.hidden = !["running", "waiting"].includes(now.state) || now.host !== "" || store.window.read_only;
      if (now.state === "failed" && isNewest && !isShown) details.open = isShown = true;
    }
    return { element, update };
  }

  async function stop(job) {
    try {
      await change("stop", { job });
      failure.replaceChildren();
    } catch (error) {
      failure.replaceChildren(problem(error));
    }
    load();
  }

  function show(jobs, outputs) {
    const present = new Set(jobs.map((job) => job.id));
    for (const [id, card] of cards) {
      if (present.has(id)) continue;
      card.element.remove();
      cards.delete(id);
      opened.delete(id);
    }
    jobs.forEach((job, index) => {
      if (!cards.has(job.id)) cards.set(job.id, makeCard(job));
      const card = cards.get(job.id);
      if (list.children[index] !== card.element) list.insertBefore(card.element, list.children[index] ?? null);
      card.update(job, outputs[job.id], index === 0);
    });
  }

  return { element: h("div", {}, failure, list), opened, show };
}

export function show(view) {
  let timer = null;
  let hasLeft = false;
  let asked = 0;
  const jobs = makeJobList(load);
  const empty = h("p", { class: "empty", hidden: true }, "Nothing was started here yet. ", h("a", { href: "#/new" }, "New experiment"));
  const failure = h("div");
  view.append(h("h1", {}, "Jobs"), h("p", { class: "hint" }, "Commands that were started here. They go on when this window is closed."), failure, empty, jobs.element);

  async function load() {
    clearTimeout(timer);
    const number = ++asked;
    try {
      const answer = await ask("jobs", { opened: [...jobs.opened] });
      if (number !== asked) return;
      failure.replaceChildren();
      empty.hidden = answer.jobs.length > 0;
      jobs.show(answer.jobs, answer.outputs);
    } catch (error) {
      failure.replaceChildren(problem(error));
    }
    if (!hasLeft && number === asked) timer = setTimeout(load, EVERY_MS);
  }

  load();
  return {
    trail: ["jobs"],
    leave: () => {
      hasLeft = true;
      clearTimeout(timer);
    },
  };
}
