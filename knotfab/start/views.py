"""Make the start for several views: curves of known type, grown in the room that all pictures leave."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.base.errors import SceneError
from knotfab.geometry.polylines import polylines_of
from knotfab.problem import Problem, Start, TargetView
from knotfab.render.picture import ViewImage
from knotfab.start.grow import Growth, grow_curves
from knotfab.start.lattice import Lattice, lattice_in, sights_of
from knotfab.start.lattice_knots import lattice_knot
from knotfab.start.pieces import edge_worth, join_pieces, seed_curves
from knotfab_formats.knot_names import parse_knot_name
from knotfab_formats.search import SearchSettings

__all__ = ["start_between_views", "start_ious"]


_SEEN_PX = 160
_REACH = 1.2  # the reach of strands from the middle, over that of silhouettes
_TURNS = (0.0, 45.0)  # degrees of the lattices that are tried, from where its edges face no view
_SHIFTS = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5))  # shifts in pitches
# tube radii that a ball of the tube may stand out of a silhouette: what it draws outside counts against
# its edge, and strokes hardly wider than the tube get strands that go there and back; 1.0 bridges gaps
_SPILL = 0.75
_GROWN = (
    "grown from disjoint unit squares on a lattice, each move over an empty square: an isotopy, and so an "
    "unlink of unknots; its corners rounded within half an edge, where no other strand is"
)
_KNOTTED = "takes the place of the first square"


def start_between_views(
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    knots: int | None = None,
    spacing: float = 1.0,
) -> Start:
    """Give the start that grows in the visual hull, on the lattice whose curves draw best the worst picture.

    Args:
        radius: radius of the tube, mm.
        knots: None for one curve a piece of the hull; a number to bridge pieces, or to part them.
        spacing: spacing of the lattice, in half the strands' least distance.

    Raises:
        SceneError: no closed tube fits into the silhouettes, or the knot has no place in them.
    """
    wanted = parse_knot_name(problem.knot)
    knot = lattice_knot(wanted.factors) if wanted.factors else None
    why = _GROWN if knot is None else f"{_GROWN}; {wanted.promise} of the lattice {_KNOTTED}"
    limits = problem.limits(radius)
    pitch = 1.001 * max(limits.separation, 2.0 * spacing * radius)
    sights, worth = sights_of(problem.views, radius)
    reach = _REACH * max(float(np.abs(p.bounds).max()) for p in problem.polygons)
    images = [v.image_at(radius, _SEEN_PX) for v in problem.views]
    how = Growth(seed=settings.seed)
    brief = replace(how, moves=how.moves // 5)  # factor of fewer moves, where lattices are compared

    def grow(lattice: Lattice, seeds: list[Indices], how: Growth) -> Start:
        curves = grow_curves(lattice, worth, edge_worth(lattice, worth), seeds, how)
        types = (wanted.promise, *("unknot" for _ in curves[1:]))
        rounded = tuple(_round_corners(lattice.nodes[c]) for c in curves)
        start = Start(rounded, why, types, facing=None)
        return replace(start, ious=_compare(images, start, radius))

    best: tuple[float, Lattice] | None = None
    for axes, shift in _lattices(problem.views):
        lattice = lattice_in(sights, axes, shift, pitch, reach, limits, _SPILL)
        seeds = seed_curves(lattice, worth, None, knot)
        drawn = min(grow(lattice, seeds, brief).ious) if seeds else 0.0
        if best is None or drawn > best[0]:
            best = drawn, lattice
    assert best is not None
    lattice = join_pieces(best[1], sights, worth, radius, knots)
    seeds = seed_curves(lattice, worth, knots, knot)
    if not seeds and knot is not None and seed_curves(lattice, worth, knots):
        raise SceneError(
            f"the knot {problem.knot}",
            f"what the pictures leave has no place for it in a tube {2 * radius:g} mm thick",
            "Use a thinner tube (--tube-radius), bolder pictures, or a simpler knot.",
        )
    if not seeds:
        raise SceneError(
            "the pictures",
            f"no closed curve of a tube {2 * radius:g} mm thick fits into all of their silhouettes at once",
            "Use bolder pictures, views further apart, or give a smaller radius (--tube-radius)",
        )
    if len(seeds) < (knots or 0):
        raise SceneError(
            f"{knots} knots (--knots)",
            f"what the pictures leave has room for {len(seeds)} of a tube {2 * radius:g} mm thick",
            "Ask for fewer, or give a smaller radius (--tube-radius)",
        )
    return grow(lattice, seeds, how)


def start_ious(problem: Problem, start: Start, radius: float) -> tuple[float, ...]:
    """Return the IoU of the tube about the start's curves with each view's picture, on a coarse image."""
    return _compare([v.image_at(radius, _SEEN_PX) for v in problem.views], start, radius)


def _compare(images: Sequence[ViewImage], start: Start, radius: float) -> tuple[float, ...]:
    points = np.concatenate(start.curves)
    rings = polylines_of(start.curves)
    return tuple(image.iou(points, rings, radius) for image in images)


def _lattices(views: Sequence[TargetView]) -> Iterator[tuple[Array, Array]]:
    """Yield axes (3, 3 rows) and shifts (3,) of lattices to try: upright, edges aslant to all views."""
    along = np.array([np.degrees(np.arctan2(v.axes[2, 0], v.axes[2, 2])) for v in views])
    every = np.arange(0.0, 90.0, 7.5)
    off = np.abs((every[:, None] - along + 45.0) % 90.0 - 45.0).min(1)
    for turn, shift in product(_TURNS, _SHIFTS):
        angle = np.radians(every[off.argmax()] + turn)
        right = np.array([np.cos(angle), 0.0, -np.sin(angle)])
        up = np.array([0.0, 1.0, 0.0])
        yield np.stack([right, up, np.cross(right, up)]), np.array(shift)


def _round_corners(curve: Array) -> Array:
    """Return a closed polyline with its corners cut twice (Chaikin 1974): each within its own unit square."""
    for _ in range(2):
        ahead = np.roll(curve, -1, axis=0)
        curve = np.stack([0.75 * curve + 0.25 * ahead, 0.25 * curve + 0.75 * ahead], 1).reshape(
            -1, 3
        )
    return curve
