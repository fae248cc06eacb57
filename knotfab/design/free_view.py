"""A scene whose view is free (`[search] free_view`): where its numbers start, and the search for them."""

from __future__ import annotations

from knotfab.errors import InputError
from knotfab.problem import Problem, Report
from knotfab.scene.model import Scene, View
from knotfab.scene.settings import SearchSettings
from knotfab.search.free_search import FreeSearch, free_search
from knotfab.search.pose import ALL, Bounds
from knotfab.start.filling import Template

__all__ = ["free_start", "freed"]


def free_start(
    scene: Scene, view: View, settings: SearchSettings, device: str, budget_s: float | None
) -> tuple[Scene, View, SearchSettings]:
    """The scene, its view and the settings with the numbers that the search starts from.

    A scene that a build has written holds the numbers that were found, and in its settings those that
    were started from: started there, the search finds the same again.

    Raises:
        InputError: with a method, device or time budget that a free view does not go with.
    """
    what = "a free view (--free view)"
    if settings.method != "flow":
        raise InputError(what, f"the search {settings.method!r} has none", "Use --search flow")
    if device != "cpu":
        raise InputError(what, f"it is not searched on {device}", "Use --device cpu")
    if budget_s is not None:
        raise InputError(
            what, "it goes with no time budget", "Leave out --time-budget, or use --accuracy draft"
        )
    view = view.model_copy(
        update={
            "light_distance_mm": settings.free_light_mm or view.light_distance_mm,
            "wall_distance_mm": settings.free_wall_mm or view.wall_distance_mm,
        }
    )
    if settings.free_radius_mm:
        bend, found = scene.material.min_bend_radius_mm, scene.piece.tube_radius_mm
        if bend != "auto" and found != "auto" and bend <= found + 0.5 * scene.piece.clearance_mm:
            # a limit that came from the radius found: it goes with the radius again
            material = scene.material.model_copy(update={"min_bend_radius_mm": "auto"})
            scene = scene.model_copy(update={"material": material})
        piece = scene.piece.model_copy(update={"tube_radius_mm": settings.free_radius_mm})
        scene = scene.model_copy(update={"piece": piece})
    settings = settings.model_copy(
        update={
            "free_light_mm": view.light_distance_mm,
            "free_wall_mm": view.wall_distance_mm,
        }
    )
    return scene, view, settings


def freed(
    scene: Scene,
    problem: Problem,
    template: Template,
    radius_mm: float,
    settings: SearchSettings,
    report: Report | None,
) -> tuple[FreeSearch, SearchSettings]:
    """Knots, view and radius found together, and the settings that say where they started."""
    given = scene.piece.tube_radius_mm != "auto" and not settings.free_radius_mm
    free = ALL if not given else tuple(name for name in ALL if name != "radius")
    bounds = Bounds(free, least_radius_mm=scene.printer.min_tube_radius_mm)
    found = free_search(problem, template, radius_mm, settings, bounds, report)
    if not given:
        settings = settings.model_copy(update={"free_radius_mm": radius_mm})
    return found, settings
