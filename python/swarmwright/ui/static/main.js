// The address says what is shown: #/ the list, #/run/ID, #/compare?run=ID&run=ID, #/new, #/jobs, #/draw.
import { ask, h } from "./dom.js";
import { showComparison } from "./compare.js";
import { showBoard } from "./draw.js";
import { showJobs } from "./jobs.js";
import { showNew } from "./new.js";
import { showRun } from "./run.js";
import { showRuns } from "./runs.js";
import { store } from "./store.js";

const view = document.getElementById("view");
const trail = document.getElementById("trail");
const connection = document.getElementById("connection");
let leave = () => {};

const routes = [
  [/^$/, (_match, query) => showRuns(view, query)],
  [/^run\/(.+)$/, (match, query) => showRun(view, decodeURIComponent(match[1]), query)],
  [/^new$/, (_match, query) => showNew(view, query)],
  [/^draw$/, (_match, query) => showBoard(view, query)],
  [/^jobs$/, () => showJobs(view)],
  [/^compare$/, (_match, query) => showComparison(view, query)],
];

function route() {
  const [path, query = ""] = location.hash.replace(/^#\/?/, "").split("?");
  leave();
  view.replaceChildren();
  for (const [pattern, show] of routes) {
    const match = pattern.exec(path);
    if (match === null) continue;
    const shown = show(match, new URLSearchParams(query));
    leave = shown.leave ?? (() => {});
    trail.replaceChildren(...(shown.trail ?? []).map((name) => h("span", {}, name)));
    document.title = [...(shown.trail ?? []), "Swarmwright"].reverse().slice(0, 2).join(" – ");
    view.focus({ preventScroll: true });
    return;
  }
  view.append(h("p", {}, "There is no such page. ", h("a", { href: "#/" }, "All runs")));
}

function theme(choice) {
  if (choice) localStorage.setItem("swarmwright-theme", choice);
  const chosen = localStorage.getItem("swarmwright-theme");
  if (chosen) document.documentElement.dataset.theme = chosen;
}

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

function switchTheme() {
  theme(isDark() ? "light" : "dark");
  route();
}

theme();
document.getElementById("theme").addEventListener("click", switchTheme);
addEventListener("hashchange", route);
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || /INPUT|SELECT|TEXTAREA/.test(event.target.tagName)) return;
  if (event.key === "d") switchTheme();
  if (event.key === "n" && !store.window.read_only) location.hash = "#/new";
  if (event.key === "Escape" && location.hash.length > 2) location.hash = "#/";
  if (event.key === "/") {
    document.querySelector("input[type=search]")?.focus();
    event.preventDefault();
  }
});
store.onConnection((isConnected) => {
  connection.textContent = isConnected ? "live" : "connection lost, trying again";
  connection.className = isConnected ? "live" : "lost";
});
store.connect();
store.window = await ask("window").catch(() => ({ folder: "", read_only: true }));
for (const link of document.querySelectorAll(".changes")) link.hidden = store.window.read_only;
route();
