/* Tubes about closed centre lines, and the unpacking of what a report embeds. */
import { BufferAttribute, BufferGeometry } from "three";

const SIDES = 16;
// of a regular polygon whose width, averaged over all directions, is the circle's
const STOUTER = Math.PI / SIDES / Math.sin(Math.PI / SIDES);

function bytesOf(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

/* Float32 (n · columns): from packed numbers, or from plain rows. */
export function unpackRows(rows, columns = 3) {
  if (rows && typeof rows.q === "string") {
    const q = new Uint16Array(bytesOf(rows.q).buffer);
    const out = new Float32Array(q.length);
    for (let i = 0; i < q.length; i++) out[i] = rows.low[i % columns] + rows.step * q[i];
    return out;
  }
  if (rows instanceof Float32Array) return rows;
  const out = new Float32Array(rows.length * columns);
  rows.forEach((row, i) => out.set(row, i * columns));
  return out;
}

export function unpackFaces(faces) {
  if (typeof faces === "string") return new Uint32Array(bytesOf(faces).buffer);
  return Uint32Array.from(faces.flat());
}

/* Positions (n, 3) of a closed curve without points that stand on the one before. */
function distinct(points) {
  const kept = [];
  const n = points.length / 3;
  for (let i = 0; i < n; i++) {
    const j = ((i + n - 1) % n) * 3;
    const d = Math.hypot(points[3 * i] - points[j], points[3 * i + 1] - points[j + 1], points[3 * i + 2] - points[j + 2]);
    if (d > 1e-6) kept.push(i);
  }
  if (kept.length === n) return points;
  const out = new Float32Array(kept.length * 3);
  kept.forEach((i, k) => out.set(points.subarray(3 * i, 3 * i + 3), 3 * k));
  return out;
}

/* A frame is carried along the curve without twist (double reflection, Wang et al. 2008), and what is left
   over where it closes is spread evenly. */
function sweepInto(points, radius, positions, normals, first) {
  const n = points.length / 3;
  const at = (i, c) => points[3 * ((i + n) % n) + c];
  const tangent = new Float64Array(3 * n);
  for (let i = 0; i < n; i++) {
    let [x, y, z] = [0, 0, 0];
    for (const j of [i, i + 1]) {
      const [a, b, c] = [0, 1, 2].map((k) => at(j, k) - at(j - 1, k));
      const d = Math.hypot(a, b, c);
      [x, y, z] = [x + a / d, y + b / d, z + c / d];
    }
    const d = Math.hypot(x, y, z) || 1;
    tangent.set([x / d, y / d, z / d], 3 * i);
  }
  const frame = new Float64Array(3 * (n + 1));
  const [tx, ty, tz] = tangent;
  let u = Math.abs(tx) < 0.6 ? [0, tz, -ty] : [-tz, 0, tx];
  let d = Math.hypot(...u);
  frame.set(u.map((v) => v / d), 0);
  for (let i = 0; i < n; i++) {
    const j = (i + 1) % n;
    const v1 = [0, 1, 2].map((k) => at(i + 1, k) - at(i, k));
    const c1 = v1[0] ** 2 + v1[1] ** 2 + v1[2] ** 2;
    const r = [0, 1, 2].map((k) => frame[3 * i + k]);
    const t = [0, 1, 2].map((k) => tangent[3 * i + k]);
    const dr = (2 / c1) * (v1[0] * r[0] + v1[1] * r[1] + v1[2] * r[2]);
    const dt = (2 / c1) * (v1[0] * t[0] + v1[1] * t[1] + v1[2] * t[2]);
    const rl = r.map((v, k) => v - dr * v1[k]);
    const v2 = [0, 1, 2].map((k) => tangent[3 * j + k] - (t[k] - dt * v1[k]));
    const c2 = v2[0] ** 2 + v2[1] ** 2 + v2[2] ** 2;
    const f = c2 > 1e-12 ? (2 / c2) * (v2[0] * rl[0] + v2[1] * rl[1] + v2[2] * rl[2]) : 0;
    frame.set(rl.map((v, k) => v - f * v2[k]), 3 * (i + 1));
  }
  const cross = (i, m) => {
    const [a, b, c] = [tangent[3 * i], tangent[3 * i + 1], tangent[3 * i + 2]];
    return [b * m[2] - c * m[1], c * m[0] - a * m[2], a * m[1] - b * m[0]];
  };
  const start = [frame[0], frame[1], frame[2]];
  const end = [frame[3 * n], frame[3 * n + 1], frame[3 * n + 2]];
  const side = cross(0, start);
  const over = Math.atan2(
    end[0] * side[0] + end[1] * side[1] + end[2] * side[2],
    end[0] * start[0] + end[1] * start[1] + end[2] * start[2],
  );
  const wide = radius * STOUTER;
  for (let i = 0; i < n; i++) {
    const e = [frame[3 * i], frame[3 * i + 1], frame[3 * i + 2]];
    const f = cross(i, e);
    for (let s = 0; s < SIDES; s++) {
      const angle = (2 * Math.PI * s) / SIDES - (over * i) / n;
      const [c, w] = [Math.cos(angle), Math.sin(angle)];
      const k = 3 * (first + i * SIDES + s);
      for (let m = 0; m < 3; m++) {
        const normal = c * e[m] + w * f[m];
        normals[k + m] = normal;
        positions[k + m] = at(i, m) + wide * normal;
      }
    }
  }
}

/* All tubes as one geometry; `geometry` is filled anew where it is given and its rings are as many. */
export function tubeGeometry(curves, radius, geometry = null) {
  const lines = curves.map((curve) => distinct(unpackRows(curve))).filter((line) => line.length >= 9);
  const sizes = lines.map((line) => line.length / 3);
  const key = sizes.join();
  const rings = sizes.reduce((a, b) => a + b, 0);
  let target = geometry;
  if (!target || target.userData.key !== key) {
    target?.dispose();
    target = new BufferGeometry();
    target.userData.key = key;
    target.setAttribute("position", new BufferAttribute(new Float32Array(3 * rings * SIDES), 3));
    target.setAttribute("normal", new BufferAttribute(new Float32Array(3 * rings * SIDES), 3));
    const index = new Uint32Array(6 * rings * SIDES);
    let [k, first] = [0, 0];
    for (const n of sizes) {
      for (let i = 0; i < n; i++) {
        const [a, b] = [first + i * SIDES, first + ((i + 1) % n) * SIDES];
        for (let s = 0; s < SIDES; s++) {
          const t = (s + 1) % SIDES;
          index.set([a + s, a + t, b + s, b + s, a + t, b + t], k);
          k += 6;
        }
      }
      first += n * SIDES;
    }
    target.setIndex(new BufferAttribute(index, 1));
  }
  const { position, normal } = target.attributes;
  let first = 0;
  lines.forEach((line, k) => {
    sweepInto(line, radius, position.array, normal.array, first);
    first += sizes[k] * SIDES;
  });
  position.needsUpdate = normal.needsUpdate = true;
  target.computeBoundingSphere();
  return target;
}

/* A mount or another body. */
export function meshGeometry(mesh) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(unpackRows(mesh.positions), 3));
  geometry.setIndex(new BufferAttribute(unpackFaces(mesh.faces), 1));
  return geometry;
}
