// The front of a run with several objectives, at any generation, over any two of them.
import { h } from "./dom.js";
import { rangeOf } from "./colors.js";
import { choice, showElites } from "./elites.js";
import { Scatter, words } from "./scatter.js";

const NONE = "nothing";

export function show(element, run) {
  let across = null;
  let up = null;
  let shade = null;
  const ranges = {};
  const picture = h("div");
  const plot = new Scatter(picture, { label: "Front", height: 400, act: (index, isBeside) => page.watch(index, isBeside) });
  const page = showElites(element, run, { states: "front", state: "front_points" }, {
    picture, options, draw, hint: "Candidates that no other dominates. Click one to watch it, shift-click to watch it beside the others.",
  });

  function options({ goals }, redraw) {
    const names = ["fitness", ...Object.keys(goals)];
    up = choice("up", names, "fitness", redraw);
    across = choice("across", names, names[1], redraw);
    shade = choice("colour", [NONE, ...names], names[2] ?? NONE, redraw);
    return [across.element, up.element, shade.element];
  }

  function label(states, name) {
    const goal = name === "fitness" ? "maximize" : states.goals[name];
    return `${name} (${goal === "maximize" ? "more" : "less"} is better)`;
  }

  function draw(states, elites) {
    // Axes grow with what was seen, so that fronts of several generations can be compared.
    for (const [name, values] of Object.entries(elites.columns)) {
      if (values.length === 0) continue;
      const [low, high] = rangeOf(values);
      const [least, most] = ranges[name] ?? [low, high];
      ranges[name] = [Math.min(low, least), Math.max(high, most)];
    }
    const axis = (list) => ({ label: label(states, list.value), values: elites.columns[list.value] });
    const isShaded = shade.list.value !== NONE;
    const isUp = (list) => list.value === "fitness" || states.goals[list.value] === "maximize";
    const isPlane = Object.keys(states.goals).length === 1 && across.list.value !== up.list.value;
    plot.show({
      x: axis(across.list), y: axis(up.list), shade: isShaded ? axis(shade.list) : null,
      ranges: { x: ranges[across.list.value] ?? [0, 1], y: ranges[up.list.value] ?? [0, 1], shade: ranges[shade.list.value] ?? [0, 1] },
      // What is dominated is to the left of a point, or to its right where less is better.
      steps: isPlane ? (isUp(across.list) ? "pre" : "post") : null,
      words: (index) => `generation ${elites.born[index]}, candidate ${elites.candidate[index]}: ${words(elites.columns, index)}`,
    });
  }

  return { update: page.update, leave: () => {
    page.leave();
    plot.destroy();
  } };
}
