"""The objective of a search: the pictures of all views, the limits that can be felt, more terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, distance_transform_edt
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array
from knotfab.geometry.measures import Neighbours
from knotfab.geometry.polylines import Polylines, project
from knotfab.limits.terms import Felt, Guard, Limits, State, follow_edges, weigh
from knotfab.problem import Problem, TargetView, ViewNumbers
from knotfab.render.image import ViewImage, grid_at
from knotfab.render.silhouette import Frame
from knotfab.scene.camera import camera_of

# tau per px: beyond, a pixel's middle sees too little of the outline that crosses it
SHARPEST = 5.0


@dataclass(frozen=True)
class Weights:
    """Weights of the terms; each term is in squared tube radii or a count of radii of curve."""

    image: float = 1.0
    clearance: float = 1.0
    bend: float = 0.1
    region: float = 10.0
    length: float = 1.0
    hold: float = 4.0  # the weight of an anchor to another frame of a sequence
    grace: float = 1.0  # times the setting of that name


class Term:
    """One more part of an objective. A subclass may also be a hard limit: `kept` is then asked at the end."""

    def __call__(self, state: State, weights: Weights) -> Felt:
        """Return a number, in the units of the other terms, and its gradient (N, 3) in the vertices.

        `state` holds the walk's own arrays, which are not to be changed.
        """
        raise NotImplementedError

    def kept(self, points: Array) -> bool:
        """Tell whether vertices (N, 3), mm, keep it."""
        return True


@dataclass
class Objective:
    """Callable loss: (points (N, 3), near, progress) -> (number, gradient (N, 3)), without side effects.

    It sums the pictures of all views, shared out by `shares` (their mean is 1), the limits that can be
    felt, and `terms`. tau grows geometrically from `tau[0]` to `tau[1]`, in units of one over
    the projected tube radius. What changes while a phase runs is changed between calls, by the loop:
    the winning capsules (`find_winners`), the shares, and the pose (`look_from`).
    """

    images: tuple[ViewImage, ...]
    rings: Polylines
    limits: Limits
    guards: dict[str, Guard]
    weights: Weights
    tau: tuple[float, float]
    terms: tuple[Term, ...] = ()
    loose: NDArray[np.bool_] | None = None  # (N,) vertices that may move; None: all
    shares: Array = field(init=False)
    # for each view, as `ViewImage` finds it: which capsule colours which pixel
    won: list[Any] = field(init=False)
    _turn: Array | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.shares = np.ones(len(self.images))
        self.won = [None] * len(self.images)

    def __call__(self, points: Array, near: Neighbours, progress: float) -> Felt:
        felt: list[tuple[float, Felt]] = []
        if self.weights.image > 0:
            for number, share in enumerate(self.shares.tolist()):
                seen = self.image_term(number, points, self.tau_px(number, progress))
                felt.append((self.weights.image * share, seen))
        state = State.at(points, self.rings, near)
        if self._turn is None:
            held = add_limits(state, self.limits, self.guards, self.weights)
        else:
            held = self.limit_terms(points, near, self.limits, self.weights, self._turn)
        felt += [(1.0, held), *((1.0, term(state, self.weights)) for term in self.terms)]
        total, slope = weigh(felt, points)
        if self.loose is not None:
            slope[~self.loose] = 0.0
        return total, slope

    def tau_px(self, number: int, progress: float) -> float:
        """Return sharpness of a view's image, per px, where a share `progress` of the phase is done."""
        start, end = self.tau
        sharp = start * (end / start) ** progress / self.images[number].radius_px
        return float(min(sharp, SHARPEST))

    def image_term(self, number: int, points: Array, tau: float) -> Felt:
        """Integrate the squared difference of a view's images, in squared projected radii; tau per px."""
        image = self.images[number]
        error, slope = image.squared_error(
            points, self.rings, self.limits.radius, tau, self.won[number]
        )
        scale = 1.0 / image.radius_px**2
        return scale * error, scale * slope

    def limit_terms(
        self,
        points: Array,
        near: Neighbours,
        limits: Limits,
        weights: Weights,
        turn: Array,
    ) -> Felt:
        """Return the weighted terms of all limits that can be felt, in the axes of `turn` (3, 3)."""
        state = State.at(points @ turn, self.rings, near)
        total, slope = add_limits(state, limits, self.guards, weights)
        return total, slope @ turn.T

    def find_winners(self, points: Array, progress: float) -> None:
        """Find each pixel's winning capsule anew; until the next call others do not colour it."""
        if self.weights.image == 0:
            return
        for number, image in enumerate(self.images):
            tau = self.tau_px(number, progress)
            self.won[number] = image.find_winners(points, self.rings, self.limits.radius, tau)

    def look_from(self, frame: Frame, limits: Limits, turn: Array) -> None:
        """See the one view from another pose: its frame, the limits there, and its axes (3, 3) as columns."""
        self.images = (self.images[0].from_frame(frame),)
        self.limits, self._turn = limits, turn

    def ious(self, points: Array) -> tuple[float, ...]:
        """Return the hard silhouettes' IoU with the target, view by view."""
        return tuple(i.iou(points, self.rings, self.limits.radius) for i in self.images)


class Pose(Protocol):
    """The pose of one view (`free_pose.FreePose`), or directions of several (`FreeDirections`)."""

    @property
    def radius_mm(self) -> float:
        """The tube's radius now."""

    def keep(self, points: Array) -> None:
        """Go back into the bounds, which the points (N, 3) may set."""

    def show(self, objective: Objective, problem: Problem) -> None:
        """Let the objective see its views from here."""

    def descend(
        self,
        objective: Objective,
        problem: Problem,
        points: Array,
        near: Neighbours,
        progress: float,
    ) -> None:
        """Move one step against the objective at vertices (N, 3), and let it see from there."""

    def settle(self, problem: Problem, points: Array) -> tuple[Problem, Array, ViewNumbers | None]:
        """Return the problem with its views here, and the points (N, 3) in their axes."""


def add_limits(state: State, limits: Limits, guards: dict[str, Guard], weights: Weights) -> Felt:
    """Return the weighted sum of the terms of all limits that can be felt; calls and seconds are counted."""
    found = ((getattr(weights, name), guard.term(state, limits)) for name, guard in guards.items())
    return weigh(((weight, felt) for weight, felt in found if felt is not None), state.points)


# Grace: the energy of an elastic curve under tension, which the eye dislikes and few pictures ask
# for.


_TENSION = 0.5  # the tension on one tube radius of length, in units of the bending energy
# curvature times radius: where counted bends weigh as much as their bending energy; of straight stretches
_BENT, _STRAIGHT = 0.3, 0.05


@dataclass(frozen=True)
class Grace(Term):
    """Callable term: weight * (r * integral of squared curvature + tension * length / r), free of scale.

    Euler's elastica under tension. On a polyline the bending energy is the sum over vertices of
    |t' - t|^2 / l, t and t' the unit tangents before and after, l the mean of the two edges (Bergou et
    al., "Discrete elastic rods", 2008, with 2 sin(theta / 2) for 2 tan(theta / 2): bounded where an edge
    folds back).

    With `bends` a root of curvature takes the place of its square, as bends are counted: a straight that
    may be t beside a curve of curvature k stands for 4 sqrt(t / k) of it. Smooth where there is none, it
    grows about as curvature does: a bend costs the same however tight it is.
    """

    radius_mm: float
    weight: float
    bends: bool = False

    def __call__(self, state: State, weights: Weights) -> Felt:
        following, previous = state.rings.next, state.rings.previous
        one = np.sqrt((state.edge * state.edge).sum(axis=1))
        unit = state.edge / _divisor(one)[:, None]
        turn = unit[following] - unit
        between = 0.5 * (one + one[following])
        length, turned = _divisor(between), (turn * turn).sum(axis=1)
        # each vertex's share, and its slopes in the square of its turn and in the length that is its own
        if self.bends:
            lengths = length / self.radius_mm
            counted, slope = _count_bends(turned / lengths / lengths)
            shares, by_turn = lengths * counted, slope / lengths
            by_length = (counted - 2.0 * slope * turned / lengths / lengths) / self.radius_mm
        else:
            by_turn = self.radius_mm / length
            shares = by_turn * turned
            by_length = -shares / length
        by_length = np.where(between > 0, by_length, 0.0)
        pull = 2.0 * by_turn[:, None] * turn
        pull = pull[previous] - pull  # the pull on the unit edges
        along = (pull * unit).sum(axis=1)
        stretch = 0.5 * (by_length + by_length[previous]) + _TENSION / self.radius_mm
        edges = (pull - along[:, None] * unit) / _divisor(one)[:, None] + stretch[:, None] * unit
        scale = self.weight * weights.grace
        total = float(shares.sum()) + _TENSION * float(one.sum()) / self.radius_mm
        return scale * total, scale * follow_edges(edges, state.rings)


def _count_bends(squares: Array) -> tuple[Array, Array]:
    """Return the root of squared curvature, in tube radii, smooth at 0; and its slope.

    At `_BENT` it is that square.
    """
    least = _STRAIGHT**0.5
    scale = _BENT**2 / ((_BENT**2 + _STRAIGHT**2) ** 0.25 - least)
    root = (squares + _STRAIGHT**2) ** 0.25
    return scale * (root - least), 0.25 * scale * root / (squares + _STRAIGHT**2)


def _divisor(lengths: Array) -> Array:
    """Return lengths, 1 where there is none: an edge without length turns by no angle that is known."""
    return np.where(lengths > 0, lengths, 1.0)


# A pull on strands that stand outside a silhouette, by how far outside they stand.


_MARGIN = 0.5  # a share of the frame on each side; a place further out counts as its edge
_CELLS = 240  # cells along the longer side
# weight of a strand that stands a tube radius outside, against one tube radius squared of image
_WEIGHT = 0.5


@dataclass(frozen=True)
class Spill(Term):
    """Length times distance outside a silhouette, in squared tube radii.

    `field` (H, W) is the distance to the silhouette in tube radii, `projection` (3, 4) leads to it.
    """

    projection: Array
    field: Array
    radius: float

    @classmethod
    def of(cls, target: TargetView, radius: float) -> Spill:
        """Return the term of one view; the tube's radius in mm."""
        view = target.view
        cell = view.longer_mm / _CELLS
        wanted, camera = grid_at(view, target.mask, cell, _MARGIN, beside=target.ends)
        far = distance_transform_edt(~wanted) * (cell / view.magnification / radius)
        return cls(camera.projection, far, radius)

    def __call__(self, state: State, weights: Weights) -> Felt:
        seen = project(state.points, self.projection)
        last = np.array(self.field.shape[::-1]) - 1
        at = np.clip(seen.places, 0.0, last)
        cell = np.minimum(at.astype(np.int64), last - 1)
        share = at - cell
        # the field is bilinear between the middles of four cells
        (u, v), (x, y) = cell.T, share.T
        f = self.field
        upper, lower = f[v, u], f[v + 1, u]
        rise, fall = f[v, u + 1] - upper, f[v + 1, u + 1] - lower
        upper, lower = upper + x * rise, lower + x * fall
        slope = np.column_stack([(1.0 - y) * rise + y * fall, lower - upper])
        slope[at != seen.places] = 0.0  # beyond the edge it stays what it is there
        scale = _WEIGHT * weights.image * state.spacing / self.radius
        return scale * float(((1.0 - y) * upper + y * lower).sum()), scale * seen.pull(slope)


# A far-sighted pull for curves that are nowhere near their pictures: nearest points, both ways.


_SAMPLES = 700  # samples of each silhouette
TENSION = 3.0


@dataclass(frozen=True)
class _Side:
    """One view: its projection (3, 4) to mm on the receiver, and samples (k, 2) there, with their tree."""

    projection: Array
    samples: Array
    tree: cKDTree


@dataclass(frozen=True)
class Chamfer(Term):
    """Mean squared distances, both ways, of every view, in squared tube radii; and some tension."""

    sides: tuple[_Side, ...]
    radius: float

    @classmethod
    def of(cls, views: Sequence[TargetView], radius: float) -> Chamfer:
        """Return the term of all views, their silhouettes thinned by a tube radius where they can be."""
        sides = []
        for target in views:
            height, width = target.mask.shape
            camera = camera_of(target.view, width, height)
            pixel = float(np.linalg.norm(camera.du))
            cells = max(0, round(0.8 * radius * target.view.magnification / pixel))
            inner = binary_erosion(target.mask, iterations=cells) if cells else target.mask
            at = np.argwhere(inner if inner.sum() > 0.02 * target.mask.sum() else target.mask)
            at = at[np.linspace(0, len(at) - 1, min(_SAMPLES, len(at))).astype(int)]
            samples = pixel * at[:, ::-1].astype(np.float64)
            scale = np.diag([pixel, pixel, 1.0])
            sides.append(_Side(scale @ camera.projection, samples, cKDTree(samples)))
        return cls(tuple(sides), radius)

    def __call__(self, state: State, weights: Weights) -> Felt:
        points, edge = state.points, state.edge
        # tension: what is pulled from many sides at once would crumple
        taut = TENSION / (state.spacing * self.radius)
        total = taut * float((edge * edge).sum())
        slope = follow_edges(2.0 * taut * edge, state.rings)
        scale = 1.0 / self.radius**2
        for side in self.sides:
            seen = project(points, side.projection)
            _, to = side.tree.query(seen.places)
            _, of = cKDTree(seen.places).query(side.samples)
            here, there = seen.places - side.samples[to], seen.places[of] - side.samples
            more = scale * len(points) / len(side.samples)
            total += scale * float((here * here).sum()) + more * float((there * there).sum())
            pull = 2.0 * scale * here
            np.add.at(pull, of, 2.0 * more * there)
            slope += seen.pull(pull)
        return total, slope
