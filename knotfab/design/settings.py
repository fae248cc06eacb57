"""Settings that suit what is asked: how smoothly knots run, how fine pictures are, how many steps."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from knotfab.design.candidates import line_radius
from knotfab.design.question import Question
from knotfab.geometry.tube import sides_for
from knotfab.problem import Problem, ViewNumbers
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Accuracy
from knotfab_formats.scene import VERIFIED_PX, ResolvedScene
from knotfab_formats.search import SearchSettings

# factors of the preset's grace, and what it counts, beside filled areas of one picture
GRACE = {
    "lines": (4.0, "curves"),  # a line shows every wave of its tube
    "wire": (10.0, "bends"),  # every one is to be made by hand
    "several": (2.65, "curves"),  # several pictures pull together, and wrinkle strands more
}
_LINE_PX = 5.0  # px of the fine picture to the width of a line


def suit(settings: SearchSettings, question: Question, given: Collection[str]) -> SearchSettings:
    """Return the settings for this question; those of the names `given` stay as they are.

    A build's own scene gives all of them: what is resolved once means the same again.
    """
    views = question.problem.views
    asks: str = question.scene.material.process
    suited = settings
    if len(views) > 1:  # each adds wishes that pull against the others'
        asks, suited = "several", settings.scaled(len(views))
    elif views[0].lines:
        asks, suited = "lines", settings.but(**_fine_lines(settings, question))
    factor, kind = GRACE.get(asks, (1.0, settings.grace_of))
    update = {**suited.model_dump(), "grace": factor * settings.grace, "grace_of": kind}
    return settings.but(**{k: v for k, v in update.items() if k not in given})


def _fine_lines(settings: SearchSettings, question: Question) -> dict[str, int]:
    """Return pictures fine enough for lines, which are thinner than what the presets were measured on."""
    view = question.views[0]
    pixels = _LINE_PX * view.longer_mm / (2.0 * line_radius(view) * view.magnification)
    return {
        "fine_px": max(settings.fine_px, min(round(pixels), VERIFIED_PX)),
        "coarse_px": max(settings.coarse_px, min(round(0.5 * pixels), VERIFIED_PX)),
    }


def fine_enough(
    settings: SearchSettings, radius_mm: float, bend_mm: float, allowed_mm: float
) -> SearchSettings:
    """Return the settings with facets and vertices close enough for the outline to stay within `allowed_mm`.

    A ring of m corners stands out from the round tube by r a² / 12, a = 2 pi / m, and a mitre between
    edges e that turn by the most a bend radius R allows, tan(angle / 2) = e / 2R, by
    r (sqrt(1 + (e / 2R)²) - 1). The first may take a third and the second a half; the rest is for
    edges that are not quite even.
    """
    edge = 2.0 * bend_mm * float(np.sqrt((1.0 + 0.5 * allowed_mm / radius_mm) ** 2 - 1.0))
    return settings.but(
        mesh_sides=max(settings.mesh_sides, sides_for(radius_mm, allowed_mm / 3)),
        settle_edge_radii=min(settings.settle_edge_radii, max(0.1, round(edge / radius_mm, 4))),
    )


def outline_px(accuracy: Accuracy, settings: SearchSettings) -> float:
    """Return how far the file's shadow may be off the exact tube's: the scene's word, or the accuracy's."""
    asked = accuracy.max_outline_error_px
    return settings.outline_px if asked is None else asked


# A scene whose views are free (`[search] free_view`): where the unknown pose or directions start.


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
    device: str = "cpu",
) -> tuple[Any, SearchSettings]:
    """Return the pose of the one view as an unknown, and the settings that say where it started.

    A tube radius (mm) that the scene gives is kept, and that of a wire.
    """
    given = scene.piece.tube_radius_mm is not None and not settings.free_radius_mm
    view = problem.views[0].view
    start = ViewNumbers(view.light_distance_mm, view.wall_distance_mm, radius)
    from knotfab.search.free_pose import ALL, Bounds, FreePose

    free = tuple(name for name in ALL if name != "radius" or not given)
    bounds = Bounds(free, least_radius_mm=scene.printer.min_tube_radius_mm)
    pose = FreePose(start, bounds, device=device)
    if not given:
        settings = settings.but(free_radius_mm=radius)
    return pose, settings
