// The servers of a broker, live: what they offer and do. Starts servers, and a broker, on this machine.
import { ask, change, date, duration, figure, h, problem } from "./dom.js";
import { makeJobList } from "./jobs.js";
import { store } from "./store.js";

const EVERY_MS = 1000;
const SERVERS = ["id", "state", "simulations", "run", "does now", "evaluations/s", "last message", "failures", "process", "since"];
const RUNS = ["run", "simulation", "generation", "evaluations", "servers", "waits for"];
const NUMBERS = new Set(["id", "evaluations/s", "generation", "evaluations", "servers"]);
const LOCAL = /^mqtt:\/\/(?:localhost|127\.0\.0\.1|\[::1\])(?::(\d+))?$/;

/** Replaces the children of an element where the values that they are made from have changed. */
function updater(element, make) {
  let before = null;
  return (...values) => {
    const now = JSON.stringify(values);
    if (now !== before) element.replaceChildren(...make(...values));
    before = now;
  };
}

function table(headings, rows) {
  const kind = (index) => (NUMBERS.has(headings[index]) ? "number" : null);
  return h("div", { class: "wide" }, h("table", { class: "servers" },
    h("thead", {}, h("tr", {}, headings.map((heading, index) => h("th", { scope: "col", class: kind(index) }, heading)))),
    h("tbody", {}, rows.map((cells) => h("tr", {}, cells.map((cell, index) => h("td", { class: kind(index) }, cell ?? "–")))))));
}

function serverCells(server) {
  const failures = server.paused === null ? figure(server.failures) : `${figure(server.failures)}, paused for ${duration(server.paused)}`;
  const last = server.last;
  return [
    server.server,
    h("span", { class: `state ${server.state.split(" ")[0]}` }, server.state),
    server.simulations.join(", ") || null,
    server.run ?? server.tool ?? (last && h("span", { class: "hint" }, `last: ${last.run}, ${date(last.at * 1000)}`)),
    server.work,
    server.speed === null ? last?.speed && h("span", { class: "hint" }, figure(last.speed)) : figure(server.speed),
    server.silent === null ? null : `${duration(server.silent)} ago`,
    server.failures ? h("span", { class: "bad", title: server.reason }, failures) : null,
    server.host === null ? null : `${server.host}/${server.process}`,
    // The last will of a lost server was written when it connected.
    server.state === "lost" || server.since === null ? null : date(server.since),
  ];
}

function runCells(tool) {
  const progress = tool.generation === null ? null : tool.generations === null ? figure(tool.generation) : `${figure(tool.generation)} of ${figure(tool.generations)}`;
  return [
    tool.run ?? tool.tool, tool.simulation, progress,
    tool.state === "looking" ? "looks for servers" : `${figure(tool.done)} of ${figure(tool.total)}`,
    figure(tool.servers), tool.waits_for && h("span", { class: "bad" }, tool.waits_for),
  ];
}

function label(broker) {
  return broker.prefix ? `${broker.url}, prefix ${broker.prefix}` : broker.url;
}

export function show(view, query) {
  const isReadOnly = store.window.read_only;
  let broker = { url: query.get("broker") ?? "", prefix: query.get("prefix") ?? "" };
  let timer = null;
  let hasLeft = false;
  let asked = 0;
  const state = h("span", { class: "state waiting", role: "status" }, "connecting");
  const choice = h("select", { "aria-label": "Broker", change: () => choose(JSON.parse(choice.value)) });
  const messages = h("div", { "aria-live": "polite" });
  const servers = h("div");
  const runs = h("div");
  const jobs = makeJobList(load);
  const started = h("section", { hidden: true }, h("h2", {}, "Started here"), jobs.element);
  const failure = h("div");
  const titles = h("datalist", { id: "simulations" });

  const address = h("input", { name: "broker", placeholder: "mqtt://host:1883", "aria-label": "Address of the broker", required: true, spellcheck: "false", autocomplete: "off" });
  const prefix = h("input", { name: "prefix", placeholder: "prefix", "aria-label": "Topic prefix", spellcheck: "false", autocomplete: "off" });
  const other = h("details", {}, h("summary", {}, "Another broker"),
    h("form", { class: "tools", submit: (event) => act(event, connect) }, address, prefix, h("button", {}, "Connect")),
    h("p", { class: "hint" }, "The account comes from the environment of the window (SWARMWRIGHT_USERNAME and SWARMWRIGHT_PASSWORD_FILE), never from the address."));

  const simulation = h("input", { value: "minisim", list: "simulations", "aria-label": "Simulation", required: true, spellcheck: "false", autocomplete: "off" });
  const count = h("input", { type: "number", min: 1, max: 256, value: 2, "aria-label": "Number of servers", required: true });
  const startBroker = h("button", { type: "button", hidden: true, click: (event) => act(event, runBroker) }, "Start a broker here");
  const local = h("section", {}, h("h2", {}, "Start servers on this machine"),
    h("form", { class: "tools", submit: (event) => act(event, serve) },
      h("label", {}, "Simulation ", simulation), titles, h("label", {}, "Servers ", count), h("button", { class: "primary" }, "Start"), startBroker),
    h("p", { class: "hint" }, "A title, file.py:Class, or an experiment file. They go on when this window is closed."));

  view.append(h("h1", {}, "Servers"), h("div", { class: "tools" }, choice, state), isReadOnly ? "" : other, messages, servers,
    runs, isReadOnly ? "" : local, failure, started);

  function choose(chosen) {
    broker = chosen;
    const asked = new URLSearchParams(Object.entries({ broker: broker.url, prefix: broker.prefix }).filter(([, value]) => value));
    history.replaceState(null, "", `#/servers?${asked}`);
    load();
  }

  async function act(event, perform) {
    event.preventDefault();
    try {
      await perform();
      failure.replaceChildren();
      load();
    } catch (error) {
      failure.replaceChildren(problem(error));
    }
  }

  async function connect() {
    const chosen = { url: address.value.trim(), prefix: prefix.value.trim() };
    await change("broker", { broker: chosen.url, prefix: chosen.prefix });
    other.open = false;
    choose(chosen);
  }

  const serve = () => change("serve", { simulation: simulation.value.trim(), count: count.valueAsNumber, broker: broker.url, prefix: broker.prefix });
  const runBroker = () => change("start_broker", { port: Number(LOCAL.exec(broker.url)[1] ?? 1883) });

  const showChoice = updater(choice, (brokers, current) => brokers.map((each) =>
    h("option", { value: JSON.stringify(each), selected: label(each) === label(current) }, label(each))));
  const showTitles = updater(titles, (names) => names.map((name) => h("option", { value: name })));
  const showMessages = updater(messages, (texts) => texts.map((text) => h("p", { class: "problem" }, text)));
  const showServers = updater(servers, (rows, more, isConnected) => (rows.length
    ? [table(SERVERS, rows.map(serverCells)), more ? h("p", { class: "hint" }, `and ${figure(more)} more`) : ""]
    : [isConnected ? h("p", { class: "empty" }, "No server has announced itself on this broker.") : ""]));
  const showRuns = updater(runs, (rows, more) => (rows.length
    ? [h("h2", {}, "Runs that use them"), table(RUNS, rows.map(runCells)), more ? h("p", { class: "hint" }, `and ${figure(more)} more`) : ""]
    : []));

  async function load() {
    clearTimeout(timer);
    const number = ++asked;
    const [here, there] = await Promise.allSettled([ask("brokers", { opened: [...jobs.opened] }), ask("servers", { broker: broker.url || null, prefix: broker.prefix || null })]);
    if (hasLeft || number !== asked) return; // a later request is about another broker, or another job
    if (here.status === "fulfilled") {
      const { brokers, simulations } = here.value;
      if (!broker.url) broker = brokers[0];
      const isListed = brokers.some((each) => label(each) === label(broker));
      showChoice(isListed ? brokers : [broker, ...brokers], broker);
      showTitles(simulations);
      started.hidden = here.value.jobs.length === 0;
      jobs.show(here.value.jobs, here.value.outputs);
    }
    if (there.status === "fulfilled") {
      const answer = there.value;
      state.textContent = answer.state;
      state.className = `state ${{ connected: "done", away: "failed" }[answer.state] ?? "waiting"}`;
      startBroker.hidden = answer.state !== "away" || !LOCAL.test(broker.url);
      showMessages(answer.messages);
      showServers(answer.servers, answer.more_servers, answer.state === "connected");
      showRuns(answer.tools, answer.more_tools);
    } else {
      state.textContent = "not shown";
      state.className = "state waiting";
      showMessages([there.reason.message]);
      showServers([], 0, false);
      showRuns([], 0);
      address.value ||= broker.url;
      prefix.value ||= broker.prefix;
    }
    timer = setTimeout(load, EVERY_MS);
  }

  load();
  return {
    trail: ["servers"],
    leave: () => {
      hasLeft = true;
      clearTimeout(timer);
    },
  };
}
