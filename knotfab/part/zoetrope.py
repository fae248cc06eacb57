"""A zoetrope: all frames of a sequence on one ring, upright and facing outwards, as one solid.

Seen from outside, at the scaled distance of the light, each frame shows its picture as it comes to
the front. Every frame stands on posts below its lowest strands, so that a figure may also leap. The
ring has a hub for the spindle of a record player, on which it spins under a flashing lamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, pi, tan
from typing import TYPE_CHECKING

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.tube import Mesh, as_manifold, as_mesh, sweep
from knotfab.knots import Knot, Knots
from knotfab_formats.libraries import took_part

if TYPE_CHECKING:
    from manifold3d import Manifold

_SIDES = 12  # sides of a tube, which is scaled down
_GAP_RADII = 1.5  # tube radii between neighbouring frames
_MARGIN_RADII = 2.0  # how far the ring goes beyond the frames
_THICK_MM = 2.4  # the ring's thickness as printed
_SPINDLE_MM = 7.4  # hole of the hub: a record player's spindle is 7.2 mm thick
_HUB_MM = 10.0  # radius of the hub
_SPOKES, _SPOKE_MM = 4, 10.0
_APART = 0.2  # a share of a frame's width, between posts
_POST = 0.9  # a share of the tube's radius: a post ends inside the tube


@dataclass(frozen=True)
class Zoetrope:
    """The solid in print pose (z up, on the bed's positive octant), mm, and its figures.

    `scale` is that of the frames against their parts, `tube_radius_mm` the radius as printed,
    `gap_mm` the smallest gap between two strands.
    """

    mesh: Mesh
    scale: float
    tube_radius_mm: float
    gap_mm: float
    diameter_mm: float
    height_mm: float
    posts: tuple[int, ...]


def find_footholds(points: Array, width: float, height: float) -> list[int]:
    """Find up to four vertices for posts: the lowest dips of the curve, spread out.

    Args:
        points: (n, 3) mm, y up. width, height: of the frame's knot, mm.
    """
    y = points[:, 1]
    dips = np.flatnonzero((y <= np.roll(y, 1)) & (y <= np.roll(y, -1)))
    # a share of a frame's height, within which posts stand
    dips = dips[y[dips] <= y.min() + 0.35 * height]
    chosen: list[int] = []
    for i in dips[np.argsort(y[dips], kind="stable")]:
        others = points[chosen][:, [0, 2]] - points[i, [0, 2]]
        if len(chosen) < 4 and not (np.linalg.norm(others, axis=1) < _APART * width).any():
            chosen.append(int(i))
    return chosen


def build_zoetrope(
    frames: Sequence[Knots], build_volume_mm: tuple[float, float, float], clearance_mm: float = 0.0
) -> Zoetrope:
    """Place all frames at even angles on a ring, as large as the printer holds, at most full size.

    Args:
        frames: in scene coordinates, one knot each, all of one radius, in the order of the
            sequence; seen from above they follow each other counter-clockwise.
        clearance_mm: between strands, which the frames keep.

    Raises:
        SceneError: frames of several knots; or the union is not one closed body.
    """
    from manifold3d import Error

    took_part("manifold3d", "joined the zoetrope")
    radius = frames[0].radius_mm
    if (count := len(frames[0].knots)) > 1:
        raise SceneError(
            "the zoetrope",
            f"{count} loose knots a frame do not stand on one ring",
            "Use the parts of the single frames",
        )
    every = np.concatenate([k.points for k in frames])
    reach = 1.05 * radius  # the corners of a tube of few sides stand out
    low, high = every.min(0) - reach, every.max(0) + reach
    beside = float(max(-low[0], high[0])) + 0.5 * _GAP_RADII * radius
    middle = _plane_distance(len(frames), beside, float(low[2]), radius)
    outer = hypot(middle + float(high[2]), beside) + _MARGIN_RADII * radius
    inner = max(middle + float(low[2]) - _MARGIN_RADII * radius, 0.0)
    scale = min(
        1.0,
        0.5 * min(build_volume_mm[:2]) / outer,
        (build_volume_mm[2] - _THICK_MM) / float(high[1] - low[1]),
    )
    ring = _make_ring(outer * scale, inner * scale).scale((1 / scale,) * 3)
    solids, posts = [ring], []
    for number, knots in enumerate(frames):
        body, count = _stand_frame(knots, float(low[1]))
        posts.append(count)
        # axes of the scene: x right, y up, z outwards; frame 0 faces +x, the next ones counter-clockwise
        solids.append(
            body.translate((0.0, 0.0, middle))
            .transform(np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0]]))
            .rotate((0.0, 0.0, 360.0 * number / len(frames)))
        )
    whole = solids[0]
    for solid in solids[1:]:
        whole = whole + solid
    whole = whole.scale((scale, scale, scale))
    if whole.status() != Error.NoError or len(whole.decompose()) != 1:
        raise SceneError(
            "the zoetrope",
            "its ring and frames do not make one closed body",
            "Use the parts of the single frames",
        )
    box = np.array(whole.bounding_box())
    size = box[3:] - box[:3]
    return Zoetrope(
        as_mesh(whole.translate(tuple(-box[:3]))),
        scale,
        scale * radius,
        scale * clearance_mm,
        float(size[:2].max()),
        float(size[2]),
        tuple(posts),
    )


def _plane_distance(count: int, beside: float, nearest: float, radius: float) -> float:
    """Choose how far from the axis the frames' planes are, so that each keeps to its own sector."""
    least = 3.0 * radius - nearest
    if count < 3:
        return least
    return max(least, beside / tan(pi / count) - nearest)


def _make_ring(outer: float, inner: float) -> Manifold:
    """Make the ring with its hub and spokes, in mm as printed, its top at z = 0."""
    from manifold3d import Manifold

    ring = Manifold.cylinder(_THICK_MM, outer, outer, 256)
    through = (0.0, 0.0, -_THICK_MM)
    if inner > 1.5 * _HUB_MM:
        ring -= Manifold.cylinder(3 * _THICK_MM, inner, inner, 256).translate(through)
        ring += Manifold.cylinder(_THICK_MM, _HUB_MM, _HUB_MM, 96)
        spoke = Manifold.cube((0.5 * (outer + inner), _SPOKE_MM, _THICK_MM))
        spoke = spoke.translate((0.0, -0.5 * _SPOKE_MM, 0.0))
        for number in range(_SPOKES):
            ring += spoke.rotate((0.0, 0.0, 360.0 * number / _SPOKES))
    if outer > _HUB_MM:
        hole = Manifold.cylinder(3 * _THICK_MM, 0.5 * _SPINDLE_MM, 0.5 * _SPINDLE_MM, 96)
        ring -= hole.translate(through)
    return ring.translate((0.0, 0.0, -_THICK_MM))


def _stand_frame(knots: Knots, ground: float) -> tuple[Manifold, int]:
    """Stand a frame's tube on posts down to the height `ground`, y up; return the number of posts, too."""
    from manifold3d import Manifold

    knot, radius = knots.knots[0], knots.radius_mm
    points = knot.points - np.array([0.0, ground, 0.0])
    body = _sweep_frame(Knot(points), radius)
    extent = np.ptp(points, axis=0)
    chosen = find_footholds(points, float(max(extent[0], extent[2])), float(extent[1]))
    for i in chosen:
        x, y, z = (float(c) for c in points[i])
        post = Manifold.cylinder(y + radius, _POST * radius, _POST * radius, 24)
        # a cylinder stands on z: up is y here
        body = body + post.rotate((-90.0, 0.0, 0.0)).translate((x, -radius, z))
    return body, len(chosen)


def _sweep_frame(knot: Knot, radius: float) -> Manifold:
    """Sweep the tube, with fewer rings if it bends little: scaled down, they are fine enough."""
    count = len(knot.points)
    most = max(1, int(0.55 * radius * count / knot.length_mm))  # tube radii between rings
    step = next(k for k in range(most, 0, -1) if count % k == 0)
    try:
        return as_manifold(sweep(knot.points[::step], radius, _SIDES))
    except SceneError:
        if step == 1:
            raise
    return as_manifold(sweep(knot.points, radius, _SIDES))
