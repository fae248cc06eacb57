"""Pack the viewer's data small: centre lines, mount, views, print pose and history."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array, Mask
from knotfab.base.limited import run_limited
from knotfab.geometry.overhang import Rules
from knotfab.geometry.polylines import sample_evenly
from knotfab.geometry.tube import Mesh, face_normals, keep_faces
from knotfab.knots import Knots, read_knots
from knotfab.part.assemble import rules_of
from knotfab.picture.raster import silhouette_uri
from knotfab.picture.read import read_targets
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import load_scene
from knotfab_formats.scene import ResolvedScene
from knotfab_validators.files.mesh import corners_stl
from knotfab_validators.geometry.mesh import merge_equal

Record = dict[str, Any]

LEVELS = 65535  # levels of a coordinate
MOUNT_FACES = 4000  # faces of the mount, thinned for the page
THIN_RADII = 1.2  # between two vertices of a state of the search, about, or more:
HISTORY_VERTICES = 30_000  # vertices of all states together, so that the page stays small
SUPPORT_CELL_MM = 3.0  # side of a column of supports on the page
VIEW_KEYS = (
    "name", "kind", "frame_width_mm", "frame_height_mm", "light_distance_mm", "light_shape",
    "light_diameter_mm", "light_width_mm", "light_height_mm", "light_leds",
    "wall_distance_mm", "wall_tilt_deg", "azimuth_deg", "elevation_deg", "frame_up_mm",
    "light_right_mm", "light_up_mm", "lamp_colour",
)  # fmt: skip


@dataclass(frozen=True)
class HistoryFrame:
    """A place of the viewer's slider: its label, the knots in scene coordinates, and the silhouette
    that they should draw, if it is not the first view's."""

    label: str
    knots: Knots
    silhouette: Mask | None = None

    def to_dict(self, most: int) -> Record:
        """Pack it for the viewer, with about `most` vertices and no more than can be told apart."""
        length = sum(knot.length_mm for knot in self.knots.knots)
        step = max(THIN_RADII * self.knots.radius_mm, length / most)
        curves = [_thin(knot.points, step) for knot in self.knots.knots]
        found: Record = {"label": self.label, "radius": self.knots.radius_mm}
        found["curves"] = [pack_rows(curve) for curve in curves]
        if self.silhouette is not None:
            found["picture"] = silhouette_uri(self.silhouette)
        return found


def read_viewer_data(folder: Path) -> Record:
    """Pack the piece that a folder holds; the frames of a sequence become the places of a slider."""
    suffixes = [path.stem.removeprefix("knots") for path in sorted(folder.glob("knots*.json"))]
    read = [_read_piece(folder, suffix) for suffix in suffixes]
    scene, knots, masks = read[0]
    frames = []
    for number, (posed, made, (mask, *_)) in enumerate(read if len(read) > 1 else (), start=1):
        assert posed.pose is not None
        placed = made.moved(np.array(posed.pose.matrix))
        frames.append(HistoryFrame(f"frame {number} of {len(read)}", placed, mask))
    bodies: list[Mesh] = []
    shown = scene.piece.printed or scene.mount.kind != "none"  # the knots alone are drawn as tubes
    if shown and (part := folder / f"part{suffixes[0]}.stl").is_file():

        def load() -> Mesh:
            whole = merge_equal(corners_stl(part.read_bytes(), part.name))
            return whole.vertices, whole.faces.astype(np.int32)

        bodies = [run_limited(load, part.name, seconds=60, remedy="Build it anew.")]
    return viewer_data(scene, knots, bodies, masks, history=frames)


def _read_piece(folder: Path, suffix: str) -> tuple[ResolvedScene, Knots, list[Mask]]:
    """Read scene, knots and silhouettes of one piece in a folder."""
    own = folder / f"scene{suffix}.toml"
    scene = resolve(load_scene(own if own.is_file() else folder / "scene.toml"))
    named = [view.picture for view in scene.views]
    targets = read_targets(named, scene.views, base=folder)
    return scene, read_knots(folder / f"knots{suffix}.json"), [target.asked for target in targets]


def viewer_data(
    scene: ResolvedScene,
    knots: Knots,
    bodies: Sequence[Mesh],
    silhouettes: Sequence[Mask],
    *,
    history: Sequence[HistoryFrame] = (),
) -> Record:
    """Pack a written piece for the viewer (docs/viewer.md).

    Args:
        scene: with its pose. knots, bodies: as they are in the file, the bodies with their mount.
        silhouettes: (H, W), of the views' pictures.
        history: what the slider goes through: all frames of a sequence.
    """
    assert scene.pose is not None
    matrix = np.array(scene.pose.matrix)
    placed = knots.moved(matrix)
    data: Record = {
        "unit": "mm",
        "radius": placed.radius_mm,
        "curves": [pack_rows(knot.points) for knot in placed.knots],
        "views": [
            {key: getattr(view, key) for key in VIEW_KEYS} | {"picture": silhouette_uri(mask)}
            for view, mask in zip(scene.views, silhouettes, strict=True)
        ],
        "wall_mounted": scene.mount.kind == "wall",
    }
    if any(view.wall for view in scene.views):
        lamps = scene.lamps
        data["lamps"] = {"mode": lamps.mode, "screen": lamps.screen, "ambient": scene.room.ambient}
    if scene.mount.kind != "none":
        data["meshes"] = [
            {"positions": pack_rows(vertices), "faces": _base64(faces.astype("<u4"))}
            for vertices, faces in _find_mount(placed, bodies, matrix)
        ]
    if scene.piece.printed and bodies:
        width, depth, _ = scene.printer.build_volume_mm
        data["print"] = {"matrix": matrix.tolist(), "bed_mm": [width, depth]}
        rules = rules_of(scene)
        if rules.supports and not rules.powder:
            columns = find_supports(bodies, rules)
            if len(columns):
                packed = pack_rows(columns) | {"cell_mm": SUPPORT_CELL_MM}
                data["print"]["supports"] = packed
    if history:
        most = HISTORY_VERTICES // len(history)
        data["history"] = [frame.to_dict(most) for frame in history]
    return data


def pack_rows(rows: Array) -> Record:
    """Pack rows (n, k) of mm into 16-bit steps, counted from the least of each column."""
    low = np.round(rows.min(axis=0), 4)
    step = max(float((rows - low).max()), 1e-6) / LEVELS
    q = np.round((rows - low) / step).clip(0, LEVELS).astype("<u2")
    return {"q": _base64(q), "low": low.tolist(), "step": step}


def find_supports(bodies: Sequence[Mesh], rules: Rules) -> Array:
    """Find columns (n, 4) mm under a piece in print pose: x, y, from z, to z, in cells of SUPPORT_CELL_MM.

    Each stands under a face steeper than the printer's limit, on the next face below it that looks
    up, or on the bed. Faces count where their middles are: an estimate to look at.
    """
    at, down = [], []
    for vertices, faces in bodies:
        normal = face_normals(vertices[faces])
        at.append(vertices[faces].mean(axis=1))
        down.append(-normal[:, 2] / np.maximum(np.linalg.norm(normal, axis=1), 1e-300))
    middle, steep = np.concatenate(at), np.concatenate(down)
    under = (steep > np.sin(np.radians(rules.max_overhang_deg))) & (middle[:, 2] > rules.layer_mm)
    kept = under | (steep < 0)
    cell = np.floor(middle[kept, :2] / SUPPORT_CELL_MM).astype(np.int64)
    z, under = middle[kept, 2], under[kept]
    order = np.lexsort((z, cell[:, 1], cell[:, 0]))
    cell, z, under = cell[order], z[order], under[order]
    new = np.append(True, (np.diff(cell, axis=0) != 0).any(axis=1))  # the lowest of its cell
    below = np.where(new, 0.0, np.roll(z, 1))
    # keep the lowest alone of neighbouring faces of one underside
    wanted = under & (new | ~np.roll(under, 1)) & (z - below > rules.layer_mm)
    place = (cell[wanted] + 0.5) * SUPPORT_CELL_MM
    return np.column_stack([place, below[wanted], z[wanted]])


def _thin(points: Array, step_mm: float) -> Array:
    """Keep every k-th point of a curve, about `step_mm` apart, but at least eight."""
    edges = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    stride = round(step_mm / max(float(edges.mean()), 1e-9))
    return points[:: max(1, min(stride, len(points) // 8))]


def _base64(array: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")


def _find_mount(knots: Knots, bodies: Sequence[Mesh], matrix: Array) -> list[Mesh]:
    """Find faces of bodies (file coordinates) that stand out of the tubes (scene)."""
    step = 0.1 * knots.radius_mm
    fine = [sample_evenly(knot.points, step, at_most=True) for knot in knots.knots]
    middles = cKDTree(np.concatenate(fine))
    found: list[Mesh] = []
    for vertices, faces in bodies:
        points = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        # tube radii from the centre line: what is farther out belongs to the mount
        off = middles.query(points)[0] > 1.02 * knots.radius_mm
        own = faces[off[faces].any(axis=1)]
        if len(own):
            found.append(_decimate(keep_faces(points, own)))
    return found


def _decimate(mesh: Mesh) -> Mesh:
    """Reduce the mesh to MOUNT_FACES at most, by quadric decimation."""
    vertices, faces = mesh
    if len(faces) <= MOUNT_FACES:
        return mesh
    import pyvista

    triangles: Any = faces
    sheet = pyvista.PolyData.from_regular_faces(vertices, triangles)
    less = sheet.decimate(1.0 - MOUNT_FACES / len(faces))
    return np.asarray(less.points, dtype=np.float64), np.asarray(less.regular_faces, dtype=np.int32)
