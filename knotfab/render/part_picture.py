"""Pictures of the part from several sides: from the light it shows the picture, elsewhere a tangle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotfab.base.arrays import Array
from knotfab.base.compiled import compiled
from knotfab.geometry.tube import face_normals, unit
from knotfab.scene.camera import camera_of, view_axes
from knotfab_formats.piece import Material
from knotfab_formats.scene import ResolvedView

ANGLES_DEG = (0.0, 30.0, 60.0, 90.0)  # turns about the vertical, one panel each
PANEL_PX = 360  # side of a panel
OVERSAMPLING = 2
PAPER = (250, 248, 244)  # sRGB
TUBE = (0.82, 0.46, 0.31)  # sRGB, in 0 to 1, of a material of the usual colour
USUAL_COLOR = str(Material.model_fields["color"].default)
AMBIENT, DIFFUSE, SPECULAR, SHINE = 0.34, 0.8, 0.22, 18  # the tube's (Phong)
# A key light comes from the upper left, a weak one from the lower right: (direction, strength).
LAMPS = (((-0.5, 0.8, 1.2), 0.9), ((0.9, -0.4, 0.6), 0.25))
MARGIN = 1.12  # the frame over the part's extent
CREASE = 0.7  # the cosine between a vertex and a face beyond which an edge is sharp
SAME_DEG = 5.0  # directions closer than this count as one


def draw_part(
    vertices: Array,
    faces: NDArray[np.integer[Any]],
    path: Path | IO[bytes],
    eyes: Array,
    panel_px: int = PANEL_PX,
    color: str = USUAL_COLOR,
) -> None:
    """Draw the part as a row of panels, one for each eye, all at one scale.

    Args:
        vertices: (n, 3) mm in scene coordinates, so that y is up.
        faces: (m, 3).
        path: the PNG to write, `panel_px` high.
        eyes: (k, 3) mm, where it is seen from, such as the lights from `place_eyes`.
        color: the material's, as #rrggbb; the usual one is drawn as `TUBE`.
    """
    from PIL import Image

    paint = np.array(TUBE if color == USUAL_COLOR else [v / 255 for v in bytes.fromhex(color[1:])])
    panels = _render(vertices, faces, eyes, panel_px * OVERSAMPLING, paint)
    strip = Image.fromarray(np.concatenate(panels, axis=1))
    size = (panel_px * len(panels), panel_px)
    strip.resize(size, Image.Resampling.BOX).save(path, "PNG", compress_level=6)


def place_eyes(views: Sequence[ResolvedView]) -> Array:
    """Return the eyes: each view's light (or eye), and turns of the first to make up four, (k, 3) mm.

    From a view's light the part shows its picture; the others begin at the first view's.
    """
    own = np.stack([camera_of(view, 1, 1).eye for view in views])
    turned = turn_eye(own[0], ANGLES_DEG)
    level, others = _level(own), _level(turned)
    new = (others @ level.T).max(axis=1) < np.cos(np.deg2rad(SAME_DEG))
    return np.concatenate([own, turned[new][: max(0, len(ANGLES_DEG) - len(own))]])


def look_from(view: ResolvedView, azimuth_deg: float, elevation_deg: float) -> Array:
    """Return the eye that is as far off as a view's light, so much to its right and above it, (3,) mm."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    way = np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])
    return np.asarray(np.linalg.norm(camera_of(view, 1, 1).eye) * way @ view_axes(view))


def turn_eye(eye: Sequence[float] | Array, angles_deg: Sequence[float]) -> Array:
    """Turn `eye` about the vertical by each angle, to the right as the part sees it, (k, 3)."""
    one = np.asarray(eye, dtype=np.float64)
    return np.array([turn_upright(one, angle) for angle in angles_deg])


def turn_upright(points: Array, angle_deg: float) -> Array:
    """Turn points (..., 3) about the vertical through the origin, anticlockwise from above."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.asarray(points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]))


def _level(eyes: Array) -> Array:
    """Return the horizontal unit directions of eyes, (k, 2)."""
    flat = eyes[:, [0, 2]]
    return np.asarray(flat / np.maximum(np.linalg.norm(flat, axis=1), 1e-9)[:, None])


def _render(
    vertices: Array, faces: NDArray[np.integer[Any]], eyes: Array, pixels: int, paint: Array
) -> list[NDArray[np.uint8]]:
    """Render the part from each eye, (pixels, pixels, 3) each."""

    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    points = vertices - middle
    normals, corners = _normals(points, faces), points[faces].reshape(-1, 3)
    of_corners = np.arange(len(corners), dtype=np.int64).reshape(-1, 3)
    looks = eyes - middle
    if np.ptp(eyes[:, 1]) > 0 or eyes[0, 1] != 0:
        reach = float(np.linalg.norm(points, axis=1).max())
    else:  # all about the vertical: what is drawn lies in this disc of the horizontal and this height
        wide, high = np.hypot(points[:, 0], points[:, 2]).max(), abs(points[:, 1]).max()
        reach = float(max(wide, high))
    panels = []
    for look in looks:
        near = float(np.linalg.norm(look))
        away = max(near, 2 * reach)
        back = look / near
        # share of the way that is vertical, where "up" is no direction any more
        steep = abs(back[1]) > 0.999
        right = np.cross((0.0, 0.0, -1.0) if steep else (0.0, 1.0, 0.0), back)
        right /= np.linalg.norm(right)
        # the axes point to the right, up, and to the eye
        axes = np.stack([right, np.cross(back, right), back])
        seen, turned = corners @ axes.T, normals @ axes.T
        scale = 0.5 * pixels * (away - 0.5 * reach) / (MARGIN * reach)
        below = scale / (away - seen[:, 2])
        places = np.column_stack(
            [0.5 * pixels + below * seen[:, 0], 0.5 * pixels - below * seen[:, 1], below]
        )
        found, normal = draw_faces(places, turned, of_corners, pixels)
        panels.append(_shade(found, normal, paint))
    return panels


def _shade(found: NDArray[np.bool_], normal: Array, paint: Array) -> NDArray[np.uint8]:
    """Shade covered pixels `found` (h, w) by normals in the eye's axes (Phong), (h, w, 3)."""
    n = normal[found]
    n = n / np.maximum(np.linalg.norm(n, axis=1), 1e-12)[:, None]
    lit, shine = np.zeros(len(n)), np.zeros(len(n))
    for where, strength in LAMPS:
        lamp = np.array(where) / np.linalg.norm(where)
        facing = n @ lamp
        lit += strength * np.maximum(facing, 0.0)
        mirrored = 2 * facing * n[:, 2] - lamp[2]  # the mirrored ray's share towards the eye
        shine += strength * np.where(facing > 0, np.maximum(mirrored, 0.0) ** SHINE, 0.0)
    colour = (AMBIENT + DIFFUSE * lit)[:, None] * paint + (SPECULAR * shine)[:, None]
    panel = np.full((*found.shape, 3), PAPER, dtype=np.uint8)
    panel[found] = np.rint(255 * np.clip(colour, 0.0, 1.0)).astype(np.uint8)
    return panel


def _normals(points: Array, faces: NDArray[np.integer[Any]]) -> Array:
    """Return unit normals at the corners of faces (m, 3), (3 m, 3).

    A vertex's normal averages its faces by area, leaving out those beyond a crease. Those have
    separate corner normals: a plate stays flat up to the rim of a hole.
    """
    face = face_normals(points[faces])
    own = np.repeat(unit(face), 3, axis=0)
    return _smooth(face, own, faces.astype(np.int64), len(points))


@compiled
def _smooth(face: Array, own: Array, faces: NDArray[np.int64], count: int) -> Array:
    kept, found = np.ones(faces.shape, dtype=np.bool_), own.copy()
    for last in (False, True):
        sums = np.zeros((count, 3))
        for n in range(len(faces)):
            for k in range(3):
                if kept[n, k]:
                    sums[faces[n, k]] += face[n]
        for n in range(len(faces)):
            for k in range(3):
                smooth = sums[faces[n, k]]
                long = max(np.sqrt((smooth * smooth).sum()), 1e-300)
                kept[n, k] = (smooth * own[3 * n + k]).sum() > CREASE * long
                if last and kept[n, k]:
                    found[3 * n + k] = smooth / long
    return found


# A mesh drawn by a compiled depth buffer: which pixels it covers, and how its surface lies there.


@compiled
def draw_faces(
    places: Array, normals: Array, faces: NDArray[np.int64], pixels: int
) -> tuple[NDArray[np.bool_], Array]:
    """Rasterise triangles into a square of `pixels`; the face nearest to the eye wins each pixel.

    Args:
        places: (n, 3): column and row, in pixels from the upper left corner, and the inverse of the distance,
            times any constant, which is linear on the page.
        normals: (n, 3) at the points.
        faces: (m, 3).

    Returns:
        (pixels, pixels) whether there is a face, and (pixels, pixels, 3) the normal there, interpolated
        on the page, without regard to perspective; not of unit length.
    """
    found = np.zeros((pixels, pixels), dtype=np.bool_)
    depth = np.zeros((pixels, pixels))
    normal = np.zeros((pixels, pixels, 3))
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, bx, by = places[a, 0], places[a, 1], places[b, 0], places[b, 1]
        cx, cy = places[c, 0], places[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0:
            continue
        left, right = min(ax, bx, cx), max(ax, bx, cx)
        top, bottom = min(ay, by, cy), max(ay, by, cy)
        # the centre of pixel k is at k + 0.5
        for row in range(max(0, math.ceil(top - 0.5)), min(pixels, math.floor(bottom - 0.5) + 1)):
            y = row + 0.5
            for column in range(
                max(0, math.ceil(left - 0.5)), min(pixels, math.floor(right - 0.5) + 1)
            ):
                x = column + 0.5
                of_a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / area
                of_b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / area
                of_c = 1.0 - of_a - of_b
                if of_a < 0.0 or of_b < 0.0 or of_c < 0.0:
                    continue
                near = of_a * places[a, 2] + of_b * places[b, 2] + of_c * places[c, 2]
                if near <= depth[row, column]:
                    continue
                found[row, column] = True
                depth[row, column] = near
                for k in range(3):
                    normal[row, column, k] = (
                        of_a * normals[a, k] + of_b * normals[b, k] + of_c * normals[c, k]
                    )
    return found, normal


# A GIF from pictures that were written before: the verified shadows of a sequence, or a film.

_LONGER_PX = 384  # longer side of the pictures


def write_gif(path: Path, images: Sequence[Image.Image], frame_ms: int | list[int]) -> None:
    """Write `images` (all of one size) as an endless GIF, each shown for `frame_ms`.

    Raises:
        ValueError: no image, or images of different sizes.
    """
    if not images or any(image.size != images[0].size for image in images):
        raise ValueError("a GIF needs images of one size")
    palette = [image.convert("P", palette=Image.Palette.ADAPTIVE) for image in images]
    palette[0].save(
        path, format="GIF", save_all=True, append_images=palette[1:], duration=frame_ms, loop=0
    )
