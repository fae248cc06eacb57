/* The shadow on a view's wall: the silhouette projected from the lamp into the frame, averaged over the lamp. */
import {
  AdditiveBlending,
  Color,
  DoubleSide,
  GLSL3,
  LinearFilter,
  Matrix4,
  Mesh,
  NearestFilter,
  NoBlending,
  OrthographicCamera,
  PlaneGeometry,
  RawShaderMaterial,
  Scene,
  Vector3,
  WebGLRenderTarget,
} from "three";
import { clipMatrix, padded } from "./camera.js";

const HARD = 4; // samples within a pixel, so that outlines are smooth
const LEVELS = 255; // of darkness

const silhouette = {
  vertexShader: `precision highp float; in vec3 position; uniform mat4 clip;
    void main() { gl_Position = clip * vec4(position, 1.0); }`,
  fragmentShader: `precision highp float; out vec4 dark; void main() { dark = vec4(1.0); }`,
};
const adding = {
  vertexShader: `precision highp float; in vec3 position; in vec2 uv; out vec2 at;
    void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }`,
  fragmentShader: `precision highp float; in vec2 at; uniform sampler2D map; uniform float share; out vec4 sum;
    void main() { sum = vec4(share * texture(map, at).r); }`,
};

export class Shadow {
  constructor(renderer) {
    this.renderer = renderer;
    this.uniforms = { clip: { value: new Matrix4() } };
    this.material = new RawShaderMaterial({
      ...silhouette, glslVersion: GLSL3, uniforms: this.uniforms, side: DoubleSide,
      depthTest: false, depthWrite: false, blending: NoBlending,
    });
    this.scene = new Scene();
    this.eye = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
    this.sum = { map: { value: null }, share: { value: 1 } };
    this.quad = new Mesh(
      new PlaneGeometry(2, 2),
      new RawShaderMaterial({
        ...adding, glslVersion: GLSL3, uniforms: this.sum, depthTest: false, depthWrite: false,
        transparent: true, blending: AdditiveBlending, premultipliedAlpha: true,
      }),
    );
    this.quad.frustumCulled = false;
    this.adding = new Scene();
    this.adding.add(this.quad);
  }

  /* What casts it: geometries in scene coordinates. */
  cast(geometries) {
    this.scene.clear();
    for (const geometry of geometries) {
      const mesh = new Mesh(geometry, this.material);
      mesh.frustumCulled = false;
      this.scene.add(mesh);
    }
  }

  _target(name, width, height, filter) {
    const kept = this[name];
    if (kept && kept.width === width && kept.height === height) return kept;
    kept?.dispose();
    this[name] = new WebGLRenderTarget(width, height, {
      depthBuffer: false, minFilter: filter, magFilter: filter, generateMipmaps: false,
    });
    return this[name];
  }

  /* The shadow in the frame grown by `share` on each side, `longer` px: a render target, 1 where it is dark.

     `lamp`: points of it, [right, up] mm from its middle; none: a point. `move` takes scene coordinates to where the piece was moved by hand; `exact` is one sample at the pixels'
     centres, as the validators have it. */
  render(camera, lamp, { share, longer, move, exact = false, into = "soft" }) {
    const frame = padded(camera, share);
    const [w, h] = [frame.across.length(), frame.down.length()];
    const width = Math.max(1, Math.round((longer * w) / Math.max(w, h)));
    const height = Math.max(1, Math.round((longer * h) / Math.max(w, h)));
    const once = this._target("once", width, height, NearestFilter);
    const out = this._target(into, width, height, LinearFilter);
    const points = exact ? [[0, 0]] : lamp.length ? lamp : Array(HARD).fill([0, 0]);
    const samples = points.length;
    const { renderer } = this;
    const before = { target: renderer.getRenderTarget(), auto: renderer.autoClear, color: new Color() };
    renderer.getClearColor(before.color);
    const alpha = renderer.getClearAlpha();
    renderer.setClearColor(0x000000, 0);
    renderer.autoClear = false;
    renderer.setRenderTarget(out);
    renderer.clear();
    for (let i = 0; i < samples; i++) {
      const jitter = exact ? [0, 0] : [((i * 0.618034) % 1) - 0.5, (i + 0.5) / samples - 0.5];
      const shift = new Vector3()
        .addScaledVector(camera.right, points[i][0])
        .addScaledVector(camera.up, points[i][1]);
      // whole levels, which add up to all of them
      this.sum.share.value = (Math.round(((i + 1) * LEVELS) / samples) - Math.round((i * LEVELS) / samples)) / LEVELS;
      const within = new Matrix4().makeTranslation((2 * jitter[0]) / width, (2 * jitter[1]) / height, 0);
      this.uniforms.clip.value.copy(within.multiply(clipMatrix(frame, shift))).multiply(move);
      renderer.setRenderTarget(once);
      renderer.clear();
      renderer.render(this.scene, this.eye);
      renderer.setRenderTarget(out);
      this.sum.map.value = once.texture;
      renderer.render(this.adding, this.eye);
    }
    renderer.setRenderTarget(before.target);
    renderer.autoClear = before.auto;
    renderer.setClearColor(before.color, alpha);
    return out;
  }

  /* {width, height, data}: its darkness 0 … 255, rows from the top. */
  read(target) {
    const { width, height } = target;
    const rgba = new Uint8Array(4 * width * height);
    this.renderer.readRenderTargetPixels(target, 0, 0, width, height, rgba);
    const data = new Uint8Array(width * height);
    for (let y = 0; y < height; y++)
      for (let x = 0; x < width; x++) data[y * width + x] = rgba[4 * ((height - 1 - y) * width + x)];
    return { width, height, data };
  }

  dispose() {
    for (const name of ["once", "soft", "small"]) this[name]?.dispose();
    this.material.dispose();
    this.quad.material.dispose();
    this.quad.geometry.dispose();
  }
}
