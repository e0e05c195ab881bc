// A new experiment from a template or a run: YAML that is checked while one types, then started.
import { ask, change, h, problem } from "./dom.js";

const CHECK_AFTER_MS = 400;

export function show(view, query) {
  const editor = h("textarea", { class: "editor", spellcheck: "false", rows: 26, "aria-label": "Experiment (YAML)", input: () => later() });
  const problems = h("ul", { class: "problems", role: "status" });
  const name = h("input", { required: true, pattern: "[A-Za-z0-9_][A-Za-z0-9_.\\-]{0,99}", "aria-label": "Name", placeholder: "name" });
  const seeds = h("input", { type: "number", min: 1, max: 200, step: 1, value: 1, "aria-label": "Number of seeds" });
  const start = h("button", { type: "submit", class: "primary" }, "Start");
  const choice = h("select", { "aria-label": "Template", change: () => take({ template: choice.value }, choice.value.replace(/^.*:/, "")) });
  let timer = null;
  let asked = 0;
  let isGone = false;

  view.append(
    h("h1", {}, "New experiment"),
    h("div", { class: "tools" }, h("label", {}, "from ", choice)),
    h("div", { class: "columns" }, editor, h("div", {}, h("h2", {}, "Check"), problems)),
    h("form", { class: "tools", submit: (event) => { event.preventDefault(); begin(); } },
      h("label", {}, "name ", name), h("label", {}, "seeds ", seeds), start,
      h("span", { class: "hint" }, "One run for each seed, from 1 on, as many at once as there are processors.")),
  );

  async function take(source, suggested) {
    try {
      editor.value = (await ask("experiment", source)).text;
      if (!name.value || name.dataset.suggested === name.value) name.value = name.dataset.suggested = suggested;
      check();
    } catch (error) {
      problems.replaceChildren(h("li", {}, problem(error)));
    }
  }

  function later() {
    clearTimeout(timer);
    timer = setTimeout(check, CHECK_AFTER_MS);
  }

  async function check() {
    const number = ++asked;
    const text = editor.value;
    try {
      const answer = await change("check", { text });
      if (!isGone && number === asked) show(answer.problems);
    } catch (error) {
      if (!isGone) problems.replaceChildren(h("li", {}, problem(error)));
    }
  }

  function show(found) {
    start.disabled = found.length > 0;
    problems.replaceChildren(...(found.length === 0 ? [h("li", { class: "fine" }, "Nothing is wrong.")] : found.map((entry) => h("li", { class: "problem" },
      entry.line === null ? null : h("button", { type: "button", click: () => select(entry.line) }, `line ${entry.line}`), " ", entry.message))));
  }

  function select(line) {
    const lines = editor.value.split("\n");
    const from = lines.slice(0, line - 1).reduce((sum, each) => sum + each.length + 1, 0);
    editor.focus();
    editor.setSelectionRange(from, from + (lines[line - 1]?.length ?? 0));
    editor.scrollTop = (editor.scrollHeight / lines.length) * (line - 5);
  }

  async function begin() {
    try {
      const count = Number(seeds.value);
      const answer = await change("start", {
        text: editor.value, name: name.value, seeds: count === 1 ? [] : Array.from({ length: count }, (_, index) => index + 1),
      });
      if (answer.problems?.length) show(answer.problems);
      else location.hash = "#/jobs";
    } catch (error) {
      problems.replaceChildren(h("li", {}, problem(error)));
    }
  }

  (async () => {
    const { names } = await ask("templates");
    choice.replaceChildren(h("option", { value: "", disabled: true }, "a template"), ...names.map((each) => h("option", { value: each }, each)));
    if (query.get("mission")) {
      const mission = query.get("mission");
      choice.value = "arena:aggregation";
      await take({ template: choice.value }, mission.replace(/\.yaml$/, "_run"));
      editor.value = editor.value.replace(/^( *mission: *)\S+/m, `$1${mission}`);
      check();
    } else if (query.get("run")) {
      choice.value = "";
      take({ run: query.get("run") }, `${query.get("run").replace(/^.*\//, "").replace(/[^A-Za-z0-9_.-]/g, "_")}-copy`);
    } else {
      choice.value = "arena:aggregation";
      take({ template: choice.value }, "aggregation");
    }
  })().catch((error) => problems.replaceChildren(h("li", {}, problem(error))));
  return { trail: ["new experiment"], leave: () => { isGone = true; clearTimeout(timer); } };
}
