"""The print pose of a piece: which way up it lies on the bed, and where."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from math import floor

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.overhang import Rules
from knotfab.geometry.tube import Mesh, box_of
from knotfab.knots import Knots
from knotfab.part.orient import AXES, Ranked, propose_turns, rank_turns, strands_of

FITS_MM = 1e-6  # a part of exactly the build volume's size fits
# a share of the size that would fit: a search does not give the same piece again, only smaller
SPARE = 0.005

QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class PrintPose:
    """The piece on the bed: z up, the least corner of its surface at the origin.

    `matrix` (4, 4) takes print coordinates to the scene (`[pose]`), and is rigid unless the
    material shrinks. `knots` and `tubes` are in print coordinates. `weighed` has the estimates
    where supports were weighed.
    """

    matrix: Array
    knots: Knots
    tubes: tuple[Mesh, ...]
    weighed: Ranked | None = None

    @property
    def size_mm(self) -> Array:
        """Extents of the surface, (3,)."""
        return box_of(self.tubes)[1]


def choose_pose(
    knots: Knots,
    tubes: Sequence[Mesh],
    build_volume_mm: tuple[float, float, float],
    frame_mm: tuple[float, float],
    upright: Array | None = None,
    rules: Rules | None = None,
    fixed_mm: tuple[float, float, float] | None = None,
) -> PrintPose:
    """Choose the pose that costs least to print among those that the build volume holds.

    With `rules` some ninety rotations are weighed by an estimate of their supports, their height
    and how they stand (`knotfab.part.orient`), from the centre lines alone, and the cheapest that
    fits is taken. In powder the volume of the piece's box is weighed instead. Without rules the
    axis of least height points up. Each is tried square to the bed and, if it does not fit, turned
    about the vertical.

    Args:
        knots: in scene coordinates.
        tubes: their meshes (vertices (n, 3) mm, faces), scene coordinates.
        build_volume_mm: width, depth and height of the printer.
        frame_mm: width and height of the picture's frame, for the size that would fit.
        upright: (3, 3) the rotation from scene to bed that a mount asks for; then only rotations
            about the vertical are tried. The meshes are then whatever is to be printed, mount and
            all.
        rules: the printer's for overhangs; not read if there is `upright`.
        fixed_mm: the part of the extents, as `upright` gives them, that would stay with a smaller
            frame, for that advice; the tube's thickness by default.

    Raises:
        SceneError: no such pose fits; names the sizes and the largest --size that would.
    """
    points = _hull_corners(np.concatenate([vertices for vertices, _ in tubes]))
    room = np.asarray(build_volume_mm, dtype=np.float64)
    sides = AXES[:3] if upright is None else (upright,)
    if rules is not None and upright is None:
        strands = strands_of(knots)
        turns = propose_turns(strands)
        if not rules.powder:
            order = rank_turns(strands, turns, rules)
            return _choose_weighed(knots, tubes, points, room, order, rules, frame_mm)
        for turn, size in _compact_turns(points, turns):
            if _fits(size, room):
                return lay_on_bed(knots, tubes, turn)
    found, sizes = _find_turn(points, room, sides)
    if found is not None:
        return lay_on_bed(knots, tubes, found)
    fixed = np.full(3, 2 * knots.radius_mm) if fixed_mm is None else np.asarray(fixed_mm)
    raise _explain_too_large(sizes, room, fixed, frame_mm, fixed_mm is not None)


def fits_upright(
    outline: Array, height_mm: float, build_volume_mm: tuple[float, float, float]
) -> bool:
    """Return whether a prism with this outline (n, 2), mm, and height fits the printer upright."""
    ends = [np.column_stack([outline, np.full(len(outline), z)]) for z in (0.0, height_mm)]
    room = np.asarray(build_volume_mm, dtype=np.float64)
    return _find_turn(np.concatenate(ends), room, (np.eye(3),))[0] is not None


def _choose_weighed(
    knots: Knots,
    tubes: Sequence[Mesh],
    points: Array,
    room: Array,
    order: list[Ranked],
    rules: Rules,
    frame: tuple[float, float],
) -> PrintPose:
    """Take the first pose in `order` that fits together with its supports or, if none does, without them.

    `points` are the corners of the hull.
    """
    beside = np.array([2 * rules.margin_mm, 2 * rules.margin_mm, 0.0])
    for within in (room - beside, room):
        sizes: list[Array] = []
        for pose in order:
            turn, larger = _find_turn(points, within, (pose.turn,))
            if turn is not None:
                return lay_on_bed(knots, tubes, turn, pose)
            sizes += larger
    raise _explain_too_large(sizes, room, np.full(3, 2 * knots.radius_mm), frame)


def _find_turn(
    points: Array, room: Array, sides: Sequence[Array]
) -> tuple[Array | None, list[Array]]:
    """Find the first rotation with one of `sides` up that fits, and the sizes of those tried before it."""
    sizes: list[Array] = []
    for turn, size in chain(_square_turns(points, sides), _oblique_turns(points, room, sides)):
        if _fits(size, room):
            return turn, sizes
        sizes.append(size)
    return None, sizes


def _fits(size: Array, room: Array) -> bool:
    return bool((size <= room + FITS_MM).all())


def lay_on_bed(
    knots: Knots, tubes: Sequence[Mesh], turn: Array, weighed: Ranked | None = None
) -> PrintPose:
    """Rotate the piece by `turn` (3, 3) from the scene, and move it to the bed's corner."""
    turned = [(vertices @ turn.T, faces) for vertices, faces in tubes]
    corner, _ = box_of(turned)
    to_print, to_scene = np.eye(4), np.eye(4)
    to_print[:3, :3], to_print[:3, 3] = turn, -corner
    to_scene[:3, :3], to_scene[:3, 3] = turn.T, turn.T @ corner
    # The meshes move with the knots instead of being swept again: only so is the corner exactly 0.
    posed = tuple((vertices - corner, faces) for vertices, faces in turned)
    return PrintPose(to_scene, knots.moved(to_print), posed, weighed)


def _square_turns(points: Array, sides: Sequence[Array]) -> list[tuple[Array, Array]]:
    """List the rotations that turn each of `sides` up, also with a quarter turn, and sizes, lowest first.

    Ties keep the order of preference.
    """
    turns = [(turn, np.ptp(points @ turn.T, axis=0)) for turn in sides]
    turns.sort(key=lambda pair: round(float(pair[1][2]), 6))
    return [(t, np.abs(q) @ box) for turn, box in turns for q, t in _quarters(turn)]


def _compact_turns(points: Array, sides: Sequence[Array]) -> list[tuple[Array, Array]]:
    """List the rotations that turn each side up with the least footprint, with sizes, the least box first.

    Both ways round are listed, since the bed may be longer in one direction.
    """
    found = []
    for side in sides:
        turned = points @ side.T
        angle, width, depth = _sweep_about(turned)
        best = int((width * depth).argmin())
        size = np.array([width[best], depth[best], np.ptp(turned[:, 2])])
        found.append((_turn_about(angle[best]) @ side, size))
    found.sort(key=lambda pair: round(float(pair[1].prod()), 3))
    return [(t, np.abs(q) @ size) for turn, size in found for q, t in _quarters(turn)]


def _sweep_about(points: Array) -> tuple[Array, Array, Array]:
    """Return angles about the vertical, rad, and the footprint's width and depth at each."""
    flat = _hull_corners(points[:, :2])
    angle = np.deg2rad(np.arange(0.0, 180.0, 0.25))
    c, s = np.cos(angle), np.sin(angle)
    width = np.ptp(flat[:, :1] * c - flat[:, 1:] * s, axis=0)
    depth = np.ptp(flat[:, :1] * s + flat[:, 1:] * c, axis=0)
    return angle, width, depth


def _turn_about(angle: float) -> Array:
    about = np.eye(3)
    about[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return about


def _quarters(turn: Array) -> tuple[tuple[Array, Array], ...]:
    return ((np.eye(3), turn), (QUARTER, QUARTER @ turn))


def _oblique_turns(
    points: Array, room: Array, sides: Sequence[Array]
) -> Iterator[tuple[Array, Array]]:
    """Yield the rotations that turn each side up and leave most room, with sizes, lowest first."""
    for upright, _ in _square_turns(points, sides)[::2]:
        turned = points @ upright.T
        angle, width, depth = _sweep_about(turned)
        best = int(np.minimum(room[0] - width, room[1] - depth).argmax())
        size = np.array([width[best], depth[best], np.ptp(turned[:, 2])])
        yield _turn_about(angle[best]) @ upright, size


def _explain_too_large(
    sizes: list[Array], room: Array, fixed: Array, frame: tuple[float, float], mounted: bool = False
) -> SceneError:
    """Return the error that names a --size that would fit; `fixed` (3,) of a size does not shrink."""
    scales = [
        float(((room - fixed) / np.maximum(size - fixed, 1e-9))[size > room + FITS_MM].min())
        for size in sizes
    ]
    scale = max(scales)
    size = sizes[scales.index(scale)]
    scale *= 1.0 - SPARE
    over = fixed - room
    if scale <= 0 and mounted and over[:2].max() < 0:
        remedy = (
            f"No smaller frame would fit: {fixed[2]:.1f} mm of the height are the piece's distance from "
            f"the wall and its mount. Use a wall_distance_mm smaller by more than {over[2]:.1f}, or "
            "--mount none"
        )
    elif scale <= 0:
        what = "mount" if mounted else "tube's thickness"
        remedy = f"Use a larger printer: this one does not even hold the {what}"
    else:
        longer = scale * max(frame)
        largest = floor(longer) if longer >= 10 else floor(10 * longer) / 10
        remedy = f"Use --size {largest:g}, another printer, or cut it in the slicer"
    return SceneError(
        "the printer's build volume",
        f"the piece is too large for this bed: it measures {_join_sides(size)} mm as it fits best, "
        f"and the printer holds {_join_sides(room)} mm",
        remedy,
    )


def _join_sides(size: Array) -> str:
    return " x ".join(f"{side:.1f}" for side in size)


def _hull_corners(points: Array) -> Array:
    """Return the corners of the points' convex hull; all points if they are flat."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points
