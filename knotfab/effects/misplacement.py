"""Misplacement: lamp, eye, piece or wall are not quite where the scene says, as people place them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from shapely import MultiPolygon

from knotfab.arrays import Array
from knotfab.compiled import compiled
from knotfab.effects.base import VERIFIED_PX, Decision, Effect, EffectContext, OnWall, World
from knotfab.scene.model import ResolvedView

__all__ = ["MISPLACEMENT", "Parting", "Steadying", "parting_mm"]

# points whose surroundings are looked at: of the largest, and how many at most
_WORST, _MOST = 0.7, 400
_LAMP, _TURN, _TILT = slice(0, 3), slice(3, 6), slice(6, 8)  # of the moves of a field


def magnitude(context: EffectContext) -> float:
    """How far any strand's shadow parts from the picture's best likeness, px; the worst view counts."""
    return max(
        max(parting_mm(view, context.points, context.radius, context.world))
        / (view.longer_mm / VERIFIED_PX)
        for view in context.views
    )


@dataclass(frozen=True)
class _Field:
    """Where points cast their shadows, and how these move: to first order, exact for the directions.

    In the axes (right, up, normal to the lamp) of the plane that touches the wall where a point's shadow
    falls: a flat wall itself. A point at height h, the lamp at height H, w how far the ray to the point goes
    along the plane over how far it comes down. The lamp off by e moves the shadow by

        -h / (H - h + e_n) (e_t + e_n w),

    the point off by u by H / (H - h) (u_t + u_n w): similar triangles; the wall itself, by d where the shadow
    falls, by -d_t - d_n w. With a piece that hangs on it, it leans as the lamp turned the other way.
    `shadows` (2, n), of the wall unrolled; `moves` (8, 2, n): by 1 mm of the lamp along each axis, 1 radian
    of the piece about each axis through its middle, and 1 radian of the wall about lines through the frame's.
    `high`, `below`, `slopes` (n,): H, H - h and the length of w.
    """

    shadows: Array
    moves: Array
    high: Array
    below: Array
    slopes: Array

    @staticmethod
    def of(points: Array, wall: OnWall, middle: Array, turns: bool) -> _Field:
        """Of points (3, n) in the wall's axes, of a piece about `middle` that `turns` or hangs there."""
        feet, axes, shadows = wall.touching(points)
        moves, high, below, slopes = _moves(points, feet, axes, wall.lamp, middle, wall.middle)
        if not turns:
            away = wall.lamp - wall.middle
            moves[6] = away[2] * moves[1] - away[1] * moves[2]
            moves[7] = away[2] * moves[0] - away[0] * moves[2]
        return _Field(shadows, moves, high, below, slopes)


@compiled
def _moves(
    points: Array, feet: Array, axes: Array, lamp: Array, middle: Array, steady: Array
) -> tuple[Array, Array, Array, Array]:
    """What `_Field` has of points (3, n), of a piece that turns about `middle` and a wall about `steady`.

    `feet` (3, n): where their shadows fall, and `axes` (3, 3, n or 1) of the wall there.
    """
    count = points.shape[1]
    moves, slopes = np.empty((8, 2, count)), np.empty(count)
    high, below, ray, by = np.empty(count), np.empty(count), np.empty(3), np.empty((3, 2))
    for n in range(count):
        own = axes[:, :, min(n, axes.shape[2] - 1)]
        high[n] = 0.0
        for i in range(3):
            ray[i] = 0.0
            for j in range(3):
                ray[i] += own[i, j] * (points[j, n] - lamp[j])
            high[n] += own[2, i] * (lamp[i] - feet[i, n])
        below[n] = -ray[2]
        slopes[n] = np.hypot(ray[0], ray[1]) / below[n]
        for k in range(2):
            # along the wall, of 1 mm along each axis, seen along the ray
            for j in range(3):
                by[j, k] = own[k, j] + own[2, j] * ray[k] / below[n]
                moves[j, k, n] = (1 - high[n] / below[n]) * by[j, k]
            share = high[n] / below[n]
            # a radian about an axis moves what is off it from the next to the one after
            for j in range(3):
                one, two = (j + 1) % 3, (j + 2) % 3
                off, aside = points[one, n] - middle[one], points[two, n] - middle[two]
                moves[3 + j, k, n] = share * (by[two, k] * off - by[one, k] * aside)
            x, y, z = feet[0, n] - steady[0], feet[1, n] - steady[1], feet[2, n] - steady[2]
            moves[6, k, n] = by[1, k] * z - by[2, k] * y
            moves[7, k, n] = by[0, k] * z - by[2, k] * x
    return moves, high, below, slopes


class Parting(NamedTuple):
    """Bounds, mm on the wall, of how far shadows part from their best likeness, by what is off."""

    lamp: float
    turn: float  # of the piece
    tilt: float  # of the wall


def parting_mm(view: ResolvedView, points: Array, radius: float, world: World) -> Parting:
    """How far shadows of what is within `radius` of points (N, 3) part by what is off (`world.placing`).

    The lamp (or eye) is off by `lamp_mm` in any direction, the piece turned by `turn_deg` about any axis
    through its middle, the wall tilted by `tilt_deg` about any line on it. What a shift, a scale and a turn
    of the whole shadow take away, fitted by least squares, nobody sees; what is left is a linear function of
    the misplacement at each point, a 2 x 3 (or 2 x 2) matrix, whose largest singular value is the worst
    direction's. At a lamp before a flat wall that is about half of lamp_mm times the spread of
    (W + z) / (L - z), and of a turn turn_deg |z| M and a keystone. Within `radius` it grows by at most its
    slope; what finite moves add to the first order is added too.
    """
    if len(points) == 0:
        return Parting(0.0, 0.0, 0.0)
    wall, placing = OnWall.of(view), world.placing
    lamp, local = wall.lamp, wall.place(points)
    middle = 0.5 * (local.min(axis=1) + local.max(axis=1))
    field = _Field.of(local, wall, middle, world.turns)
    clear = float(field.below.min() - radius)
    far = float(np.linalg.norm(local - middle[:, None], axis=0).max()) + radius
    off = placing.lamp_mm
    angle = float(np.radians(placing.turn_deg)) if world.turns else 0.0
    lean = float(np.tan(np.radians(placing.tilt_deg)))
    aside = 0.0 if world.turns else lean * float(np.linalg.norm(lamp - wall.middle))  # the lamp's
    if clear <= max(off, angle * far, aside):
        return Parting(np.inf, np.inf, np.inf)  # it may be moved into the lamp
    centre, shift = field.shadows.mean(axis=1), field.moves.mean(axis=2)[:, :, None]
    spread = field.shadows - centre[:, None]
    size = max(float((spread**2).sum()), 1e-12)
    scale = (field.moves.reshape(8, -1) @ spread.ravel()) / size
    turn = (field.moves.reshape(8, -1) @ _aside(spread).ravel()) / size

    def left(field: _Field) -> Array:
        """(8, 2, n) what the best likeness does not take away."""
        s = field.shadows - centre[:, None]
        likeness = scale[:, None, None] * s + turn[:, None, None] * _aside(s)
        return np.asarray(field.moves - shift - likeness)

    here, kinds = left(field), (_LAMP, _TURN, _TILT) if lean > 0 else (_LAMP, _TURN)
    sizes = [_largest(here[of]) for of in kinds]
    some = np.unique(np.concatenate([_worst_of(size) for size in sizes]))
    near, here = local[:, some], here[:, :, some]
    slopes = [
        left(_Field.of(near + step[:, None], wall, middle, world.turns)) - here
        for step in radius * np.eye(3)
    ]

    def largest(of: slice, size: Array) -> float:
        steep = np.sqrt(sum(_largest(d[of]) ** 2 for d in slopes))
        return float((size[some] + steep).max())

    by_lamp, by_turn, *by_tilt = map(largest, kinds, sizes)

    def bent(of: slice, by: float) -> float:
        """What a round wall adds along it, and within `radius`: it leaves the plane that touches it."""
        if wall.round is None:
            return 0.0
        way = by * _largest(field.moves[of]) * (1 + field.slopes * radius / clear)
        aside = way + 0.5 * radius * field.high / clear
        return float((way * aside * field.slopes).max()) / abs(wall.round.radius)

    grown = float(field.high.max()) / clear
    if wall.round is not None:  # on which light falls aslant
        grown *= float(np.hypot(1.0, field.slopes).max())
    second = grown * angle**2 * far * (0.5 + far / clear)  # foreshortening, and nearer to the lamp
    tilted = 0.0
    if lean > 0 and world.turns:
        steepest = float((field.slopes * field.below).max() + radius) / clear
        reach = float(np.linalg.norm(field.shadows - wall.middle[:2, None], axis=0).max())
        reach += grown * radius * (1 + steepest)
        if lean * steepest >= 1:
            return Parting(np.inf, np.inf, np.inf)  # the wall may be turned into a ray
        further = steepest**2 / (1 - lean * steepest) + 0.5  # along the rays, and along the wall
        tilted = lean * by_tilt[0] + lean**2 * reach * further + bent(_TILT, lean)
    elif lean > 0:
        around = 0.5 * lean * aside * by_lamp  # the lamp goes round, not straight
        tilted = (lean * by_tilt[0] + around) * (1 + aside / (clear - aside)) ** 2
    nearer = (1 + off / (clear - off)) ** 2
    return Parting(
        (off * by_lamp + bent(_LAMP, off)) * nearer,
        angle * by_turn + second + bent(_TURN, angle),
        tilted,
    )


def _worst_of(size: Array) -> Array:
    """The largest few of (n,); the slope of others does not make them the worst."""
    most = min(_MOST, len(size))
    some = np.argpartition(size, -most)[-most:]
    return np.asarray(some[size[some] >= _WORST * size.max()])


def _aside(vectors: Array) -> Array:
    """(2, n), turned by a quarter."""
    return np.stack([-vectors[1], vectors[0]])


def _largest(matrices: Array) -> Array:
    """(n,) the largest singular value of each of (k, 2, n)."""
    a, b = matrices[:, 0], matrices[:, 1]
    aa, bb, ab = (a * a).sum(0), (b * b).sum(0), (a * b).sum(0)
    return np.asarray(np.sqrt(0.5 * (aa + bb + np.hypot(aa - bb, 2 * ab))))


MISPLACEMENT = Effect(
    "misplacement",
    "px",
    magnitude,
    4.0,  # of parts against each other: the eye forgives more than a blur of that width
    "strands part where lamp, piece or wall are placed as people place them",
)


@dataclass(frozen=True)
class Steadying:
    """What careless placing asks of depth: that the piece has less of it.

    `axes` (3, 3) rows: the view's, in the scene. `outline`: the silhouette in the plane through the origin,
    mm.
    """

    decision: Decision
    view: ResolvedView
    axes: Array
    outline: MultiPolygon
    world: World

    def cost(self, parts: list[Array]) -> float:
        """The IoU that lifted points (n, 3) of each curve are expected to lose; from the threshold on."""
        with self.decision.called("depth"):
            return self.decision.excess * self.lost(np.concatenate(parts))

    def lost(self, points: Array) -> float:
        """The IoU that careless placing is expected to cost strands at points (n, 3) of the view's axes.

        Lamp, piece and wall are off by as much as the scene expects along and about each axis, one regardless
        of the other. What the best likeness leaves of the moves, to first order, has a root mean square u
        over all strands. An edge moves along its normal by u / sqrt(pi) on average
        (a normal variable's mean size, half of the square), so that the two silhouettes differ by a share
        s = u / sqrt(pi) times the outline's length over the area of either, and 1 - IoU = s / (1 + s / 2).
        """
        wall, placing = OnWall.of(self.view), self.world.placing
        local = wall.place(points @ self.axes)
        middle = 0.5 * (local.min(axis=1) + local.max(axis=1))
        field = _Field.of(local, wall, middle, self.world.turns)
        angle = np.radians(placing.turn_deg) if self.world.turns else 0.0
        sizes = np.array([placing.lamp_mm, angle, np.tan(np.radians(placing.tilt_deg))])
        moves = np.repeat(sizes, [3, 3, 2])[:, None, None] * field.moves
        moves = moves - moves.mean(axis=2)[:, :, None]
        spread = field.shadows - field.shadows.mean(axis=1)[:, None]
        alike = np.stack([spread.ravel(), _aside(spread).ravel()])
        seen = moves.reshape(8, -1) @ alike.T
        left = (moves**2).sum() - (seen**2).sum() / max(float((spread**2).sum()), 1e-12)
        parted = float(np.sqrt(max(left, 0.0) / len(points))) / self.view.magnification
        share = parted / np.sqrt(np.pi) * self.outline.length / self.outline.area
        return float(share / (1 + share / 2))
