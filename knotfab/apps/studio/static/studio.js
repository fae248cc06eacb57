/* The studio's page. What it shows is the server's state: a reload, or a second tab, shows the same. */
import { byId, capital, element, post } from "./api.js";
import { brief, clearResult, showBuilds, showResult } from "./builds.js";
import { buildFields, labelsOf, showFields, showWrong } from "./fields.js";
import { Stage } from "./stage.js";
import { showPreview } from "./survey.js";
import { listenToPictures } from "./picture.js";

const LATE_S = 2; // so long after its estimate a build takes longer than usual
const stage = new Stage();
let state = null;
let until = null; // when the build will have ended, by the page's clock

/* ---- what the server tells */

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
  else if (event.event === "stage") follow({ stage: event.name, left_s: event.left_s, fraction: null, late: false });
  else if (event.event === "progress") follow({ stage: event.stage, share: event.share, left_s: event.left_s, fraction: event.fraction, late: event.late, ...(event.iou === null ? {} : { iou: event.iou }) });
  else if (event.event === "say") byId("notes").append(element("li", {}, event.text));
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
  showPanel(before, next);
  const { phase, name } = next.build;
  const changed = !before || before.build.phase !== phase || before.build.name !== name;
  if (before && before.build.name !== name) stage.clear();
  if (changed && phase === "running") select("tab-live");
  if (changed || phase === "running") byId("notes").replaceChildren(...(next.build.notes ?? []).map((text) => element("li", {}, text)));
  if (changed && next.build.result) {
    showResult(next.build.result, next.build.title, before?.build.phase === "running");
    if (before) select("tab-result");
  } else if (changed && phase !== "running") clearResult();
  showBuild();
}

function showPanel(before, next) {
  showFields(next);
  showBuilds(next, select);
  const seen = (one) => JSON.stringify([one.preview.number, one.preview.error, one.preview.looking, one.picture?.name]);
  if (!before || seen(before) !== seen(next)) showPreview(next);
}

function showBuild() {
  const { phase, share, iou, left_s: left, sentence, result } = state.build;
  const running = phase === "running" || phase === "stopping";
  byId("build").hidden = running;
  byId("build").disabled = !state.picture;
  byId("stop").hidden = !running;
  byId("stop").disabled = phase === "stopping";
  byId("bar").value = running || phase === "done" || phase === "rejected" ? share ?? 0 : 0;
  byId("shadow-iou").textContent = iou ? `IoU ${iou.toFixed(3)}` : "";
  until = running && left != null ? performance.now() + 1000 * left : null;
  const wrong = Object.keys(state.wrong ?? {});
  const words = {
    idle: state.picture ? "Ready." : "Choose a picture to begin.",
    running: doing(),
    stopping: "Stopping …",
    done: `${state.build.title}: every required check passed. ${result ? brief(result) : ""}`,
    rejected: sentence || "Built, but a required check failed: see the report.",
    stopped: sentence,
    failed: sentence,
  };
  const mend = !running && wrong.length > 0;
  // what was built last is another piece
  const other = !running && state.current && state.picture?.name !== state.builds.find((b) => b.name === state.current)?.picture;
  byId("said").textContent = mend ? `Not right yet: ${labelsOf(wrong)}.` : words[other && state.picture ? "idle" : phase];
  byId("said").classList.toggle("bad", mend || (!other && (phase === "failed" || phase === "rejected")));
  if (other) byId("bar").value = 0;
}

/* What the build does now, and how long it will take yet. */
function doing() {
  const { stage: name, iou, fraction, title } = state.build;
  const part = name === "slicer" && fraction ? ` ${Math.round(100 * fraction)} %` : "";
  return `${title ? `${title}: ` : ""}${capital(name ?? "")}${part}${iou ? `, IoU ${iou.toFixed(3)}` : ""}${remaining()}`;
}

function remaining() {
  if (until === null) return "";
  const seconds = (until - performance.now()) / 1000;
  if (state.build.late || seconds < -LATE_S) return ", longer than usual";
  return seconds >= 90 ? `, about ${Math.round(seconds / 60)} min left` : `, about ${Math.max(1, Math.round(seconds))} s left`;
}

/* ---- what a person does */

function listenToBuild() {
  byId("panel").addEventListener("submit", (e) => e.preventDefault());
  byId("build").addEventListener("click", press);
  byId("stop").addEventListener("click", () => post("/api/stop").catch((error) => say(error.message)));
  setInterval(() => {
    if (state?.build.phase === "running" && until !== null) byId("said").textContent = doing();
  }, 1000);
}

function press() {
  post("/api/build").then(() => {
    if (window.innerWidth <= 860) byId("stage").scrollIntoView({ block: "start" });
  }).catch((error) => {
    say(error.message);
    if (Object.keys(state.wrong).length) showWrong(state);
  });
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
      const tabs = [...list.children].filter((tab) => !tab.hidden);
      const next = tabs[(tabs.indexOf(document.activeElement) + by + tabs.length) % tabs.length];
      next.focus();
      select(next.id);
    });
  }
}

async function begin() {
  listenToPictures(select);
  listenToBuild();
  listenToTabs();
  await buildFields();
  connect();
}

begin();
