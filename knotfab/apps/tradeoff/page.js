"use strict";
const { points } = JSON.parse(document.getElementById("shown").textContent);
const at = (id) => document.getElementById(id);
const marks = [...document.querySelectorAll(".point")].sort((a, b) => a.dataset.i - b.dataset.i);
const make = (name, text, kind) => {
  const found = document.createElement(name);
  if (text !== undefined) found.textContent = text;
  if (kind) found.className = kind;
  return found;
};

function show(i) {
  const point = points[i];
  for (const mark of marks) {
    const chosen = Number(mark.dataset.i) === i;
    mark.classList.toggle("chosen", chosen);
    mark.setAttribute("tabindex", chosen ? "0" : "-1");
  }
  at("name").textContent = point.knob === "preset" ? point.label : `${point.knob}: ${point.label}`;
  at("remark").textContent = point.remark || (point.front ? "On the front: nothing measured beats it." : "");
  const figures = at("figures");
  figures.replaceChildren(...point.figures.map(([name, value]) => {
    const pair = make("div");
    pair.append(make("dt", name), make("dd", value));
    return pair;
  }));
  const settings = at("settings");
  settings.replaceChildren(...point.changed.map(([key, old, now]) => {
    const row = make("tr");
    row.append(make("td", key), make("td", old, "n"), make("td", now, "n"));
    return row;
  }));
  at("same").hidden = point.changed.length > 0;
  at("differ").hidden = point.changed.length === 0;
  at("shadows").replaceChildren(...point.shadows.map(([name, iou, picture]) => {
    const figure = make("figure"), image = make("img");
    image.src = `data:image/png;base64,${picture}`;
    image.alt = `${name}: the shadow over the picture`;
    figure.append(image, make("figcaption", `${name} ${iou}`));
    return figure;
  }));
}

function focus(i) {
  show(i);
  marks[i].focus({ preventScroll: true });
}

marks.forEach((mark, i) => {
  mark.addEventListener("pointerenter", () => show(i));
  mark.addEventListener("focus", () => show(i));
  mark.addEventListener("click", () => focus(i));
  mark.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    const to = step ? (i + step + marks.length) % marks.length : { Home: 0, End: marks.length - 1 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    focus(to);
  });
});
for (const button of document.querySelectorAll("button[data-i]")) {
  button.addEventListener("click", () => {
    at("chart").scrollIntoView({ block: "nearest" });
    focus(Number(button.dataset.i));
  });
}
for (const button of document.querySelectorAll("button[data-knob]")) {
  button.addEventListener("click", () => {
    const on = button.getAttribute("aria-pressed") !== "true";
    for (const other of document.querySelectorAll("button[data-knob]")) other.setAttribute("aria-pressed", "false");
    button.setAttribute("aria-pressed", String(on));
    for (const mark of marks) {
      const kind = mark.dataset.kind;
      mark.classList.toggle("dim", on && kind !== button.dataset.knob && kind !== "-1");
    }
  });
}
show(Number(at("chart").dataset.first));
