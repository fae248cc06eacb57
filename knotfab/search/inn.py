"""The paper's search: the weights of an invertible network that maps a template to the knots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from knotfab.effects.base import Decision, Limits
from knotfab.geometry.carry import (
    Curves,
    Parameters,
    carry,
    even_parameters,
    refined,
    same_type,
)
from knotfab.geometry.neighbours import Neighbours, find_neighbours
from knotfab.geometry.polylines import Rings, dot, rings_of_sizes
from knotfab.scene.settings import SearchSettings
from knotfab.search.network import CouplingNetwork
from knotfab.search.objective import Objective
from knotfab.search.phases import Phase, three_phases

__all__ = ["ObjectiveAt", "Warped", "circles", "keep_largest", "warp"]

Array = NDArray[np.float64]
# (points, rings, pixels, weights, tau range) -> objective of polygons like these
ObjectiveAt = Callable[[Array, Rings, Phase], Objective]

_REFRESH = 40  # iterations between even samplings of the curves
_EDGE = 0.8  # vertex spacing of these in tube radii: coarser than the flow's, which has each vertex free
_TAU = (1.0, 6.0)  # from softer than the flow's: there is further to go
_FURTHER = 2.0  # the rate from a circle over that from a filling template
_SLOWEST = 0.1  # the last step's rate over the first's
_SLOPE = 20.0  # of the hidden units: it bends about the piece's twentieth part at once
_REFINEMENTS = 5  # how often the samples may be doubled for their certificate
_CIRCLE = 0.35  # radius of a circle over the shorter side of what it is to draw


@dataclass(frozen=True)
class Warped:
    """Polygons on the images of the template's curves, and what is proved of them."""

    points: Array  # (N, 3) mm
    rings: Rings
    network: CouplingNetwork  # takes points in units of `size`
    size: float  # mm
    iou: float
    proved: bool  # that every polygon has the type of its template
    steps: int  # certified steps from the template to here
    refinements: int  # doublings of the samples that the proof needed
    least_margin: float  # mm


def circles(curves: Sequence[Array], radius: float, separation: float) -> list[Array]:
    """A circle for each planar curve [(n, 2) mm], each in a plane of its own: [(m, 3) mm].

    Convex polygons in parallel planes: an unlink of unknots, by inspection (paper, sec. 3.2, whose
    template (cos s, sin s, 0) wants s from 0 to 2 pi, not to 1).

    Args:
        radius: of the tube, mm; no circle is smaller than four of these.
        separation: between neighbouring planes, mm.
    """
    found = []
    for k, curve in enumerate(curves):
        low, high = curve.min(0), curve.max(0)
        around = max(_CIRCLE * float((high - low).min()), 4.0 * radius)
        count = max(48, round(2 * np.pi * around / (0.5 * radius)))
        angle = 2 * np.pi * np.arange(count) / count
        middle = 0.5 * (low + high)
        found.append(
            np.column_stack(
                [
                    middle[0] + around * np.cos(angle),
                    middle[1] + around * np.sin(angle),
                    np.full(count, (k - 0.5 * (len(curves) - 1)) * separation),
                ]
            )
        )
    return found


def keep_largest(effects: dict[str, Decision], fresh: dict[str, Decision]) -> None:
    """Judge `effects` anew: the larger magnitude counts, and what was simulated once stays so.

    The network goes further than any bound from the template covers.
    """
    for name, decision in fresh.items():
        old = effects[name]
        if decision.magnitude > old.magnitude:
            old.magnitude, old.threshold = decision.magnitude, decision.threshold
            old.simulated |= decision.simulated


def warp(
    points: Array,
    rings: Rings,
    objective_at: ObjectiveAt,
    limits: Limits,
    settings: SearchSettings,
    device: str = "cpu",
    report: Callable[[float, float | None], None] | None = None,
) -> Warped:
    """Search the network's weights so that the images of closed polygons draw the picture.

    The curves are smooth ones through the template's vertices (N, 3), mm. Adam descends the objective
    of the flow, with the flow's terms for the limits; its rate follows from how far the vertices are to go
    in one step, so that it suits any depth and width. At the end the polygons are carried from the
    template to where they are in certified steps (`sampling_certificate.carry`); where that fails
    with the samples at hand, with twice as many.
    """
    template = rings.split(points)
    curves = Curves.through(template)
    size = float(np.abs(points).max())
    network = CouplingNetwork(
        settings.network_depth, settings.network_width, settings.seed, gain=_SLOPE
    ).to(device)

    def path(at: Array, share: float) -> Array:
        with torch.no_grad():
            there = size * network(torch.as_tensor(at / size, device=device), share)
        return np.asarray(there.cpu().numpy())

    where, seen = _descend(
        curves, network, size, path, objective_at, limits, settings, device, report
    )
    edge = _EDGE * limits.radius
    for refinement in range(_REFINEMENTS + 1):
        start = curves.at(where)
        sizes = rings_of_sizes(tuple(len(w) for w in where))
        joined = np.concatenate(start)
        begin = same_type(template, curves.knots, start, where, curves.periods)
        finer = refined(where, curves.periods)
        end = same_type(
            sizes.split(path(joined, 1.0)),
            where,
            _images(path, curves, finer),
            finer,
            curves.periods,
        )
        if begin.valid and end.valid:
            way = carry(joined, sizes, path, edge)
            if way.reached == 1.0:
                margin = min(begin.margin, end.margin, way.least_margin)
                return Warped(
                    way.points, sizes, network, size, seen, True, way.steps, refinement, margin
                )
        if refinement < _REFINEMENTS:
            where = finer
    return Warped(path(joined, 1.0), sizes, network, size, seen, False, 0, _REFINEMENTS, 0.0)


def _images(
    path: Callable[[Array, float], Array], curves: Curves, where: Parameters
) -> list[Array]:
    """[(n, 3)] the images of each curve's points at its parameters."""
    start = curves.at(where)
    return np.split(path(np.concatenate(start), 1.0), np.cumsum([len(part) for part in start])[:-1])


def _descend(
    curves: Curves,
    network: CouplingNetwork,
    size: float,
    path: Callable[[Array, float], Array],
    objective_at: ObjectiveAt,
    limits: Limits,
    settings: SearchSettings,
    device: str,
    report: Callable[[float, float | None], None] | None,
) -> tuple[Parameters, float]:
    """Adam on the network's weights; the parameters of even samples at the end, and their IoU."""
    rate = 1e-3 / settings.network_width
    adam = torch.optim.Adam(network.parameters(), lr=rate, betas=(0.9, 0.99))
    edge, radius = _EDGE * limits.radius, limits.radius
    total = settings.network_iterations
    first = settings.network_rate_radii * (_FURTHER if settings.network_start == "circle" else 1.0)
    phases = [replace(phase, tau=_TAU) for phase in three_phases(settings)[:2]]
    where = curves.knots
    x = np.concatenate(curves.at(where))
    objective: Objective | None = None
    before: Array | None = None
    near: Neighbours | None = None
    phase, rings = 0, rings_of_sizes(tuple(len(w) for w in where))
    start = torch.empty(0)
    for iteration in range(total):
        progress = iteration / max(1, total - 1)
        if objective is None or iteration % _REFRESH == 0 or phase != int(progress >= 0.6):
            phase = int(progress >= 0.6)
            where = even_parameters(where, _images(path, curves, where), curves.periods, edge)
            rings = rings_of_sizes(tuple(len(w) for w in where))
            even = np.concatenate(curves.at(where))
            start = torch.as_tensor(even / size, device=device)
            objective = objective_at(path(even, 1.0), rings, phases[phase])
            near = before = None
        mapped = size * network(start)
        x = mapped.detach().cpu().numpy()
        if near is None or near.moved(x) > 0.3 * radius:
            near = _near(x, rings, limits)
        if before is not None:
            goal = first * _SLOWEST**progress * radius
            moved = float(np.sqrt(dot(x - before, x - before).mean()))
            rate *= float(np.sqrt(np.clip(goal / max(moved, 1e-300), 0.5, 2.0)))
        before = x
        adam.zero_grad()
        torch.autograd.backward(objective(mapped, near, progress))
        for group in adam.param_groups:
            group["lr"] = rate
        adam.step()
        if report is not None and iteration % 10 == 0:
            report(progress, objective.iou(x))
    where = even_parameters(where, _images(path, curves, where), curves.periods, edge)
    rings = rings_of_sizes(tuple(len(w) for w in where))
    x = np.concatenate(_images(path, curves, where))
    objective = objective_at(x, rings, phases[1])
    seen = objective.iou(x)
    if report is not None:
        report(1.0, seen)
    return where, seen


def _near(points: Array, rings: Rings, limits: Limits) -> Neighbours:
    """Everything that the clearance term can feel before the list is made anew."""
    edge = points[rings.next] - points
    longest = float(np.sqrt(dot(edge, edge).max()))
    felt = 1.02 * limits.separation + 1.5 * longest + 0.7 * limits.radius
    return find_neighbours(points, rings, max(4.0 * limits.radius, felt), 6)
