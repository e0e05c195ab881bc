// Elements without HTML in strings: what a run or a file is called can never become markup.

/** Makes an element. Attributes that are functions listen to events, `null` and `false` are left out. */
export function h(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    if (typeof value === "function") element.addEventListener(key, value);
    else if (key === "class") element.className = value;
    else element.setAttribute(key, value === true ? "" : value);
  }
  element.append(...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export function text(value) {
  return value === null || value === undefined ? "" : String(value);
}

const LARGEST = 1e300;

/** A number whose difference from others is finite, for charts. */
export function bounded(value) {
  return value === null ? null : Math.min(Math.max(value, -LARGEST), LARGEST);
}

/** A number with about four significant digits, and thousands apart. */
export function figure(value) {
  if (value === null || value === undefined) return "–";
  if (Number.isInteger(value) && Math.abs(value) < 1e15) return (value + 0).toLocaleString("en"); // no -0
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e7)) return value.toExponential(3);
  return value.toLocaleString("en", { maximumSignificantDigits: size >= 1000 ? Math.ceil(Math.log10(size)) : 4 });
}

export function duration(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  if (seconds > 0 && seconds < 0.1) return `${figure(1000 * seconds)} ms`;
  if (seconds < 60) return `${seconds < 10 ? seconds.toFixed(1) : Math.round(seconds)} s`;
  const minutes = Math.round(seconds / 60);
  if (minutes < 60) return `${minutes} min`;
  const hours = Math.floor(minutes / 60);
  if (hours < 48) return `${hours} h ${minutes % 60} min`;
  return `${Math.floor(hours / 24)} d ${hours % 24} h`;
}

export function date(iso) {
  const time = new Date(iso);
  return Number.isNaN(time.getTime()) ? text(iso) : time.toLocaleString("sv").slice(0, 16);
}

/** Sends a request; what the server says is wrong is thrown as an Error. `signal` may give up. */
async function send(path, options) {
  let response;
  try {
    response = await fetch(`api/${path}`, options);
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Error("The server of this window does not answer. Is it still running?");
  }
  if (response.ok) return response;
  const kind = response.headers.get("content-type") ?? "";
  const isRefused = response.status < 500 && kind.includes("text/plain");
  const message = kind.includes("json") ? (await response.json()).error : isRefused ? await response.text() : null;
  throw new Error(message || `${path.split("?")[0]}: the server answered ${response.status}`);
}

function query(parameters) {
  if (parameters instanceof URLSearchParams) return parameters;
  const pairs = Object.entries(parameters).flatMap(([key, value]) => [value].flat().map((each) => [key, each]));
  return new URLSearchParams(pairs.filter(([, value]) => value !== null && value !== undefined));
}

/** Asks the server. */
export async function ask(path, parameters = {}, signal = null) {
  return (await send(`${path}?${query(parameters)}`, { signal })).json();
}

/** Asks questions of which the newest counts: those before it are given up, with an AbortError. */
export class Newest {
  #abort = new AbortController();
  #isEnded = false;

  ask(path, parameters) {
    return ask(path, parameters, this.next());
  }

  /** Gives up what was asked; returns the signal of the next question. */
  next() {
    this.#abort.abort();
    this.#abort = new AbortController();
    if (this.#isEnded) this.#abort.abort();
    return this.#abort.signal;
  }

  end() {
    this.#isEnded = true;
    this.#abort.abort();
  }
}

const REST = 3; // times as long as the last call took

/** Calls `load` when something has changed: one call at a time, and with pauses, so that it takes a small part of the time. */
export class Refresher {
  #load;
  #least;
  #timer = null;
  #isBusy = false;
  #isDue = false;
  #isEnded = false;

  constructor(load, leastMs) {
    this.#load = load;
    this.#least = leastMs;
  }

  async ask() {
    this.#isDue = true;
    if (this.#isBusy || this.#timer !== null || this.#isEnded) return;
    this.#isDue = false;
    this.#isBusy = true;
    const began = performance.now();
    try {
      await this.#load();
    } finally {
      this.#isBusy = false;
    }
    if (this.#isEnded) return;
    this.#timer = setTimeout(() => {
      this.#timer = null;
      if (this.#isDue) this.ask();
    }, Math.max(this.#least, REST * (performance.now() - began)));
  }

  end() {
    this.#isEnded = true;
    clearTimeout(this.#timer);
  }
}

const PART_HEAD = 8; // bytes: kind and length of a part

/** Asks the server for something in parts; calls back with kind, content and headers of each as it comes. `signal` may give up. */
export async function askParts(path, parameters, signal, took) {
  const response = await send(`${path}?${query(parameters)}`, { signal });
  const reader = response.body.getReader();
  const head = new Uint8Array(PART_HEAD);
  let content = null;
  let filled = 0;
  for (;;) {
    const { done, value } = await reader.read();
    if (done) break;
    for (let at = 0; at < value.length;) {
      const target = content ?? head;
      const taken = value.subarray(at, at + target.length - filled);
      target.set(taken, filled);
      [at, filled] = [at + taken.length, filled + taken.length];
      if (filled < target.length) break;
      const view = new DataView(head.buffer);
      if (content) took(view.getUint32(0, true), content.buffer, response.headers);
      content = content ? null : new Uint8Array(view.getUint32(4, true));
      filled = 0;
    }
  }
  if (content || filled) throw new Error(`${path}: the answer of the server ended early`);
}

/** Asks the server to change something, or a question that is too long for an address. */
export async function change(name, values, signal = null) {
  const headers = { "Content-Type": "application/json" };
  return (await send(name, { method: "POST", headers, body: JSON.stringify(values), signal })).json();
}

/**
 * A table. Numbers, and null for none, are on the right as figures; other cells are texts or elements. empty: what is said
 * without rows; hasNames: whether the first cell of a row is its name; isNumeric: whether texts are on the right, too.
 */
export function table(heads, rows, { empty = "", hasNames = false, isNumeric = false } = {}) {
  if (rows.length === 0) return h("p", { class: "empty" }, empty);
  const cell = (value, column) => {
    const isNumber = typeof value === "number" || value === null;
    if (hasNames && column === 0) return h("th", { scope: "row" }, value);
    return h("td", { class: isNumber || isNumeric ? "number" : null }, isNumber ? figure(value) : value);
  };
  return h("div", { class: "wide" }, h("table", {},
    h("thead", {}, h("tr", {}, heads.map((head) => h("th", { scope: "col" }, head)))),
    h("tbody", {}, rows.map((row) => h("tr", {}, row.map(cell))))));
}

export function color(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

export function problem(error) {
  return h("p", { class: "problem", role: "alert" }, error.message);
}

/** Says in an element what is wrong, unless a question was merely given up. */
export function tell(element, error) {
  if (error.name !== "AbortError") element.replaceChildren(problem(error));
}

/** Asks whether to leave what has unsaved changes. */
export function askToLeave() {
  return askWhether("Leave without saving? What was changed here will be lost.", "Leave", "Stay");
}

/** Asks a question with two answers; resolves to whether it was the first. Frames in other pages may not use `confirm`. */
export async function askWhether(question, yes, no) {
  return await openDialog(question, null, yes, no) !== null;
}

/** Asks for a text; resolves to null where it was not given. */
export function askFor(question, yes) {
  return openDialog(question, h("input", { "aria-label": question }), yes, "Cancel");
}

/** Resolves to the text of a field, empty without one; to null where the dialog was closed or the answer is no. */
function openDialog(question, field, yes, no) {
  return new Promise((resolve) => {
    const dialog = h("dialog", { "aria-label": question, close: () => { resolve(null); dialog.remove(); } },
      h("form", { submit: (event) => { event.preventDefault(); resolve(field?.value ?? ""); dialog.close(); } }, h("p", {}, question), field, h("div", { class: "tools" },
        h("button", { type: "button", click: () => dialog.close() }, no), h("button", { type: "submit", class: "primary" }, yes))));
    document.body.append(dialog);
    dialog.showModal();
  });
}
