/* The lamp (or eye) of a view and the picture's frame on its wall, as docs/conventions.md has them. */
import { Matrix4, Vector3 } from "three";
import { lampSize } from "./lamp.js";

const rad = (degrees) => ((degrees || 0) * Math.PI) / 180;

/* The view's right, up and back (towards its light) in the scene. */
export function viewAxes(view) {
  const [a, e] = [rad(view.azimuth_deg), rad(view.elevation_deg)];
  const right = new Vector3(Math.cos(a), 0, -Math.sin(a));
  const level = new Vector3(Math.sin(a), 0, Math.cos(a));
  const vertical = new Vector3(0, 1, 0);
  const back = level.clone().multiplyScalar(Math.cos(e)).addScaledVector(vertical, Math.sin(e));
  const up = vertical.clone().multiplyScalar(Math.cos(e)).addScaledVector(level, -Math.sin(e));
  return { right, up, back };
}

/* How a view is set up by its scene: what the sliders start from. */
export function setupOf(view) {
  const distance = view.light_distance_mm;
  return {
    distance: Number.isFinite(distance) && distance > 0 ? distance : Infinity,
    height: view.light_up_mm ?? 0,
    side: view.light_right_mm ?? 0,
    diameter: lampSize(view),
    tilt: view.wall_tilt_deg ?? 0,
    turn: 0,
  };
}

/* Lamp, frame and axes of a view with the lamp and the wall where `setup` has them.

   `lamp` is null where that is the sun, `towards` the direction to it; `corner` is the frame's top left as
   seen from the lamp, `across` and `down` its sides, all mm. The picture stays where it is on the wall. */
export function cameraOf(view, setup) {
  const { right, up, back } = viewAxes(view);
  const t = rad(setup.tilt);
  const upright = up.clone().multiplyScalar(Math.cos(t)).addScaledVector(back, Math.sin(t));
  const middle = upright
    .clone()
    .multiplyScalar(view.frame_up_mm ?? 0)
    .addScaledVector(back, -view.wall_distance_mm);
  const across = right.clone().multiplyScalar(view.frame_width_mm);
  const down = upright.clone().multiplyScalar(-view.frame_height_mm);
  const corner = middle.clone().addScaledVector(across, -0.5).addScaledVector(down, -0.5);
  const sun = !Number.isFinite(setup.distance);
  const far = Number.isFinite(view.light_distance_mm) ? view.light_distance_mm : 500;
  const lamp = back
    .clone()
    .multiplyScalar(sun ? far : setup.distance)
    .addScaledVector(up, setup.height)
    .addScaledVector(right, setup.side);
  const normal = new Vector3().crossVectors(across, upright).normalize();
  return {
    lamp: sun ? null : lamp,
    towards: lamp.clone().normalize(),
    at: lamp,
    right,
    up,
    back,
    middle,
    corner,
    across,
    down,
    normal,
  };
}

/* The frame grown on each side by this share of it. */
export function padded(camera, share) {
  return {
    ...camera,
    corner: camera.corner.clone().addScaledVector(camera.across, -share).addScaledVector(camera.down, -share),
    across: camera.across.clone().multiplyScalar(1 + 2 * share),
    down: camera.down.clone().multiplyScalar(1 + 2 * share),
  };
}

/* Scene to the frame's own coordinates: with a lamp at L, X = L + w (corner + s across + t down - L) becomes
   (s w, t w, w), 0 < w < 1 before the wall; from the sun, X = corner + s across + t down + h towards, (s, t, h), h > 0.
   `shift` moves the lamp (mm), which a soft shadow averages over. */
function frameMatrix(camera, shift = null) {
  const { across, down, corner } = camera;
  const lamp = camera.lamp && (shift ? camera.lamp.clone().add(shift) : camera.lamp);
  const towards = lamp
    ? corner.clone().sub(lamp)
    : shift
      ? camera.at.clone().add(shift).normalize()
      : camera.towards;
  return new Matrix4().makeBasis(across, down, towards).setPosition(lamp ?? corner).invert();
}

/* The pinhole of a view: a point to (right, up) mm on the wall from the frame's middle, and its scale there. */
export function pinholeOf(view) {
  const camera = cameraOf(view, setupOf(view));
  const e = frameMatrix(camera).elements;
  const [width, height] = [view.frame_width_mm, view.frame_height_mm];
  return ([x, y, z]) => {
    const [s, t, w] = [0, 1, 2].map((k) => e[k] * x + e[k + 4] * y + e[k + 8] * z + e[k + 12]);
    const far = camera.lamp ? w : 1;
    return [(s / far - 0.5) * width, (0.5 - t / far) * height, 1 / far];
  };
}

/* Scene to clip coordinates of the frame: matter between lamp and wall lands where its shadow falls, what lies
   on or behind the wall is clipped. */
export function clipMatrix(camera, shift = null) {
  const near = 1e-3;
  const limit = 1 - 1e-4; // what a plate's face is off the wall by rounding lies on it
  // s and t from 0 … 1 to -1 … 1 with t downwards; w, or h, into the clip range
  const clip = camera.lamp
    ? new Matrix4().set(
        2, 0, -1, 0,
        0, -2, 1, 0,
        0, 0, (limit + near) / (limit - near), (-2 * limit * near) / (limit - near),
        0, 0, 1, 0,
      )
    : new Matrix4().set(
        2, 0, 0, -1,
        0, -2, 0, 1,
        0, 0, -2e-5, 1 + 1e-6,
        0, 0, 0, 1,
      );
  return clip.multiply(frameMatrix(camera, shift));
}
