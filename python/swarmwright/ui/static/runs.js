// The list of runs: filter, sort, select several.
import { askFor, askWhether, change, color, date, duration, figure, h, problem } from "./dom.js";
import { shareOf } from "./colors.js";
import { store } from "./store.js";
import { onTheme } from "./theme.js";

const COLUMNS = [
  { key: "id", title: "run" },
  { key: "state", title: "state" },
  { key: "simulation", title: "simulation" },
  { key: "method", title: "method" },
  { key: "controller", title: "controller" },
  { key: "seed", title: "seed", numeric: true },
  { key: "generations", title: "generations", numeric: true },
  { key: "spark", title: "best so far" },
  { key: "best", title: "best", numeric: true, help: "Best recorded fitness, which is biased upwards where fitness depends on the seed" },
  { key: "held_out", title: "held-out", numeric: true, help: "Mean fitness of the best candidate on seeds that evolution did not use" },
  { key: "failed", title: "failed", numeric: true, help: "Evaluations of which at least one episode failed" },
  { key: "rate", title: "evaluations/s", numeric: true },
  { key: "left", title: "time left", numeric: true },
  { key: "created", title: "started" },
];
const SPARK = { width: 120, height: 26 };
const selected = new Set();

export function runAddress(id) {
  return `#/run/${encodeURIComponent(id)}`;
}

function cell(column, row) {
  switch (column.key) {
    case "id":
      return [h("a", { href: runAddress(row.id) }, row.id === "." ? "this folder" : row.id), row.tags.map((tag) => h("span", { class: "tag" }, tag))];
    case "state":
      return [h("span", { class: `state ${row.state}`, title: row.problem }, row.state)];
    case "generations":
      return [row.budget ? `${figure(row.generations)} / ${figure(row.budget)}` : figure(row.generations)];
    case "spark":
      return [spark(row.spark)];
    case "failed":
      return [row.failed ? h("span", { class: "bad" }, figure(row.failed)) : ""];
    case "held_out":
      return row.held_out === null
        ? [""]
        : [figure(row.held_out), row.held_out_failed ? h("span", { class: "bad", title: `${row.held_out_failed} failed episodes are left out` }, " *") : ""];
    case "best":
      return [figure(row.best)];
    case "rate":
      return [row.rate === null ? "" : figure(row.rate)];
    case "left":
      return [row.left === null ? "" : duration(row.left)];
    case "seed":
      return [row.seed === null ? "" : String(row.seed)];
    case "created":
      return [row.created ? date(row.created) : ""];
    default:
      return [row[column.key] ?? ""];
  }
}

function spark(values) {
  const canvas = h("canvas", { width: SPARK.width * 2, height: SPARK.height * 2, class: "spark", "aria-hidden": "true" });
  const numbers = values.filter((value) => value !== null);
  if (numbers.length < 2) return canvas;
  const [low, high] = [Math.min(...numbers), Math.max(...numbers)];
  const context = canvas.getContext("2d");
  context.strokeStyle = color("--accent");
  context.lineWidth = 2.5;
  context.beginPath();
  values.forEach((value, index) => {
    if (value === null) return;
    const x = 3 + (index / (values.length - 1)) * (canvas.width - 6);
    const y = high === low ? canvas.height / 2 : 4 + (1 - shareOf(value, [low, high])) * (canvas.height - 8);
    context.lineTo(x, y);
  });
  context.stroke();
  return canvas;
}

/** Words must all occur in a row; `key:word` in that column alone, `key>1` compares numbers. */
function matcher(query) {
  const conditions = query.toLowerCase().split(/\s+/).filter(Boolean).map((word) => {
    const comparison = /^([a-z_-]+)(>=|<=|>|<)(-?[\d.e+-]+)$/.exec(word);
    if (comparison) {
      const key = comparison[1].replaceAll("-", "_");
      const bound = Number(comparison[3]);
      const tests = { ">": (v) => v > bound, "<": (v) => v < bound, ">=": (v) => v >= bound, "<=": (v) => v <= bound };
      return (row) => row[key] !== null && tests[comparison[2]](row[key]);
    }
    const [key, value] = word.includes(":") ? word.split(/:(.*)/s) : [null, word];
    if (key !== null && COLUMNS.some((column) => column.key === key)) {
      return (row) => String(row[key] ?? "").toLowerCase().includes(value);
    }
    if (key === "tag") return (row) => row.tags.some((tag) => tag.toLowerCase().includes(value));
    return (row) => [row.id, ...row.tags, row.state, row.simulation, row.method, row.controller, row.name, row.problem]
      .some((field) => String(field ?? "").toLowerCase().includes(word));
  });
  return (row) => conditions.every((condition) => condition(row));
}

function compareBy(key, isReversed) {
  const sign = isReversed ? -1 : 1;
  return (one, other) => {
    const [a, b] = key === "spark" ? [one.best, other.best] : [one[key], other[key]];
    if (a === b) return one.id < other.id ? -1 : 1;
    if (a === null || a === "") return 1;
    if (b === null || b === "") return -1;
    if (typeof a === "number" && typeof b === "number") return sign * (a - b);
    return sign * String(a).localeCompare(String(b), "en", { numeric: true });
  };
}

export function show(view, query) {
  let sort = query.get("sort") ?? "created";
  let isReversed = query.get("order") !== "up";
  const lines = new Map();
  const count = h("span", { class: "count", role: "status" });
  const search = h("input", {
    type: "search", placeholder: "Filter: words, state:running, best>-3", "aria-label": "Filter runs",
    value: query.get("filter") ?? "", input: () => { remember(); draw(); },
  });
  const compare = h("button", { type: "button", click: () => {
    location.hash = `#/compare?${new URLSearchParams([...selected].map((id) => ["run", id]))}`;
  } }, "Compare");
  const remove = h("button", { type: "button", class: "changes", click: deleteSelected }, "Delete");
  const tag = h("button", { type: "button", click: tagSelected }, "Tag");
  const all = h("input", { type: "checkbox", "aria-label": "Select all that are shown", change: () => {
    for (const row of shown()) all.checked ? selected.add(row.id) : selected.delete(row.id);
    draw();
  } });
  const heads = COLUMNS.map((column) => h("th", { scope: "col", class: column.numeric ? "number" : null, title: column.help }, h("button", {
    type: "button",
    click: () => {
      isReversed = sort === column.key ? !isReversed : Boolean(column.numeric) || column.key === "created";
      sort = column.key;
      remember();
      draw();
    },
  }, column.title)));
  const body = h("tbody");
  const empty = h("p", { class: "empty" });
  const message = h("div");

  async function deleteSelected() {
    const names = [...selected];
    const few = names.slice(0, 5).join(", ") + (names.length > 5 ? ` and ${names.length - 5} more` : "");
    if (!await askWhether(`Delete ${names.length === 1 ? "the run" : `${names.length} runs`} ${few}? Their records cannot be brought back.`, "Delete", "Cancel")) return;
    try {
      await change("delete", { runs: names });
      message.replaceChildren(h("p", { class: "hint" }, "Deleting… ", h("a", { href: "#/jobs" }, "Jobs")));
    } catch (error) {
      message.replaceChildren(problem(error));
    }
  }

  async function tagSelected() {
    const tags = await askFor(`Tags for ${selected.size === 1 ? "the run" : `${selected.size} runs`}, separated by commas:`, "Add");
    if (!tags) return;
    try {
      await change("annotate", { runs: [...selected], add: tags });
      message.replaceChildren();
    } catch (error) {
      message.replaceChildren(problem(error));
    }
  }

  view.append(
    h("div", { class: "tools" }, search, compare, ...(store.window.read_only ? [] : [tag, remove]), count),
    message,
    h("div", { class: "wide" }, h("table", { class: "runs" }, h("thead", {}, h("tr", {}, h("th", {}, all), heads)), body)),
    empty,
  );

  function remember() {
    const parameters = new URLSearchParams();
    if (search.value) parameters.set("filter", search.value);
    if (sort !== "created") parameters.set("sort", sort);
    if (!isReversed) parameters.set("order", "up");
    history.replaceState(null, "", `#/${parameters.size ? `?${parameters}` : ""}`);
  }

  function shown() {
    return [...store.rows.values()].filter(matcher(search.value)).sort(compareBy(sort, isReversed));
  }

  function line(row) {
    const known = lines.get(row.id);
    if (known && known.row === row) {
      known.box.checked = selected.has(row.id);
      return known.element;
    }
    const box = h("input", { type: "checkbox", "aria-label": `Select ${row.id}`, change: () => {
      box.checked ? selected.add(row.id) : selected.delete(row.id);
      tools();
    } });
    box.checked = selected.has(row.id);
    const element = h("tr", {}, h("td", {}, box), COLUMNS.map((column) => h("td", { class: column.numeric ? "number" : null }, cell(column, row).flat())));
    if (row.problem) element.append(h("td", { class: "problem" }, row.problem));
    lines.set(row.id, { row, element, box });
    return element;
  }

  function tools() {
    for (const id of selected) if (!store.rows.has(id)) selected.delete(id);
    compare.disabled = tag.disabled = remove.disabled = selected.size === 0;
    compare.textContent = selected.size ? `Compare ${selected.size}` : "Compare";
  }

  function draw() {
    const rows = shown();
    const elements = rows.map(line);
    if (elements.length !== body.children.length || elements.some((element, index) => body.children[index] !== element)) {
      body.replaceChildren(...elements);
    }
    heads.forEach((head, index) => head.setAttribute("aria-sort", COLUMNS[index].key === sort ? (isReversed ? "descending" : "ascending") : "none"));
    count.textContent = rows.length === store.rows.size ? `${store.rows.size} runs` : `${rows.length} of ${store.rows.size} runs`;
    all.checked = rows.length > 0 && rows.every((row) => selected.has(row.id));
    empty.replaceChildren(...(store.rows.size || !store.isLoaded ? [] : [
      `There are no runs below ${store.window.folder} yet. They appear here as soon as one starts, for example by `,
      h("code", {}, "swarmwright optimize FILE"), ".",
    ]));
    tools();
  }

  draw();
  const endListening = store.listen(draw);
  const endTheme = onTheme(() => {
    lines.clear();
    draw();
  });
  return { trail: [], leave: () => {
    endListening();
    endTheme();
  } };
}
