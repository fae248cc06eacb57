"""Define the objective of a search: the images of all views, the limits, and further terms."""

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
from knotfab.geometry.polylines import Polylines, project, sum_rows
from knotfab.limits.terms import Felt, Guard, Limits, State, follow_edges, weigh
from knotfab.problem import Problem, TargetView, ViewNumbers
from knotfab.render.image import ViewImage, grid_at
from knotfab.render.silhouette import Frame
from knotfab.scene.camera import camera_of

SHARPEST = 5.0  # largest tau, 1/px; a sharper outline crosses pixels whose centres hardly notice it


@dataclass(frozen=True)
class Weights:
    """Weights of the terms, each of which is in squared tube radii, or in tube radii of curve."""

    image: float = 1.0
    clearance: float = 1.0
    bend: float = 0.1
    region: float = 10.0
    length: float = 1.0
    hold: float = 4.0  # of an anchor to another frame of a sequence
    grace: float = 1.0  # factor on the setting of that name


class Term:
    """A further term of an objective; a subclass that is also a hard limit overrides `kept`."""

    def __call__(self, state: State, weights: Weights) -> Felt:
        """Return the value, in the units of the other terms, and its gradient by the vertices, (N, 3).

        The arrays of `state` belong to the caller and must not be changed.
        """
        raise NotImplementedError

    def kept(self, points: Array) -> bool:
        """Return whether vertices (N, 3), mm, keep the limit."""
        return True


@dataclass
class Objective:
    """The loss of a phase: (points (N, 3), near, progress) -> (value, gradient (N, 3)), without side effects.

    It sums the image terms of all views, weighted by `shares` (of mean 1), the terms of the limits, and
    `terms`. tau grows geometrically from `tau[0]` to `tau[1]`, in units of one over the projected tube
    radius. The dominant capsules (`find_winners`), shares and pose (`look_from`) change only between calls.
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
    # for each view the capsule that dominates each pixel, as `ViewImage.find_winners` returns it
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
        """Return the sharpness tau of a view's image, 1/px, after a share `progress` of the phase."""
        start, end = self.tau
        sharp = start * (end / start) ** progress / self.images[number].radius_px
        return float(min(sharp, SHARPEST))

    def image_term(self, number: int, points: Array, tau: float) -> Felt:
        """Integrate the squared error of a view's image, in squared projected radii; tau is in 1/px."""
        image = self.images[number]
        error, slope = image.squared_error(
            points, self.rings, self.limits.radius, tau, self.won[number]
        )
        scale = 1.0 / image.radius_px**2
        return scale * error, scale * slope

    def limit_terms(
        self, points: Array, near: Neighbours, limits: Limits, weights: Weights, turn: Array
    ) -> Felt:
        """Return the weighted terms of all limits, computed in the axes that are the columns of `turn`."""
        state = State.at(points @ turn, self.rings, near)
        total, slope = add_limits(state, limits, self.guards, weights)
        return total, slope @ turn.T

    def find_winners(self, points: Array, progress: float) -> None:
        """Recompute the capsule that dominates each pixel; it stays fixed until the next call."""
        if self.weights.image == 0:
            return
        for number, image in enumerate(self.images):
            tau = self.tau_px(number, progress)
            self.won[number] = image.find_winners(points, self.rings, self.limits.radius, tau)

    def look_from(self, frame: Frame, limits: Limits, turn: Array) -> None:
        """Look from another pose of the one view, by its frame and limits; `turn` has its axes in columns."""
        self.images = (self.images[0].from_frame(frame),)
        self.limits, self._turn = limits, turn

    def ious(self, points: Array) -> tuple[float, ...]:
        """Return the IoU of each view's hard silhouette with its target."""
        return tuple(i.iou(points, self.rings, self.limits.radius) for i in self.images)


class Pose(Protocol):
    """A free pose: of one view (`free_pose.FreePose`) or directions of several (`FreeDirections`)."""

    @property
    def radius_mm(self) -> float:
        """The present radius of the tube."""

    def keep(self, points: Array) -> None:
        """Return into the bounds, which may depend on the points (N, 3)."""

    def show(self, objective: Objective, problem: Problem) -> None:
        """Show the objective the images of its views from the present pose."""

    def descend(
        self,
        objective: Objective,
        problem: Problem,
        points: Array,
        near: Neighbours,
        progress: float,
    ) -> None:
        """Take one step down the objective at vertices (N, 3), and show it the new pose."""

    def settle(self, problem: Problem, points: Array) -> tuple[Problem, Array, ViewNumbers | None]:
        """Return the problem with the pose entered, the points (N, 3) in its axes, and one view's numbers."""


def add_limits(state: State, limits: Limits, guards: dict[str, Guard], weights: Weights) -> Felt:
    """Sum the weighted terms of all limits that have one; the guards count calls and seconds."""
    found = ((getattr(weights, name), guard.term(state, limits)) for name, guard in guards.items())
    return weigh(((weight, felt) for weight, felt in found if felt is not None), state.points)


# Grace: the energy of an elastic curve under tension, which is low for curves that please the eye.

# cost of one tube radius of length, in units of the bending energy
TENSION_LYING = 0.5
# and of strands in arches: the longer they run, the higher they must rise. It costs .0006 of IoU
TENSION_ARCHED = 1.4


@dataclass(frozen=True)
class Grace(Term):
    """The scale-free term weight * (r * integral of squared curvature + tension * length / r).

    It is the energy of Euler's elastica. On a polyline the bending energy is the sum over vertices of
    |t' - t|^2 / l, with unit tangents t and t' before and after and l the mean of the two edges (Bergou et
    al., "Discrete elastic rods", 2008, with 2 sin(theta / 2) for 2 tan(theta / 2), which stays bounded where
    an edge folds back).
    """

    radius_mm: float
    weight: float
    tension: float = TENSION_LYING

    def __call__(self, state: State, weights: Weights) -> Felt:
        following, previous = state.rings.next, state.rings.previous
        one = state.length
        divisor = _divisor(one)[:, None]
        unit = state.edge / divisor
        turn = unit[following] - unit
        between = 0.5 * (one + one[following])
        length, turned = _divisor(between), sum_rows(turn * turn)
        # each vertex's energy, and its derivatives by the squared turn and by the vertex's length
        by_turn = self.radius_mm / length
        shares = by_turn * turned
        by_length = -shares / length
        by_length = np.where(between > 0, by_length, 0.0)
        pull = 2.0 * by_turn[:, None] * turn
        pull = pull[previous] - pull  # gradient by the unit edges
        along = sum_rows(pull * unit)
        stretch = 0.5 * (by_length + by_length[previous]) + self.tension / self.radius_mm
        edges = (pull - along[:, None] * unit) / divisor + stretch[:, None] * unit
        scale = self.weight * weights.grace
        total = float(shares.sum()) + self.tension * float(one.sum()) / self.radius_mm
        return scale * total, scale * follow_edges(edges, state.rings)


def _divisor(lengths: Array) -> Array:
    """Return lengths to divide by, with 1 in place of 0."""
    return np.where(lengths > 0, lengths, 1.0)


_MARGIN = 0.5  # margin of the distance field around the frame, as a share of it
_CELLS = 240  # cells of the field along the frame's longer side
# cost of a tube radius of strand, one radius outside, in squared radii of image error
_WEIGHT = 0.5
# the same of one that stands out as a knob: more than the two squared radii that it may draw in another view
_WEIGHT_KNOB = 1.5
_KNOB = 0.5  # how far a tube may stand out of a silhouette before it is a knob, in radii
_STROKE = 1.0  # radii from what is wider than a knob, where thin parts are strokes, and no corners or tips


@dataclass(frozen=True)
class Spill(Term):
    """A pull on strands outside a silhouette: length times distance, in squared tube radii.

    `field` (H, W) is the distance from the silhouette in tube radii, weighted, and `projection` (3, 4) maps
    to its cells. Places beyond the field count as its edge.
    """

    projection: Array
    field: Array
    radius: float

    @classmethod
    def for_view(cls, target: TargetView, radius: float) -> Spill:
        """Build the term for one view; the tube's radius is in mm."""
        view = target.view
        cell = view.longer_mm / _CELLS
        wanted, camera = grid_at(view, target.mask, cell, _MARGIN, beside=target.ends)
        far = distance_transform_edt(~wanted) * (cell / view.magnification / radius)
        return cls(camera.projection, far, radius)

    @classmethod
    def for_knobs(cls, target: TargetView, radius: float) -> Spill:
        """Build the term that counts from where a tube stands out of a silhouette as a knob.

        In strokes too thin for any other place it counts from their outline.
        """
        view = target.view
        cell = view.longer_mm / _CELLS
        wanted, camera = grid_at(view, target.mask, cell, _MARGIN, beside=target.ends)
        radii = cell / view.magnification / radius
        inner = distance_transform_edt(wanted) * radii > _KNOB
        wide = distance_transform_edt(~inner) * radii <= _KNOB
        strokes = wanted & (distance_transform_edt(~wide) * radii > _STROKE)
        far = distance_transform_edt(~(inner | strokes)) * radii
        return cls(camera.projection, _WEIGHT_KNOB / _WEIGHT * far, radius)

    def __call__(self, state: State, weights: Weights) -> Felt:
        seen = project(state.points, self.projection)
        last = np.array(self.field.shape[::-1]) - 1
        at = np.clip(seen.places, 0.0, last)
        cell = np.minimum(at.astype(np.int64), last - 1)
        share = at - cell
        # interpolate bilinearly between the centres of four cells
        (u, v), (x, y) = cell.T, share.T
        f = self.field
        upper, lower = f[v, u], f[v + 1, u]
        rise, fall = f[v, u + 1] - upper, f[v + 1, u + 1] - lower
        upper, lower = upper + x * rise, lower + x * fall
        slope = np.column_stack([(1.0 - y) * rise + y * fall, lower - upper])
        slope[at != seen.places] = 0.0  # constant beyond the edge
        scale = _WEIGHT * weights.image * state.spacing / self.radius
        return scale * float(((1.0 - y) * upper + y * lower).sum()), scale * seen.pull(slope)


_SAMPLES = 700  # samples of each silhouette
TENSION = 3.0  # weight of the squared edges of `Chamfer`


@dataclass(frozen=True)
class _Side:
    """One view's projection (3, 4) to mm on the receiver, and samples (k, 2) of its silhouette there."""

    projection: Array
    samples: Array
    tree: cKDTree


@dataclass(frozen=True)
class Chamfer(Term):
    """A far-reaching pull on curves that are far from their pictures, in squared tube radii.

    It sums squared distances to nearest points, both ways in every view, and a tension.
    """

    sides: tuple[_Side, ...]
    radius: float

    @classmethod
    def for_views(cls, views: Sequence[TargetView], radius: float) -> Chamfer:
        """Build the term for all views, with silhouettes eroded by about a radius unless little remains."""
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
        # without tension, strands pulled from many sides would crumple
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
