"""The paper's search: optimise the weights of an invertible network that maps a template to the knots."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch

from knotfab.apps.paper.network import CouplingNetwork
from knotfab.base.arrays import Array
from knotfab.geometry.carry import (
    Carried,
    Curves,
    Parameters,
    carry,
    certify_same_type,
    refine_parameters,
    space_evenly,
)
from knotfab.geometry.measures import Neighbours
from knotfab.geometry.polylines import dot, polylines_of, split_alike
from knotfab.problem import Report
from knotfab.search.flow import find_felt, three_phases
from knotfab.search.optimizer import Adam, one_thread
from knotfab.search.state import SearchState

_REFRESH = 40  # iterations after which the curves are sampled evenly again
_EDGE = 0.8  # vertex spacing in tube radii, coarser than the flow's, whose vertices are all free
_TAU = (1.0, 6.0)  # softer at first than the flow's, since there is farther to go
_FURTHER = 2.0  # ratio of the rate from a circle to that from a filling template
_SLOPE = 20.0  # slope of the hidden units, each of which bends about a twentieth of the piece
_FINE = 0.6  # share of the iterations after which the fine picture is used


@dataclass(frozen=True)
class _Map:
    """The network as an isotopy of points in mm; its unit is `size` mm."""

    network: CouplingNetwork
    size: float
    device: str

    def __call__(self, points: Array, share: float = 1.0) -> Array:
        """Map points (N, 3) a share of the way from the identity, 0, to the network, 1."""
        with torch.no_grad():
            there = self.network(torch.as_tensor(points / self.size, device=self.device), share)
        return np.asarray((self.size * there).cpu().numpy())

    def images(self, curves: Curves, where: Parameters) -> list[Array]:
        """Return the images [(n, 3)] of the points at given parameters of each curve."""
        start = curves.at(where)
        return split_alike(self(np.concatenate(start)), start)


@one_thread()
def search_network(state: SearchState, report: Report | None = None) -> None:
    """Optimise the network's weights so that the images of the state's polylines draw the pictures.

    The curves are smooth and pass through the start's vertices. Adam minimises the flow's objective, with a
    rate set by the distance that vertices should move in a step, so that it suits any depth and width. At
    the end the polygons are carried from start to result in certified steps (`geometry.carry`), with twice
    the samples each time that fails. If no sampling can be carried all the way, the knots stay where the
    best one got to.
    """
    template = state.rings.split(state.points)
    curves = Curves.through(template)
    settings = state.settings
    network = CouplingNetwork(
        settings.network_depth, settings.network_width, settings.seed, gain=_SLOPE
    ).to(state.device)
    mapped = _Map(network, float(np.abs(state.points).max()), state.device)
    where = _descend(state, curves, mapped, report)
    best = Carried(np.concatenate(template), 0.0, 0, 0, np.inf)
    rings, doublings = polylines_of(template), 0
    for refinement in range(6):  # at most five doublings of the samples
        start = curves.at(where)
        begun = certify_same_type(template, curves.knots, start, where, curves.periods)
        if begun.reached == 1.0:
            sampled = polylines_of(where)
            way = carry(np.concatenate(start), sampled, mapped, _EDGE * state.radius)
            if way.reached > best.reached:
                margin = min(begun.least_margin, way.least_margin)
                best, rings, doublings = replace(way, least_margin=margin), sampled, refinement
        if best.reached == 1.0:
            break
        where = refine_parameters(where, curves.periods)
    state.points, state.rings = best.points, rings
    state.log.accepted += best.steps
    state.log.add_margin(best.least_margin)
    state.log.template += f"; {_describe(best, doublings)}"


def _describe(way: Carried, doublings: int) -> str:
    if way.reached == 0.0:
        return "not carried along the invertible network: no step of it could be certified"
    percent = np.floor(1000 * way.reached) / 10  # never rounded up to 100 %
    far = "" if way.reached == 1.0 else f", {percent:.1f}% of the way"
    said = f"carried along the invertible network in {way.steps} steps, with"
    return f"{said} {doublings} doublings of its samples{far}"


def _descend(state: SearchState, curves: Curves, mapped: _Map, report: Report | None) -> Parameters:
    """Optimise the network's weights with Adam. Returns the parameters of even samples at the end."""
    network, settings, limits = mapped.network, state.settings, state.limits
    rate = 1e-3 / settings.network_width
    adam = Adam(network.parameters(), betas=(0.9, 0.99))
    edge, radius = _EDGE * limits.radius, limits.radius
    total = settings.network_iterations
    first = settings.network_rate_radii * (_FURTHER if settings.network_start == "circle" else 1.0)
    phases = [
        replace(phase, tau=_TAU) for phase in three_phases(settings, len(state.problem.views))[:2]
    ]
    where = curves.knots
    for iteration in range(total):
        progress = iteration / max(1, total - 1)
        number = int(progress >= _FINE)
        if iteration % _REFRESH == 0 or number != int((iteration - 1) / max(1, total - 1) >= _FINE):
            where = _sample(state, curves, mapped, where, edge)
            start = torch.as_tensor(
                np.concatenate(curves.at(where)) / mapped.size, device=state.device
            )
            state.judge_effects()
            phase = phases[number]
            objective = state.objective(phase)
            update, since = state.between(objective, phase), iteration
            near: Neighbours | None = None
            before: Array | None = None
        images = mapped.size * network(start)
        x = images.detach().cpu().numpy()
        if near is None or near.moved(x) > 0.3 * radius:
            near = find_felt(x, state.rings, radius, limits.separation)
        if before is not None:
            goal = first * 0.1**progress * radius  # decays to a tenth
            moved = float(np.sqrt(dot(x - before, x - before).mean()))
            rate *= float(np.sqrt(np.clip(goal / max(moved, 1e-300), 0.5, 2.0)))
        before = x
        update(x, near, iteration - since, progress)
        if state.watch is not None:  # not certified before the end
            state.watch(partial(state.knots_at, x, state.rings), False)
        _, slope = objective(x, near, progress)
        along = torch.as_tensor(slope, dtype=images.dtype, device=images.device)
        adam.zero_grad()
        images.backward(along)
        adam.step(rate)
        if report is not None and iteration % 10 == 0:
            report(progress, min(objective.ious(x)))
    where = _sample(state, curves, mapped, where, edge)
    state.judge_effects()
    if report is not None:
        report(1.0, min(state.ious()))
    return where


def _sample(
    state: SearchState, curves: Curves, mapped: _Map, where: Parameters, edge_mm: float
) -> Parameters:
    """Sample the images of the curves evenly into the state, and return the samples' parameters."""
    where = space_evenly(where, mapped.images(curves, where), curves.periods, edge_mm)
    state.rings = polylines_of(where)
    state.points = np.concatenate(mapped.images(curves, where))
    return where
