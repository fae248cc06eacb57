"""Designs that were never searched: a view, its world and some points, which is all that effects ask for."""

from types import SimpleNamespace
from typing import Any

from knotfab.base.arrays import Array
from knotfab.effects.base import EffectContext, World
from knotfab.effects.survey import survey
from knotfab.knots import Knot, Knots
from knotfab_formats.piece import Mount
from knotfab_formats.scene import ResolvedView


def view(**keys: Any) -> ResolvedView:
    frame = {"frame_width_mm": 180.0, "frame_height_mm": 180.0}
    return ResolvedView.model_validate({**frame, **keys})


def design_under(world: World, points: Array) -> Any:
    """A design of a tube of 2 mm radius about points (n, 3), with a tolerance of a quarter of a pixel."""
    scene = SimpleNamespace(
        views=(view(),),
        placing=world.placing,
        room=world.room,
        material=world.material,
        printer=world.printer,
        mount=Mount(),
        hangs=lambda knots: False,
    )
    effects = survey(EffectContext((view(),), points, 2.0, 0.25, world), {})
    return SimpleNamespace(
        result=SimpleNamespace(effects=effects),
        settings=SimpleNamespace(tolerance_px=0.25, mesh_sides=24),
        scene=scene,
        knots=Knots((Knot(points),), 2.0),
    )
