/* The fields: built from a list, filled from the state, marked where what they hold is wrong. */
import { byId, element, post } from "./api.js";

const WORDS = { spellcheck: "false", autocomplete: "off" };
/* [setting, kind, what it needs]; labels and usual values come from the server, which says what is wrong in the same words */
const LISTS = {
  "clean-fields": [
    ["ink", "menu", { "": "what stands out", dark: "what is dark", light: "what is light", alpha: "what is opaque", flood: "what the border does not reach (photographs)" }],
    ["crop", "menu", { "": "paper about a drawing", none: "nothing", auto: "all about the drawing" }],
    ["smooth", "range", { min: 0, max: 20, step: 0.5, unit: "px", hint: "Rounds ragged edges." }],
    ["lines", "menu", { "": "along their middle where they are thin", on: "along their middle", off: "filled" }],
  ],
  "scene-fields": [
    ["size", "range", { min: 60, max: 400, step: 5, unit: "mm" }],
    ["lamp_distance", "range", { min: 150, max: 3000, step: 10, unit: "mm" }],
    ["wall_distance", "range", { min: 30, max: 1000, step: 5, unit: "mm" }],
    ["lamps", "menu", { "": "one: a shadow", rgb: "three: in colours", "warm+cold": "warm and cold: two tints" }],
  ],
  "print-fields": [
    ["mount", "choice", { auto: "Auto", wall: "Wall", stand: "Stand", hang: "Hang", none: "None" }],
    ["plate", "menu", { "": "as it holds best", roots: "roots, in its own shadow", rounded: "a thin rectangle", full: "the whole frame", pegs: "pegs, off the wall" }],
    ["supports", "menu", { "": "without, where that works", none: "without", slicer: "the slicer's" }],
    ["accuracy", "choice", { sketch: "Sketch", draft: "Draft", standard: "Standard", fine: "Fine" }],
    ["printer", "menu", {}],
    ["material", "menu", {}],
    ["print", "check", { hint: "Slices the part with PrusaSlicer, where it is installed: hours, grams and supports, for 30 seconds to some minutes more." }],
    ["accept", "check", { value: "unrecognisable" }],
  ],
};
let labels = {};
let usual = {};
const inputs = {};
const ranges = {};

export async function buildFields() {
  const choices = await (await fetch("/api/choices")).json();
  ({ labels, usual } = choices);
  byId("file").accept = choices.suffixes.join(",");
  for (const [place, fields] of Object.entries(LISTS)) byId(place).append(...fields.map(build));
  inputs.font = byId("font");
  inputs.font.addEventListener("change", () => set("font", inputs.font.value));
  inputs.font.after(wrongOf("font"));
  byId("fonts").append(...choices.fonts.map((value) => element("option", { value })));
  fillPrinters(choices);
  fillMaterials(choices.materials);
}

function build([name, kind, about]) {
  if (kind === "check") {
    const input = element("input", { type: "checkbox", id: name, ...described(name, about), change: () => set(name, input.checked ? about.value ?? true : null) });
    inputs[name] = input;
    return element("div", { class: "line" }, element("label", { class: "check" }, input, ` ${labels[name]}`), ...below(name, about));
  }
  if (kind === "choice") {
    const options = Object.entries(about).map(([value, text]) => element("label", {}, element("input", { type: "radio", name, value, change: () => set(name, value) }), element("span", {}, text)));
    return element("fieldset", { class: "choice" }, element("legend", {}, labels[name]), element("div", {}, ...options), wrongOf(name));
  }
  const label = element("label", { for: name }, labels[name]);
  if (kind === "menu") {
    inputs[name] = element("select", { id: name, ...described(name, {}), change: (e) => set(name, e.target.value) }, ...Object.entries(about).map(([value, text]) => element("option", { value }, text)));
    return element("div", { class: "line" }, element("div", { class: "field wide" }, label, inputs[name]), wrongOf(name));
  }
  const input = element("input", { type: "text", id: name, inputmode: "decimal", ...WORDS, ...described(name, about), placeholder: usual[name], change: () => set(name, input.value) });
  inputs[name] = input;
  const unit = element("span", {}, about.unit ?? "");
  const { min, max, step } = about;
  let waiting = 0;
  const range = element("input", { type: "range", min, max, step, "aria-label": `${labels[name]}${about.unit ? `, ${about.unit}` : ""}`, input: () => {
    input.value = range.value;
    clearTimeout(waiting);
    waiting = setTimeout(() => set(name, input.value), 150);
  } });
  ranges[name] = range;
  return element("div", { class: "line" }, element("div", { class: "field" }, label, range, input, unit), ...below(name, about));
}

const described = (name, { hint }) => ({ "aria-describedby": `${name}-wrong${hint ? ` ${name}-hint` : ""}` });
const wrongOf = (name) => element("p", { class: "wrong", id: `${name}-wrong`, role: "alert" });
const below = (name, { hint }) => [wrongOf(name), ...(hint ? [element("p", { class: "hint", id: `${name}-hint` }, hint)] : [])];

function fillPrinters({ printers }) {
  const order = [...printers].sort((a, b) => a.title.localeCompare(b.title));
  const own = order.find((p) => p.name === usual.printer);
  inputs.printer.append(element("option", { value: "" }, `${own.title} (usual)`), ...order.filter((p) => p !== own).map((p) => element("option", { value: p.name }, p.title)));
}

function fillMaterials(materials) {
  inputs.material.append(element("option", { value: "" }, "the printer's usual one"), ...materials.map(({ name, title }) => element("option", { value: name }, title)));
}

function set(name, value) {
  // what is wrong comes back with the state, and is shown at the field
  post("/api/settings", { [name]: value }).catch((error) => {
    if (error.message.startsWith("The studio")) byId("setting-error").textContent = error.message;
  });
}

export function showFields(state) {
  byId("setting-error").textContent = "";
  for (const [name, input] of Object.entries(inputs)) {
    const wrong = state.wrong[name];
    input.toggleAttribute("aria-invalid", Boolean(wrong));
    if (wrong) input.setAttribute("aria-invalid", "true");
    if (input === document.activeElement && input.type === "text") continue; // somebody types
    const value = wrong ? wrong.text : state.settings[name];
    if (input.type === "checkbox") input.checked = Boolean(value);
    else input.value = value ?? "";
  }
  if (inputs.printer.selectedIndex < 0) inputs.printer.value = "";
  for (const name of ["mount", "accuracy"]) for (const input of document.getElementsByName(name)) input.checked = input.value === state.settings[name];
  for (const mark of document.querySelectorAll(".wrong")) mark.textContent = state.wrong[mark.id.slice(0, -6)]?.why ?? "";
  const sides = state.preview.views?.[0]?.frame_mm;
  const frame = sides && Math.max(...sides);
  if (frame) inputs.size.placeholder = Math.round(frame);
  for (const [name, range] of Object.entries(ranges)) {
    if (range === document.activeElement) continue;
    const value = state.settings[name] ?? (name === "size" ? frame : null) ?? usual[name];
    range.value = Number(value);
  }
  byId("font-row").hidden = !state.picture?.text && byId("source-text").hidden;
}

/* Go to the first field that is wrong; its sentence stands below it. */
export function showWrong(state) {
  const [name] = Object.keys(state.wrong);
  const input = inputs[name] ?? document.getElementsByName(name)[0];
  input?.closest("details")?.setAttribute("open", "");
  input?.focus();
}

export const labelsOf = (names) => names.map((name) => labels[name]).join(", ");
