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
  showWays(preview, settings);
  byId("survey-lines").replaceChildren(...lines.map((line) => element("p", {}, line.trim())));
}

/* Other ways to read it, each a button that fills the fields. */
function showWays({ ways = [], panels, number }, settings) {
  byId("ways").hidden = ways.length < 2;
  byId("ways-shown").replaceChildren(...ways.map(({ settings: own, refused }, k) => {
    const taken = Object.entries(own).every(([name, value]) => (settings[name] ?? null) === value);
    const words = told(own) || "as it stands";
    const image = element("img", { src: `/preview/${panels.length + k}.png?${number}`, alt: "" });
    const note = element("span", {}, refused ? `${words}: a build would refuse it` : words);
    return element("button", { type: "button", class: "way", "aria-pressed": String(taken), click: () => setAll(own) }, image, note);
  }));
}
