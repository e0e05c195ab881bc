// What each server did when: a lane for each, failures as crosses, and who was waited for.
import { Newest, ask, duration, figure, h, table, tell } from "./dom.js";
import { decode, rangeOf } from "./colors.js";
import { HeatMap } from "./heatmap.js";

const LANE_PX = 22;
const LOWEST_PX = 132;
const ZOOM = 4;
const SHORTEST_S = 1e-3; // part that the server shows
const OUTCOMES = {
  failed: "failed", unusable: "unusable result", server_failed: "the server failed", disconnected: "the connection was lost",
  lost: "lost with the server",
};

export function show(element, run) {
  const newest = new Newest();
  let timeline = null;
  let tabled = null; // the session in the table
  let shownPart = {};
  let failures = new Map();
  const session = h("select", { change: () => load({}) });
  const shade = h("select", { change: draw }, h("option", { value: "busy" }, "share of time at work"), h("option", { value: "episodes" }, "episodes a second"));
  const whole = h("button", { type: "button", click: () => load({}) }, "Whole session");
  const choices = h("div", { class: "tools" }, h("label", {}, "session ", session), h("label", {}, "colour ", shade), whole);
  const message = h("div");
  const picture = h("div");
  const note = h("p", { class: "hint" });
  const tables = h("div");
  element.append(choices, message, picture, note, tables);
  const map = new HeatMap(picture, { label: "Timeline of servers", act: ({ column, row }, isBeside) => {
    const failed = failures.get(`${column} ${row}`);
    if (failed) run.replay({ generation: failed[0].generation, candidate: failed[0].candidate, episode: failed[0].episode }, isBeside);
    else zoom(column);
  } });

  /** Shows a part of the session that is chosen, or the whole. */
  async function load(part) {
    try {
      const answer = await newest.ask("timeline", { run: run.id, session: session.value || null, ...part });
      shownPart = part;
      timeline = { ...answer, busy: decode(answer.busy), episodes: decode(answer.episodes) };
      if (session.length !== answer.sessions.length) session.replaceChildren(...answer.sessions.map((number) => h("option", { value: number }, number)));
      session.value = answer.session;
      session.parentElement.hidden = answer.sessions.length < 2;
      message.replaceChildren();
      draw();
      if (answer.session === tabled) return;
      drawTable(await newest.ask("timeline_shares", { run: run.id, session: answer.session }));
      tabled = answer.session;
    } catch (error) {
      tell(message, error);
    }
  }

  function zoom(column) {
    const span = timeline.end - timeline.begin;
    if (span <= SHORTEST_S) return;
    const middle = timeline.begin + span * (column + 0.5) / timeline.bins;
    const part = Math.max(span / ZOOM, SHORTEST_S);
    const end = Math.min(Math.max(middle + part / 2, part), timeline.seconds);
    load({ session: timeline.session, begin: Math.max(0, end - part), end });
  }

  function draw() {
    if (timeline === null) return;
    const { bins, servers } = timeline;
    const width = (timeline.end - timeline.begin) / bins;
    const hasOwn = servers.length === 0 || timeline.failures.some((failure) => failure.server < 0);
    const lanes = hasOwn ? [-1, ...servers] : servers;
    const isBusy = shade.value === "busy" && servers.length > 0;
    shade.parentElement.hidden = servers.length === 0;
    const values = new Float32Array(bins * lanes.length).fill(NaN);
    const numbers = (row, column) => {
      if (lanes[row] < 0) return { count: timeline.evaluated[column] };
      const at = (row - (hasOwn ? 1 : 0)) * bins + column;
      return { busy: timeline.busy[at] / width, count: timeline.episodes[at] };
    };
    for (let row = 0; row < lanes.length; row += 1) {
      for (let column = 0; column < bins; column += 1) {
        const { busy, count } = numbers(row, column);
        const value = lanes[row] >= 0 && isBusy ? busy : lanes[row] < 0 && servers.length > 0 ? 0 : count / width;
        if (value > 0) values[column * lanes.length + row] = value;
      }
    }
    failures = new Map();
    for (const failure of timeline.failures) {
      const key = `${failure.bin} ${lanes.indexOf(failure.server)}`;
      failures.set(key, [...failures.get(key) ?? [], failure]);
    }
    const marks = [...failures.keys()].map((key) => key.split(" ").map(Number)).map(([column, row]) => ({ column, row }));
    map.show({
      columns: bins, rows: lanes.length, values, marks, height: Math.min(700, 52 + Math.max(LOWEST_PX, LANE_PX * lanes.length)),
      range: isBusy ? [0, 1] : [0, rangeOf(values)[1]],
      below: { label: "seconds since the session began", range: [timeline.begin, timeline.end] },
      left: { label: "", labels: lanes.map((server) => server < 0 ? "this process" : `server ${server}`) },
      bar: isBusy ? "at work" : servers.length ? "episodes a second" : "evaluations a second",
      words: (column, row) => {
        const { busy, count } = numbers(row, column);
        const at = timeline.begin + (column + 0.5) * width;
        const work = lanes[row] < 0
          ? (servers.length ? "" : `: ${figure(count / width)} evaluations a second`)
          : `: at work ${figure(Math.round(100 * busy))} % of ${duration(width)}, ${figure(count / width)} episodes a second`;
        const trouble = (failures.get(`${column} ${row}`) ?? [])
          .map((failure) => `${figure(failure.attempts)} × ${OUTCOMES[failure.outcome] ?? failure.outcome}: ${failure.reason} (generation ${failure.generation}, candidate ${failure.candidate})`);
        return [`${lanes[row] < 0 ? "this process" : `server ${lanes[row]}`} after ${duration(at)}${work}`, ...trouble].join("; ");
      },
    });
    note.textContent = [
      servers.length ? "Time without colour is idle." : "The run evaluated in its own process, which records no time for each evaluation: the lane spreads those of a generation over its duration.",
      marks.length ? "Crosses are failed attempts: click one to watch its candidate." : null,
      marks.length ? "Click anywhere else to zoom in." : "Click to zoom in.",
    ].filter(Boolean).join(" ");
    whole.disabled = timeline.begin === 0 && timeline.end >= timeline.seconds;
  }

  function drawTable({ shares, waiting }) {
    const heads = ["server", "episodes", "share", "episodes/s at work", "seconds at work", "failed attempts", "lost", "handed back", "slower than another", "others waited for it"];
    const rows = shares.map((share) => {
      const wait = waiting[share.server];
      return [
        String(share.server), share.evaluations, `${figure(Math.round(1000 * share.share) / 10)} %`, share.rate, share.seconds, share.failed,
        share.lost, share.handed_back, share.slower,
        wait ? `${figure(wait.seconds)} s in ${figure(wait.generations)} generation${wait.generations === 1 ? "" : "s"}` : "–",
      ];
    });
    tables.replaceChildren(...(rows.length === 0 ? [] : [table(heads, rows, { isNumeric: true }),
      h("p", { class: "hint" }, "Of the whole run, except waiting: the time between the last answer of the other servers and that of the last server, at the end of the generations of this session.")]));
  }

  /** Shows what has come; a session that was chosen stays, as does its part. */
  function update() {
    tabled = null;
    const isNewest = timeline === null || timeline.session === timeline.sessions.at(-1);
    if (isNewest && shownPart.begin === undefined) session.value = "";
    return load(shownPart);
  }

  load({});
  return { update, leave: () => {
    newest.end();
    map.destroy();
  } };
}
