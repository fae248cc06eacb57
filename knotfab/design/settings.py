"""Adapt the search settings to a question: smoothness, resolution, iterations, and free views."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from knotfab.design.candidates import line_radius
from knotfab.design.question import Question
from knotfab.geometry.tube import sides_for
from knotfab.problem import Problem, ViewNumbers
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Accuracy
from knotfab_formats.scene import VERIFIED_PX, ResolvedScene, ResolvedView
from knotfab_formats.search import SearchSettings

# factor on the preset's grace, except for filled areas of one picture
GRACE_OF_LINES = 4.0  # a line shows every wave of its tube
GRACE_OF_SEVERAL = 2.65  # several pictures pull at strands and wrinkle them
_LINE_PX = 5.0  # width of a line in the fine picture


def suit_settings(
    settings: SearchSettings, question: Question, given: Collection[str]
) -> SearchSettings:
    """Return the settings that suit this question; the keys in `given` keep their values.

    The scene that a build has written gives all keys, so a rebuild uses the same values.
    """
    views = question.problem.views
    factor, suited = 1.0, settings
    if len(views) > 1:
        factor, suited = GRACE_OF_SEVERAL, settings.scaled(len(views))
    elif views[0].lines:
        factor, suited = GRACE_OF_LINES, settings.but(**_fine_lines(settings, question))
    update = {**suited.model_dump(), "grace": factor * settings.grace}
    return settings.but(**{k: v for k, v in update.items() if k not in given})


def _fine_lines(settings: SearchSettings, question: Question) -> dict[str, int]:
    """Return resolutions fine enough for lines, which are thinner than the presets assume."""
    view = question.views[0]
    pixels = _LINE_PX * view.longer_mm / (2.0 * line_radius(view) * view.magnification)
    return {
        "fine_px": max(settings.fine_px, min(round(pixels), VERIFIED_PX)),
        "coarse_px": max(settings.coarse_px, min(round(0.5 * pixels), VERIFIED_PX)),
    }


def refine_mesh(
    settings: SearchSettings, radius_mm: float, bend_mm: float, allowed_mm: float
) -> SearchSettings:
    """Refine facets and vertices until the outline's error stays within `allowed_mm`.

    A ring of m corners exceeds the round tube by r a² / 12, with a = 2 pi / m. A mitre between edges e at
    bend radius R, with tan(angle / 2) = e / 2R, exceeds it by r (sqrt(1 + (e / 2R)²) - 1). They may use a
    third and a half of the error; uneven edges take the rest.
    """
    edge = 2.0 * bend_mm * float(np.sqrt((1.0 + 0.5 * allowed_mm / radius_mm) ** 2 - 1.0))
    return settings.but(
        mesh_sides=max(settings.mesh_sides, sides_for(radius_mm, allowed_mm / 3)),
        settle_edge_radii=min(settings.settle_edge_radii, max(0.1, round(edge / radius_mm, 4))),
    )


def outline_px(accuracy: Accuracy, settings: SearchSettings) -> float:
    """Return the largest error allowed to the file's shadow, px: the scene's, or else the preset's."""
    asked = accuracy.max_outline_error_px
    return settings.outline_px if asked is None else asked


def outline_mm(
    views: Sequence[ResolvedView], limit_px: float, depth_mm: float, radius_mm: float
) -> float:
    """Return how far a mesh may stand out of the exact tube, mm, for an error of so many px in any view."""
    allowed = []
    for view in views:
        light = view.light_distance_mm
        # the part nearest to the light casts the largest shadow; where that is unknown, a fifth of the way
        front = 0.2 * light if len(views) > 1 else 0.5 * depth_mm + radius_mm
        largest = (light + view.wall_distance_mm) / max(light - front, 0.1 * light)
        allowed.append(limit_px * view.pixel_mm / largest)
    return min(allowed)


# Starting values of free views (`[search] free_view`).


def place_start(
    scene: ResolvedScene, settings: SearchSettings
) -> tuple[ResolvedScene, SearchSettings]:
    """Set distances and radius to those from which the search for a free view starts.

    The scene that a build has written holds the numbers found, and its settings those that the search started
    from, so a rebuild starts there again.

    Raises:
        InputError: the scene turns the view, although its direction is to be found.
    """
    (view,) = scene.views
    if view.azimuth_deg or view.elevation_deg:
        raise InputError(
            "a free view (--free view)",
            f"the view has azimuth_deg = {view.azimuth_deg:g} and elevation_deg = {view.elevation_deg:g}, "
            "and which way a piece is turned is what is looked for",
            "Leave these two keys out, or leave out --free",
        )
    light = settings.free_light_mm or view.light_distance_mm
    wall = settings.free_wall_mm or view.wall_distance_mm
    settings = settings.but(free_light_mm=light, free_wall_mm=wall)
    view = view.but(light_distance_mm=light, wall_distance_mm=wall)
    update: dict[str, object] = {"views": (view,)}
    if settings.free_radius_mm:
        bend, found = scene.material.min_bend_radius_mm, scene.piece.tube_radius_mm
        if bend and found and bend <= found + 0.5 * scene.piece.clearance_mm:
            # this limit followed from the radius found, so let it follow again
            update["material"] = scene.material.but(min_bend_radius_mm=None)
        radius = {"tube_radius_mm": settings.free_radius_mm}
        update["piece"] = scene.piece.but(**radius)
    return scene.but(**update), settings


def place_directions(
    scene: ResolvedScene, settings: SearchSettings
) -> tuple[ResolvedScene, SearchSettings]:
    """Enter in scene and settings the directions that a search for several free views starts from.

    Elevations are free unless the piece turns under one lamp.

    Raises:
        InputError: the number of angles in the settings differs from that of the views.
    """
    views = scene.views
    keys = {"free_azimuths_deg": "azimuth_deg", "free_elevations_deg": "elevation_deg"}
    if settings.free_azimuths_deg:
        for key, angle in keys.items():
            if getattr(settings, key):
                starts = _angles(key, getattr(settings, key), len(views))
                pairs = zip(views, starts, strict=True)
                views = tuple(v.but(**{angle: a}) for v, a in pairs)
        return scene.but(views=views), settings
    if scene.mount.kind in ("stand", "hang"):
        del keys["free_elevations_deg"]
    starts_deg = {
        key: " ".join(f"{getattr(view, angle)!r}" for view in views) for key, angle in keys.items()
    }
    return scene, settings.but(**starts_deg)


def _angles(key: str, text: str, count: int) -> list[float]:
    """Read the angles that a key holds, one a view.

    Raises:
        InputError: there are not so many.
    """
    try:
        angles = [float(word) for word in text.split()]
    except ValueError:
        angles = []
    if len(angles) != count:
        raise InputError(
            f"scene key [search] {key} = {text!r}",
            f"it is to hold a number for each of the {count} views, with spaces between them",
            "Leave it out: the search then starts where the views are",
        )
    return angles


def start_pose(
    scene: ResolvedScene, problem: Problem, radius: float, settings: SearchSettings
) -> tuple[Any, SearchSettings]:
    """Return the pose of a single free view, and the settings that record where it starts.

    A tube radius (mm) that the scene gives is kept, unless the settings free it.
    """
    given = scene.piece.tube_radius_mm is not None and not settings.free_radius_mm
    view = problem.views[0].view
    start = ViewNumbers(view.light_distance_mm, view.wall_distance_mm, radius)
    from knotfab.search.free_pose import ALL, Bounds, FreePose

    free = tuple(name for name in ALL if name != "radius" or not given)
    bounds = Bounds(free, least_radius_mm=scene.printer.min_tube_radius_mm)
    pose = FreePose(start, bounds)
    if not given:
        settings = settings.but(free_radius_mm=radius)
    return pose, settings


def without_arches(scene: ResolvedScene) -> ResolvedScene:
    """Return the scene with the slicer's supports and no mount, so that strands run as they look best."""
    piece = scene.piece.but(supports="slicer")
    return scene.but(piece=piece, mount=scene.mount.but(kind="none"))


def fix_view(scene: ResolvedScene, found: ResolvedView, radius_mm: float) -> ResolvedScene:
    """Enter the view that a search has found, and mark it as no longer free.

    For a piece that stands in a plate on the wall, the wall's distance stays as it is.
    """
    keys = {"light_distance_mm": found.light_distance_mm}
    if not scene.mount.on_feet:
        keys["wall_distance_mm"] = found.wall_distance_mm
    return scene.but(
        views=(scene.views[0].but(**keys),),
        piece=scene.piece.but(tube_radius_mm=radius_mm),
        search={**scene.search, "free_view": False},
    )
