"""The certified flow's settings and parts (`search.optimizer` runs it), and the phases of a search."""

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
    """Settings of the flow. Lengths in tube radii unless a unit says otherwise."""

    iterations: int = 200
    rate: float = 0.12  # root-mean-square step at the start, in tube radii
    rate_end: float = 0.02
    clamp: float = 0.3  # no vertex goes further in one step, in tube radii
    smoothing: float = 1.5  # width of the H1 preconditioner along the curve, in tube radii
    momentum: float = 0.85
    evening: float = 0.25  # share of the tangential motion that would even the edges out, a step
    reach: float = 4.0  # neighbour lists hold segments at least this close, in tube radii


@dataclass
class FlowResult:
    """The end of the flow, and the account of its certificates."""

    points: Array
    accepted: int = 0
    shortened: int = 0
    refused: int = 0
    least_margin: float = np.inf
    losses: list[float] = field(default_factory=list)


@compiled
def _filter(ring: Array, share: float) -> None:
    """Add to each of a ring's numbers (n,), in place, `share` of the filtered number before it."""
    last = 0.0
    for n in range(len(ring)):
        last = ring[n] + share * last
    last *= 1.0 / (1.0 - share ** len(ring))  # the sum as if it had gone round for ever
    for n in range(len(ring)):
        last = ring[n] + share * last
        ring[n] = last


@compiled
def precondition(gradient: Array, bounds: Indices, sigma: float) -> Array:
    """Return the H1 gradient: for each ring, the x that solves x - sigma^2 x'' = g, sigma in samples.

    Smoothed by (1, 2, 1) / 4: what changes sides from vertex to vertex is the pixels' noise. By differences
    the matrix is, but for a factor, (1 - r S)(1 - r S^-1), S the shift along the ring: a filter forth
    and one back. `bounds` are those of `Polylines`.
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
    """Return the step along the curve that brings each vertex midway between its neighbours."""
    ahead, behind = points[rings.next] - points, points - points[rings.previous]
    tangent = ahead + behind
    tangent /= np.sqrt(dot(tangent, tangent))[:, None]
    shift = np.sqrt(dot(ahead, ahead)) - np.sqrt(dot(behind, behind))
    return np.asarray(0.5 * shift[:, None] * tangent)


def find_felt(
    points: Array, rings: Polylines, radius: float, separation: float, reach: float = 4.0
) -> Neighbours:
    """Find everything that the clearance term can feel before the list is made anew, after 0.3 radii.

    Args:
        separation: least distance of centre lines that is asked for, mm.
        reach: radii that are looked at in any case.
    """
    edge = points[rings.next] - points
    longest = float(np.sqrt(dot(edge, edge).max()))
    felt = 1.02 * separation + 1.5 * longest + 0.7 * radius
    return find_neighbours(points, rings, max(reach * radius, felt), 6)


# The plan of a search: the phases that it goes through, and the repairs while a limit is
# violated.


SETTLE = Weights(clearance=20.0, bend=5.0, region=50.0)  # weights of the phase that ends feasible


@dataclass(frozen=True)
class Phase:
    """One walk of the flow: the picture's longer side, the steps, the weights, and tau from start to end.

    tau is in units of one over the projected tube radius. `spill`: strands that stand outside a silhouette
    are drawn to it; `balanced`: views that fall short of their goals count for more.
    """

    pixels: int
    walk: FlowSettings
    weights: Weights
    tau: tuple[float, float]
    spill: bool = False
    balanced: bool = True

    @property
    def iterations(self) -> int:
        return self.walk.iterations


@dataclass(frozen=True)
class Plan:
    """The phases of a search; `repair` gives the repair of a number, from 0.

    `network`: the paper's network moves the curves first.
    """

    phases: tuple[Phase, ...]
    repair: Callable[[int], Phase]
    repairs: int = 8  # repairs of the whole curve; each round gives the picture less weight
    mendings: int = 4  # repairs of single stretches, before those
    keep_vertices: bool = False  # their number and order stay: no resampling
    network: bool = False


def plan_of(settings: SearchSettings, views: int = 1) -> Plan:
    """Return the plan of a search from a template for so many views; without phases for the network alone."""
    phases: tuple[Phase, ...] = ()
    if settings.method != "inn":
        phases = three_phases(settings, views)
    network = settings.method != "flow"
    return Plan(phases, lambda number: repair_phase(settings, number), network=network)


def three_phases(
    settings: SearchSettings, views: int = 1, rates: tuple[float, float, float] | None = None
) -> tuple[Phase, Phase, Phase]:
    """Return a coarse picture, a fine one, and one that weighs the limits most.

    Args:
        views: several begin softer and with longer steps, for there is further to go, and first pull in what
            stands outside a silhouette (later a spill may stay that draws as much elsewhere).
        rates: rates of the steps, in tube radii, at the start of the coarse phase, between the two, and at
            the end of the fine one; None: by the number of views.
    """
    several = views > 1
    # smooth first, what the picture asks for comes in later; several ask for more than that leaves them
    smooth = (1.0, 1.0) if several else (4.0, 2.0)
    start, middle, end = rates or ((0.2, 0.08, 0.03) if several else (0.15, 0.06, 0.02))
    return (
        Phase(
            settings.coarse_px,
            FlowSettings(iterations=settings.coarse_iterations, rate=start, rate_end=middle),
            Weights(grace=smooth[0]),
            (1.0 if several else 1.5, 3.0),
            spill=several,
            balanced=False,  # the coarse picture is too soft to say what a view falls short of
        ),
        Phase(
            settings.fine_px,
            FlowSettings(iterations=settings.fine_iterations, rate=middle, rate_end=end),
            Weights(clearance=3.0, bend=0.5, grace=smooth[1]),
            (3.0, settings.tau),
        ),
        Phase(
            settings.fine_px,
            FlowSettings(iterations=settings.settle_iterations, rate=0.03, rate_end=0.01),
            SETTLE,
            (settings.tau, settings.tau),
        ),
    )


def repair_phase(settings: SearchSettings, number: int) -> Phase:
    """Return the repair of this number, from 0; every second one gives the picture less weight."""
    weights = Weights(
        image=0.3 ** (number // 2),
        clearance=40.0,
        bend=40.0,
        region=100.0,
        length=20.0,
        hold=160.0,
    )
    walk = FlowSettings(iterations=60, rate=0.02 if number < 2 else 0.04, rate_end=0.005)
    return Phase(settings.fine_px, walk, weights, (settings.tau, settings.tau))
