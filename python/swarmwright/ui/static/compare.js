// Several runs compared: the same statistics, tables and figure as `swarmwright runs compare`.
import { Newest, change, figure, h, table, tell } from "./dom.js";
import { runAddress } from "./runs.js";

const BY = { fitness: "fitness", hypervolume: "hypervolume of fronts", qd_score: "QD score of archives", coverage: "coverage of archives" };
const STYLES = ["screen", "ieee", "nature", "science", "acm", "elsevier", "springer"];
const MOST_NAMES = 12;

function select(name, choices, chosen, changed) {
  const element = h("select", { "aria-label": name, change: changed }, Object.entries(choices).map(([value, words]) => h("option", { value }, words)));
  element.value = chosen in choices ? chosen : Object.keys(choices)[0];
  return element;
}

function groupsTable(groups) {
  const isLacking = groups.some((group) => group.left_out);
  const isFailed = groups.some((group) => group.runs.some((run) => run.failed));
  const heads = ["group", "runs", ...(isLacking ? ["left out"] : []), "evaluations", ...(isFailed ? ["failed evaluations"] : []), "median", "quartiles", "worst", "best"];
  return table(heads, groups.map((group) => [
    h("details", {}, h("summary", {}, group.label || "all runs"), group.runs.map((run) => h("div", {}, h("a", { href: runAddress(run.id) }, run.id)))),
    group.runs.length, ...(isLacking ? [group.left_out] : []), span(group.runs.map((run) => run.evaluations)),
    ...(isFailed ? [span(group.runs.map((run) => run.failed))] : []),
    group.median, group.quartiles.map(figure).join(" to "), group.worst, group.best,
  ]));
}

function span(counts) {
  const [low, high] = [Math.min(...counts), Math.max(...counts)];
  return low === high ? figure(low) : `${figure(low)} to ${figure(high)}`;
}

function pairsTable(pairs) {
  return table(["first", "second", "effect", "A12", "difference", "95 % interval", "p", "p (Holm)"], pairs.map((pair) => [
    pair.first, pair.second, pair.magnitude ?? "not significant", pair.a12, pair.difference,
    pair.interval ? pair.interval.map(figure).join(" to ") : "", probability(pair.p), probability(pair.p_holm),
  ]));
}

function probability(p) {
  return p === null ? "–" : p < 0.001 ? "< 0.001" : p.toFixed(3);
}

export function show(view, query) {
  const runs = query.getAll("run");
  const newest = new Newest();
  const newestLeague = new Newest();
  let result = null;
  const box = (name) => {
    const input = h("input", { type: "checkbox", change: load });
    input.checked = query.get(name) === "true";
    return input;
  };
  const inputs = { held_out: box("held_out"), unfinished: box("unfinished"), metrics: box("metrics") };
  const at = h("input", { type: "number", min: 1, step: 1, change: load, placeholder: "the end", "aria-label": "after", value: query.get("at") ?? query.get("at_episodes") ?? "" });
  const unit = select("unit", { at: "evaluations", at_episodes: "episodes" }, query.has("at_episodes") ? "at_episodes" : "at", load);
  const by = select("compared by", BY, query.get("by") ?? "fitness", load);
  const x = select("x axis", { evaluations: "evaluations", generations: "generations" }, query.get("x") ?? "", load);
  const style = select("style", Object.fromEntries(STYLES.map((name) => [name, name])), query.get("style") ?? "", load);
  const links = h("span", { class: "tools" });
  const tables = h("div");
  const picture = h("div", { class: "figure" });
  const status = h("span", { role: "status", class: "hint" });
  const league = h("div", { class: "league" });
  const games = h("section", { hidden: true }, h("div", { class: "tools" },
    h("button", { type: "button", click: playLeague }, "Play a league"), h("span", { class: "hint" }, "The best of each run against all others, on both sides, on seeds that no run used.")), league);
  const copied = (words, text) => h("button", { type: "button", click: async () => {
    try {
      await navigator.clipboard.writeText(text());
      status.textContent = `${words}: copied.`;
    } catch {
      status.textContent = "The browser does not allow copying; use the download.";
    }
  } }, words);
  view.append(
    h("h1", {}, `${runs.length} ${runs.length === 1 ? "run" : "runs"} compared`),
    h("p", { class: "names" }, runs.slice(0, MOST_NAMES).map((id) => h("a", { href: runAddress(id) }, id)), runs.length > MOST_NAMES ? `and ${runs.length - MOST_NAMES} more` : null),
    h("div", { class: "tools" }, h("label", {}, "by ", by), h("label", {}, inputs.held_out, " on held-out seeds"),
      h("label", {}, "after ", at, " ", unit), h("label", {}, inputs.unfinished, " with unfinished runs")),
    h("div", { class: "tools" }, h("label", {}, "over ", x), h("label", {}, inputs.metrics, " all metrics"), h("label", {}, "style ", style), links,
      copied("Copy as text", () => result?.text ?? ""), copied("Copy as LaTeX", () => result?.latex ?? ""), status),
    picture, tables, games,
  );

  async function playLeague(event) {
    const button = event.currentTarget;
    button.disabled = true;
    league.replaceChildren(h("p", { class: "empty" }, "playing…"));
    try {
      const { tables: played, notes } = await change("league", { runs }, newestLeague.next());
      league.replaceChildren(...played.flatMap(({ side, head, rows }) => [side ? h("h2", {}, side) : "", table(head, rows, { isNumeric: true })]),
        h("ul", { class: "notes" }, notes.map((note) => h("li", {}, note))));
    } catch (error) {
      tell(league, error);
    }
    button.disabled = false;
  }

  function parameters() {
    const values = {
      by: by.value === "fitness" ? null : by.value, [unit.value]: at.value || null, x: x.value === "evaluations" ? null : x.value,
      style: style.value === "screen" ? null : style.value,
      ...Object.fromEntries(Object.entries(inputs).map(([name, input]) => [name, input.checked ? "true" : null])),
    };
    return new URLSearchParams([...runs.map((id) => ["run", id]), ...Object.entries(values).filter(([, value]) => value !== null)]);
  }

  async function load() {
    const query = parameters();
    history.replaceState(null, "", `#/compare?${query}`);
    links.replaceChildren(...["svg", "pdf", "png", "csv"].map((format) =>
      h("a", { class: "button", download: `comparison.${format}`, href: `api/compare_file?${query}&format=${format}` }, format.toUpperCase())));
    status.textContent = "comparing…";
    try {
      result = await newest.ask("compare", query);
      status.textContent = "";
      draw(result);
    } catch (error) {
      if (error.name === "AbortError") return;
      result = null;
      status.textContent = "";
      picture.replaceChildren();
      tell(tables, error);
    }
  }

  function draw({ values, figure: svg, can_play: canPlay }) {
    games.hidden = !canPlay || runs.length < 2;
    tables.replaceChildren(...values.tasks.flatMap((task) => {
      const groups = values.groups.filter((group) => task.groups.includes(group.label));
      const pairs = values.pairs.filter((pair) => task.groups.includes(pair.first) && task.groups.includes(pair.second));
      const test = task.kruskal_wallis;
      return [
        values.tasks.length > 1 ? h("h2", {}, task.label) : null,
        groupsTable(groups),
        test ? h("p", {}, `All groups: Kruskal and Wallis' H = ${figure(test.h)}, p = ${probability(test.p)}`) : null,
        pairs.length ? pairsTable(pairs) : null,
      ];
    }).filter((element) => element !== null), h("ul", { class: "notes" }, values.notes.map((note) => h("li", {}, `${note}.`))));
    // An image runs no scripts and loads nothing.
    const reader = new FileReader();
    reader.onload = () => picture.replaceChildren(h("img", { src: reader.result, alt: "Curves of the groups, and the value of every run" }));
    reader.readAsDataURL(new Blob([svg], { type: "image/svg+xml" }));
  }

  load();
  return { trail: ["compare"], leave: () => [newest, newestLeague].forEach((each) => each.end()) };
}
