/* The print pose: the bed, and the supports as columns. */
import {
  BoxGeometry, BufferGeometry, Float32BufferAttribute, Group, InstancedMesh, LineBasicMaterial, LineSegments,
  Matrix4, Mesh, MeshBasicMaterial, MeshStandardMaterial, PlaneGeometry, Quaternion, Vector3,
} from "three";
import { unpackRows } from "./tube.js";

const GRID_MM = 10;

/* The bed in the coordinates of part.stl: a sheet with a line every centimetre. */
export function bedOf(print) {
  const [w, d] = print.bed_mm;
  const bed = new Group();
  const sheet = new Mesh(new PlaneGeometry(w, d), new MeshBasicMaterial({ transparent: true, opacity: 0.6 }));
  sheet.position.set(w / 2, d / 2, -0.6);
  sheet.userData.paint = "bed";
  const ends = [];
  for (let x = 0; x <= w + 1e-9; x += GRID_MM) ends.push(x, 0, -0.4, x, d, -0.4);
  for (let y = 0; y <= d + 1e-9; y += GRID_MM) ends.push(0, y, -0.4, w, y, -0.4);
  const lines = new BufferGeometry();
  lines.setAttribute("position", new Float32BufferAttribute(ends, 3));
  const grid = new LineSegments(lines, new LineBasicMaterial({ transparent: true, opacity: 0.5 }));
  grid.userData.paint = "grid";
  bed.add(sheet, grid);
  return bed;
}

/* Columns (x, y, from z, to z), see-through. */
export function supportsOf(print) {
  const { supports } = print;
  if (!supports) return new Group();
  const rows = unpackRows(supports, 4);
  const n = rows.length / 4;
  const columns = new InstancedMesh(
    new BoxGeometry(1, 1, 1),
    new MeshStandardMaterial({ transparent: true, opacity: 0.28, depthWrite: false, roughness: 1 }),
    n,
  );
  columns.userData.paint = "support";
  const matrix = new Matrix4();
  const still = new Quaternion();
  const wide = 0.8 * supports.cell_mm;
  for (let i = 0; i < n; i++) {
    const [x, y, low, high] = rows.subarray(4 * i, 4 * i + 4);
    matrix.compose(new Vector3(x, y, (low + high) / 2), still, new Vector3(wide, wide, Math.max(high - low, 0.01)));
    columns.setMatrixAt(i, matrix);
  }
  columns.frustumCulled = false;
  return columns;
}
