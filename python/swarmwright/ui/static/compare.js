// Several runs compared: the same statistics, table and figure as `swarmwright runs compare`.
import { ask, h, problem } from "./dom.js";
import { runAddress } from "./runs.js";

export function show(view, query) {
  const runs = query.getAll("run");
  let isGone = false;
  const heldOut = h("input", { type: "checkbox", change: load });
  heldOut.checked = query.get("held_out") === "true";
  const at = h("input", { type: "number", min: 1, step: 1, change: load, placeholder: "the end", value: query.get("at") ?? "" });
  const copy = h("button", { type: "button", click: () => navigator.clipboard?.writeText(output.textContent) }, "Copy");
  const save = h("a", { class: "button", download: "comparison.svg" }, "Save the figure (SVG)");
  const output = h("pre", { class: "report" });
  const figure = h("div", { class: "figure" });
  view.append(
    h("h1", {}, `${runs.length} ${runs.length === 1 ? "run" : "runs"} compared`),
    h("p", { class: "names" }, runs.slice(0, 12).map((id) => h("a", { href: runAddress(id) }, id)), runs.length > 12 ? `and ${runs.length - 12} more` : null),
    h("div", { class: "tools" }, h("label", {}, heldOut, " on held-out seeds"), h("label", {}, "after evaluations ", at), copy, save),
    figure, output,
  );

  async function load() {
    const parameters = { run: runs, held_out: heldOut.checked ? "true" : null, at: at.value || null };
    const shown = new URLSearchParams([...runs.map((id) => ["run", id]), ...(heldOut.checked ? [["held_out", "true"]] : []), ...(at.value ? [["at", at.value]] : [])]);
    history.replaceState(null, "", `#/compare?${shown}`);
    output.textContent = "comparing…";
    try {
      const result = await ask("compare", parameters);
      if (isGone) return;
      output.textContent = result.text;
      const image = new Blob([result.figure], { type: "image/svg+xml" });
      const reader = new FileReader();
      reader.onload = () => {
        // An image runs no scripts and loads nothing.
        figure.replaceChildren(h("img", { src: reader.result, alt: "Fitness of the groups" }));
        save.href = reader.result;
      };
      reader.readAsDataURL(image);
    } catch (error) {
      if (isGone) return;
      figure.replaceChildren(problem(error));
      output.textContent = "";
    }
  }

  load();
  return { trail: ["compare"], leave: () => { isGone = true; } };
}
