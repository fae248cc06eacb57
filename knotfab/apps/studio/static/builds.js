/* What was built: the list, and a result with its files and its report. */
import { attempt, byId, capital, element, post } from "./api.js";

const SHOWN = 4; // files, before the others unfold
let select = () => {};
let of = ""; // whose report is shown

export function showBuilds(state, selectTab) {
  select = selectTab;
  const running = ["running", "stopping"].includes(state.build.phase);
  byId("earlier").hidden = !state.builds.length;
  byId("builds").replaceChildren(...state.builds.map((built) => row(built, built.name === state.current, running)));
}

function row(built, current, running) {
  const { title, result, picture } = built;
  const image = picture ? element("img", { src: `/pictures/${encodeURIComponent(picture)}.png`, alt: "" }) : "";
  const told = result ? brief(result) : "stopped";
  return element("li", {}, element("button", { type: "button", class: "open", "aria-current": current && "true", title: `${title}: ${told}`, click: () => show(built, running) }, image, element("span", {}, title, element("small", {}, told))));
}

/* While another build runs, an old one's result can be looked at; else its picture and settings come back too. */
function show({ name, title, result, picture }, running) {
  byId("builds-error").textContent = running || picture ? "" : "Built before the studio kept notes: the result is here, its settings are in scene.toml.";
  if (result) showResult(result, title);
  select(result ? "tab-result" : "tab-preview");
  if (!running) attempt("builds-error", post("/api/open", { name }));
}

export function clearResult() {
  of = "";
  byId("result-empty").hidden = false;
  byId("result").hidden = true;
}

export function showResult(built, title, anew = false) {
  const here = `/files/${built.where.split("/").map(encodeURIComponent).join("/")}`;
  byId("result-empty").hidden = true;
  byId("result").hidden = false;
  byId("result-title").textContent = title;
  byId("verdict").textContent = built.where.endsWith("/rejected") ? "A required check failed" : capital(built.verdict ?? "built");
  byId("figures").textContent = capital(built.piece);
  const main = built.files.find((name) => name === "part.3mf");
  byId("download").hidden = !main;
  byId("download").textContent = `Download ${main}`;
  byId("download").href = `${here}/${main}`;
  const links = built.files.filter((n) => n !== main).map((name) => element("a", { href: `${here}/${encodeURIComponent(name)}`, download: name.startsWith("report.") ? name : "" }, name));
  byId("files").replaceChildren(...links.slice(0, SHOWN));
  byId("more-files").replaceChildren(...links.slice(SHOWN));
  byId("more-files").parentElement.hidden = links.length <= SHOWN;
  byId("report").hidden = !built.files.includes("report.html");
  if (!byId("report").hidden && (of !== here || anew)) byId("report").src = `${here}/report.html`;
  of = here;
}

export function brief(built) {
  const parts = [];
  if (built.where.endsWith("/rejected")) parts.push("a check failed");
  if (built.verdict) parts.push(built.verdict);
  if (built.piece) parts.push(built.piece);
  return parts.join(", ");
}
