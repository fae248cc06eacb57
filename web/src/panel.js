/* What is set by hand: which view, from where it is looked at, the lamp, the wall, the search. */
import { calm } from "./look.js";
import { colours, onTheme } from "./style.js";

const SUN = 1; // the end of the lamp's slider
const NEAREST = 0.35; // of the scene's distance
const FARTHEST = 6;
const PLAY_MS = 140;

function make(tag, properties = {}, ...children) {
  const { dataset, ...own } = properties;
  const element = Object.assign(document.createElement(tag), own);
  Object.assign(element.dataset, dataset);
  element.append(...children);
  return element;
}

const mm = (value) => `${Math.abs(value) < 100 ? Math.round(10 * value) / 10 : Math.round(value)} mm`;
const signed = (value, unit) => `${value > 0 ? "+" : value < 0 ? "−" : ""}${Math.abs(Math.round(10 * value) / 10)}${unit}`;

/* Share of the lamp's slider to a distance, by factors, and back; its end is the sun. */
const distanceAt = (share, scene) => (share >= SUN ? Infinity : scene * NEAREST * (FARTHEST / NEAREST) ** share);
const shareOf = (distance, scene) =>
  Number.isFinite(distance)
    ? Math.min(0.999, Math.max(0, Math.log(distance / scene / NEAREST) / Math.log(FARTHEST / NEAREST)))
    : SUN;

export function buildPanel(root, stage) {
  const gone = new AbortController();
  const bar = make("div", { className: "bar" });
  const lower = make("div", { className: "lower" });
  const foot = make("div", { className: "foot" });
  const time = make("div", { className: "time" });
  const hint = make("p", {
    className: "hint",
    textContent:
      "Drag to turn, pinch or scroll to zoom. Keys: arrows, + and −, 0.",
  });
  if (!stage.renderer) return { refresh() {}, dispose() {} };
  stage.box.append(bar, hint);
  root.append(lower, foot, time);
  let playing = 0;
  let sliders = [];

  function group(label, entries) {
    const box = make("div", { className: "group", role: "group", ariaLabel: label });
    box.buttons = entries.map(([text, act, pressed]) => {
      const button = make("button", { type: "button", textContent: text });
      button.addEventListener("click", () => {
        act();
        refresh();
      });
      button.pressed = pressed;
      box.append(button);
      return button;
    });
    bar.append(box);
    return box;
  }

  function slider(label, range, read, write, tell) {
    const id = `k${sliders.length}`;
    const input = make("input", { type: "range", id, min: range[0], max: range[1], step: range[2] });
    const output = make("output", { htmlFor: id });
    input.addEventListener("input", () => {
      write(Number(input.value));
      show();
    });
    const show = () => {
      input.value = read();
      output.textContent = tell();
      input.setAttribute("aria-valuetext", tell());
    };
    sliders.push(show);
    lower.append(make("div", { className: "slider" }, make("label", { htmlFor: id, textContent: label }), input, output));
  }

  function buildSliders() {
    lower.replaceChildren();
    sliders = [];
    const { view } = stage;
    const eye = view.kind === "eye";
    const what = eye ? "Eye" : "Lamp";
    const scene = Number.isFinite(view.light_distance_mm) && view.light_distance_mm ? view.light_distance_mm : 500;
    const reach = Math.round(0.4 * Math.min(scene, 1000));
    const set = (name) => (value) => stage.setLamp({ [name]: value });
    const get = (name) => () => stage.lamp[name];
    slider(`${what} distance`, [0, 1, 0.001], () => shareOf(stage.lamp.distance, scene),
      (share) => stage.setLamp({ distance: distanceAt(share, scene) }),
      () => (Number.isFinite(stage.lamp.distance) ? mm(stage.lamp.distance) : eye ? "far away" : "the sun"));
    const about = (value) => [Math.round(value ?? 0) - reach, Math.round(value ?? 0) + reach, stage.mixes ? 0.5 : 1];
    slider(`${what} height`, about(view.light_up_mm), get("height"), set("height"), () => signed(stage.lamp.height, " mm"));
    slider(`${what} aside`, about(view.light_right_mm), get("side"), set("side"), () => signed(stage.lamp.side, " mm"));
    if (eye) return;
    slider("Lamp size", [0, 120, 1], get("diameter"), set("diameter"), () => mm(stage.lamp.diameter));
    slider("Wall tilt", [-45, 45, 0.5], get("tilt"), set("tilt"),
      () => signed(stage.lamp.tilt, "°"));
    if (!stage.data.wall_mounted)
      slider("Piece turned", [-45, 45, 0.5], get("turn"), set("turn"), () => signed(stage.lamp.turn, "°"));
  }

  let groups = [];
  let told = null;
  function build() {
    bar.replaceChildren();
    foot.replaceChildren();
    time.replaceChildren();
    groups = [];
    const { data } = stage;
    const shadow = stage.view.kind !== "eye";
    const several = data.views.length > 1 && !stage.mixes;
    const places = several
      ? data.views.map((view, k) => [view.name, () => choose(k), () => stage.mode === "wall" && stage.index === k])
      : [["In the light", () => stage.setMode("wall"), () => stage.mode === "wall"]];
    if (data.print) places.push(["As printed", () => stage.setMode("print"), () => stage.mode === "print"]);
    if (places.length > 1) groups.push(group("What is shown", places));
    else if (!stage.mixes) bar.append(make("span"));
    if (stage.mixes)
      groups.push(group("Lamps, on and off", data.views.map((view, k) => [
        view.name, () => stage.setLit(stage.lit.map((on, n) => on !== (n === k))), () => stage.lit[k],
      ])));
    groups.push(group("Seen from", [
      ["Beside", () => stage.look.reset(), null],
      [shadow ? "Lamp" : "Eye", () => stage.look.fromLamp(), null],
      ["Afar", () => stage.look.fromSide(), null],
    ]));
    if (stage.mixes) {
      const which = make("select", { ariaLabel: "The lamp that is moved by hand" },
        ...data.views.map((view, k) => make("option", { value: k, textContent: `Move ${view.name}`, selected: k === stage.index })));
      which.addEventListener("change", () => {
        choose(Number(which.value));
        refresh();
      });
      foot.append(which);
    }
    const box = make("input", { type: "checkbox", checked: stage.compare });
    box.addEventListener("change", () => {
      stage.setCompare(box.checked);
      refresh();
    });
    const c = colours();
    const key = make("span", { className: "keys" });
    for (const [name, colour] of [["both", c.dark], ["too much", c.spill], ["missing", c.missing]]) {
      const swatch = make("i");
      swatch.style.background = colour;
      key.append(make("span", { className: "key" }, swatch, name), " ");
    }
    told = make("span", { role: "status" });
    const reset = make("button", { type: "button", className: "reset", textContent: "Put back" });
    reset.addEventListener("click", () => {
      stage.resetLamp();
      refresh();
    });
    if (!stage.mixes) foot.append(make("label", {}, box, "Compare with the picture"));
    foot.append(key, told, reset);
    foot.key = key;
    buildTime();
    buildSliders();
  }

  function choose(k) {
    stage.mode = "wall";
    if (stage.mixes) stage.pick(k);
    else stage.setView(k);
    buildSliders();
  }

  function buildTime() {
    const n = stage.frames.length;
    time.hidden = n === 0;
    if (!n) return;
    const last = n - 1;
    const input = make("input", {
      type: "range", min: 0, max: last, step: 1, value: stage.frame ?? last, ariaLabel: "Frame of the sequence",
    });
    const output = make("output");
    const show = (k) => {
      stage.setFrame(k);
      output.textContent = nameOf(k);
      input.setAttribute("aria-valuetext", output.textContent);
    };
    const nameOf = (k) => stage.frames[k].label ?? `${k + 1} of ${n}`;
    input.addEventListener("input", () => {
      stop();
      show(Number(input.value));
    });
    const play = make("button", { type: "button", textContent: "Play" });
    const stop = () => {
      clearInterval(playing);
      playing = 0;
      play.setAttribute("aria-pressed", "false");
    };
    play.addEventListener("click", () => {
      if (playing) return stop();
      play.setAttribute("aria-pressed", "true");
      playing = setInterval(() => {
        input.value = (Number(input.value) + 1) % n;
        show(Number(input.value));
      }, calm() ? 6 * PLAY_MS : PLAY_MS);
      return undefined;
    });
    play.setAttribute("aria-pressed", "false");
    output.textContent = nameOf(stage.frame ?? 0);
    time.append(play, input, output);
  }

  let measuring = 0;
  function measure() {
    if (measuring) return;
    measuring = setTimeout(() => {
      measuring = 0;
      const lit = stage.mode === "wall";
      const [iou, right] = [lit && !stage.mixes ? stage.iou() : null, lit ? stage.right() : null];
      told.replaceChildren();
      if (right !== null)
        told.append("With all lamps on, ", make("b", { textContent: `${(100 * right).toFixed(1)} %` }), " of the picture has its right colour.");
      if (iou !== null)
        told.append("The shadow and the picture share ", make("b", { textContent: `${Math.round(100 * iou)} %` }), " of what either covers.");
    }, 120);
  }

  function refresh() {
    const lit = stage.mode === "wall";
    for (const box of groups)
      for (const button of box.buttons) {
        if (button.pressed) button.setAttribute("aria-pressed", String(button.pressed()));
      }
    for (const show of sliders) show();
    lower.hidden = foot.hidden = !lit;
    for (const box of groups.slice(-1)) for (const button of box.buttons.slice(1)) button.hidden = !lit;
    foot.key.hidden = !stage.compare || stage.mixes;
    const { view, data } = stage;
    stage.renderer.domElement.setAttribute("aria-label", lit
      ? `The part in 3D, ${view.kind === "eye" ? "seen by the eye" : "with its lamp and the shadow on the wall"}${data.views.length > 1 ? `: ${view.name}` : ""}`
      : "The part in 3D as it is printed, with its supports");
    measure();
  }

  let known = null;
  const follow = () => {
    if (known !== stage.data && known?.views !== stage.data.views) {
      known = stage.data;
      build();
      refresh();
    } else measure();
  };
  follow();
  stage.listeners.add(follow);
  const stopTheme = onTheme(() => {
    build();
    refresh();
  });
  return {
    refresh,
    dispose() {
      gone.abort();
      stopTheme();
      clearInterval(playing);
      clearTimeout(measuring);
      stage.listeners.delete(follow);
    },
  };
}
