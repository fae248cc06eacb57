"""The print pose of the bare piece: which way up it lies on the bed, and where."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from math import floor

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from knotfab.errors import SceneError
from knotfab.knots import Knots

__all__ = ["PrintPose", "choose_pose"]

Array = NDArray[np.float64]
Mesh = tuple[Array, NDArray[np.int32]]

FITS_MM = 1e-6  # a part of exactly the build volume's size fits
TURN_STEP_DEG = 0.25

# Scene to bed, in order of preference: back down (the light above), then a side down.
ORIENTATIONS = (
    np.eye(3),
    np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
)
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class PrintPose:
    """The piece on the bed: z up, least corner of its surface at the origin.

    `matrix` is (4, 4), rigid, and takes print coordinates to the scene (`[pose]` of scene.toml);
    `knots` and `tubes` are in print coordinates.
    """

    matrix: Array
    knots: Knots
    tubes: tuple[Mesh, ...]

    @property
    def size_mm(self) -> Array:
        """(3,) extents of the surface."""
        return np.asarray(np.max([v.max(axis=0) for v, _ in self.tubes], axis=0))


def choose_pose(
    knots: Knots,
    tubes: Sequence[Mesh],
    build_volume_mm: tuple[float, float, float],
    frame_mm: tuple[float, float] | None = None,
) -> PrintPose:
    """The pose of least height that the build volume holds.

    The three axes are tried as the vertical in the order of the height they give, first square to
    the bed, and, where none of those fits, turned about the vertical.

    Args:
        knots: in scene coordinates.
        tubes: their meshes (vertices (n, 3) mm, faces), scene coordinates.
        build_volume_mm: width, depth and height of the printer.
        frame_mm: width and height of the picture's frame, for the advice when nothing fits.

    Raises:
        SceneError: no such pose fits; names the sizes and the largest frame that would.
    """
    points = np.concatenate([vertices for vertices, _ in tubes])
    room = np.asarray(build_volume_mm, dtype=np.float64)
    tried: list[tuple[Array, Array]] = []  # turns, and the sizes they give
    for turn, size in chain(_square_turns(points), _oblique_turns(points, room)):
        if bool((size <= room + FITS_MM).all()):
            return _placed(knots, tubes, turn)
        tried.append((turn, size))
    raise _too_large([size for _, size in tried], room, knots.radius_mm, frame_mm)


def _placed(knots: Knots, tubes: Sequence[Mesh], turn: Array) -> PrintPose:
    turned = [(vertices @ turn.T, faces) for vertices, faces in tubes]
    corner = np.min([vertices.min(axis=0) for vertices, _ in turned], axis=0)
    to_print, to_scene = np.eye(4), np.eye(4)
    to_print[:3, :3], to_print[:3, 3] = turn, -corner
    to_scene[:3, :3], to_scene[:3, 3] = turn.T, turn.T @ corner
    # The meshes move with the knots instead of being swept again: only so is the corner exactly 0.
    posed = tuple((vertices - corner, faces) for vertices, faces in turned)
    return PrintPose(to_scene, knots.moved(to_print), posed)


def _square_turns(points: Array) -> list[tuple[Array, Array]]:
    """Turns (3, 3) that keep axes on axes and the sizes they give; least height first.

    Ties keep the order of preference.
    """
    box = _extents(points)
    turns = [(turn, np.abs(turn) @ box) for turn in ORIENTATIONS]
    turns.sort(key=lambda pair: round(float(pair[1][2]), 6))
    return [(t, np.abs(t) @ box) for turn, _ in turns for t in (turn, QUARTER @ turn)]


def _oblique_turns(points: Array, room: Array) -> Iterator[tuple[Array, Array]]:
    """For each side up, the turn about the vertical that leaves most room; least height first."""
    for upright, _ in _square_turns(points)[::2]:
        turned = points @ upright.T
        flat = _outline(turned[:, :2])
        angle = np.deg2rad(np.arange(0.0, 180.0, TURN_STEP_DEG))
        c, s = np.cos(angle), np.sin(angle)
        width = np.ptp(flat[:, :1] * c - flat[:, 1:] * s, axis=0)
        depth = np.ptp(flat[:, :1] * s + flat[:, 1:] * c, axis=0)
        best = int(np.minimum(room[0] - width, room[1] - depth).argmax())
        about = np.eye(3)
        about[:2, :2] = [[c[best], -s[best]], [s[best], c[best]]]
        yield about @ upright, np.array([width[best], depth[best], np.ptp(turned[:, 2])])


def _too_large(
    sizes: list[Array], room: Array, radius: float, frame: tuple[float, float] | None
) -> SceneError:
    # The centre line scales with the frame; the tube may keep its radius.
    scales = [
        float(((room - 2 * radius) / np.maximum(size - 2 * radius, 1e-9)).min()) for size in sizes
    ]
    scale = max(scales)
    size = sizes[scales.index(scale)]
    if scale <= 0:
        remedy = "Use a larger printer: this one does not even hold the tube's thickness"
    elif frame is None:
        remedy = (
            f"Scale the piece to at most {100 * scale:.1f} % of its size, or use another printer"
        )
    else:
        width, height = (floor(10 * scale * side) / 10 for side in frame)
        remedy = f"The largest frame that would fit is {width:.1f} x {height:.1f} mm"
    return SceneError(
        "the printer's build volume",
        f"the piece measures {_by(size)} mm as it fits best, and the printer holds {_by(room)} mm",
        remedy,
    )


def _by(size: Array) -> str:
    return " x ".join(f"{side:.1f}" for side in size)


def _extents(points: Array) -> Array:
    return np.asarray(np.ptp(points, axis=0))


def _outline(flat: Array) -> Array:
    """The corners of the convex hull of (n, 2) points: all that their extents depend on."""
    try:
        return np.asarray(flat[ConvexHull(flat).vertices])
    except QhullError:
        return flat
