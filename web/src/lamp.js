/* A lamp as it is: a disc, a ball, a rectangle, an array of LEDs. Its size is the longest line across it. */
import { BoxGeometry, Group, InstancedMesh, Matrix4, Quaternion, SphereGeometry, Vector3 } from "three";

const GOLDEN = Math.PI * (3 - Math.sqrt(5));
const POINTS = 16; // that a lamp's shadow is averaged over, about
const MOST_LEDS = 100; // of a larger array so many stand for all
const PLASTIC = 1.32471795724; // x³ = x + 1: its powers spread points evenly over a square (R2)

/* The longest line within the lamp, mm; 0 of a point. */
export function lampSize(view) {
  const across = Math.hypot(view.light_width_mm ?? 0, view.light_height_mm ?? 0);
  if (view.light_shape === "rectangle") return across;
  return (view.light_diameter_mm ?? 5) + (view.light_shape === "leds" ? across : 0);
}

/* The middles of the LEDs of an array, [right, up] mm. */
function ledsOf(view) {
  let [columns, rows] = view.light_leds ?? [1, 1];
  if (columns * rows > MOST_LEDS) {
    const fewer = Math.sqrt(MOST_LEDS / (columns * rows));
    [columns, rows] = [Math.max(1, Math.floor(columns * fewer)), Math.max(1, Math.floor(rows * fewer))];
  }
  const along = (n, size) => Array.from({ length: n }, (_, k) => (n > 1 ? (k / (n - 1) - 0.5) * size : 0));
  const up = along(rows, view.light_height_mm);
  return along(columns, view.light_width_mm).flatMap((x) => up.map((y) => [x, y]));
}

const disc = (diameter, n) =>
  Array.from({ length: n }, (_, k) => {
    const r = 0.5 * diameter * Math.sqrt((k + 0.5) / n);
    return [r * Math.cos(k * GOLDEN), r * Math.sin(k * GOLDEN)];
  });

/* Points of the lamp, [right, up] mm from its middle, each for the same share of its light; grown to `size`. */
export function lampPoints(view, size) {
  const own = lampSize(view);
  if (!(own > 0)) return disc(size, POINTS);
  const grown = size / own;
  let points;
  if (view.light_shape === "rectangle") {
    points = Array.from({ length: POINTS }, (_, k) => [
      (((k + 0.5) / PLASTIC) % 1) * view.light_width_mm - view.light_width_mm / 2,
      (((k + 0.5) / PLASTIC ** 2) % 1) * view.light_height_mm - view.light_height_mm / 2,
    ]);
  } else if (view.light_shape === "leds") {
    const leds = ledsOf(view);
    const each = disc(view.light_diameter_mm ?? 0, Math.max(1, Math.floor(POINTS / leds.length)));
    points = leds.flatMap(([x, y]) => (each.length > 1 ? each.map(([u, v]) => [x + u, y + v]) : [[x, y]]));
  } else points = disc(own, POINTS);
  return points.map(([x, y]) => [grown * x, grown * y]);
}

/* The lamp to be seen: a mesh for each of its spots, x to the right, y up, z out of it; none smaller than `least` mm. */
export function lampBodies(view, size, least, material) {
  const own = lampSize(view);
  const grown = own > 0 ? size / own : 1;
  const group = new Group();
  const add = (geometry, middles, sides) => {
    const mesh = new InstancedMesh(geometry, material, middles.length);
    mesh.frustumCulled = false;
    middles.forEach(([x, y], k) =>
      mesh.setMatrixAt(k, new Matrix4().compose(new Vector3(x, y, 0), new Quaternion(), new Vector3(...sides))),
    );
    group.add(mesh);
  };
  if (view.light_shape === "rectangle") {
    const [w, h] = [view.light_width_mm, view.light_height_mm].map((side) => Math.max(grown * side, least));
    add(new BoxGeometry(1, 1, 1), [[0, 0]], [w, h, 0.3 * least]);
  } else {
    const leds = view.light_shape === "leds" ? ledsOf(view).map(([x, y]) => [grown * x, grown * y]) : [[0, 0]];
    const wide = view.light_shape === "leds" ? grown * view.light_diameter_mm : size;
    const seen = Math.max(wide, leds.length > 1 ? 0.4 * least : least);
    const thick = view.light_shape === "ball" || seen > wide ? 1 : 0.25; // a disc is flat
    add(new SphereGeometry(0.5, 32, 16), leds, [seen, seen, thick * seen]);
  }
  return group;
}
