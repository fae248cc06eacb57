"""Repair a violated limit after the phases: stretches alone first, then the whole curve.

After a search of thousands of vertices a handful bend too tightly. A repair of the whole curve costs
the picture everywhere, and resampling it cuts new corners; these few stretches can be mended alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import Polylines
from knotfab.geometry.resample import subdivide
from knotfab.limits.feasibility import Feasibility
from knotfab.search.flow import FlowSettings
from knotfab.search.phases import Phase, Plan
from knotfab.search.state import SearchState, resample_state, run_phase

__all__ = ["find_stretches", "mend_stretches", "repair"]


_REACH = 4.0  # tube radii of a stretch about a violation
_ITERATIONS = 60
_STRETCHED = 0.87  # a share of the spacing: an edge half as long again as that is cut in two
_RATE, _RATE_END = 0.04, 0.005  # root-mean-square step of the vertices that move, in tube radii


def repair(state: SearchState, plan: Plan) -> None:
    """Mend and repair until every limit holds, or the plan's rounds are used up."""
    if plan.repairs == 0 or not state.wanting(state.points):
        return
    # most often a few bends are left, and the whole curve need not give way for them
    mended = mend_stretches(state, plan.repair(0), plan.mendings)
    while state.log.repairs < plan.repairs and state.wanting(state.points):
        resample_state(state, state.settings.settle_edge_radii * state.radius)
        phase = plan.repair(state.log.repairs)
        state.log.repairs += 1
        run_phase(state, phase, until_kept=True)
    state.log.repairs += mended


def mend_stretches(state: SearchState, phase: Phase, rounds: int) -> int:
    """Mend what violates a limit where it can be, by the weights of `phase`; the rounds that took.

    Every round lets go of the stretches that violate a limit then. Too great a length is no matter of
    a stretch, and stays. Steps are certified as everywhere. Edges that a round has stretched are cut in
    two: by the bend radius they may turn further, and their mitres would stand out.
    """
    edge_mm = _STRETCHED * state.settings.settle_edge_radii * state.radius
    for done in range(rounds):
        _cut_long_edges(state, edge_mm)
        feasibility = state.feasibility()
        loose = find_stretches(state.points, state.rings, feasibility)
        if not feasibility.violations or not loose.any():
            return done
        # the flow's rates are root mean squares over all vertices, moved or not
        share = float(np.sqrt(loose.mean()))
        walk = FlowSettings(iterations=_ITERATIONS, rate=_RATE * share, rate_end=_RATE_END * share)
        run_phase(state, replace(phase, walk=walk), until_kept=True, loose=loose)
    _cut_long_edges(state, edge_mm)
    return rounds


def _cut_long_edges(state: SearchState, edge_mm: float) -> None:
    if not state.keep_vertices:
        state.points, state.rings = subdivide(state.points, state.rings, edge_mm)


def find_stretches(points: Array, rings: Polylines, feasibility: Feasibility) -> NDArray[np.bool_]:
    """Find [N] True near a violated bend, the narrowest violated gap or the place furthest outside."""
    limits = feasibility.limits
    places = [points[bend_radii(points, rings) < limits.bend_radius]]
    if "clearance" in feasibility.broken:
        places.append(feasibility.gap_at[None])
    if "region" in feasibility.broken:
        places.append(feasibility.outside_at[None])
    every = np.concatenate(places)
    if len(every) == 0:
        return np.zeros(len(points), dtype=bool)
    apart, _ = cKDTree(every).query(points)
    return np.asarray(apart < _REACH * limits.radius)
