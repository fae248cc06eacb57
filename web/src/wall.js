/* What the wall looks like: light, the shadow, and the picture over it in the colours of the comparison. */
import { Color, DoubleSide, ShaderMaterial } from "three";

export function wallMaterial() {
  const colour = () => ({ value: new Color() });
  const number = (value) => ({ value });
  return new ShaderMaterial({
    uniforms: {
      shadow: number(null), picture: number(null), compare: number(0), desk: number(0), eye: number(0), inset: number(0),
      grown: number(2), aspect: number(1), mixed: number(null), colour: number(0), card: number(0),
      paper: colour(), wall: colour(), dark: colour(), spill: colour(), missing: colour(), line: colour(),
    },
    side: DoubleSide,
    transparent: true,
    depthWrite: false,
    polygonOffset: true, // a plate's face lies on the wall
    polygonOffsetFactor: -2,
    polygonOffsetUnits: -16,
    vertexShader: `varying vec2 at;
      void main() { at = uv; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
    fragmentShader: `varying vec2 at;
      uniform sampler2D shadow, picture, mixed;
      uniform float compare, desk, eye, inset, grown, aspect, colour, card;
      uniform vec3 paper, wall, dark, spill, missing, line;
      void main() {
        float s = texture2D(shadow, at).r;
        vec2 f = (at - 0.5) * grown + 0.5;               // in the picture's frame
        vec2 inside = step(vec2(0.0), f) * step(f, vec2(1.0));
        float p = texture2D(picture, clamp(f, 0.0, 1.0)).r * inside.x * inside.y * compare;
        float far = length((at - 0.5) * 2.0);
        float lit = 1.0 - smoothstep(0.35, 1.0, far);
        vec3 ground = mix(paper, wall, inset > 0.5 ? 1.0 : lit);
        vec3 plain = mix(ground, dark, s * 0.93);
        vec3 told = mix(ground, missing, p * (1.0 - s));
        told = mix(told, mix(spill, dark, p), s * 0.93);
        // what a stand darkens below the frame is on its desk
        vec3 c = mix(plain, told, compare * (1.0 - desk * step(f.y, 0.0)));
        c = mix(c, texture2D(mixed, at).rgb, colour);
        vec2 wide = fwidth(f) * 1.2;
        vec2 edge = smoothstep(wide, vec2(0.0), abs(abs(f - 0.5) - 0.5));
        float near = step(abs(f.x - 0.5), 0.5 + wide.x) * step(abs(f.y - 0.5), 0.5 + wide.y);
        c = mix(c, line, max(edge.x, edge.y) * near * 0.55);
        float shown = inset > 0.5 ? 1.0 : 1.0 - smoothstep(0.8, 1.0, far);
        if (card > 0.5) shown = inside.x * inside.y;     // a screen that ends at the frame
        gl_FragColor = vec4(c, shown * (gl_FrontFacing ? 1.0 : 0.25) * (eye > 0.5 && inset < 0.5 ? 0.85 : 1.0));
        #include <colorspace_fragment>
      }`,
  });
}
