"""The certified flow: all vertices descend the objective together, and no accepted step crosses a strand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.base.compiled import compiled
from knotfab.geometry.carry import certify, step_limits
from knotfab.geometry.measures import Neighbours, find_neighbours
from knotfab.geometry.polylines import Polylines, dot
from knotfab.limits.terms import Felt
from knotfab.search.objective import Weights
from knotfab_formats.libraries import took_part
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
def _precondition(gradient: Array, bounds: Indices, sigma: float) -> Array:
    """Return H1 gradient: of each ring the x that solves x - sigma^2 x'' = smooth gradient, sigma in samples.

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


def _along(points: Array, rings: Polylines) -> Array:
    """Return tangential motion of each vertex to the middle of its two neighbours."""
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


def flow(
    points: Array,
    rings: Polylines,
    objective: Loss,
    radius: float,
    settings: FlowSettings,
    report: Callable[[float, Array], None] | None = None,
    done: Callable[[Array], bool] | None = None,
    separation: float = 0.0,
    between: Between | None = None,
) -> FlowResult:
    """Descend `objective` from `points` (N, 3), mm, keeping the knot type.

    Every accepted step is certified to be an isotopy (`certificate.certify`): a step that fails is halved
    up to six times, then refused. `report(progress, points)` is called each iteration; `done(points)`
    may end the flow early. `separation`: least distance of centre lines that the objective asks for, mm.
    `between(points, near, iteration, progress)` is called before each step.
    """
    result = FlowResult(points.copy())
    took_part("numpy", "moved the knots")
    took_part("numba", "ran the loops of pictures and limits")
    x = result.points
    near: Neighbours | None = None
    momentum = np.zeros_like(x)
    scale = 0.0
    for iteration in range(settings.iterations):
        progress = iteration / max(1, settings.iterations - 1)
        if near is None or near.moved(x) > 0.3 * radius:
            near = find_felt(x, rings, radius, separation, settings.reach)
        if between is not None:
            between(x, near, iteration, progress)
        loss, gradient = objective(x, near, progress)
        result.losses.append(loss)
        spacing = float(np.linalg.norm(x[rings.next] - x, axis=1).mean())
        g = _precondition(gradient, rings.bounds, settings.smoothing * radius / spacing)
        scale = max(0.9 * scale + 0.1 * float(dot(g, g).mean()), 1e-300)
        if iteration == 0:
            scale = max(float(dot(g, g).mean()), 1e-300)
        momentum = settings.momentum * momentum + (1 - settings.momentum) * g
        rate = settings.rate * (settings.rate_end / settings.rate) ** progress * radius
        step = -momentum * (rate / np.sqrt(scale))
        step += settings.evening * _along(x, rings)
        length = np.sqrt(dot(step, step))
        largest = settings.clamp * radius
        limit = np.minimum(step_limits(x, rings, near, largest), largest)
        step *= np.minimum(1.0, limit / np.maximum(length, 1e-300))[:, None]
        for halving in range(7):
            verdict = certify(x, step, rings, near)
            if verdict.valid:
                x = x + step
                result.accepted += 1
                result.shortened += halving > 0
                result.least_margin = min(result.least_margin, verdict.margin)
                break
            step = 0.5 * step
        else:
            result.refused += 1
            momentum[:] = 0
            near = None
        result.points = x
        if report is not None:
            report(progress, x)
        if done is not None and iteration % 10 == 9 and done(x):
            break
    return result


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
