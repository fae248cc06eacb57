/* The studio's page. What it shows is the server's state: a reload, or a second tab, shows the same. */
import { Sheet } from "./sheet.js";
import { Stage } from "./stage.js";

const LARGEST_MB = 32;
const GLYPHS = ["♞", "☺", "♥", "✈", "⚓", "♫", "★", "☂"];
const byId = (id) => document.getElementById(id);
const stage = new Stage();
const sheet = new Sheet(byId("drawing"), byId("pen"));
let state = null;
let until = null; // when the build will have ended, by the page's clock

/* ---- talking to the server */

async function call(path, body, kind = "application/json") {
  let answer;
  try {
    answer = await fetch(path, { method: "POST", body, headers: { "content-type": kind } });
  } catch {
    throw new Error("The studio does not answer: is it still running?");
  }
  const text = await answer.text();
  let found = {};
  try {
    found = JSON.parse(text);
  } catch {
    found = { sentence: text };
  }
  if (!answer.ok) throw new Error(found.sentence || "The studio refused this.");
  return found;
}
const post = (path, data = {}) => call(path, JSON.stringify(data));

function connect() {
  const socket = new WebSocket(`ws://${location.host}/live`);
  socket.onopen = () => (byId("connection").textContent = "");
  socket.onmessage = ({ data }) => hear(JSON.parse(data));
  socket.onclose = () => {
    byId("connection").textContent = "The studio does not answer; trying again …";
    setTimeout(connect, 1500);
  };
}

function hear(event) {
  if (event.event === "state") show(event);
  else if (event.event === "scene") stage.setScene(event);
  else if (event.event === "knots") stage.setKnots(event);
  else if (event.event === "stage") follow({ stage: event.name, left_s: event.left_s });
  else if (event.event === "progress") follow({ stage: event.stage, share: event.share, left_s: event.left_s, ...(event.iou === null ? {} : { iou: event.iou }) });
  else if (event.event === "say") addNote(event.text);
}

function follow(news) {
  if (!state) return;
  Object.assign(state.build, news);
  showBuild();
}

/* ---- showing the state */

function show(next) {
  const before = state;
  state = next;
  document.documentElement.dataset.ready = "";
  document.documentElement.toggleAttribute("data-watching", next.watching);
  byId("panel").hidden = byId("tab-preview").hidden = next.watching;
  showPictures();
  showSettings();
  if (!before || before.preview.number !== next.preview.number || before.preview.error !== next.preview.error || before.chosen.length !== next.chosen.length) showPreview();
  byId("earlier").hidden = !next.builds.length;
  byId("builds").replaceChildren(...next.builds.map((built) => {
    const button = element("button", { type: "button" }, built.where, element("small", {}, brief(built)));
    button.addEventListener("click", () => { showResult(built); select("tab-result"); });
    return element("li", {}, button);
  }));
  const phase = next.build.phase;
  const changed = !before || before.build.phase !== phase || before.build.name !== next.build.name;
  if (changed && phase === "running") {
    byId("notes").replaceChildren();
    if (before) stage.clear();
    select("tab-live");
  }
  if (changed || phase === "running") byId("notes").replaceChildren(...(next.build.notes ?? []).map((text) => element("li", {}, text)));
  if (changed && next.build.result) {
    showResult(next.build.result);
    if (before) select("tab-result");
  }
  showBuild();
}

function showPictures() {
  byId("beside-row").hidden = !state.chosen.length;
  byId("pictures").replaceChildren(...state.pictures.map(({ name }) => {
    const chosen = state.chosen.includes(name);
    const image = element("img", { src: `/pictures/${encodeURIComponent(name)}.png`, alt: "" });
    const button = element("button", { type: "button", "aria-pressed": String(chosen), "aria-label": `Picture ${name}`, title: name }, image);
    button.addEventListener("click", () => {
      const more = byId("beside").checked;
      const names = !more ? [name] : chosen ? state.chosen.filter((n) => n !== name) : [...state.chosen, name];
      attempt("picture-error", post("/api/choose", { names }));
    });
    return element("li", {}, button);
  }));
}

function showSettings() {
  for (const input of document.querySelectorAll("[data-set]")) {
    if (input === document.activeElement) continue;
    const value = state.settings[input.dataset.set];
    if (input.type === "checkbox") input.checked = value === true;
    else input.value = value ?? "";
  }
  for (const name of ["mount", "accuracy"]) for (const input of document.getElementsByName(name)) input.checked = input.value === state.settings[name];
  for (const range of document.querySelectorAll("[data-for]")) {
    if (range === document.activeElement) continue;
    const frame = range.dataset.for === "width" ? state.preview.views?.[0]?.frame_mm[0] : null;
    range.value = state.settings[range.dataset.for] ?? frame ?? range.dataset.usual ?? 180;
    if (frame) byId("width").placeholder = Math.round(frame);
  }
}

function showPreview() {
  const { lines, error, number } = state.preview;
  const seen = lines.length > 0 && state.chosen.length > 0;
  byId("empty").hidden = seen || !!error;
  byId("survey").hidden = !seen;
  byId("survey-error").textContent = error;
  if (!seen) return;
  byId("survey-picture").src = `/preview.png?${number}`;
  byId("survey-picture").alt = lines.join(" ");
  byId("survey-lines").replaceChildren(...lines.map((line) => element("p", {}, line.trim())));
}

function showBuild() {
  const { phase, stage: name, share, iou, left_s: left, sentence, can_go_on: further } = state.build;
  const running = phase === "running" || phase === "stopping";
  byId("build").hidden = running || state.watching;
  byId("build").disabled = !state.chosen.length;
  byId("build").textContent = phase === "idle" ? "Build" : "Build anew";
  byId("stop").hidden = !running || state.watching; // Ctrl-C in its terminal stops it
  byId("stop").disabled = phase === "stopping";
  byId("go-on").hidden = running || !further || state.watching;
  byId("bar").value = running || phase === "done" || phase === "rejected" ? share ?? 0 : 0;
  byId("shadow-iou").textContent = iou ? `IoU ${iou.toFixed(3)}` : "";
  until = running && left != null ? performance.now() + 1000 * left : null;
  const words = {
    idle: state.chosen.length ? "Ready." : "Choose a picture to begin.",
    running: `${capital(name ?? "")}${iou ? `, IoU ${iou.toFixed(3)}` : ""}`,
    stopping: "Stopping …",
    done: `Built: every required check passed. ${state.build.result ? brief(state.build.result) : ""}`,
    rejected: sentence || "Built, but a required check failed: see the report.",
    stopped: sentence,
    failed: sentence,
  };
  byId("said").textContent = words[phase] + (phase === "running" ? remaining() : "");
  byId("said").classList.toggle("bad", phase === "failed" || phase === "rejected");
}

function remaining() {
  if (until === null) return "";
  const seconds = Math.max(1, (until - performance.now()) / 1000);
  return seconds >= 90 ? `, about ${Math.round(seconds / 60)} min left` : `, about ${Math.round(seconds)} s left`;
}

function showResult(built) {
  const here = `/files/${built.where.split("/").map(encodeURIComponent).join("/")}`;
  byId("result-empty").hidden = true;
  byId("result").hidden = false;
  byId("verdict").textContent = built.where.endsWith("/rejected") ? "A required check failed" : capital(built.verdict ?? "built");
  byId("figures").textContent = [brief(built), ...built.reasons].join(". ");
  const part = built.files.includes("part.3mf");
  byId("download").hidden = !part;
  byId("download").href = `${here}/part.3mf`;
  byId("files").replaceChildren(...built.files.filter((n) => n !== "part.3mf").map((name) => element("a", { href: `${here}/${encodeURIComponent(name)}`, download: name === "report.html" ? name : "" }, name)));
  if (byId("report").getAttribute("src") !== `${here}/report.html` || built === state.build.result) byId("report").src = `${here}/report.html`;
}

function brief(built) {
  const parts = [];
  if (built.verdict) parts.push(built.verdict);
  if (built.ious?.length) parts.push(`IoU ${built.ious.map((v) => v?.toFixed(3) ?? "–").join(", ")}`);
  if (built.hours) parts.push(`${built.hours.toFixed(1)} h`);
  if (built.mass_g) parts.push(`${Math.round(built.mass_g)} g`);
  if (built.size_mm) parts.push(`${built.size_mm.map((v) => Math.round(v)).join(" × ")} mm`);
  return parts.join(", ");
}

function addNote(text) {
  byId("notes").append(element("li", {}, text));
}

/* ---- what a person does */

async function attempt(place, promise) {
  byId(place).textContent = "";
  try {
    await promise;
  } catch (error) {
    byId(place).textContent = error.message;
  }
}

function upload(blob, name) {
  if (blob.size > LARGEST_MB * 2 ** 20) {
    byId("picture-error").textContent = `${name} has more than ${LARGEST_MB} MB, too much for a picture. Scale it down; about 1000 pixels on a side are enough.`;
    return;
  }
  const beside = byId("beside").checked ? "&beside=1" : "";
  attempt("picture-error", call(`/api/pictures?name=${encodeURIComponent(name)}${beside}`, blob, "application/octet-stream").then(() => select("tab-preview")));
}

function useText() {
  attempt("picture-error", post("/api/text", { text: byId("text").value, beside: byId("beside").checked }).then(() => select("tab-preview")));
}

function listenToPicture() {
  byId("file").addEventListener("change", (e) => {
    const [file] = e.target.files;
    if (file) upload(file, file.name);
    e.target.value = "";
  });
  // anywhere on the page: a picture that misses the field must not replace the page
  for (const kind of ["dragenter", "dragover", "dragleave", "drop"]) {
    document.addEventListener(kind, (e) => {
      e.preventDefault();
      byId("drop").classList.toggle("over", kind === "dragenter" || kind === "dragover");
      const [file] = kind === "drop" ? e.dataTransfer.files : [];
      if (file) upload(file, file.name);
    });
  }
  document.addEventListener("paste", (e) => {
    const [file] = e.clipboardData.files;
    if (file) upload(file, file.name);
  });
  byId("use-text").addEventListener("click", useText);
  byId("text").addEventListener("keydown", (e) => {
    if (e.key === "Enter") { e.preventDefault(); useText(); }
  });
  byId("glyphs").append(...GLYPHS.map((glyph) => {
    const button = element("button", { type: "button", "aria-label": `Symbol ${glyph}` }, glyph);
    button.addEventListener("click", () => { byId("text").value = glyph; useText(); });
    return button;
  }));
  byId("undo").addEventListener("click", () => sheet.undo());
  byId("clear").addEventListener("click", () => sheet.clear());
  byId("use-drawing").addEventListener("click", async () => {
    if (sheet.empty) byId("picture-error").textContent = "The sheet is empty: draw something first.";
    else upload(await sheet.blob(), "drawing.png");
  });
}

function listenToSettings() {
  byId("panel").addEventListener("submit", (e) => e.preventDefault());
  for (const input of document.querySelectorAll("[data-set], [name=mount], [name=accuracy]")) {
    input.addEventListener("change", () => {
      const value = input.type === "checkbox" ? input.checked : input.type === "number" ? (input.value === "" ? null : Number(input.value)) : input.value;
      set(input.dataset.set ?? input.name, value === false ? null : value);
    });
  }
  for (const range of document.querySelectorAll("[data-for]")) {
    const number = byId(range.dataset.for);
    range.addEventListener("input", () => (number.value = range.value));
    range.addEventListener("change", () => set(range.dataset.for, Number(range.value)));
  }
}

function set(name, value) {
  attempt("setting-error", post("/api/settings", { [name]: value }));
}

function listenToBuild() {
  byId("build").addEventListener("click", () => press(false));
  byId("go-on").addEventListener("click", () => press(true));
  byId("stop").addEventListener("click", () => post("/api/stop").catch((error) => say(error.message)));
  setInterval(() => {
    if (state?.build.phase === "running" && until !== null) {
      const { stage: name, iou } = state.build;
      byId("said").textContent = `${capital(name ?? "")}${iou ? `, IoU ${iou.toFixed(3)}` : ""}${remaining()}`;
    }
  }, 1000);
}

function press(goOn) {
  if (window.innerWidth <= 860) byId("stage").scrollIntoView({ block: "start" });
  post("/api/build", { go_on: goOn }).catch((error) => say(error.message));
}

function say(text) {
  byId("said").textContent = text;
  byId("said").classList.add("bad");
}

/* ---- tabs, by mouse and by arrow keys */

function select(id) {
  const tab = byId(id);
  for (const other of tab.parentElement.children) {
    const chosen = other === tab;
    other.setAttribute("aria-selected", String(chosen));
    other.tabIndex = chosen ? 0 : -1;
    byId(other.getAttribute("aria-controls")).hidden = !chosen;
  }
  if (id === "tab-live") stage.renew();
}

function listenToTabs() {
  for (const list of document.querySelectorAll("[role=tablist]")) {
    list.addEventListener("click", (e) => e.target.role === "tab" && select(e.target.id));
    list.addEventListener("keydown", (e) => {
      const by = { ArrowRight: 1, ArrowLeft: -1 }[e.key];
      if (!by) return;
      const tabs = [...list.children];
      const next = tabs[(tabs.indexOf(document.activeElement) + by + tabs.length) % tabs.length];
      next.focus();
      select(next.id);
    });
  }
}

/* ---- small helpers */

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}
const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);

async function fillChoices() {
  const { printers } = await (await fetch("/api/choices")).json();
  byId("printer").append(element("option", { value: "" }, "Prusa MK4 (usual)"), ...printers.map(({ name, volume_mm: v }) => element("option", { value: name }, `${name}, ${v.join(" × ")} mm`)));
}

listenToPicture();
listenToSettings();
listenToBuild();
listenToTabs();
fillChoices().finally(connect);
