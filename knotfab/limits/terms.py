"""Limits as terms of the objective, evaluated only while they can be felt."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.kernels import bend_hinge, gap_hinge
from knotfab.geometry.measures import Neighbours
from knotfab.geometry.polylines import Polylines, row_lengths
from knotfab.scene.camera import Plane
from knotfab_formats.scene import SettledRegion

Felt = tuple[float, Array]  # a value, and its gradient (N, 3) in the vertices


@dataclass(frozen=True)
class Limits:
    """The limits of the finished knots, in mm, all resolved to numbers."""

    radius: float
    clearance: float
    bend_radius: float
    length: float
    region: SettledRegion
    walls: tuple[Plane, ...] = ()  # walls behind the piece, each a normal and an offset in mm

    @property
    def separation(self) -> float:
        """Least distance of centre lines: two radii and the clearance."""
        return 2 * self.radius + self.clearance


@dataclass
class State:
    """One iteration of the search, as the terms see it."""

    points: Array  # (N, 3) mm
    edge: Array  # (N, 3) to the next vertex
    rings: Polylines
    near: Neighbours
    length: Array  # (N,) of the edges, mm
    spacing: float  # their mean, mm

    @classmethod
    def at(cls, points: Array, rings: Polylines, near: Neighbours) -> State:
        """Return the state of closed polylines whose vertices are `points` (N, 3)."""
        edge = points[rings.next] - points
        length = row_lengths(edge)
        return cls(points, edge, rings, near, length, float(length.mean()))


def follow_edges(slope: Array, rings: Polylines) -> Array:
    """Convert a gradient in the edges, `slope` (N, 3), into the gradient in the vertices (N, 3)."""
    return np.asarray(slope[rings.previous] - slope)


def weigh(parts: Iterable[tuple[float, Felt]], points: Array) -> Felt:
    """Return the weighted sum of terms, and its gradient in vertices `points` (N, 3)."""
    total, slope = 0.0, np.zeros_like(points)
    for weight, (value, pull) in parts:
        total += weight * value
        slope += weight * pull
    return total, slope


def total_length(state: State) -> Felt:
    """Return the total edge length, mm, with its gradient; edges of no length have none."""
    along = state.edge / np.maximum(state.length, 1e-300)[:, None]
    return float(state.length.sum()), follow_edges(along, state.rings)


Term = Callable[[State, Limits], Felt]
# (vertices, polylines, limits) -> mm that every vertex may go before the term is more than nothing
Slack = Callable[[Array, Polylines, Limits], float]


@dataclass(frozen=True)
class Limit:
    """One limit: its hinge term with gradient, and how far it is from being felt.

    A limit without a `slack` is always evaluated: in a filling strands always lie side by side, and bend.
    """

    name: str
    term: Term
    slack: Slack | None = None


@dataclass
class Guard:
    """A limit as one search watches it: how often its term was called, and what that cost.

    The term and its gradient are zero until some vertex has moved as far as the measured slack,
    which is then measured again. Skipping the term before that changes no step.
    """

    limit: Limit
    calls: int = 0
    seconds: float = 0.0  # value and gradient, and the watch
    _seen: tuple[Array, Limits] | None = field(default=None, repr=False)
    _slack: float = 0.0

    def term(self, state: State, limits: Limits) -> Felt | None:
        """Return the limit's term and its gradient; None where it cannot be felt."""
        begun = time.perf_counter()
        found = None
        if self._felt(state, limits):
            found = self.limit.term(state, limits)
            self.calls += 1
        self.seconds += time.perf_counter() - begun
        return found

    def add(self, earlier: Guard) -> None:
        """Add the calls and seconds of an earlier search."""
        self.calls += earlier.calls
        self.seconds += earlier.seconds

    def _felt(self, state: State, limits: Limits) -> bool:
        if self.limit.slack is None:
            return True
        points = state.points
        if self._seen is not None and self._seen[1] == limits:
            before = self._seen[0]
            if before.shape == points.shape:
                moved = float(row_lengths(points - before).max())
                if moved < self._slack:
                    return False
        self._seen = (points.copy(), limits)
        self._slack = self.limit.slack(points, state.rings, limits)
        return self._slack <= 0.0


# Bend limit: no vertex bends tighter than the material, or the tube itself, allows.

_BEND_OVERSHOOT = 1.06


def bend_term(state: State, limits: Limits) -> Felt:
    """Return the squared hinge of excess curvature, and its gradient."""
    total, gradient = bend_hinge(
        state.points, state.rings.next, limits.bend_radius * _BEND_OVERSHOOT
    )
    scale = state.spacing / limits.radius
    return scale * total, scale * gradient


BEND = Limit("bend", bend_term)


# Clearance: strands keep two radii and a gap between their centre lines.

_GAP_OVERSHOOT = 1.02  # aim a little wider than required, so the end is on the safe side


def clearance_term(state: State, limits: Limits) -> Felt:
    """Return the squared hinge (2r + c - d)+^2 over near pairs of segments, in squared radii.

    Pairs count if their arc distance exceeds pi (r + c/2); d is the exact distance between
    segments. Two per cent are added to aim a little wide.
    """
    distance = limits.separation * _GAP_OVERSHOOT
    total, gradient = gap_hinge(
        state.points,
        state.rings.next,
        state.rings.start,
        state.rings.size,
        state.near.i,
        state.near.j,
        distance + 1.5 * state.spacing,
        0.5 * np.pi * limits.separation / state.spacing,
        distance,
    )
    scale = state.spacing / limits.radius**3
    return scale * total, scale * gradient


CLEARANCE = Limit("clearance", clearance_term)


# Length budget: the centre lines together stay below what the material allows.

_AIM = 0.99  # share of the budget, so the end is on the safe side


def length_term(state: State, limits: Limits) -> Felt:
    """Return the squared hinge of the excess in tube radii (paper, length loss)."""
    length, slope = total_length(state)
    excess = max(0.0, length - _AIM * limits.length) / limits.radius
    return excess**2, (2 * excess / limits.radius) * slope


def slack(points: Array, rings: Polylines, limits: Limits) -> float:
    """Return how far every vertex may move before the length is felt, mm.

    Vertices that move by at most d lengthen n edges by at most 2 d each.
    """
    length = float(np.linalg.norm(points[rings.next] - points, axis=1).sum())
    return (_AIM * limits.length - length) / (2 * len(points))


LENGTH = Limit("length", length_term, slack)
