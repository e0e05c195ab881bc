// The address says what is shown: `#/` the list of runs, `#/VIEW/ARGUMENT?QUERY` any other view.
import { ask, askToLeave, h, problem } from "./dom.js";
import { store } from "./store.js";
import { restoreTheme, switchTheme } from "./theme.js";

const view = document.getElementById("view");
const trail = document.getElementById("trail");
const connection = document.getElementById("connection");
const START = "runs";
let shown = {}; // what the view that is shown returned
let routed = 0;

function leave() {
  shown.leave?.();
  shown = {};
}

/** Shows what the address says, after asking where the present view would lose changes. */
async function followAddress(event) {
  const wanted = location.hash;
  if (shown.isChanged?.()) {
    history.pushState(null, "", event.oldURL);
    if (document.querySelector("dialog[open]")) return;
    if (!await askToLeave()) return;
    leave();
    if (location.hash !== wanted) history.pushState(null, "", wanted || "#/");
  }
  route();
}

async function route() {
  const number = ++routed;
  const [path, query = ""] = location.hash.replace(/^#\/?/, "").split("?");
  const [name, ...rest] = (path || START).split("/");
  leave();
  const entry = store.window.views.find((each) => each.name === name && !each.is_tab);
  if (entry === undefined) {
    view.replaceChildren(h("p", {}, "There is no such page. ", h("a", { href: "#/" }, "All runs")));
    return;
  }
  try {
    const { show } = await import(new URL(entry.script, document.baseURI));
    if (number !== routed) return;
    view.replaceChildren();
    shown = show(view, new URLSearchParams(query), decodeURIComponent(rest.join("/"))) ?? {};
    trail.replaceChildren(...(shown.trail ?? []).map((each) => h("span", {}, each)));
    document.title = [...(shown.trail ?? []), "Swarmwright"].reverse().slice(0, 2).join(" – ");
    view.focus({ preventScroll: true });
  } catch (error) {
    if (number === routed) view.replaceChildren(problem(error));
  }
}

restoreTheme();
document.getElementById("theme").addEventListener("click", switchTheme);
addEventListener("hashchange", followAddress);
addEventListener("beforeunload", (event) => {
  if (shown.isChanged?.()) event.preventDefault();
});
addEventListener("keydown", (event) => {
  if (document.querySelector("dialog[open]")) return;
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
store.follow();
store.window = await ask("window").catch((error) => {
  view.replaceChildren(problem(error));
  return store.window;
});
document.getElementById("views").replaceChildren(...store.window.views
  .filter((each) => each.title && !each.is_tab && !(each.is_for_changes && store.window.read_only))
  .map((each) => h("a", { href: `#/${each.name}` }, each.title)));
route();
