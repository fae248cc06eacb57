"""What the viewer is handed: centre lines, mount, views, print pose and history, packed small."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from knotfab.arrays import Array, Mask
from knotfab.geometry.meshes import Mesh
from knotfab.knots import Knots
from knotfab.scene.model import ResolvedScene

__all__ = ["pack_rows", "viewer_data"]

Record = dict[str, Any]

LEVELS = 65535  # of a coordinate
PICTURE_PX = 512  # of the silhouette's longer side
OFF_TUBE = 1.02  # tube radii from the centre line: what is farther out belongs to the mount
VIEW_KEYS = (
    "name", "kind", "frame_width_mm", "frame_height_mm", "light_distance_mm", "light_diameter_mm",
    "wall_distance_mm", "wall_tilt_deg", "azimuth_deg", "elevation_deg", "frame_up_mm",
)  # fmt: skip


def viewer_data(
    scene: ResolvedScene,
    knots: Knots,
    bodies: Sequence[Mesh],
    silhouettes: Sequence[Mask],
) -> Record:
    """The viewer's data (docs/viewer.md) of a written piece.

    Args:
        scene: with its pose. knots, bodies: as they are in the file, the bodies with their mount.
        silhouettes: of the views' pictures (H, W).
    """
    matrix = np.array(scene.pose.matrix)
    placed = knots.moved(matrix)
    data: Record = {
        "unit": "mm",
        "radius": knots.radius_mm,
        "curves": [pack_rows(knot.points) for knot in placed.knots],
        "views": [
            {key: getattr(view, key) for key in VIEW_KEYS} | {"picture": _picture_uri(mask)}
            for view, mask in zip(scene.views, silhouettes, strict=True)
        ],
        "wall_mounted": scene.mount.kind == "wall",
    }
    if scene.mount.kind != "none":
        data["meshes"] = [_pack_mesh(mesh) for mesh in _mount_of(placed, bodies, matrix)]
    if scene.piece.printed:
        width, depth, _ = scene.printer.build_volume_mm
        data["print"] = {"matrix": matrix.tolist(), "bed_mm": [width, depth]}
    return data


def pack_rows(rows: Array) -> Record:
    """Rows (n, k) of mm as whole steps in 16 bits, each column from its least on."""
    low = rows.min(axis=0)
    step = max(float(np.ptp(rows, axis=0).max()), 1e-6) / LEVELS
    q = np.round((rows - low) / step).astype("<u2")
    return {"q": _base64(q), "low": np.round(low, 4).tolist(), "step": step}


def _base64(array: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")


def _pack_mesh(mesh: Mesh) -> Record:
    vertices, faces = mesh
    return {"positions": pack_rows(vertices), "faces": _base64(faces.astype("<u4"))}


def _mount_of(knots: Knots, bodies: Sequence[Mesh], matrix: Array) -> list[Mesh]:
    """The faces of bodies (file coordinates) that stick out of the tubes about `knots` (scene)."""
    middles = cKDTree(_fine(knots))
    found: list[Mesh] = []
    for vertices, faces in bodies:
        points = vertices @ matrix[:3, :3].T + matrix[:3, 3]
        off = middles.query(points)[0] > OFF_TUBE * knots.radius_mm
        own = faces[off[faces].any(axis=1)]
        if len(own):
            used, renumbered = np.unique(own, return_inverse=True)
            found.append((points[used], renumbered.reshape(-1, 3).astype(np.int32)))
    return found


def _fine(knots: Knots) -> Array:
    """Points along the centre lines, a tenth of a radius apart at most."""
    found = []
    for knot in knots.knots:
        a, b = knot.points, np.roll(knot.points, -1, axis=0)
        n = int(np.ceil(np.linalg.norm(b - a, axis=1).max() / (0.1 * knots.radius_mm)))
        share = (np.arange(n) / n)[:, None, None]
        found.append((a + share * (b - a)).reshape(-1, 3))
    return np.concatenate(found)


def _picture_uri(mask: Mask) -> str:
    """A silhouette as a small PNG of two colours."""
    image = Image.fromarray(~mask)
    scale = PICTURE_PX / max(image.size)
    if scale < 1:
        size = max(1, round(image.width * scale)), max(1, round(image.height * scale))
        grey = image.convert("L").resize(size, Image.Resampling.BOX)
        image = grey.point(lambda value: 255 if value > 127 else 0)
    file = io.BytesIO()
    image.convert("1", dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode("ascii")
