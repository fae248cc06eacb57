/* The live view: the viewer where there is WebGL, else the knot from the side; the shadow beside it in both. */
import { asLists, drawShadow, drawSide, unpack } from "./project.js";

const byId = (id) => document.getElementById(id);

/* Whether a graphics processor draws: without one, 3D would take the build's time. */
function hasGraphics() {
  try {
    const context = window.KnotfabViewer && document.createElement("canvas").getContext("webgl2");
    const told = context?.getExtension("WEBGL_debug_renderer_info");
    const name = told ? context.getParameter(told.UNMASKED_RENDERER_WEBGL) : "";
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return Boolean(context) && !/swiftshader|llvmpipe|softpipe|software/i.test(name);
  } catch {
    return false;
  }
}

/* Lamps on one screen mix where their colours differ; else they are lit one at a time. */
function lampsOf(views) {
  if (!views.some((view) => view.wall)) return {};
  const mode = new Set(views.map((view) => String(view.lamp_colour))).size > 1 ? "mix" : "switch";
  return { lamps: { mode, screen: "ends" } };
}

export class Stage {
  constructor() {
    this.views = [];
    this.curves = [];
    this.radius = 1;
    this.pictures = [];
    this.turn = [-0.7, 0.35];
    this.viewer = null;
    this.frames = 0;
    this.waiting = false;
    this.resting = 0; // until then nothing is drawn: drawing must not take the build's time
    this.data = null;
    this.lay(!hasGraphics());
    new ResizeObserver(() => this.ask()).observe(byId("shadow"));
  }

  /* Flat: two drawings. Else the viewer in 3D, with the shadow as a picture in it. */
  lay(flat) {
    this.flat = flat;
    document.querySelector(".live").classList.toggle("flat", flat);
    byId("viewer").hidden = flat;
    byId("side").hidden = !flat;
  }

  /* What the knots are drawn with: an event "scene" of the build. */
  async setScene(event) {
    this.pictures = await Promise.all((event.pictures ?? []).map(imageOf));
    this.views = event.views;
    if (event.radius_mm) this.radius = event.radius_mm;
    const views = event.views.map((view, k) => ({ ...view, picture: event.pictures?.[k] }));
    this.changed = true;
    this.data = { unit: "mm", radius: this.radius, curves: asLists(this.curves), views, ...lampsOf(views) };
    this.renew();
  }

  /* The viewer is made when it is first seen: hidden, it has no size. */
  renew() {
    if (this.flat || !this.data || byId("show-live").hidden) return this.ask();
    try {
      this.data.curves = asLists(this.curves);
      this.data.radius = this.radius;
      if (!this.viewer) this.viewer = window.KnotfabViewer.mount(byId("viewer"), this.data, { controls: true });
      else if (this.changed) this.viewer.setScene(this.data);
      this.changed = false;
    } catch (error) {
      console.warn("no 3D view here:", error.message);
      this.lay(true);
    }
    this.ask();
  }

  setKnots(event) {
    this.curves = unpack(event.curves);
    this.radius = event.radius_mm;
    this.ask();
  }

  clear() {
    this.curves = [];
    this.ask();
  }

  /* Draw with the next frame of the screen, once, whatever has come until then. */
  ask() {
    if (this.waiting) return;
    this.waiting = true;
    setTimeout(() => requestAnimationFrame(() => this.drawAndRest()), Math.max(0, this.resting - performance.now()));
  }

  /* Draw, and rest twice as long as that took until the screen had it. */
  drawAndRest() {
    this.waiting = false;
    const begun = performance.now();
    this.draw();
    requestAnimationFrame(() => setTimeout(() => {
      const took = performance.now() - begun;
      this.resting = performance.now() + (took > 40 ? 2 * took : 0);
    }));
  }

  draw() {
    if (!this.views.length || byId("show-live").hidden) return;
    drawShadow(byId("shadow"), this.views[0], this.curves, this.radius, this.pictures[0]);
    if (this.flat) drawSide(byId("side"), this.views[0], this.curves, this.radius, this.turn);
    else if (this.viewer) this.viewer.setCurves(asLists(this.curves), this.radius);
    this.frames += 1;
    document.documentElement.dataset.frames = this.frames;
  }
}

/* A data URI as an image that can be drawn. */
async function imageOf(uri) {
  const image = new Image();
  image.src = uri;
  await image.decode();
  return image;
}
