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

/** A number with about four significant digits, and thousands apart. */
export function figure(value) {
  if (value === null || value === undefined) return "–";
  if (Number.isInteger(value)) return value.toLocaleString("en");
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e7)) return value.toExponential(3);
  return value.toLocaleString("en", { maximumSignificantDigits: size >= 1000 ? Math.ceil(Math.log10(size)) : 4 });
}

export function duration(seconds) {
  if (seconds === null || seconds === undefined) return "–";
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

/** Asks the server; what it says is wrong is thrown as an Error. */
export async function ask(path, parameters = {}) {
  const query = new URLSearchParams(parameters instanceof URLSearchParams ? parameters : []);
  for (const [key, value] of parameters instanceof URLSearchParams ? [] : Object.entries(parameters)) {
    for (const each of Array.isArray(value) ? value : [value]) {
      if (each !== null && each !== undefined) query.append(key, each);
    }
  }
  const response = await fetch(`api/${path}?${query}`);
  if (response.status === 401) throw new Error(await response.text());
  const body = (response.headers.get("content-type") ?? "").includes("json") ? await response.json() : {};
  if (!response.ok) throw new Error(body.error ?? `${path}: the server answered ${response.status}`);
  return body;
}

const PART_HEAD = 8; // bytes: kind and length of a part

/** Asks the server for something in parts; calls back with kind, content and headers of each as it comes. `signal` may give up. */
export async function askParts(path, parameters, signal, took) {
  const query = Object.entries(parameters).filter(([, value]) => value !== null && value !== undefined);
  const response = await fetch(`api/${path}?${new URLSearchParams(query)}`, { signal });
  if (!response.ok) {
    const isJson = (response.headers.get("content-type") ?? "").includes("json");
    throw new Error(isJson ? (await response.json()).error : `${path}: the server answered ${response.status}`);
  }
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

/** Asks the server to change something. */
export async function change(name, values) {
  const response = await fetch(`api/${name}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(values) });
  const body = (response.headers.get("content-type") ?? "").includes("json") ? await response.json() : { error: await response.text() };
  if (!response.ok) throw new Error(body.error);
  return body;
}

export function color(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

export function problem(error) {
  return h("p", { class: "problem", role: "alert" }, error.message);
}

/** Asks a question with two answers; resolves to whether it was the first. Frames in other pages may not use `confirm`. */
export function askWhether(question, yes, no) {
  return new Promise((resolve) => {
    const answer = (isYes) => () => {
      resolve(isYes);
      dialog.close();
    };
    const dialog = h("dialog", { "aria-label": question, close: () => { resolve(false); dialog.remove(); } },
      h("p", {}, question), h("div", { class: "tools" },
        h("button", { type: "button", click: answer(false) }, no), h("button", { type: "button", class: "primary", click: answer(true) }, yes)));
    document.body.append(dialog);
    dialog.showModal();
  });
}
