/* Colours and styles, light and dark. Styles are constructed, so that no page needs 'unsafe-inline' for them. */
import css from "./style.css";

const dark = () => globalThis.matchMedia?.("(prefers-color-scheme: dark)").matches ?? false;

const LIGHT = {
  paper: "#f4f0e8", wall: "#fffdf8", dark: "#2b2d33", spill: "#d65e32", missing: "#266ea8", line: "#8d8578",
  tube: "#cf6f47", mount: "#b9b2a4", sky: "#fffaf0", ground: "#b7a48e", light: "#fff3dd", bulb: "#e9a21b",
  rays: "#b98a2e", bed: "#e6dfd2", grid: "#bdb4a4", support: "#5f8f9d",
};
const DARK = {
  paper: "#1d1e22", wall: "#d8c7a4", dark: "#17181b", spill: "#d65e32", missing: "#2f7fc0", line: "#6f6757",
  tube: "#d9805a", mount: "#8f8a80", sky: "#cfd3dd", ground: "#4a3f35", light: "#ffe7bd", bulb: "#ffd37a",
  rays: "#c9a45a", bed: "#2b2d32", grid: "#474a52", support: "#6fa7b6",
};

export const colours = () => (dark() ? DARK : LIGHT);

/* Calls `changed` when the reader's scheme changes; returns what ends that. */
export function onTheme(changed) {
  const query = globalThis.matchMedia?.("(prefers-color-scheme: dark)");
  query?.addEventListener("change", changed);
  return () => query?.removeEventListener("change", changed);
}

export function adoptStyle(root) {
  const sheet = new CSSStyleSheet();
  sheet.replaceSync(css);
  root.adoptedStyleSheets = [sheet];
}
