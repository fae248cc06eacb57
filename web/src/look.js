/* The spectator: turned and zoomed by hand, by touch and by keys; or standing where the lamp is. */
import { Vector3 } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

const STEP = Math.PI / 24; // of an arrow key
const ZOOM = 1.12; // of + and -
const GLIDE_MS = 450;
const FOV = 32;

export const calm = () => globalThis.matchMedia?.("(prefers-reduced-motion: reduce)").matches ?? false;

export class Look {
  constructor(stage, canvas) {
    this.stage = stage;
    this.canvas = canvas;
    this.atLamp = false;
    this.glide = null;
    const orbit = (this.orbit = new OrbitControls(stage.camera, canvas));
    orbit.enableDamping = !calm();
    orbit.dampingFactor = 0.12;
    orbit.enableZoom = false; // the page scrolls until the canvas was chosen
    orbit.addEventListener("change", () => stage.requestDraw());
    orbit.addEventListener("start", () => {
      this.glide = null;
      if (this.atLamp) this._leaveLamp();
    });
    canvas.style.touchAction = "pan-y"; // one finger up and down scrolls the page, sideways turns the part
    this.events = new AbortController();
    const on = (name, act, more = {}) => canvas.addEventListener(name, act, { signal: this.events.signal, ...more });
    on("pointerdown", (event) => {
      canvas.focus({ preventScroll: true });
      orbit.enableZoom = true;
      event.stopPropagation();
    });
    on("focus", () => (orbit.enableZoom = true));
    on("blur", () => (orbit.enableZoom = false));
    on("keydown", (event) => this._key(event));
  }

  _key(event) {
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (turns[event.key]) this.turn(turns[event.key][0] * STEP, turns[event.key][1] * STEP);
    else if (event.key === "+" || event.key === "=") this.zoom(1 / ZOOM);
    else if (event.key === "-" || event.key === "_") this.zoom(ZOOM);
    else if (event.key === "0") this.reset();
    else return;
    event.preventDefault();
  }

  /* Turn the spectator about what is looked at, radians to the right and down. */
  turn(right, down) {
    if (this.atLamp) this._leaveLamp();
    const { camera } = this.stage;
    const away = camera.position.clone().sub(this.orbit.target);
    const r = away.length();
    const polar = Math.min(Math.max(Math.acos(away.y / r) + down, 0.02), Math.PI - 0.02);
    const azimuth = Math.atan2(away.x, away.z) + right;
    away.setFromSphericalCoords(r, polar, azimuth);
    this._go(this.orbit.target.clone().add(away), this.orbit.target, FOV, false);
  }

  zoom(factor) {
    if (this.atLamp) this._leaveLamp();
    const { camera } = this.stage;
    const away = camera.position.clone().sub(this.orbit.target).multiplyScalar(factor);
    this._go(this.orbit.target.clone().add(away), this.orbit.target, FOV, false);
  }

  _leaveLamp() {
    // the same picture from as far away as the ordinary lens needs
    this.atLamp = false;
    const { camera } = this.stage;
    const away = camera.position.clone().sub(this.orbit.target);
    away.multiplyScalar(Math.tan((camera.fov * Math.PI) / 360) / Math.tan((FOV * Math.PI) / 360));
    camera.position.copy(this.orbit.target).add(away);
    this._lens(FOV);
  }

  _lens(fov) {
    this.stage.camera.fov = fov;
    this.stage.camera.updateProjectionMatrix();
  }

  /* How far the spectator must be for a ball of this radius to fill the picture. */
  _distance(radius) {
    const aspect = Math.min(1, this.stage.camera.aspect || 1);
    return radius / Math.sin((FOV * Math.PI) / 360) / aspect;
  }

  reset(gliding = true) {
    this.atLamp = false;
    const { stage } = this;
    if (stage.mode === "print") {
      const [w, d] = stage.data.print.bed_mm;
      const middle = new Vector3(w / 2, 0.2 * Math.max(w, d), -d / 2);
      const from = new Vector3(-0.55, 0.62, 1).normalize().multiplyScalar(this._distance(0.62 * Math.hypot(w, d)));
      this._go(middle.clone().add(from), middle, FOV, gliding);
      return;
    }
    if (stage.view.kind === "eye") {
      this.fromLamp(gliding);
      return;
    }
    const { right, up, back } = stage.cameraNow();
    const { center, radius } = stage.ball();
    const from = back.clone().multiplyScalar(0.86).addScaledVector(right, 0.62).addScaledVector(up, 0.26).normalize();
    this._go(center.clone().addScaledVector(from, this._distance(0.86 * radius)), center, FOV, gliding);
  }

  fromLamp(gliding = true) {
    this.atLamp = true;
    this._lampPlace(gliding);
  }

  fromSide() {
    this.atLamp = false;
    const { right, back, middle, at } = this.stage.cameraNow();
    const target = middle.clone().add(at).multiplyScalar(0.5);
    const reach = 0.5 * at.distanceTo(middle) + 0.4 * this.stage.view.frame_width_mm;
    const from = right.clone().addScaledVector(back, 0.25).add(new Vector3(0, 0.3, 0)).normalize();
    this._go(target.clone().addScaledVector(from, this._distance(reach) * 0.95), target, FOV, true);
  }

  _lampPlace(gliding) {
    const { at, middle } = this.stage.cameraNow();
    const { frame_width_mm: w, frame_height_mm: h } = this.stage.view;
    const aspect = this.stage.camera.aspect || 1;
    const half = 0.58 * Math.max(h, w / aspect);
    const fov = (2 * Math.atan(half / at.distanceTo(middle)) * 180) / Math.PI;
    this._go(at, middle, fov, gliding);
  }

  /* Where the lamp moves, one who stands there moves along. */
  follow() {
    if (this.atLamp) this._lampPlace(false);
  }

  _go(position, target, fov, gliding) {
    const { camera } = this.stage;
    if (gliding && !calm()) {
      this.glide = {
        begun: performance.now(),
        from: [camera.position.clone(), this.orbit.target.clone(), camera.fov],
        to: [position.clone(), target.clone(), fov],
      };
    } else {
      this.glide = null;
      camera.position.copy(position);
      this.orbit.target.copy(target);
      this._lens(fov);
    }
    this.stage.requestDraw();
  }

  /* Before each picture; returns whether another must follow. */
  update() {
    const { camera } = this.stage;
    if (this.glide) {
      const share = Math.min(1, (performance.now() - this.glide.begun) / GLIDE_MS);
      const t = share * share * (3 - 2 * share);
      const { from, to } = this.glide;
      camera.position.lerpVectors(from[0], to[0], t);
      this.orbit.target.lerpVectors(from[1], to[1], t);
      this._lens(from[2] + (to[2] - from[2]) * t);
      if (share === 1) this.glide = null;
    }
    const away = camera.position.distanceTo(this.orbit.target);
    camera.near = 0.01 * away;
    camera.far = 20 * away + 5000;
    camera.updateProjectionMatrix();
    const moving = this.orbit.update();
    return Boolean(this.glide) || moving;
  }

  dispose() {
    this.events.abort();
    this.orbit.dispose();
  }
}
