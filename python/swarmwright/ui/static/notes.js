// A tab of the run: its tags, and a note.
import { ask, change, h, problem } from "./dom.js";
import { store } from "./store.js";

export async function show(element, run) {
  const { tags, note } = await ask("notes", { run: run.id });
  const isFixed = store.window.read_only;
  const status = h("span", { role: "status", class: "hint" });
  const text = h("textarea", { rows: 8, maxlength: 10000, readonly: isFixed, "aria-label": "Note", placeholder: "What is this run about?" });
  text.value = note;
  const names = h("input", { "aria-label": "Tags", readonly: isFixed, placeholder: "thesis, noise", value: tags.join(", ") });
  let saved = tags;
  let savedInputs = [text.value, names.value];
  const form = h("form", { class: "note", submit: async (event) => {
    event.preventDefault();
    const now = names.value.split(",").map((each) => each.trim()).filter(Boolean);
    const inputs = [text.value, names.value];
    try {
      await change("annotate", { runs: [run.id], note: text.value, add: now.join(","), remove: saved.filter((each) => !now.includes(each)).join(",") });
      saved = now;
      savedInputs = inputs;
      status.replaceChildren("Saved.");
    } catch (error) {
      status.replaceChildren(problem(error));
    }
  } }, h("label", {}, "tags, separated by commas ", names), h("label", {}, "note ", text), isFixed ? null : h("div", { class: "tools" }, h("button", { type: "submit", class: "primary" }, "Save"), status));
  element.append(form);
  return { isChanged: () => !isFixed && (text.value !== savedInputs[0] || names.value !== savedInputs[1]) };
}
