/* Rectangles that are dragged on the picture: what of it is read, and the thing that is cut out of it. */
import { attempt, byId, post } from "./api.js";
import { setAll } from "./fields.js";

/* A rectangle is dragged on the picture; arrow keys move it, and size it with Shift. */
class Box {
  constructor(stateNow, name) {
    this.stateNow = stateNow;
    this.name = name; // of the setting, which begins the ids of all that belongs to it
    this.box = null; // left, top, width, height as shares
    const area = this.part("area");
    area.addEventListener("pointerdown", (e) => {
      e.preventDefault();
      area.setPointerCapture(e.pointerId);
      this.press(this.at(e));
    });
    area.addEventListener("pointermove", (e) => area.hasPointerCapture(e.pointerId) && this.move(this.at(e)));
    area.addEventListener("lostpointercapture", () => this.release());
    this.part("box").addEventListener("keydown", (e) => this.key(e));
    this.part("open").addEventListener("click", () => this.open());
  }

  part(which) {
    return byId(`${this.name}-${which}`);
  }

  press(at) {
    this.from = at;
  }

  move(at) {
    this.span(this.from, at);
  }

  release() {}

  get picture() {
    const { pictures, chosen } = this.stateNow();
    return pictures.find((p) => p.name === chosen[0]);
  }

  open() {
    const { picture } = this;
    if (!picture) return;
    this.part("picture").src = `/pictures/${encodeURIComponent(picture.name)}.png`;
    const given = String(this.stateNow().settings[this.name] ?? "").split(",").map(Number);
    const [left, top, width, height] = given.length === 4 ? given : this.usual(picture);
    this.box = [left / picture.width, top / picture.height, width / picture.width, height / picture.height];
    this.part("dialog").showModal();
    this.show();
  }

  at(event) {
    const frame = this.part("picture").getBoundingClientRect();
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
    const { style } = this.part("box");
    [style.left, style.top, style.width, style.height] = this.box.map((share) => `${100 * share}%`);
    const [left, top, width, height] = this.pixels();
    this.part("told").textContent = `${width} × ${height} px from (${left}, ${top})`;
  }

  pixels() {
    const { width, height } = this.picture;
    const [left, top] = [Math.round(this.box[0] * width), Math.round(this.box[1] * height)];
    return [left, top, Math.min(width - left, Math.round(this.box[2] * width)), Math.min(height - top, Math.round(this.box[3] * height))];
  }

  close(settings) {
    this.part("dialog").close();
    if (settings) setAll(settings);
  }
}

/* What of the picture is read. */
export class Crop extends Box {
  constructor(stateNow) {
    super(stateNow, "crop");
    byId("crop-use").addEventListener("click", () => this.close({ crop: this.text() }));
    byId("crop-auto").addEventListener("click", () => this.close({ crop: "auto" }));
    byId("crop-none").addEventListener("click", () => this.close({ crop: null }));
  }

  usual({ width, height }) {
    return [0, 0, width, height];
  }

  text() {
    const { width, height } = this.picture;
    const found = this.pixels();
    return found[2] === width && found[3] === height ? null : found.join(", ");
  }
}
