// The list of runs, kept up to date by server-sent events.

class Store {
  rows = new Map();
  version = 0;
  isLoaded = false;
  window = { folder: "", read_only: true, views: [] };
  #listeners = new Set();
  #connection = () => {};
  #source = null;
  #timer = null;

  onConnection(listener) {
    this.#connection = listener;
  }

  /** Calls back with the ids that have changed; returns what ends that. */
  listen(listener) {
    this.#listeners.add(listener);
    return () => this.#listeners.delete(listener);
  }

  /** Follows the list while the page is seen: browsers have six connections to a server, for all its pages. */
  follow() {
    document.addEventListener("visibilitychange", () => this.#connect());
    this.#connect();
  }

  #connect() {
    this.#source?.close();
    clearTimeout(this.#timer);
    if (document.hidden) return;
    const source = new EventSource(`api/events?version=${this.version}`);
    this.#source = source;
    source.onopen = () => this.#connection(true);
    source.onmessage = (event) => this.#take(JSON.parse(event.data));
    source.onerror = () => {
      // It would connect again by itself, but with the version of the first time.
      source.close();
      this.#connection(false);
      this.#timer = setTimeout(() => this.#connect(), 1000);
    };
  }

  #take(message) {
    const changed = new Set([...message.rows.map((row) => row.id), ...message.gone]);
    if (message.whole) {
      const present = new Set(message.rows.map((row) => row.id));
      for (const id of this.rows.keys()) if (!present.has(id)) message.gone.push(id), changed.add(id);
    }
    for (const row of message.rows) this.rows.set(row.id, row);
    for (const id of message.gone) this.rows.delete(id);
    this.version = message.version;
    this.isLoaded = true;
    for (const listener of this.#listeners) listener(changed);
  }
}

export const store = new Store();
