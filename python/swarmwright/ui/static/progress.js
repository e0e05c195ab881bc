// Champions of all generations of a competition against each other; those of a match, to watch.
import { ask, change, figure, h, table, tell } from "./dom.js";
import { rangeOf } from "./colors.js";
import { choice } from "./elites.js";
import { HeatMap } from "./heatmap.js";
import { drawChart, series } from "./lines.js";

const LOOK_MS = 500; // between two looks at matches that are played
const ALL = "all";
const ANCESTORS = "against earlier opponents (CIAO)";
const LINES = { rating: ["ratings_low", "ratings", "ratings_high"], "mean fitness": ["low", "means", "high"] };

const percent = (share) => `${figure(Math.round(1000 * share) / 10)} %`;
const interval = (low, high) => `95 %: ${figure(low)} to ${figure(high)}`;

export function show(element, run) {
  let isGone = false;
  let timer = null;
  let result = null;
  let shown = ""; // what is drawn
  let present = 0; // generations of the run
  let rounds = 1; // in which all meet all: of two sides, the matches of one are those of the other
  let removeLines = () => {};
  const champions = h("input", { type: "number", min: 2, step: 1, "aria-label": "champions of each side", input: offer });
  const episodes = h("input", { type: "number", min: 2, step: 1, "aria-label": "episodes of each match", input: offer });
  const start = h("button", { type: "button", class: "primary", click: () => order("progress_play", { champions: champions.value, episodes: episodes.value }) });
  const end = h("button", { type: "button", click: () => order("progress_stop") }, "Stop");
  const bar = h("progress", { max: 1, "aria-label": "Matches that are played" });
  const status = h("span", { role: "status", class: "count" });
  const message = h("div");
  const facts = h("div", { class: "sides" });
  const tools = h("div", { class: "tools" });
  const picture = h("div", { hidden: true });
  const hint = h("p", { class: "hint" });
  const lines = h("div", { class: "lines" });
  const rows = h("div");
  const details = h("details", { hidden: true, toggle: drawTable }, h("summary", {}, "As a table"), rows);
  element.append(h("p", { class: "hint" }, "The fitness of a competition shows no progress, since opponents improve as well. Here, champions of all generations of each side meet those of the other, or of all others together."),
    h("div", { class: "tools" }, h("label", {}, "champions ", champions), h("label", {}, "episodes ", episodes), start, end, bar, status),
    message, facts, tools, picture, hint, lines, details);
  const map = new HeatMap(picture, { label: "Matches of champions", height: 420, act: ({ column, row }, isBeside) => watch(side.list.selectedIndex, row, column, isBeside) });
  const side = choice("fitness of", [], "", draw);
  const which = choice("matches", [ALL, ANCESTORS], ALL, draw);
  const line = choice("over generations", Object.keys(LINES), Object.keys(LINES)[0], draw);

  async function order(request, values = {}) {
    try {
      take(await change(request, { run: run.id, ...values }));
      look();
    } catch (error) {
      tell(message, error);
    }
  }

  /** Reads what is known, again and again while matches are played. */
  async function look() {
    clearTimeout(timer);
    try {
      take(await ask("progress", { run: run.id }));
    } catch (error) {
      if (!isGone) tell(message, error);
    }
  }

  function take(answer) {
    if (isGone) return;
    const { playing, error, limits } = answer;
    if (limits && champions.value === "") {
      [champions.value, champions.max] = limits.champions;
      [episodes.value, episodes.max] = limits.episodes;
    }
    present = answer.present ?? present;
    if (answer.sides) rounds = answer.sides > 2 ? answer.sides : 1;
    message.replaceChildren();
    if (error) tell(message, new Error(error));
    end.hidden = bar.hidden = playing === null;
    start.hidden = playing !== null;
    if (playing?.whole) bar.value = playing.done / playing.whole;
    else bar.removeAttribute("value");
    status.textContent = playing === null ? "" : [playing.whole ? `${figure(playing.done)} of ${figure(playing.whole)} episodes` : null,
      playing.waiting_for ? `waiting for ${playing.waiting_for}` : null].filter(Boolean).join(", ");
    if (playing !== null) timer = setTimeout(look, LOOK_MS);
    const newest = JSON.stringify(answer.result);
    if (answer.result !== null && newest !== shown) {
      [shown, result] = [newest, answer.result];
      drawAll();
    }
    offer();
  }

  function offer() {
    const count = Math.min(Number(champions.value), present);
    start.textContent = `Play ${figure(rounds * count * count)} matches`;
    if (result === null) return;
    const last = result.generations.at(-1);
    const newer = present - 1 - last;
    hint.textContent = [
      `${figure(result.generations.length)} champions of each side, up to generation ${figure(last)}, ${figure(result.episodes)} episodes of each match.`,
      newer > 0 ? `The run has ${figure(newer)} newer ${newer === 1 ? "generation" : "generations"}: play again to include them.` : null,
      "Click a match to watch its first episode, shift-click to watch it beside the others.",
    ].filter(Boolean).join(" ");
  }

  function drawAll() {
    picture.hidden = details.hidden = false;
    const names = result.sides.map((each) => each.name);
    const chosen = Math.max(0, side.list.selectedIndex);
    side.list.replaceChildren(...names.map((name) => h("option", {}, name)));
    side.list.selectedIndex = chosen;
    tools.replaceChildren(side.element, which.element, line.element);
    facts.replaceChildren(...result.sides.map(describe));
    draw();
    drawTable();
  }

  function describe(each, index) {
    const take = each.generations.indexOf(each.take);
    const latest = result.generations.length - 1;
    const [low, high] = each.null;
    return h("section", {}, h("h2", {}, dot(each), each.name, `: ${each.verdict}`), h("dl", { class: "facts" }, [
      ["mean fitness, first to last tenth", `${each.gain > 0 ? "+" : ""}${figure(each.gain)} (${interval(each.gain_low, each.gain_high)})`],
      ["cyclic share", `${percent(each.cyclic_share)} (${percent(low)} to ${percent(high)} from noise)${each.cycles ? ": goes in circles" : ""}`,
        "Part of the differences between champions that depends on the opponent, so that no ranking explains it"],
      ["generation to take", [figure(each.take), " ", h("button", { type: "button", click: (event) => watch(index, take, latest, event.shiftKey) }, "Watch")],
        "The earliest that is not clearly worse than the best; Watch plays it against the last opponent"],
    ].map(([name, value, note]) => h("div", {}, h("dt", { title: note }, name), h("dd", {}, value)))));
  }

  function dot({ color: hue }) {
    const mark = h("span", { class: "dot" });
    mark.style.background = hue;
    return mark;
  }

  function draw() {
    if (result === null) return;
    const own = side.list.selectedIndex;
    const { generations, sides } = result;
    const count = generations.length;
    const isShown = (row, column) => which.list.value === ALL || column <= row;
    const values = new Float32Array(count * count).fill(NaN);
    for (let row = 0; row < count; row += 1) {
      for (let column = 0; column < count; column += 1) if (isShown(row, column)) values[column * count + row] = sides[own].outcomes[row][column];
    }
    const half = generations.at(-1) / (count - 1) / 2; // they are evenly spread from 0 on
    const axis = (name) => ({ label: `generation of ${name}`, range: [-half, generations.at(-1) + half], whole: true });
    map.show({
      columns: count, rows: count, values, range: rangeOf(values), isUpward: true,
      below: axis(sides[own].opponents), left: axis(sides[own].name),
      bar: `mean fitness of ${sides[own].name}`,
      words: (column, row) => `${sides[own].name} of generation ${generations[row]} against ${sides[own].opponents} of generation ${generations[column]}`
        + (isShown(row, column) ? `: ${figure(sides[own].outcomes[row][column])}` : ""),
    });
    removeLines();
    const removers = sides.map((each) => drawChart(lines, 220, {
      x: `generation of ${each.name}`, y: line.list.value, bands: [{ series: [3, 1], fill: `${each.color}40` }],
      series: () => [series("lower", "", 0), series(each.name, each.color), series("upper", "", 0)],
    }, [generations, ...LINES[line.list.value].map((name) => each[name])], (index) => watch(0, index, index, false)));
    removeLines = () => removers.forEach((remove) => remove());
  }

  function drawTable() {
    if (!details.open || result === null) return;
    const { generations, sides } = result;
    const heads = sides.flatMap(({ name }) => [`rating of ${name}`, "95 %", "mean fitness", "95 %"]);
    rows.replaceChildren(table(["generation", ...heads, ""], generations.map((generation, index) => [
      generation,
      ...sides.flatMap((each) => [figure(each.ratings[index]), `${figure(each.ratings_low[index])} to ${figure(each.ratings_high[index])}`,
        figure(each.means[index]), `${figure(each.low[index])} to ${figure(each.high[index])}`]),
      h("button", { type: "button", click: (event) => watch(0, index, index, event.shiftKey) }, "Watch"),
    ]), { isNumeric: true }));
  }

  /** Watches a match: of a side's champion, by the index of its generation, against those of the others. */
  function watch(own, row, column, isBeside) {
    const match = result.sides.map((_, each) => result.generations[each === own ? row : column]);
    run.replay({ match: match.join(",") }, isBeside);
  }

  look();
  return { update: look, leave: () => {
    isGone = true;
    clearTimeout(timer);
    removeLines();
    map.destroy();
  } };
}
