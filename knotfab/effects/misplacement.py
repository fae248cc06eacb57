"""Misplacement: people place lamp, eye, piece and wall only roughly where the scene says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from shapely import MultiPolygon

from knotfab.base.arrays import Array, Indices
from knotfab.effects.base import Decision, Effect, EffectContext, Shadows, World
from knotfab_formats.scene import ResolvedView

# points whose surroundings are looked at: of the largest, and how many at most
_WORST, _MOST = 0.7, 400


def magnitude(context: EffectContext) -> float:
    """Return the largest departure of any shadow from the picture's best likeness, in the worst view, px."""
    return max(
        max(parting_mm(seen, context.radius, context.world)) / seen.view.pixel_mm
        for seen in context.shadows
    )


@dataclass(frozen=True)
class _Field:
    """Shadows of points and their first-order motion, exact in all directions.

    In the wall's axes (right, up, normal to the lamp). A point at height h, the lamp at height H, w how far
    the ray to the point goes along the wall over how far it comes down. The lamp off by e moves the shadow by

        -h / (H - h + e_n) (e_t + e_n w),

    the point off by u by H / (H - h) (u_t + u_n w): similar triangles; the wall itself, by d where the shadow
    falls, by -d_t - d_n w. With a piece that hangs on it, it leans as the lamp turned the other way.
    `moves` (n, 8, 2): by 1 mm of the lamp along each axis, 1 radian of the piece about each axis through its
    middle, and 1 radian of the wall about lines through the frame's. `high`: H; `below`, `slopes` (n,): H - h
    and the length of w.
    """

    shadows: Array  # (n, 2)
    moves: Array
    high: float
    below: Array
    slopes: Array

    @staticmethod
    def from_shadows(seen: Shadows, middle: Array, turns: bool) -> _Field:
        """Return the field of shadows; the piece turns about `middle` if `turns`, else hangs on the wall."""
        wall, shadows = seen.wall, seen.wall.cast(seen.places)
        moves, *found = _moves(seen.places, shadows, wall.lamp, middle, wall.middle, turns)
        return _Field(shadows, moves, float(wall.lamp[2]), *found)


def _moves(
    places: Array, shadows: Array, lamp: Array, middle: Array, steady: Array, turns: bool
) -> tuple[Array, Array, Array]:
    """Compute the numbers of `_Field` at places (n, 3); the wall turns about `steady`."""
    ray, moves = places - lamp, np.empty((len(places), 8, 2))
    below = -ray[:, 2]
    share, lean = (lamp[2] / below)[:, None, None], ray[:, :2] / below[:, None]
    # (n, 2, 3): how far 1 mm along each axis moves the shadow right and up
    by = np.concatenate([np.broadcast_to(np.eye(2), (len(places), 2, 2)), lean[..., None]], axis=2)
    moves[:, :3] = ((1 - share) * by).swapaxes(1, 2)
    # a radian about an axis moves what is off it from the next to the one after
    moves[:, 3:6] = (share * np.cross((places - middle)[:, None], by)).swapaxes(1, 2)
    if turns:
        x, y = (shadows - steady[:2]).T[..., None]
        moves[:, 6] = -steady[2] * by[..., 1] - by[..., 2] * y
        moves[:, 7] = -steady[2] * by[..., 0] - by[..., 2] * x
    else:  # the lamp goes round
        x, y, z = lamp - steady
        moves[:, 6] = z * moves[:, 1] - y * moves[:, 2]
        moves[:, 7] = z * moves[:, 0] - x * moves[:, 2]
    return moves, below, np.hypot(*ray.T[:2]) / below


def _likeness(moves: Array, shadows: Array) -> tuple[Array, Array, Array]:
    """Fit one similarity of shadows (n, 2) to moves (n, 8, 2) by least squares.

    Returns shift along both axes, scale and turn (4, 8), their weights (4,) and the centre (2,). The
    sum of squares that each removes is its weight times its square.
    """
    centre, (u, v) = shadows.mean(axis=0), np.moveaxis(moves, 2, 0)
    x, y = (shadows - centre).T
    size = max(float(x @ x + y @ y), 1e-12)
    weights = np.array([len(moves), len(moves), size, size])
    found = np.stack([u.sum(axis=0), v.sum(axis=0), x @ u + y @ v, x @ v - y @ u])
    return found / weights[:, None], weights, centre


def _left(moves: Array, shadows: Array, likeness: Array, centre: Array) -> Array:
    """Subtract what `_likeness` fitted, (4, 8) about `centre`, at shadows (n, 2) from moves (n, 8, 2)."""
    (x, y), (right, up, scale, turn) = (shadows - centre).T[..., None], likeness
    taken = right + scale * x - turn * y, up + scale * y + turn * x
    return np.asarray(moves - np.stack(taken, axis=2))


def _largest(moves: Array) -> Array:
    """Return the largest singular value of moves (n, 8, 2) for lamp, piece and wall, (3, n)."""
    a, b = np.moveaxis(moves, 2, 0)
    aa, bb, ab = (np.add.reduceat(of, (0, 3, 6), axis=1).T for of in (a * a, b * b, a * b))
    return np.asarray(np.sqrt(0.5 * (aa + bb + np.sqrt((aa - bb) ** 2 + 4 * ab * ab))))


class Parting(NamedTuple):
    """Bounds, mm on the wall, of how far misplacement moves shadows from their best likeness."""

    lamp: float
    turn: float  # the piece's
    tilt: float  # the wall's


def parting_mm(seen: Shadows, radius: float, world: World) -> Parting:
    """Bound how far shadows within `radius` of places depart by misplacement (`world.placing`).

    The lamp (or eye) is off by `lamp_mm` in any direction, the piece turned by `turn_deg` about any axis
    through its middle, the wall tilted by `tilt_deg` about any line on it. What a shift, a scale and a turn
    of the whole shadow take away, fitted by least squares, nobody sees; what is left is a linear function of
    the misplacement at each point, a 2 x 3 (or 2 x 2) matrix, whose largest singular value is the worst
    direction's. At a lamp before a flat wall that is about half of lamp_mm times the spread of
    (W + z) / (L - z), and of a turn turn_deg |z| M and a keystone. Within `radius` it grows by at most its
    slope; what finite moves add to the first order is added too.
    """
    if len(seen.places) == 0:
        return Parting(0.0, 0.0, 0.0)
    wall, placing, places = seen.wall, world.placing, seen.places
    middle, far = seen.span
    field, far = _Field.from_shadows(seen, middle, world.turns), far + radius
    clear = float(field.below.min() - radius)
    off = placing.lamp_mm
    angle = float(np.radians(placing.turn_deg)) if world.turns else 0.0
    lean = float(np.tan(np.radians(placing.tilt_deg)))
    # the tilt moves the lamp by this
    aside = 0.0 if world.turns else lean * float(np.linalg.norm(wall.lamp - wall.middle))
    if clear <= max(off, angle * far, aside):
        return Parting(np.inf, np.inf, np.inf)  # it may be moved into the lamp
    likeness, _, centre = _likeness(field.moves, field.shadows)
    here = _left(field.moves, field.shadows, likeness, centre)
    kinds = 3 if lean > 0 else 2
    sizes = _largest(here)[:kinds]
    some = np.unique(np.concatenate([_worst_of(size) for size in sizes]))
    near, here = places[some], here[some]
    squares = np.zeros((3, len(some)))
    for step in radius * np.eye(3):
        there = _Field.from_shadows(seen.of_places(near + step), middle, world.turns)
        squares += _largest(_left(there.moves, there.shadows, likeness, centre) - here) ** 2
    by_lamp, by_turn, *by_tilt = (sizes[:, some] + np.sqrt(squares[:kinds])).max(axis=1).tolist()
    grown = field.high / clear
    second = grown * angle**2 * far * (0.5 + far / clear)  # foreshortening, and nearer to the lamp
    tilted = 0.0
    if lean > 0 and world.turns:
        steepest = float((field.slopes * field.below).max() + radius) / clear
        reach = float(np.linalg.norm(field.shadows - wall.middle[:2], axis=1).max())
        reach += grown * radius * (1 + steepest)
        if lean * steepest >= 1:
            return Parting(np.inf, np.inf, np.inf)  # the wall may be turned into a ray
        further = steepest**2 / (1 - lean * steepest) + 0.5  # along the rays, and along the wall
        tilted = lean * by_tilt[0] + lean**2 * reach * further
    elif lean > 0:
        around = 0.5 * lean * aside * by_lamp  # the lamp goes round, not straight
        tilted = (lean * by_tilt[0] + around) * (1 + aside / (clear - aside)) ** 2
    nearer = (1 + off / (clear - off)) ** 2
    return Parting(off * by_lamp * nearer, angle * by_turn + second, tilted)


def _worst_of(size: Array) -> Indices:
    """Return the indices of the largest few of (n,), the only ones that can become the worst."""
    some = np.flatnonzero(size >= _WORST * size.max())
    if len(some) > _MOST:
        some = some[np.argpartition(size[some], -_MOST)[-_MOST:]]
    return some


MISPLACEMENT = Effect(
    "misplacement",
    "px",
    magnitude,
    4.0,  # tolerances for parts against each other: the eye forgives more than a blur of that width
    "strands part where lamp, piece or wall are placed as people place them",
)


@dataclass(frozen=True)
class Steadying:
    """The cost of depth: the deeper the piece, the more of the picture careless placing loses.

    `axes` (3, 3) rows: the view's, in the scene. `outline`: the silhouette in the plane through the origin,
    mm.
    """

    decision: Decision
    view: ResolvedView
    axes: Array
    outline: MultiPolygon
    world: World

    def cost(self, parts: list[Array]) -> float:
        """Return the expected IoU loss of lifted points (n, 3) of each curve, above the threshold."""
        with self.decision.called("depth"):
            return self.decision.excess * self.lost(np.concatenate(parts))

    def lost(self, points: Array) -> float:
        """Return the expected IoU loss from misplacement for strands at points (n, 3) in the view's axes.

        Lamp, piece and wall are off by as much as the scene expects along and about each axis, independently
        of each other. What the best likeness leaves of the moves, to first order, has a root mean square u
        over all strands. An edge moves along its normal by u / sqrt(pi) on average
        (a normal variable's mean size, half of the square), so that the two silhouettes differ by a share
        s = u / sqrt(pi) times the outline's length over the area of either, and 1 - IoU = s / (1 + s / 2).
        """
        seen, placing = Shadows.from_points(self.view, points @ self.axes), self.world.placing
        field = _Field.from_shadows(seen, seen.span[0], self.world.turns)
        angle = np.radians(placing.turn_deg) if self.world.turns else 0.0
        sizes = np.array([placing.lamp_mm, angle, np.tan(np.radians(placing.tilt_deg))])
        likeness, weights, _ = _likeness(field.moves, field.shadows)
        taken = weights @ likeness**2
        left = float(np.repeat(sizes, [3, 3, 2]) ** 2 @ ((field.moves**2).sum(axis=(0, 2)) - taken))
        parted = float(np.sqrt(max(left, 0.0) / len(points))) / self.view.magnification
        share = parted / np.sqrt(np.pi) * self.outline.length / self.outline.area
        return float(share / (1 + share / 2))
