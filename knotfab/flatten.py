"""Where no pose keeps the printer's limit for supports: the same piece again, with less depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotfab.design.design import Design, design_knots
from knotfab.part.assemble import Part, part_of, rules_of
from knotfab.part.flatter import Flattening, flatter_depth
from knotfab.progress import Progress
from knotfab.request import Request
from knotfab.scene.camera import view_axes
from knotfab.target.read import Target

__all__ = ["flatten"]

ROUNDS = 2  # of searching anew


def flatten(
    request: Request, target: Target, made: Design, part: Part, progress: Progress
) -> tuple[Design, Part, Flattening | None]:
    """Search again at the depth that an estimate proposes, where the scene leaves the depth open.

    A depth that the scene gives, knots to start from, and a time budget are not overruled: then there is a
    proposal only.
    """
    first = _depth_mm(made)
    proposal = _propose_depth(made, part) if request.printing else None
    if proposal is None:
        return made, part, None
    given = request.scene.search.get("start")  # whose depth is as it is
    if request.scene.piece.depth == "auto" and request.time_budget_s is None and not given:
        choice = made.radius
        for _ in range(ROUNDS):
            piece = request.scene.piece.model_copy(
                update={"depth": proposal, "tube_radius_mm": made.knots.radius_mm}
            )
            scene = request.scene.model_copy(update={"piece": piece})
            made = replace(design_knots(scene, [target], request.device, progress), radius=choice)
            part = part_of(made, request.printing, [target], progress)
            proposal = _propose_depth(made, part)
            if proposal is None:
                break
    return made, part, Flattening(first, _depth_mm(made), proposal)


def _propose_depth(made: Design, part: Part) -> float | None:
    account = part.pose.account
    if account is None or account.within or made.scene.piece.depth == "flat":
        return None
    return flatter_depth(made.knots, _depth_mm(made), rules_of(made.scene))


def _depth_mm(made: Design) -> float:
    return float(np.ptp(made.knots.points @ view_axes(made.scene.views[0])[2]))
