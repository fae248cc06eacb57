"""A scene whose views are free (`[search] free_view`): where the unknown pose or directions start."""

from __future__ import annotations

from typing import Any

from knotfab.base.errors import InputError
from knotfab.problem import Problem, ViewNumbers
from knotfab.render.forms import COMPILED, Forms
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.search import SearchSettings

__all__ = ["place_directions", "place_start", "start_pose"]


def place_start(
    scene: ResolvedScene, settings: SearchSettings
) -> tuple[ResolvedScene, SearchSettings]:
    """Return the scene and the settings with the numbers that the search starts from.

    A scene that a build has written holds the numbers that were found, and in its settings those that
    were started from: started there, the search finds the same again.

    Raises:
        InputError: the view is turned, where its turn is one of the unknowns.
    """
    (view,) = scene.views
    if view.azimuth_deg or view.elevation_deg:
        raise InputError(
            "a free view (--free view)",
            f"the view has azimuth_deg = {view.azimuth_deg:g} and elevation_deg = {view.elevation_deg:g}, "
            "and which way a piece is turned is what is looked for",
            "Leave these two keys out, or --free",
        )
    light = settings.free_light_mm or view.light_distance_mm
    wall = settings.free_wall_mm or view.wall_distance_mm
    settings = settings.but(free_light_mm=light, free_wall_mm=wall)
    view = view.but(light_distance_mm=light, wall_distance_mm=wall)
    update: dict[str, object] = {"views": (view,)}
    if settings.free_radius_mm:
        bend, found = scene.material.min_bend_radius_mm, scene.piece.tube_radius_mm
        if bend and found and bend <= found + 0.5 * scene.piece.clearance_mm:
            # a limit that came from the radius found: it goes with the radius again
            update["material"] = scene.material.but(min_bend_radius_mm=None)
        radius = {"tube_radius_mm": settings.free_radius_mm}
        update["piece"] = scene.piece.but(**radius)
    return scene.but(**update), settings


def place_directions(
    scene: ResolvedScene, settings: SearchSettings
) -> tuple[ResolvedScene, SearchSettings]:
    """Return the same of several views, of which the azimuths are unknown.

    Raises:
        InputError: the settings name not as many azimuths as there are views.
    """
    views = scene.views
    if settings.free_azimuths_deg:
        words = settings.free_azimuths_deg.split()
        try:
            starts = [float(word) for word in words]
        except ValueError:
            starts = []
        if len(starts) != len(views):
            raise InputError(
                f"scene key [search] free_azimuths_deg = {settings.free_azimuths_deg!r}",
                f"it is to hold a number for each of the {len(views)} views, with spaces between them",
                "Leave it out: the search then starts where the views are",
            )
        pairs = zip(views, starts, strict=True)
        views = tuple(v.but(azimuth_deg=a) for v, a in pairs)
        return scene.but(views=views), settings
    starts_deg = " ".join(f"{view.azimuth_deg!r}" for view in views)
    return scene, settings.but(free_azimuths_deg=starts_deg)


def start_pose(
    scene: ResolvedScene,
    problem: Problem,
    radius: float,
    settings: SearchSettings,
    forms: Forms = COMPILED,
) -> tuple[Any, SearchSettings]:
    """Return the pose of the one view as an unknown, and the settings that say where it started.

    A tube radius (mm) that the scene gives is kept, and that of a wire.
    """
    given = scene.piece.tube_radius_mm is not None and not settings.free_radius_mm
    view = problem.views[0].view
    start = ViewNumbers(view.light_distance_mm, view.wall_distance_mm, radius)
    pose = forms.free_pose(start, given, scene.printer.min_tube_radius_mm)
    if not given:
        settings = settings.but(free_radius_mm=radius)
    return pose, settings
