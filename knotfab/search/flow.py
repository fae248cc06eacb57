"""Define the certified flow's settings and parts, which `search.optimizer` runs, and a search's phases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.base.compiled import compiled
from knotfab.geometry.measures import Neighbours, find_neighbours
from knotfab.geometry.polylines import Polylines, dot
from knotfab.limits.terms import Felt
from knotfab.search.objective import Weights
from knotfab_formats.search import SearchSettings

Loss = Callable[[Array, Neighbours, float], Felt]  # (points, near, progress) -> (loss, gradient)
Between = Callable[[Array, Neighbours, int, float], None]  # (points, near, iteration, progress)


@dataclass(frozen=True)
class FlowSettings:
    """Settings of the flow. Lengths are in tube radii."""

    iterations: int = 200
    rate: float = 0.12  # root-mean-square step at the start
    rate_end: float = 0.02
    clamp: float = 0.3  # longest step of a vertex
    smoothing: float = 1.5  # width of the H1 preconditioner along the curve
    momentum: float = 0.85
    evening: float = 0.25  # share of the tangential motion that would even out the edges, per step
    reach: float = 4.0  # neighbour lists contain all segments at least this close


@dataclass
class FlowResult:
    """The vertices at the end of the flow, and the counts and least margin of its certificates."""

    points: Array
    accepted: int = 0
    shortened: int = 0
    refused: int = 0
    least_margin: float = np.inf
    losses: list[float] = field(default_factory=list)


@compiled
def _filter(ring: Array, share: float) -> None:
    """Filter a ring (n,) in place: each number becomes itself plus `share` of the filtered one before it."""
    last = 0.0
    for n in range(len(ring)):
        last = ring[n] + share * last
    last *= 1.0 / (1.0 - share ** len(ring))  # the limit of infinitely many rounds
    for n in range(len(ring)):
        last = ring[n] + share * last
        ring[n] = last


@compiled
def precondition(gradient: Array, bounds: Indices, sigma: float) -> Array:
    """Return the H1 gradient: for each ring, the x that solves x - sigma^2 x'' = g, sigma in samples.

    It is also smoothed by (1, 2, 1) / 4, which removes the pixels' noise that alternates between vertices.
    The finite-difference matrix is proportional to (1 - r S)(1 - r S^-1), with S the shift along the ring, so
    it is inverted by one filter forward and one backward. `bounds` are those of `Polylines`.
    """
    square = sigma * sigma
    half = 1.0 / (2.0 * square)
    share = 1.0 / (1.0 + half + np.sqrt(half * (2.0 + half)))  # r
    scale = (1.0 + share * share) / (1.0 + 2.0 * square)
    out = np.empty_like(gradient)
    for number in range(len(bounds) - 1):
        begin, end = bounds[number], bounds[number + 1]
        before = end - 1
        for n in range(begin, end):
            after = n + 1 if n + 1 < end else begin
            for k in range(3):
                sides = gradient[before, k] + gradient[after, k]
                out[n, k] = 0.5 * gradient[n, k] + 0.25 * sides
            before = n
        for k in range(3):
            _filter(out[begin:end, k], share)
            _filter(out[begin:end, k][::-1], share)
    out *= scale
    return out


def along_curve(points: Array, rings: Polylines) -> Array:
    """Return the tangential step that brings each vertex midway between its neighbours, (N, 3)."""
    ahead = points[rings.next] - points
    tangent, length = ahead + ahead[rings.previous], np.sqrt(dot(ahead, ahead))
    tangent /= np.sqrt(dot(tangent, tangent))[:, None]
    return np.asarray(0.5 * (length - length[rings.previous])[:, None] * tangent)


def find_felt(
    points: Array, rings: Polylines, radius: float, separation: float, reach: float = 4.0
) -> Neighbours:
    """Find all pairs of segments that the clearance term may feel before a vertex has moved 0.3 radii.

    Args:
        separation: the required least distance of centre lines, mm.
        reach: least distance to search, in tube radii.
    """
    edge = points[rings.next] - points
    longest = float(np.sqrt(dot(edge, edge).max()))
    felt = 1.02 * separation + 1.5 * longest + 0.7 * radius
    return find_neighbours(points, rings, max(reach * radius, felt), 6)


# The plan of a search: its phases, and its repairs while a limit is violated.

SETTLE = Weights(clearance=20.0, bend=5.0, region=50.0)  # of the last phase, which ends feasible


@dataclass(frozen=True)
class Phase:
    """One run of the flow at one resolution, with the picture's sharpness `tau` from start to end.

    `pixels` is the picture's longer side; tau is in units of one over the projected tube radius. `spill`
    pulls strands outside a silhouette to it, `knobs` those that stand out as knobs. `balanced` gives more
    weight to views that miss their goals.
    """

    pixels: int
    walk: FlowSettings
    weights: Weights
    tau: tuple[float, float]
    spill: bool = False
    knobs: bool = False
    balanced: bool = True

    @property
    def iterations(self) -> int:
        return self.walk.iterations


@dataclass(frozen=True)
class Plan:
    """The phases of a search; `repair` returns the repair of a number, from 0.

    With `network` the paper's network moves the curves first.
    """

    phases: tuple[Phase, ...]
    repair: Callable[[int], Phase]
    repairs: int = 8  # most repairs of the whole curve; later ones give the picture less weight
    mendings: int = 4  # most repairs of single stretches, which come first
    keep_vertices: bool = False  # whether vertices keep their number and order, without resampling
    network: bool = False


def plan_of(settings: SearchSettings, views: int = 1) -> Plan:
    """Return the plan of a search; the network alone (`method` "inn") has no phases."""
    phases: tuple[Phase, ...] = ()
    if settings.method != "inn":
        phases = three_phases(settings, views)
    network = settings.method != "flow"
    return Plan(phases, lambda number: repair_phase(settings, number), network=network)


def three_phases(
    settings: SearchSettings, views: int = 1, rates: tuple[float, float, float] | None = None
) -> tuple[Phase, Phase, Phase]:
    """Return three phases: a coarse picture, a fine one, and one that weighs the limits most.

    Args:
        views: with several, strands have further to go. The search then begins softer and with longer steps,
            and pulls in what is outside a silhouette; later, spill may stay that draws as much elsewhere,
            unless it is a knob.
        rates: step sizes in tube radii at the start of the coarse phase, between it and the fine one, and at
            the end of that; None chooses by the number of views.
    """
    several = views > 1
    # one picture: keep strands smooth first and let its details come later; several need more freedom
    smooth = (1.0, 1.0) if several else (4.0, 2.0)
    start, middle, end = rates or ((0.2, 0.08, 0.03) if several else (0.15, 0.06, 0.02))
    return (
        Phase(
            settings.coarse_px,
            FlowSettings(iterations=settings.coarse_iterations, rate=start, rate_end=middle),
            Weights(grace=smooth[0]),
            (1.0 if several else 1.5, 3.0),
            spill=several,
            balanced=False,  # the coarse picture is too soft to measure a view's shortfall
        ),
        Phase(
            settings.fine_px,
            FlowSettings(iterations=settings.fine_iterations, rate=middle, rate_end=end),
            Weights(clearance=3.0, bend=0.5, grace=smooth[1]),
            (3.0, settings.tau),
            knobs=several,
        ),
        Phase(
            settings.fine_px,
            FlowSettings(iterations=settings.settle_iterations, rate=0.03, rate_end=0.01),
            SETTLE,
            (settings.tau, settings.tau),
            knobs=several,
        ),
    )


def repair_phase(settings: SearchSettings, number: int) -> Phase:
    """Return repair `number`, from 0; every second one gives the picture less weight."""
    weights = Weights(
        image=0.3 ** (number // 2), clearance=40.0, bend=40.0, region=100.0, length=20.0, hold=160.0
    )
    walk = FlowSettings(iterations=60, rate=0.02 if number < 2 else 0.04, rate_end=0.005)
    return Phase(settings.fine_px, walk, weights, (settings.tau, settings.tau))
