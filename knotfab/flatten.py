"""Where no pose keeps the printer's limit for supports, or no pegs hold it: the same piece again, flatter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from knotfab.design.design import Design, design_knots
from knotfab.mount.nearer import Place, propose_place
from knotfab.mount.piece_frame import Stiffness
from knotfab.mount.wall import NotHeldError
from knotfab.part.assemble import Part, part_of, rules_of
from knotfab.part.flatter import Flattening, flatter_depth
from knotfab.progress import Progress
from knotfab.request import Request
from knotfab.scene.camera import view_axes
from knotfab.target.read import Target

__all__ = ["flatten"]

ROUNDS = 2  # of searching anew


def flatten(
    request: Request, target: Target, made: Design, progress: Progress
) -> tuple[Design, Part, Flattening | None]:
    """The part of a design; searched again, where the scene leaves that open, as an estimate proposes.

    With less depth for supports; before a nearer wall, and with less depth if need be, for a mount on
    pegs. A depth and a wall that the scene gives, knots to start from, and a time budget are not overruled:
    then there is a proposal only.

    Raises:
        SceneError: no part can be made of it.
    """
    shallower, nearer = _open(request)
    first, unheld, proposal = made, "", None
    for left in range(ROUNDS, -1, -1):
        settled = not (left and (shallower or nearer))
        try:
            part = part_of(made, request.printing, [target], progress, thoroughly=settled)
        except NotHeldError as error:
            if settled:
                raise
            with progress.stage("mount"):
                place = _propose_place(made, shallower, nearer)
            if place is not None:
                unheld = unheld or error.why
                progress.say(
                    f"{error.why}: searched again, {place.depth_mm:.0f} mm deep and "
                    f"{place.wall_mm:.0f} mm from the wall"
                )
                made = _search(request, target, made, place, progress)
                continue
            part = part_of(made, request.printing, [target], progress)
        proposal = _propose_depth(made, part) if request.printing else None
        if proposal is None or not (left and shallower):
            break
        made = _search(request, target, made, Place(proposal, _wall_mm(made)), progress)
    if proposal is None and made is first:
        return made, part, None
    walls = _wall_mm(first), _wall_mm(made)
    return made, part, Flattening(_depth_mm(first), _depth_mm(made), proposal, unheld, walls)


def _open(request: Request) -> tuple[bool, bool]:
    """Whether another depth may be taken, and another distance to the wall."""
    scene = request.scene
    free = request.printing and request.time_budget_s is None and not scene.search.get("start")
    wall = "wall_distance_mm" not in scene.views[0].model_fields_set
    return free and scene.piece.depth == "auto", free and wall


def _search(
    request: Request, target: Target, made: Design, place: Place, progress: Progress
) -> Design:
    """The design at another place; its tube is chosen anew where the wall, and so the size, differs."""
    same = place.wall_mm == _wall_mm(made)
    radius = made.knots.radius_mm if same else request.scene.piece.tube_radius_mm
    piece = request.scene.piece.model_copy(
        update={"depth": place.depth_mm, "tube_radius_mm": radius}
    )
    view = request.scene.views[0].model_copy(update={"wall_distance_mm": place.wall_mm})
    scene = request.scene.model_copy(update={"piece": piece, "views": (view,)})
    again = design_knots(scene, [target], request.device, progress)
    return replace(again, radius=made.radius) if same else again


def _propose_place(made: Design, shallower: bool, nearer: bool) -> Place | None:
    material, limit = made.scene.material, made.scene.mount.max_sag_mm
    return propose_place(
        made.knots,
        made.scene.views[0],
        made.scene.piece.clearance_mm,
        Stiffness(material.young_modulus_mpa, material.density_g_cm3, limit),
        shallower=shallower,
        nearer=nearer,
    )


def _propose_depth(made: Design, part: Part) -> float | None:
    account = part.pose.account
    if account is None or account.within or made.scene.piece.depth == "flat":
        return None
    return flatter_depth(made.knots, _depth_mm(made), rules_of(made.scene))


def _depth_mm(made: Design) -> float:
    return float(np.ptp(made.knots.points @ view_axes(made.scene.views[0])[2]))


def _wall_mm(made: Design) -> float:
    return made.scene.views[0].wall_distance_mm
