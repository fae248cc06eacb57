"""Misplacement: lamp, eye, piece or wall are not quite where the scene says, as people place them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from shapely import MultiPolygon

from knotfab.arrays import Array
from knotfab.effects.base import VERIFIED_PX, Decision, Effect, EffectContext, OnWall, World
from knotfab.scene.model import ResolvedView

__all__ = ["MISPLACEMENT", "Parting", "Steadying", "parting_mm"]

_WORST = 0.7  # of the largest: points whose surroundings are looked at


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

        def local(vectors: Array) -> Array:
            """(.., 3, n) vectors in each point's own axes."""
            return np.asarray(np.einsum("ijn,...jn->...in", axes, vectors))

        ray, high = local(points - wall.lamp[:, None]), local(wall.lamp[:, None] - feet)[2]
        below = -ray[2]
        w = ray[:2] / below
        moves = np.zeros((8, 2, points.shape[1]))

        def along(vectors: Array) -> Array:
            """(k, 2, n) where vectors (k, 3, n) in each point's own axes are seen along its ray."""
            return np.asarray(vectors[:, :2] + vectors[:, 2:] * w)

        moves[:3] = (1 - high / below) * along(axes.swapaxes(0, 1))
        moves[3:6] = high / below * along(local(_turned(points - middle[:, None])))
        if turns:
            right, up, _ = -along(local(_turned(feet - wall.middle[:, None])))
            moves[6], moves[7] = right, -up
        else:
            away = wall.lamp - wall.middle
            moves[6] = away[2] * moves[1] - away[1] * moves[2]
            moves[7] = away[2] * moves[0] - away[0] * moves[2]
        return _Field(shadows, moves, high, below, np.linalg.norm(w, axis=0))


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

    def left(field: _Field, of: slice) -> Array:
        """(3 or 2, 2, n) what the best likeness does not take away."""
        s = field.shadows - centre[:, None]
        likeness = scale[of, None, None] * s + turn[of, None, None] * _aside(s)
        return np.asarray(field.moves[of] - shift[of] - likeness)

    def largest(of: slice) -> float:
        here = left(field, of)
        size = _largest(here)
        some = size >= _WORST * size.max()  # the slope of others does not make them the worst
        near, here = local[:, some], here[:, :, some]
        slopes = [
            left(_Field.of(near + step[:, None], wall, middle, world.turns), of) - here
            for step in radius * np.eye(3)
        ]
        steep = np.sqrt(sum(_largest(d) ** 2 for d in slopes))
        return float((size[some] + steep).max())

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
    by_lamp = largest(slice(0, 3))
    tilted = 0.0
    if lean > 0 and world.turns:
        steepest = float((field.slopes * field.below).max() + radius) / clear
        reach = float(np.linalg.norm(field.shadows - wall.middle[:2, None], axis=0).max())
        reach += grown * radius * (1 + steepest)
        if lean * steepest >= 1:
            return Parting(np.inf, np.inf, np.inf)  # the wall may be turned into a ray
        further = steepest**2 / (1 - lean * steepest) + 0.5  # along the rays, and along the wall
        tilted = lean * largest(slice(6, 8)) + lean**2 * reach * further + bent(slice(6, 8), lean)
    elif lean > 0:
        around = 0.5 * lean * aside * by_lamp  # the lamp goes round, not straight
        tilted = (lean * largest(slice(6, 8)) + around) * (1 + aside / (clear - aside)) ** 2
    nearer = (1 + off / (clear - off)) ** 2
    return Parting(
        (off * by_lamp + bent(slice(0, 3), off)) * nearer,
        angle * largest(slice(3, 6)) + second + bent(slice(3, 6), angle),
        tilted,
    )


def _turned(vectors: Array) -> Array:
    """(3, 3, n) what a radian about each axis moves the ends of (3, n) by."""
    x, y, z = vectors
    none = np.zeros_like(x)
    return np.array([[none, -z, y], [z, none, -x], [-y, x, none]])


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
