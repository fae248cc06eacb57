/* What a tube will make of the picture: the sentences, the panels, and the rectangle that crops it. */
import { byId, element } from "./api.js";
import { set, setAll, told } from "./fields.js";

export function showPreview({ preview, chosen, settings }) {
  const { lines, error, number, panels, views, looking } = preview;
  const seen = lines.length > 0 && chosen.length > 0;
  byId("empty").hidden = seen || Boolean(error);
  byId("survey").hidden = !seen;
  byId("survey-error").textContent = error;
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

/* A rectangle is dragged on the picture; arrow keys move it, and size it with Shift. */
export class Crop {
  constructor(stateNow) {
    this.stateNow = stateNow;
    this.box = null; // left, top, width, height as shares
    const area = byId("crop-area");
    let from = null;
    area.addEventListener("pointerdown", (e) => {
      e.preventDefault();
      area.setPointerCapture(e.pointerId);
      from = this.at(e);
    });
    area.addEventListener("pointermove", (e) => from && this.span(from, this.at(e)));
    for (const end of ["pointerup", "pointercancel"]) area.addEventListener(end, () => (from = null));
    byId("crop-box").addEventListener("keydown", (e) => this.key(e));
    byId("crop-open").addEventListener("click", () => this.open());
    byId("crop-use").addEventListener("click", () => this.close(this.text()));
    byId("crop-auto").addEventListener("click", () => this.close("auto"));
    byId("crop-none").addEventListener("click", () => this.close(null));
  }

  get picture() {
    const { pictures, chosen } = this.stateNow();
    return pictures.find((p) => p.name === chosen[0]);
  }

  open() {
    const { picture } = this;
    if (!picture) return;
    byId("crop-picture").src = `/pictures/${encodeURIComponent(picture.name)}.png`;
    const given = String(this.stateNow().settings.crop ?? "").split(",").map(Number);
    const [left, top, width, height] = given.length === 4 ? given : [0, 0, picture.width, picture.height];
    this.box = [left / picture.width, top / picture.height, width / picture.width, height / picture.height];
    byId("crop-dialog").showModal();
    this.show();
  }

  at(event) {
    const frame = byId("crop-picture").getBoundingClientRect();
    const share = (v, low, size) => Math.min(1, Math.max(0, (v - low) / size));
    return [share(event.clientX, frame.left, frame.width), share(event.clientY, frame.top, frame.height)];
  }

  span([ax, ay], [bx, by]) {
    this.box = [Math.min(ax, bx), Math.min(ay, by), Math.abs(ax - bx), Math.abs(ay - by)];
    this.show();
  }

  key(event) {
    const by = { ArrowLeft: [-0.01, 0], ArrowRight: [0.01, 0], ArrowUp: [0, -0.01], ArrowDown: [0, 0.01] }[event.key];
    if (!by) return;
    event.preventDefault();
    const at = event.shiftKey ? 2 : 0;
    for (const k of [0, 1]) {
      const most = at ? 1 - this.box[k] : 1 - this.box[k + 2];
      this.box[at + k] = Math.min(most, Math.max(at ? 0.02 : 0, this.box[at + k] + by[k]));
    }
    this.show();
  }

  show() {
    const { style } = byId("crop-box");
    [style.left, style.top, style.width, style.height] = this.box.map((share) => `${100 * share}%`);
    const [left, top, width, height] = this.pixels();
    byId("crop-told").textContent = `${width} × ${height} px from (${left}, ${top})`;
  }

  pixels() {
    const { width, height } = this.picture;
    const [left, top] = [Math.round(this.box[0] * width), Math.round(this.box[1] * height)];
    return [left, top, Math.min(width - left, Math.round(this.box[2] * width)), Math.min(height - top, Math.round(this.box[3] * height))];
  }

  text() {
    const { width, height } = this.picture;
    const found = this.pixels();
    return found[2] === width && found[3] === height ? null : found.join(", ");
  }

  close(value) {
    byId("crop-dialog").close();
    set("crop", value);
  }
}
