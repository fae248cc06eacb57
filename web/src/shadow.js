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
const lighting = {
  ...adding,
  fragmentShader: `precision highp float; in vec2 at; uniform sampler2D map; uniform vec3 tint; out vec4 sum;
    void main() { sum = vec4(tint * (1.0 - texture(map, at).r), 1.0); }`,
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
    this.light = { map: { value: null }, tint: { value: new Color() } };
    const added = (shaders, uniforms) => new RawShaderMaterial({
      ...shaders, glslVersion: GLSL3, uniforms, depthTest: false, depthWrite: false,
      transparent: true, blending: AdditiveBlending, premultipliedAlpha: true,
    });
    this.summing = added(adding, this.sum);
    this.lighting = added(lighting, this.light);
    this.quad = new Mesh(new PlaneGeometry(2, 2), this.summing);
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
    const putBack = this._begin(out);
    this.quad.material = this.summing;
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
    putBack();
    return out;
  }

  /* Draw into a target, which is cleared to a colour; what is returned puts all back as it was. */
  _begin(target, colour = new Color(0, 0, 0), clear = true) {
    const { renderer } = this;
    const [before, auto, color, alpha] =
      [renderer.getRenderTarget(), renderer.autoClear, renderer.getClearColor(new Color()), renderer.getClearAlpha()];
    renderer.setClearColor(colour, 0);
    renderer.autoClear = false;
    renderer.setRenderTarget(target);
    if (clear) renderer.clear();
    renderer.setClearColor(0x000000, 0);
    return () => {
      renderer.setRenderTarget(before);
      renderer.autoClear = auto;
      renderer.setClearColor(color, alpha);
    };
  }

  /* What lamps throw together, in linear colours: a render target.

     `lamps`: [{camera, points, tint}], the tint [r, g, b] in shares of white; `ambient`: that of all other light. */
  mix(lamps, ambient, options) {
    let out = null;
    lamps.forEach(({ camera, points, tint }, k) => {
      const one = this.render(camera, points, options);
      out = this._target("mixed", one.width, one.height, LinearFilter);
      const putBack = this._begin(out, new Color().setRGB(...ambient), k === 0);
      this.light.map.value = one.texture;
      this.light.tint.value.setRGB(...tint);
      this.quad.material = this.lighting;
      this.renderer.render(this.adding, this.eye);
      putBack();
    });
    return out;
  }

  /* {width, height, data}: its first channels, 0 … 255, pixel by pixel, rows from the top: of a shadow its darkness. */
  read(target, channels = 1) {
    const { width, height } = target;
    const rgba = new Uint8Array(4 * width * height);
    this.renderer.readRenderTargetPixels(target, 0, 0, width, height, rgba);
    const data = new Uint8Array(channels * width * height);
    for (let y = 0; y < height; y++)
      for (let x = 0; x < width; x++)
        for (let c = 0; c < channels; c++)
          data[(y * width + x) * channels + c] = rgba[4 * ((height - 1 - y) * width + x) + c];
    return { width, height, data };
  }

  dispose() {
    for (const name of ["once", "soft", "small", "mixed"]) this[name]?.dispose();
    this.material.dispose();
    this.summing.dispose();
    this.lighting.dispose();
    this.quad.geometry.dispose();
  }
}
