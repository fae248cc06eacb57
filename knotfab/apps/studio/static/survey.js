/* What a tube will make of the picture: the sentences and the panels. */
import { byId, element } from "./api.js";

/* A sign of work at once, before anything is known of the picture; "" takes it away. */
export function showWork(words) {
  const empty = !byId("panels").children.length;
  byId("at-work").textContent = words;
  byId("survey").hidden = Boolean(words) || empty;
  byId("empty").hidden = Boolean(words || byId("survey-error").textContent) || !empty;
  byId("build").disabled = Boolean(words) || empty;
}

export function showPreview({ preview, picture }) {
  const { lines, error, number, panels, views, looking } = preview;
  const seen = lines.length > 0 && picture !== null;
  byId("survey-error").textContent = error;
  byId("survey").classList.toggle("looking", Boolean(looking));
  if (seen) {
    const [width, height] = views[0].frame_mm;
    byId("panels").classList.toggle("wide", width > 1.6 * height);
  }
  byId("panels").replaceChildren(...(seen ? panels : []).map((caption, k) =>
    element("figure", {}, element("img", { src: `/preview/${k}.png?${number}`, alt: "" }), element("figcaption", {}, caption))));
  byId("survey-lines").replaceChildren(...lines.map((line) => element("p", {}, line.trim())));
  showWork(looking && !seen && !error ? "Looking at the picture …" : "");
}
