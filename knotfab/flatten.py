"""Where no pose keeps the printer's limit for supports: the same piece again, with less depth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from knotfab.design.design import Design, design_knots
from knotfab.part.assemble import Part, part_of, rules_of
from knotfab.part.flatter import flatter_depth
from knotfab.progress import Progress
from knotfab.target.read import Target

if TYPE_CHECKING:
    from knotfab.pipeline import Request

__all__ = ["Flattening", "flattened"]

ROUNDS = 2  # of searching anew


@dataclass(frozen=True)
class Flattening:
    """What was done about supports beyond the limit: depths in mm.

    `from_mm` is the depth of the first search, `to_mm` of the one that was kept (equal where
    none followed), and `proposed_mm` what the kept one would still need, None where nothing.
    """

    from_mm: float
    to_mm: float
    proposed_mm: float | None


def flattened(
    request: Request, target: Target, made: Design, part: Part, progress: Progress
) -> tuple[Design, Part, Flattening | None]:
    """Search again at the depth that an estimate proposes, where the scene leaves the depth open.

    A depth that the scene gives, or a time budget, is not overruled: then there is a proposal only.
    """
    first = _depth(made)
    proposal = _proposal(made, part) if request.printing else None
    if proposal is None:
        return made, part, None
    if request.scene.piece.depth == "auto" and request.time_budget_s is None:
        choice = made.radius
        for _ in range(ROUNDS):
            piece = request.scene.piece.model_copy(
                update={"depth": proposal, "tube_radius_mm": made.knots.radius_mm}
            )
            scene = request.scene.model_copy(update={"piece": piece})
            made = replace(design_knots(scene, [target], request.device, progress), radius=choice)
            part = part_of(made, request.printing, target, progress)
            proposal = _proposal(made, part)
            if proposal is None:
                break
    return made, part, Flattening(first, _depth(made), proposal)


def _proposal(made: Design, part: Part) -> float | None:
    account = part.pose.account
    if account is None or account.within or made.scene.piece.depth == "flat":
        return None
    return flatter_depth(made.knots, _depth(made), rules_of(made.scene))


def _depth(made: Design) -> float:
    return float(np.ptp(made.knots.points[:, 2]))
