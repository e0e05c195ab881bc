// Light or dark: as chosen here, or else as the system is.

const KEY = "swarmwright-theme";
const system = matchMedia("(prefers-color-scheme: dark)");
const listeners = new Set();

export function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : system.matches;
}

/** Takes the theme that was chosen last. */
export function restoreTheme() {
  try {
    const chosen = localStorage.getItem(KEY);
    if (chosen) document.documentElement.dataset.theme = chosen;
  } catch {
    // A frame on another site, as in a notebook, may be refused to store anything.
  }
}

export function switchTheme() {
  const chosen = isDark() ? "light" : "dark";
  document.documentElement.dataset.theme = chosen;
  try {
    localStorage.setItem(KEY, chosen);
  } catch {
    // As above.
  }
  redrawAll();
}

/** Calls back when the colours have changed, to redraw what CSS does not colour; returns what ends that. */
export function onTheme(redraw) {
  listeners.add(redraw);
  return () => listeners.delete(redraw);
}

function redrawAll() {
  for (const redraw of listeners) redraw();
}

system.addEventListener("change", redrawAll);
