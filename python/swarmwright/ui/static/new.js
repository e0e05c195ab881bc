// A new experiment from a template or a run: a form beside its YAML, checked while one types, then started.
import { ask, askWhether, change, h, problem } from "./dom.js";
import { makeForm } from "./form.js";
import { makeSweep } from "./sweep.js";

const CHECK_AFTER_MS = 400;
const MOST_UNDONE = 100;

export function show(view, query) {
  const editor = h("textarea", { class: "editor", spellcheck: "false", rows: 26, "aria-label": "Experiment (YAML)", input: () => { forget(); later(); } });
  const problems = h("ul", { class: "problems" });
  const held = h("p", { class: "hint", hidden: true }, "This run was not made on this machine, and its code is not trusted. Read it first; checking the experiment executes it. ",
    h("button", { type: "button", click: () => hold(false) }, "Check"));
  const name = h("input", { required: true, pattern: "[A-Za-z0-9_][A-Za-z0-9_.\\-]{0,99}", "aria-label": "Name", placeholder: "name" });
  const seeds = h("input", { type: "number", min: 1, max: 200, step: 1, value: 1, "aria-label": "Number of seeds", input: () => sweep.plan() });
  const start = h("button", { type: "submit", class: "primary" }, "Start");
  const undo = h("button", { type: "button", disabled: true, title: "Undo the last change by the form", click: () => goBack() }, "Undo");
  const choice = h("select", { "aria-label": "Template", change: () => choose() });
  const refused = h("p", { class: "problem", role: "alert" });
  const before = [];
  let timer = null;
  let asked = 0;
  let isGone = false;
  let isHeld = false; // the text names code of somebody else, which is executed when it is checked
  let isWrong = false;
  let isStarting = false; // a second click would start it again
  let runs = null; // of a sweep; 0 where it is wrong, null without one
  let kept = null; // what was opened or started
  let taken = ""; // the template

  const sweep = makeSweep({
    text: () => editor.value,
    seeds: () => seeds.valueAsNumber || 1,
    removed: (path) => form.focusVary(path),
    changed: (count) => {
      runs = count;
      start.textContent = runs === null ? "Start" : "Start sweep";
      allow();
    },
  });
  const form = makeForm({
    text: () => editor.value,
    replace: (text) => {
      before.push(editor.value);
      if (before.length > MOST_UNDONE) before.shift();
      put(text);
    },
    vary: (field, node) => sweep.toggle(field, node),
    isVaried: (path) => sweep.isVaried(path),
    mayExecute: () => !isHeld,
  });

  view.append(
    h("h1", {}, "New experiment"),
    h("form", { class: "tools", submit: (event) => { event.preventDefault(); begin(); } },
      h("label", {}, "from ", choice), h("label", {}, "name ", name), h("label", {}, "seeds ", seeds), start,
      h("span", { class: "hint" }, "One run uses the seed of the experiment; several use seeds 1, 2, 3, …")),
    refused,
    sweep.element,
    h("div", { class: "workbench" }, form.element,
      h("div", { class: "text-column" }, h("div", { class: "tools" }, h("h2", {}, "YAML"), undo), editor, h("h2", {}, "Check"), held, h("div", { role: "status" }, problems))),
  );

  const state = () => JSON.stringify([editor.value, sweep.entered()]);
  const isChanged = () => kept !== null && (state() !== kept || form.isChanged());

  async function choose() {
    if (!isChanged() || await askWhether("Take this template? What is not started of this experiment will be lost.", "Take", "Stay")) take({ template: choice.value }, choice.value.replace(/^.*:/, ""));
    else choice.value = taken;
  }

  function allow() {
    start.disabled = isStarting || isWrong || isHeld || runs === 0;
  }

  function hold(isOn) {
    isHeld = isOn;
    held.hidden = !isOn;
    problems.replaceChildren();
    allow();
    if (!isOn) later(0);
  }

  /** Changes the text for the form, and shows where. */
  function put(text) {
    const old = editor.value;
    editor.value = text;
    undo.disabled = before.length === 0;
    let same = 0;
    while (same < old.length && same < text.length && old[same] === text[same]) same++;
    scrollToLine(text.slice(0, same).split("\n").length);
    later(0);
  }

  /** What was typed is undone by the editor itself. */
  function forget() {
    before.length = 0;
    undo.disabled = true;
  }

  function goBack() {
    const text = before.pop();
    if (text !== undefined) put(text);
  }

  async function take(source, suggested) {
    try {
      taken = source.template ?? "";
      const answer = await ask("experiment", source);
      if (isGone || taken !== (source.template ?? "")) return;
      editor.value = answer.text;
      kept = state();
      forget();
      hold(!answer.is_trusted);
      if (!name.value || name.dataset.suggested === name.value) name.value = name.dataset.suggested = suggested;
      editor.scrollTop = 0;
      later(0);
    } catch (error) {
      problems.replaceChildren(h("li", {}, problem(error)));
    }
  }

  function later(wait = CHECK_AFTER_MS) {
    clearTimeout(timer);
    timer = setTimeout(() => {
      form.read();
      sweep.plan();
      if (!isHeld) check();
    }, wait);
  }

  async function check() {
    const number = ++asked;
    const text = editor.value;
    try {
      const answer = await change("check", { text });
      if (!isGone && number === asked) showProblems(answer.problems);
    } catch (error) {
      if (!isGone) problems.replaceChildren(h("li", {}, problem(error)));
    }
  }

  function showProblems(found) {
    isWrong = found.length > 0;
    allow();
    form.showProblems(found);
    problems.replaceChildren(...(found.length === 0 ? [h("li", { class: "fine" }, "Nothing is wrong.")] : found.map((entry) => h("li", { class: "problem" },
      entry.line === null ? null : h("button", { type: "button", click: () => select(entry.line) }, `line ${entry.line}`), " ",
      form.hasField(entry.message) ? h("button", { type: "button", click: () => form.focus(entry.message) }, "field") : null, " ", entry.message))));
  }

  function select(line) {
    const lines = editor.value.split("\n");
    const from = lines.slice(0, line - 1).reduce((sum, each) => sum + each.length + 1, 0);
    editor.focus();
    editor.setSelectionRange(from, from + (lines[line - 1]?.length ?? 0));
    scrollToLine(line);
  }

  function scrollToLine(line) {
    const height = editor.scrollHeight / editor.value.split("\n").length;
    const top = height * (line - 1);
    if (top < editor.scrollTop || top > editor.scrollTop + editor.clientHeight - 2 * height) editor.scrollTop = top - 4 * height;
  }

  async function begin() {
    refused.textContent = "";
    if (isStarting) return;
    isStarting = true;
    allow();
    try {
      await form.settle();
      const count = Number(seeds.value);
      const now = state();
      const isSweep = sweep.entered().length > 0;
      const common = { text: editor.value, name: name.value };
      const answer = !isSweep
        ? await change("start", { ...common, seeds: count === 1 ? [] : Array.from({ length: count }, (_, index) => index + 1) })
        : await change("sweep", { ...common, vary: sweep.entered(), seeds: count });
      if (isGone) return;
      if (answer.problems?.length && !isSweep) showProblems(answer.problems);
      else if (answer.problems?.length) refused.textContent = answer.problems.map((entry) => entry.message).join("\n");
      else {
        kept = now;
        location.hash = "#/jobs";
      }
    } catch (error) {
      refused.textContent = error.message;
    }
    isStarting = false;
    allow();
  }

  (async () => {
    const { names } = await ask("templates");
    choice.replaceChildren(h("option", { value: "", disabled: true }, "a template"), ...names.map((each) => h("option", { value: each }, each)));
    if (query.get("mission")) {
      const mission = query.get("mission");
      choice.value = "arena:aggregation";
      await take({ template: choice.value }, mission.replace(/\.yaml$/, "_run"));
      // As a text in JSON, which YAML reads, too: the address may come from anywhere.
      editor.value = editor.value.replace(/^( *mission: *)\S+/m, (_match, key) => key + JSON.stringify(mission));
      if (query.get("fitness")) editor.value = `${editor.value.trimEnd()}\nfitness: ${JSON.stringify(query.get("fitness"))}\n`;
      kept = state();
      later(0);
    } else if (query.get("run")) {
      choice.value = "";
      take({ run: query.get("run") }, `${query.get("run").replace(/^.*\//, "").replace(/[^A-Za-z0-9_.-]/g, "_")}-copy`);
    } else {
      choice.value = "arena:aggregation";
      take({ template: choice.value }, "aggregation");
    }
  })().catch((error) => problems.replaceChildren(h("li", {}, problem(error))));
  return { trail: ["new experiment"], isChanged, leave: () => { isGone = true; clearTimeout(timer); form.leave(); sweep.leave(); } };
}
