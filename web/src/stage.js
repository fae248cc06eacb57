/* The stage: part, lamp, wall and bed in one canvas, drawn only when something changed. */
import {
  Box3,
  BufferGeometry,
  Color,
  DirectionalLight,
  DoubleSide,
  Float32BufferAttribute,
  Group,
  HemisphereLight,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  OrthographicCamera,
  PerspectiveCamera,
  PlaneGeometry,
  Scene,
  Sphere,
  Vector3,
  WebGLRenderer,
} from "three";
import { cameraOf, padded, setupOf } from "./camera.js";
import { lampBodies, lampPoints } from "./lamp.js";
import { Look } from "./look.js";
import { mixtureOf, shareRight } from "./mixing.js";
import { Picture } from "./picture.js";
import { bedOf, supportsOf } from "./print.js";
import { Shadow } from "./shadow.js";
import { colours, onTheme } from "./style.js";
import { meshGeometry, tubeGeometry } from "./tube.js";
import { wallMaterial } from "./wall.js";

const WIDE = 0.5; // of the frame that the wall shows beyond it, on each side
const SHADOW_PX = 1536; // on the longer side of that wall, at most
const IOU_PX = 512; // on the longer side of the frame

export class Stage {
  constructor(root, data) {
    this.box = document.createElement("div");
    this.box.className = "stage";
    root.append(this.box);
    this.listeners = new Set();
    this.mode = "wall"; // "wall" | "print"
    this.compare = true;
    this.setup = {};
    try {
      this.renderer = new WebGLRenderer({ antialias: true, alpha: true, preserveDrawingBuffer: false });
    } catch {
      this.box.innerHTML = '<p class="none">This browser shows no 3D graphics (WebGL 2).</p>';
      this.data = data;
      return;
    }
    const { domElement: canvas } = this.renderer;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    this.box.append(canvas);
    this.renderer.setPixelRatio(Math.min(globalThis.devicePixelRatio || 1, 2));
    this.shadow = new Shadow(this.renderer);
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(32, 1, 1, 1e5);
    this.flat = new Scene();
    this.flatEye = new OrthographicCamera(-0.5, 0.5, 0.5, -0.5, -1, 1);
    this._furnish();
    this.look = new Look(this, canvas);
    this.stopTheme = onTheme(() => this._paint());
    this.observer = new ResizeObserver(() => this._resize());
    this.observer.observe(this.box);
    this.setScene(data);
    this._paint();
  }

  _furnish() {
    this.part = new Group(); // as its wall or stand holds it; print pose turns it onto the bed
    this.part.matrixAutoUpdate = false;
    this.tubeMaterial = new MeshStandardMaterial({ roughness: 0.62, metalness: 0, side: DoubleSide });
    this.mountMaterial = new MeshStandardMaterial({
      roughness: 0.8, metalness: 0, side: DoubleSide, flatShading: true,
    });
    this.tube = new Mesh(new BufferGeometry(), this.tubeMaterial);
    this.tube.frustumCulled = false;
    this.mounts = new Group();
    this.part.add(this.tube, this.mounts);
    this.sky = new HemisphereLight(0xffffff, 0xffffff, 1.35);
    this.sun = new DirectionalLight(0xffffff, 2.1);
    this.fill = new DirectionalLight(0xffffff, 0.5);
    this.wallGeometry = new PlaneGeometry(1, 1);
    this.wall = new Mesh(this.wallGeometry, wallMaterial());
    this.wall.matrixAutoUpdate = false;
    this.wall.frustumCulled = false;
    this.inset = new Mesh(this.wallGeometry, this.wall.material);
    this.flat.add(this.inset);
    this.bulbs = new Group(); // one for each lamp that is shown
    this.bulbMaterial = new MeshBasicMaterial();
    this.rays = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ transparent: true, opacity: 0.35 }));
    this.rays.frustumCulled = false;
    this.setting = new Group();
    this.setting.add(this.wall, this.bulbs, this.rays);
    this.bed = new Group();
    this.scene.add(this.part, this.setting, this.bed, this.sky, this.sun, this.fill);
  }

  setScene(data) {
    this.data = data;
    this.frames = data.history ?? [];
    this.frame = null; // of the history; null: the part itself
    this.setups = data.views.map(setupOf);
    this.lit = data.views.map(() => true); // of lamps that mix
    this.pictures?.forEach((picture) => picture.dispose());
    this.pictures = new Map();
    if (!this.renderer) return;
    for (const mesh of this.mounts.children) mesh.geometry.dispose();
    this.mounts.clear();
    for (const mesh of data.meshes ?? []) this.mounts.add(new Mesh(meshGeometry(mesh), this.mountMaterial));
    this._tubes(data.curves, data.radius);
    this.bed.clear();
    if (data.print) this.bed.add(bedOf(data.print), supportsOf(data.print));
    if (!data.print) this.mode = "wall";
    this.index = Math.min(this.index ?? 0, data.views.length - 1);
    this.setView(this.index);
  }

  setCurves(curves, radius = this.data.radius) {
    this.data = { ...this.data, curves, radius };
    if (!this.renderer) return;
    this.frame = null;
    this._tubes(curves, radius);
  }

  _tubes(curves, radius) {
    this.tube.geometry = tubeGeometry(curves, radius, this.tube.geometry);
    this._changed();
  }

  /* A frame of the history, or the part itself (null). What holds the part is shown with it alone. */
  setFrame(number) {
    this.frame = number;
    const now = number === null ? this.data : this.frames[number];
    this._tubes(now.curves, now.radius ?? this.data.radius);
  }

  get view() {
    return this.data.views[this.index];
  }

  /* Whether it stands: what it darkens below the frame is then no fault. */
  get onDesk() {
    return !this.data.wall_mounted && (this.data.meshes ?? []).length > 0;
  }

  /* The ball about the piece and its frame, in scene coordinates. */
  ball() {
    const box = new Box3();
    for (const { geometry } of [this.tube, ...this.mounts.children]) {
      if (!geometry.attributes.position?.count) continue;
      geometry.computeBoundingBox();
      box.union(geometry.boundingBox);
    }
    const { corner, across, down } = this.cameraNow();
    for (const [s, t] of [[0, 0], [1, 0], [1, 1], [0, 1]])
      box.expandByPoint(corner.clone().addScaledVector(across, s).addScaledVector(down, t));
    return box.getBoundingSphere(new Sphere());
  }

  get lamp() {
    return this.setups[this.index];
  }

  /* Whether several lamps light one screen, all at once. */
  get mixes() {
    return this.data.lamps?.mode === "mix" && this.data.views.length > 1;
  }

  /* Which lamps are switched on, where several mix. */
  setLit(lit) {
    this.lit = this.data.views.map((_, k) => Boolean(lit[k]));
    this._changed();
  }

  setView(index) {
    this.index = index;
    if (!this.renderer) return;
    this.look.reset(false);
    this._changed();
  }

  /* Another lamp is moved by hand; who looks stays where they are. */
  pick(index) {
    this.index = index;
    this._changed();
  }

  setLamp(changes) {
    Object.assign(this.lamp, changes);
    this.look?.follow();
    this._changed();
  }

  resetLamp() {
    this.setLamp(setupOf(this.view));
  }

  setMode(mode) {
    this.mode = mode;
    this.look.reset(false);
    this._changed();
  }

  setCompare(on) {
    this.compare = on;
    this._changed();
  }

  cameraNow(index = this.index) {
    return cameraOf(this.data.views[index], this.setups[index]);
  }

  /* Where the piece was moved by hand: turned about its middle, or tilted with the wall that holds it. */
  moved() {
    const { turn, tilt } = this.lamp;
    const { right, middle, up } = cameraOf(this.view, setupOf(this.view));
    if (!this.data.wall_mounted)
      return new Matrix4().makeRotationAxis(up, (turn * Math.PI) / 180);
    const angle = ((tilt - (this.view.wall_tilt_deg ?? 0)) * Math.PI) / 180;
    return new Matrix4()
      .makeTranslation(middle)
      .multiply(new Matrix4().makeRotationAxis(right, angle))
      .multiply(new Matrix4().makeTranslation(middle.clone().negate()));
  }

  _changed() {
    this.stale = true;
    this.requestDraw();
    for (const listener of this.listeners) listener();
  }

  requestDraw() {
    if (this.waiting || !this.renderer) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      this._draw();
    });
  }

  _cast() {
    const bodies = this.frame === null ? this.mounts.children.map((mesh) => mesh.geometry) : [];
    this.shadow.cast([this.tube.geometry, ...bodies]);
  }

  /* The picture that the shadow is to be: the view's, or that of a frame of a sequence. */
  get picture() {
    return this.pictureOf(this.view);
  }

  pictureOf(view) {
    const source = (this.frame !== null && this.frames[this.frame].picture) || view.picture;
    if (!source) return null;
    if (!this.pictures.has(source)) this.pictures.set(source, new Picture(source, () => this._changed()));
    return this.pictures.get(source);
  }

  readShadow(longer = 1024, soft = false) {
    this._cast();
    const options = { share: 0.25, longer: Math.round(1.5 * longer), move: this.moved(), exact: !soft, into: "small" };
    return this.shadow.read(this.shadow.render(this.cameraNow(), this._points(), options));
  }

  /* What all lamps that are on throw together. */
  _mix(options) {
    const { tints, other } = mixtureOf(this.data.views, this.lit, this.data.lamps.ambient ?? 0);
    const lamps = tints.map((tint, k) => ({ camera: this.cameraNow(k), points: this._points(k), tint }));
    return this.shadow.mix(lamps, other, options);
  }

  readMixed(longer = 1024) {
    if (!this.renderer || !this.mixes) return null;
    this._cast();
    return this.shadow.read(this._mix({ share: 0, longer, move: this.moved() }), 3);
  }

  /* The share of the frame in which all lamps are hidden that are to be, and no others; null until that is known. */
  right(longer = IOU_PX) {
    if (!this.renderer || !this.mixes) return null;
    const pictures = this.data.views.map((view) => this.pictureOf(view));
    if (!pictures.every((picture) => picture?.ready)) return null;
    this._cast();
    const options = { share: 0, longer, move: this.moved(), exact: true, into: "small" };
    const shadows = this.data.views.map((_, k) => this.shadow.read(this.shadow.render(this.cameraNow(k), [], options)));
    return shareRight(pictures, shadows);
  }

  iou(longer = IOU_PX) {
    if (!this.renderer) return null;
    const { picture } = this;
    if (!picture?.ready) return null;
    const { width, height, data } = this.readShadow(longer);
    return picture.iou(data, width, height, this.onDesk);
  }

  _paint() {
    if (!this.renderer) return;
    const c = (this.theme = colours());
    this.tubeMaterial.color.set(c.tube);
    this.mountMaterial.color.set(c.mount);
    this.sky.color.set(c.sky);
    this.sky.groundColor.set(c.ground);
    this.sun.color.set(c.light);
    this.bulbMaterial.color.set(c.bulb);
    this.rays.material.color.set(c.rays);
    const u = this.wall.material.uniforms;
    for (const name of ["paper", "wall", "dark", "spill", "missing", "line"]) u[name].value.set(c[name]);
    this.bed.traverse((thing) => thing.material?.color?.set(c[thing.userData.paint]));
    this._changed();
  }

  _resize() {
    const { clientWidth: width, clientHeight: height } = this.box;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.look.follow();
    this.requestDraw();
  }

  _arrange(camera) {
    const printing = this.mode === "print";
    this.setting.visible = !printing;
    this.bed.visible = printing;
    this.mounts.visible = this.frame === null;
    const move = this.moved();
    const pose = this.data.print && new Matrix4().set(...this.data.print.matrix.flat());
    // from part.stl, whose z is up, to the screen, whose y is
    const upright = new Matrix4().set(1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1);
    if (printing) this.part.matrix.copy(upright).multiply(pose.invert());
    else this.part.matrix.copy(move);
    this.bed.matrixAutoUpdate = false;
    this.bed.matrix.copy(upright);
    this.part.matrixWorldNeedsUpdate = this.bed.matrixWorldNeedsUpdate = true;
    const wide = padded(camera, WIDE);
    const middle = wide.corner.clone().addScaledVector(wide.across, 0.5).addScaledVector(wide.down, 0.5);
    this.wall.matrix.makeBasis(wide.across, wide.down.clone().negate(), camera.normal).setPosition(middle);
    this.wall.matrixWorldNeedsUpdate = true;
    this.wall.visible = !printing;
    const scale = Math.max(this.view.frame_width_mm, this.view.frame_height_mm);
    this._light(0.036 * scale);
    this.rays.visible = !this.look.atLamp;
    const ends = [];
    for (const [s, t] of [[0, 0], [1, 0], [1, 1], [0, 1]]) {
      const end = camera.corner.clone().addScaledVector(camera.across, s).addScaledVector(camera.down, t);
      const start = camera.lamp ?? end.clone().addScaledVector(camera.towards, 4 * scale);
      ends.push(...start.toArray(), ...end.toArray());
    }
    this.rays.geometry.setAttribute("position", new Float32BufferAttribute(ends, 3));
    this.sun.position.copy(printing ? this.camera.position : camera.at).normalize();
    if (printing) this.sun.position.add(new Vector3(0.4, 0.9, 0.2)).normalize();
    this.fill.position.copy(this.camera.position).normalize();
  }

  /* The bodies of the lamps that are shown, each made anew where it is another one. */
  _light(least) {
    const { views } = this.data;
    while (this.bulbs.children.length < views.length)
      this.bulbs.add(Object.assign(new Group(), { matrixAutoUpdate: false }));
    this.bulbs.children.forEach((bulb, k) => {
      const [view, setup] = [views[k], this.setups[k]];
      bulb.visible = Boolean(view) && (this.mixes ? this.lit[k] : k === this.index) && !this.look.atLamp;
      if (!bulb.visible) return;
      const camera = this.cameraNow(k);
      bulb.visible = camera.lamp !== null;
      bulb.matrix.makeBasis(camera.right, camera.up, camera.back).setPosition(camera.at);
      bulb.matrixWorldNeedsUpdate = true;
      const lit = [setup.diameter, least, view.light_shape, view.light_width_mm, view.light_height_mm, view.light_leds, this.mixes && view.lamp_colour].join();
      if (bulb.userData.lit === lit) return;
      for (const body of bulb.children) body.traverse((mesh) => (mesh.geometry?.dispose(), mesh.dispose?.()));
      bulb.clear();
      const paint = this.mixes ? new MeshBasicMaterial({ color: new Color().setRGB(...view.lamp_colour) }) : this.bulbMaterial;
      bulb.add(lampBodies(view, setup.diameter, least, paint));
      bulb.userData.lit = lit;
    });
  }

  /* Points of the lamp, as large as it was set by hand; none of an eye. */
  _points(index = this.index) {
    const { diameter } = this.setups[index];
    const view = this.data.views[index];
    return view.kind === "eye" || !(diameter > 0) ? [] : lampPoints(view, diameter);
  }

  _draw() {
    const { renderer } = this;
    const { clientWidth: width, clientHeight: height } = this.box;
    if (!width || !height) return; // until it is seen
    const moving = this.look.update();
    const camera = this.cameraNow();
    this._arrange(camera);
    if (this.mode === "wall" && this.stale) {
      this._cast();
      const eye = this.view.kind === "eye";
      const fine = Math.round(1.6 * Math.max(width, height) * renderer.getPixelRatio());
      const options = { share: WIDE, longer: Math.min(SHADOW_PX, fine), move: this.moved() };
      const u = this.wall.material.uniforms;
      u.colour.value = this.mixes ? 1 : 0;
      u.card.value = this.data.lamps?.screen === "ends" ? 1 : 0;
      if (this.mixes) u.mixed.value = this._mix(options).texture;
      const target = this.shadow.render(camera, this._points(), options);
      const { picture } = this;
      u.shadow.value = target.texture;
      u.picture.value = picture?.texture ?? null;
      u.compare.value = this.compare && !this.mixes && picture?.ready ? 1 : 0;
      u.desk.value = this.onDesk ? 1 : 0;
      u.eye.value = eye ? 1 : 0;
      u.grown.value = 1 + 2 * WIDE;
      u.aspect.value = this.view.frame_width_mm / this.view.frame_height_mm;
      this.stale = false;
    }
    renderer.setClearColor(new Color(this.theme.paper), 1);
    renderer.setScissorTest(false);
    renderer.setViewport(0, 0, width, height);
    renderer.render(this.scene, this.camera);
    if (this.mode === "wall" && !this.look.atLamp) this._drawInset(width, height);
    if (moving) this.requestDraw();
  }

  /* The wall seen straight on, in a corner. */
  _drawInset(width, height) {
    const { renderer } = this;
    const [w, h] = [this.view.frame_width_mm, this.view.frame_height_mm];
    const size = 0.3 * Math.min(width, height);
    const [wide, high] = [(size * w) / Math.max(w, h), (size * h) / Math.max(w, h)];
    const gap = Math.round(0.035 * Math.min(width, height)) + 4;
    renderer.setViewport(width - wide - gap, gap, wide, high);
    renderer.setScissor(width - wide - gap, gap, wide, high);
    renderer.setScissorTest(true);
    const shown = 0.56 / (1 + 2 * WIDE); // half of the wall's side, a little more than the frame
    Object.assign(this.flatEye, { left: -shown, right: shown, top: shown, bottom: -shown });
    this.flatEye.updateProjectionMatrix();
    const u = this.wall.material.uniforms;
    u.inset.value = 1;
    renderer.autoClear = false;
    renderer.render(this.flat, this.flatEye);
    renderer.autoClear = true;
    u.inset.value = 0;
    renderer.setScissorTest(false);
  }

  dispose() {
    if (!this.renderer) return;
    cancelAnimationFrame(this.waiting);
    this.observer.disconnect();
    this.stopTheme();
    this.look.dispose();
    this.shadow.dispose();
    this.pictures.forEach((picture) => picture.dispose());
    this.scene.traverse((thing) => {
      thing.geometry?.dispose();
      thing.material?.dispose();
    });
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.listeners.clear();
  }
}
