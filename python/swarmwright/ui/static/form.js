// The form of an experiment beside its text: each field is a part of the text, which stays the only truth.
import { change, h } from "./dom.js";

const TYPING_MS = 500;
const FEW = 5; // fields of a section that are all shown
const NUMBER = /^[-+]?(\d[\d_]*\.?\d*|\.\d+)(e[-+]?\d+)?$/i;
const TYPED = "\0"; // `data-entered` of an input with text that is not entered yet
const OUTSIDE_SWEEPS = ["Servers", "Time limits", "Failures"];

export const nameOf = (path) => path.join(".");
export const keyOf = (path) => JSON.stringify(path);

/**
 * Makes a form. `host` has the text: `text()`, `replace(text)`; `vary(field, node)` is asked for by a field,
 * `isVaried(path)` says whether it was; `mayExecute()`, whether the code that the text names may be executed.
 */
export function makeForm(host) {
  const find = h("input", { type: "search", "aria-label": "Find a field", placeholder: "find a field", input: () => update() });
  const notice = h("p", { class: "hint", role: "status" });
  const body = h("fieldset", { class: "form", "aria-label": "Fields of the experiment" });
  const help = h("p", { class: "help", id: "field-help" });
  const element = h("div", { class: "form-column" }, h("div", { class: "tools" }, find), notice, body, help);
  const rows = new Map();
  const errors = new Map(); // of what was entered, by key
  const opened = new Map(); // sections, where somebody opened or closed them
  const whole = new Set(); // sections that show all fields
  const asked = new Set(); // classes whose parameters were asked for
  let sections = [];
  let titles = []; // of simulations on the broker
  let shown = [];
  let values = { text: "", keys: {} };
  let known = null;
  let built = "";
  let problems = [];
  let number = 0;
  let changes = Promise.resolve();
  let pending = 0; // changes
  let isGone = false;

  async function read() {
    const mine = ++number;
    let answer;
    try {
      answer = await change("form", { text: host.text(), known });
    } catch (error) {
      if (isGone || mine !== number) return;
      notice.textContent = `The form shows the last text that could be read. The text now: ${error.message.replace(/^text:(\d+): /, "line $1: ")}`;
      notice.classList.add("bad");
      body.disabled = true;
      return;
    }
    if (isGone || mine !== number) return;
    notice.textContent = "";
    body.disabled = false;
    if (answer.sections) sections = answer.sections;
    known = answer.form;
    values = answer.values;
    build();
    if (answer.class && host.mayExecute() && !asked.has(answer.class)) {
      asked.add(answer.class);
      change("class_parameters", { simulation: answer.class }).then(() => !isGone && read(), () => {});
    }
  }

  /** Returns what the text has at a path: `{text, keys}`, or undefined. */
  function at(path) {
    let node = values;
    for (const key of path) {
      if (!node?.keys || !Object.hasOwn(node.keys, key)) return undefined;
      node = node.keys[key];
    }
    return node;
  }

  /** Returns the sections with fields for what the text has and the form does not know. */
  function withOthers() {
    const names = new Set(sections.flatMap((section) => section.fields.map((field) => keyOf(field.path))));
    const above = new Set(sections.flatMap((section) => section.fields.flatMap((field) => field.path.slice(0, -1).map((_, index) => keyOf(field.path.slice(0, index + 1))))));
    const others = [];
    const walk = (node, path) => {
      const key = keyOf(path);
      if (node.keys && (path.length === 0 || above.has(key))) for (const [name, inner] of Object.entries(node.keys)) walk(inner, [...path, name]);
      else if (path.length > 0 && !names.has(key)) others.push({ path, takes: ["any"], kind: "YAML" });
    };
    walk(values, []);
    const result = sections.map((section) => ({ ...section, fields: [...section.fields] }));
    for (const field of others) {
      const section = result.find((each) => each.fields.some((other) => other.path[0] === field.path[0])) ?? result.find((each) => each.title === "Other");
      if (section) section.fields.push(field);
      else result.push({ title: "Other", fields: [field] });
    }
    return result;
  }

  function build() {
    const next = withOthers();
    const shape = JSON.stringify(next);
    if (shape !== built) {
      const focused = document.activeElement?.dataset?.key;
      const typed = [...rows].filter(([, entry]) => isTyped(entry)).map(([key, entry]) => [key, controlOf(entry).value]);
      built = shape;
      shown = next;
      rows.clear();
      errors.clear();
      body.replaceChildren(...shown.map(makeSection));
      suggest();
      for (const [key, value] of typed) {
        if (rows.has(key)) Object.assign(controlOf(rows.get(key)), { value }).dataset.entered = TYPED;
      }
      update();
      if (rows.has(focused)) controlOf(rows.get(focused)).focus();
    }
    update();
  }

  function makeSection(section) {
    const count = h("span", { class: "count" });
    const more = h("button", { type: "button", class: "link", click: () => { whole.has(section.title) ? whole.delete(section.title) : whole.add(section.title); update(); } });
    const entries = h("div", { class: "entries" }, section.fields.map((field) => makeRow(section, field)));
    const details = h("details", { class: "section" }, h("summary", { click: () => opened.set(section.title, !details.open) }, section.title, " ", count), entries, more);
    section.parts = { details, count, more };
    return details;
  }

  function makeRow(section, field) {
    const key = keyOf(field.path);
    const id = `field-${rows.size}`;
    const input = makeInput(field, id, key);
    const message = h("p", { class: "problem", id: `${id}-problem`, role: "status" });
    const canVary = !OUTSIDE_SWEEPS.includes(section.title) && nameOf(field.path) !== "seed";
    const vary = canVary ? h("button", {
      type: "button", class: "vary", "aria-label": `Vary ${nameOf(field.path)}`, title: "Try several values in a sweep",
      click: () => { host.vary(field, at(field.path)); update(); },
    }, "vary") : nameOf(field.path) === "broker" ? h("button", { type: "button", title: "Ask the broker for the simulations of its servers", click: () => askBroker(key) }, "ask") : h("span");
    const short = field.path.length > 1 && field.path[0] !== "requirements" ? field.path.slice(1).join(".") : nameOf(field.path);
    const row = h("div", { class: "entry", mouseenter: () => explain(field), focusin: () => explain(field) },
      h("label", { for: id, title: field.help ?? "" }, short), input, vary, message);
    rows.set(key, { field, row, input, message, vary, section });
    return row;
  }

  function makeInput(field, id, key) {
    const takes = field.takes ?? [];
    const common = { id, "data-key": key, "aria-describedby": `${id}-problem field-help` };
    const isSelect = takes.length === 0 || (takes.length === 1 && takes[0] === "boolean");
    if (isSelect) {
      const choices = field.choices ?? ["true", "false"];
      return h("select", { ...common, change: (event) => enter(field, event.target.value) },
        h("option", { value: "" }, field.default ? `default: ${field.default}` : "default"), choices.map((choice) => h("option", { value: choice }, choice)));
    }
    const isNumber = takes.every((kind) => kind === "integer" || kind === "number") && !field.choices;
    let timer = null;
    const input = h("input", {
      ...common, type: isNumber ? "number" : "text", step: isNumber ? (takes.includes("number") ? "any" : 1) : null,
      min: isNumber ? field.low : null, max: isNumber ? field.high : null, placeholder: field.default ?? "",
      list: field.choices ? `${id}-choices` : null, autocomplete: "off", spellcheck: "false",
      change: () => { clearTimeout(timer); if (input.dataset.entered !== input.value || input.validity.badInput) enter(field, input.value, input.validity.badInput); },
      input: () => {
        clearTimeout(timer);
        input.dataset.entered = TYPED;
        if (!field.is_kind && input.value.trim() && !input.validity.badInput) timer = setTimeout(() => { if (input.dataset.entered === TYPED) enter(field, input.value); }, TYPING_MS);
      },
    });
    if (!field.choices) return input;
    return h("span", { class: "combo" }, input, h("datalist", { id: `${id}-choices` }, field.choices.map((choice) => h("option", { value: choice }))));
  }

  function enter(field, entry, isBad = false) {
    const key = keyOf(field.path);
    const control = controlOf(rows.get(key));
    control.dataset.entered = entry;
    if (isBad) {
      refuse(key, field, "must be a number");
      update();
      return;
    }
    pending += 1;
    changes = changes.then(() => apply(field, key, entry)).finally(() => { pending -= 1; });
  }

  /** Notes what is wrong with an entry, which stays until the field or its part of the text changes. */
  function refuse(key, field, message) {
    errors.set(key, { message, text: at(field.path)?.text });
  }

  async function apply(field, key, entry) {
    for (let attempt = 0; attempt < 10 && !isGone; attempt++) {
      const text = host.text();
      try {
        const answer = await change("form_change", { text, path: field.path, entry });
        if (host.text() !== text) continue; // somebody typed meanwhile
        errors.delete(key);
        if (answer.text !== text) host.replace(answer.text);
      } catch (error) {
        refuse(key, field, error.message.replace(/^text:\d+: /, ""));
      }
      update();
      return;
    }
  }

  /** Suggests the simulations of the servers on the broker. */
  async function askBroker(key) {
    const { message } = rows.get(key);
    message.textContent = "";
    try {
      const answer = await change("broker_simulations", { broker: at(["broker"])?.text ?? "", prefix: at(["prefix"])?.text ?? "" });
      titles = answer.simulations;
      help.textContent = `${answer.servers} servers offer ${titles.join(", ") || "nothing"}.`;
      errors.delete(key);
      suggest();
    } catch (error) {
      refuse(key, { path: ["broker"] }, error.message);
    }
    update();
  }

  function suggest() {
    const list = rows.get(keyOf(["simulation"]))?.input.querySelector("datalist");
    const present = new Set([...(list?.options ?? [])].map((option) => option.value));
    list?.append(...titles.filter((title) => !present.has(title)).map((value) => h("option", { value })));
  }

  function controlOf(entry) {
    return entry.input.matches(".combo") ? entry.input.firstChild : entry.input;
  }

  const isTyped = (entry) => controlOf(entry).dataset.entered === TYPED;

  function show(entry) {
    find.value = "";
    opened.set(entry.section.title, true);
    whole.add(entry.section.title);
    update();
  }

  function explain(field) {
    help.replaceChildren(h("b", {}, nameOf(field.path)), field.kind ? ` ${field.kind}` : "", field.default ? `, default ${field.default}` : "", field.is_required ? ", required" : "", h("br"), field.help ?? "");
  }

  /** Shows what the text has, what is wrong, and the fields that are wanted, in the rows that there are. */
  function update() {
    const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
    const wrong = assign(problems);
    for (const section of shown) {
      let set = 0;
      let hidden = 0;
      let visible = 0;
      let bad = 0;
      for (const field of section.fields) {
        const key = keyOf(field.path);
        const entry = rows.get(key);
        const node = at(field.path);
        if (errors.has(key) && errors.get(key).text !== node?.text) errors.delete(key);
        const message = errors.get(key)?.message ?? wrong.get(key) ?? "";
        const isSet = node !== undefined;
        const searched = `${nameOf(field.path)} ${field.help ?? ""}`.toLowerCase();
        const isWanted = words.length > 0
          ? words.every((word) => searched.includes(word))
          : isSet || message || field.is_kind || (field.is_required && at(field.path.slice(0, -1)) !== undefined) || section.fields.length <= FEW || whole.has(section.title);
        fill(entry, node);
        entry.row.hidden = !isWanted;
        entry.row.classList.toggle("set", isSet);
        entry.message.textContent = message;
        controlOf(entry).setAttribute("aria-invalid", message ? "true" : "false");
        if (entry.vary.matches(".vary")) entry.vary.setAttribute("aria-pressed", host.isVaried(field.path) ? "true" : "false");
        set += isSet;
        hidden += !isWanted;
        visible += isWanted;
        bad += message !== "";
      }
      const { details, count, more } = section.parts;
      count.textContent = bad ? `${bad} wrong` : set ? `${set} set` : "";
      count.classList.toggle("bad", bad > 0);
      details.open = words.length ? visible > 0 : bad > 0 || (opened.get(section.title) ?? set > 0);
      details.hidden = words.length > 0 && visible === 0;
      more.hidden = words.length > 0 || (hidden === 0 && !whole.has(section.title));
      more.textContent = whole.has(section.title) ? "Show fewer options" : `Show all options (${hidden} more)`;
    }
  }

  /** Puts a value of the text into its field, except where somebody is typing. */
  function fill(entry, node) {
    const control = controlOf(entry);
    const value = node === undefined || (node.keys && control.tagName === "SELECT") ? "" : node.text;
    const isEntered = errors.has(keyOf(entry.field.path)) || (control === document.activeElement && control.tagName === "INPUT");
    if (isEntered && control.value !== value) return;
    if (control.tagName === "SELECT" && value && ![...control.options].some((option) => option.value === value)) control.append(h("option", { value }, value));
    if (control.type === "number" && value && !NUMBER.test(value)) control.type = "text"; // to show it as it is
    if (control.value !== value) control.value = value;
    control.dataset.entered = value;
  }

  /** Returns the message of each field: a message begins with the key that it is about. */
  function assign(list) {
    const messages = new Map();
    for (const { message } of list) {
      let best = null;
      for (const { field } of rows.values()) {
        const name = nameOf(field.path);
        if (message.startsWith(name) && /^(:|\[|\.)/.test(message.slice(name.length)) && (best === null || name.length > nameOf(best.path).length)) best = field;
      }
      if (best !== null) messages.set(keyOf(best.path), message.slice(nameOf(best.path).length).replace(/^: /, ""));
    }
    return messages;
  }

  return {
    element,
    read,
    update,
    /** Whether something is typed into a field that is not in the text. */
    isChanged: () => pending > 0 || [...rows.values()].some(isTyped),
    /** Resolves when all that was typed is in the text. Throws what a field does not take. */
    async settle() {
      for (const entry of rows.values()) if (isTyped(entry)) enter(entry.field, controlOf(entry).value, controlOf(entry).validity.badInput);
      for (let last = null; last !== changes;) await (last = changes);
      for (const [key, { message }] of errors) {
        const entry = rows.get(key);
        const { value, validity } = controlOf(entry);
        if (value === (at(entry.field.path)?.text ?? "") && !validity.badInput) continue; // such as a broker that does not answer
        show(entry);
        controlOf(entry).focus();
        throw new Error(`${nameOf(entry.field.path)}: ${message}`);
      }
    },
    /** Shows a field that is not varied any more. */
    focusVary(path) {
      const entry = rows.get(keyOf(path));
      if (entry === undefined) return;
      show(entry);
      entry.vary.focus();
    },
    showProblems(list) {
      problems = list;
      update();
    },
    /** Shows the field that a message is about; false where there is none. */
    focus(message) {
      const [key] = [...assign([{ message }]).keys()];
      if (key === undefined) return false;
      const entry = rows.get(key);
      show(entry);
      controlOf(entry).focus();
      return true;
    },
    hasField: (message) => assign([{ message }]).size > 0,
    leave: () => { isGone = true; },
  };
}
