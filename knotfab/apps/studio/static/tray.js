/* Pictures: where they come from, the tray, and which of them make the piece. */
import { attempt, byId, call, element, post } from "./api.js";
import { Sheet } from "./sheet.js";
import { showWork } from "./survey.js";

const LARGEST_MB = 32;
const GLYPHS = ["♞", "☺", "♥", "✈", "⚓", "♫", "★", "☂"];
const sheet = new Sheet(byId("drawing"), byId("pen"));
let shown = null;
let select = () => {};

export function showPictures(state) {
  shown = state;
  const { chosen, kind, pictures } = state;
  for (const input of document.getElementsByName("kind")) input.checked = input.value === kind;
  byId("kind-hint").textContent = hint(state);
  const first = [...chosen, ...pictures.map((p) => p.name).filter((name) => !chosen.includes(name))];
  const order = kind === "one" ? pictures.map((p) => p.name) : first;
  byId("pictures").replaceChildren(...order.map((name) => thumbnail(pictures.find((p) => p.name === name), state)));
}

function hint({ kind }) {
  if (kind === "one") return "";
  if (kind === "views") return "One part, up to four pictures: each is its shadow from another side. Add pictures, or press those of the tray.";
  return "A part for each frame. Add the pictures in their order.";
}

function thumbnail({ name, title }, { chosen, kind }) {
  const place = chosen.indexOf(name);
  const image = element("img", { src: `/pictures/${encodeURIComponent(name)}.png`, alt: "" });
  const several = kind !== "one" && place >= 0;
  const number = several ? element("b", { class: "place", "aria-hidden": "true" }, String(place + 1)) : "";
  const what = several ? `Picture ${title}, number ${place + 1}` : `Picture ${title}`;
  const button = element("button", { type: "button", class: "thumb", "aria-pressed": String(place >= 0), "aria-label": what, title, click: () => press(name) }, image, number);
  const item = element("li", {}, button, small("✕", `Remove ${title} from the tray`, () => attempt("picture-error", post("/api/remove", { name })), "remove"));
  if (several && chosen.length > 1) {
    if (place > 0) item.append(small("‹", `Move ${title} forward`, () => move(place, place - 1), "earlier"));
    if (place < chosen.length - 1) item.append(small("›", `Move ${title} back`, () => move(place, place + 1), "later"));
  }
  return item;
}

const small = (text, label, click, kind) => element("button", { type: "button", class: `small ${kind}`, "aria-label": label, title: label, click }, text);

function press(name) {
  const { chosen, kind } = shown;
  const names = kind === "one" ? [name] : chosen.includes(name) ? chosen.filter((n) => n !== name) : [...chosen, name];
  attempt("picture-error", post("/api/choose", { names }));
}

function move(from, to) {
  const names = [...shown.chosen];
  names.splice(to, 0, ...names.splice(from, 1));
  attempt("picture-error", post("/api/choose", { names }));
}

function upload(blob, name) {
  if (blob.size > LARGEST_MB * 2 ** 20)
    return attempt("picture-error", Promise.reject(new Error(`${name} has more than ${LARGEST_MB} MB, too much for a picture. Scale it down; about 1000 pixels on a side are enough.`)));
  select("tab-preview");
  showWork(`Reading ${name} …`);
  return attempt("picture-error", call(`/api/pictures?name=${encodeURIComponent(name)}`, blob, "application/octet-stream").finally(() => showWork("")));
}

/* Frames come in the order of the numbers in their names: 2 before 10. */
async function uploadAll(files) {
  const order = [...files].sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }));
  for (const file of order) await upload(file, file.name);
}

function useText() {
  attempt("picture-error", post("/api/text", { text: byId("text").value }).then(() => select("tab-preview")));
}

export function listenToPictures(selectTab) {
  select = selectTab;
  for (const input of document.getElementsByName("kind"))
    input.addEventListener("change", () => attempt("picture-error", post("/api/choose", { names: shown.chosen, kind: input.value })));
  byId("file").addEventListener("change", async (e) => {
    await uploadAll(e.target.files);
    e.target.value = "";
  });
  // anywhere on the page: a picture that misses the field must not replace the page
  for (const kind of ["dragenter", "dragover", "dragleave", "drop"]) {
    document.addEventListener(kind, (e) => {
      e.preventDefault();
      byId("drop").classList.toggle("over", kind === "dragenter" || kind === "dragover");
      if (kind === "drop") uploadAll(e.dataTransfer.files);
    });
  }
  document.addEventListener("paste", (e) => uploadAll(e.clipboardData.files));
  byId("use-text").addEventListener("click", useText);
  byId("text").addEventListener("keydown", (e) => {
    if (e.key === "Enter") { e.preventDefault(); useText(); }
  });
  byId("glyphs").append(...GLYPHS.map((glyph) => element("button", { type: "button", "aria-label": `Symbol ${glyph}`, click: () => { byId("text").value = glyph; useText(); } }, glyph)));
  byId("undo").addEventListener("click", () => sheet.undo());
  byId("clear").addEventListener("click", () => sheet.clear());
  byId("use-drawing").addEventListener("click", async () => {
    if (sheet.empty) byId("picture-error").textContent = "The sheet is empty: draw something first.";
    else upload(await sheet.blob(), "drawing.png");
  });
}
