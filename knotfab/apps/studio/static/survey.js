/* What a tube will make of the picture: the sentences and the panels. */
import { byId, element } from "./api.js";
import { setAll, told } from "./fields.js";

/* A sign of work at once, before anything is known of the picture; "" takes it away. */
export function showWork(words) {
  byId("at-work").textContent = words;
  byId("empty").hidden = Boolean(words || byId("survey-error").textContent) || !byId("survey").hidden;
}

export function showPreview({ preview, chosen, settings }) {
  const { lines, error, number, panels, views, looking } = preview;
  const seen = lines.length > 0 && chosen.length > 0;
  byId("survey").hidden = !seen;
  byId("survey-error").textContent = error;
  showWork(looking && !seen && !error ? "Looking at the picture …" : "");
  byId("survey").classList.toggle("looking", Boolean(looking));
  if (!seen) return;
  const [width, height] = views[0].frame_mm;
  byId("panels").classList.toggle("wide", width > 1.6 * height);
  byId("panels").replaceChildren(...panels.map((caption, k) =>
    element("figure", {}, element("img", { src: `/preview/${k}.png?${number}`, alt: "" }), element("figcaption", {}, caption))));
  byId("survey-lines").replaceChildren(...lines.map((line) => element("p", {}, line.trim())));
}
