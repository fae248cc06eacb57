"""Refuse what a scene cannot ask for, whoever reads it."""

from __future__ import annotations

from pathlib import Path

from knotfab.base.errors import InputError, SceneError
from knotfab.knots import read_start
from knotfab_formats.knot_names import parse_knot_name
from knotfab_formats.scene import Printer, ResolvedScene

__all__ = [
    "require_mount",
    "require_radius",
    "require_several",
    "require_start",
    "require_tube",
    "require_walls",
]


def require_mount(scene: ResolvedScene) -> None:
    """Refuse a mount that cannot be, before any work is done.

    Raises:
        InputError: a wall mount of a piece with several views, or on a wall that is not flat.
    """
    if scene.mount.kind == "wall" and any(v.wall_radius_mm is not None for v in scene.views):
        raise InputError(
            "a wall mount (--mount wall)",
            "plate, pegs and drilling template are for a flat wall, and this one is round",
            "Use --mount stand, or none",
        )
    if scene.mount.kind == "wall" and len(scene.views) > 1:
        raise InputError(
            "a wall mount (--mount wall)",
            f"this piece has {len(scene.views)} views: pegs that run along one light's rays stand in the "
            "picture of the other",
            "Use --mount stand, whose base lies below all pictures, or hang",
        )


def require_walls(scene: ResolvedScene) -> None:
    """Refuse what a round wall cannot have.

    Raises:
        InputError: a mount on it, an eye before it, or a view that is yet to be found.
    """
    if all(view.wall_radius_mm is None for view in scene.views):
        return
    require_mount(scene)
    what = "scene key views.wall_radius_mm"
    if any(v.kind == "eye" and v.wall_radius_mm is not None for v in scene.views):
        raise InputError(
            what,
            "an eye sees the piece itself, in a flat frame, and no shadow on a wall",
            "Leave it out of the views of an eye",
        )
    if scene.settings.free_view:
        raise InputError(
            what,
            "where a round wall has the picture depends on where lamp and wall are, which a free view is yet "
            "to find (--free)",
            "Leave one of the two out",
        )


def require_several(scene: ResolvedScene) -> None:
    """Refuse what several views cannot have, for a physical reason.

    Raises:
        InputError: naming the key and what to do.
    """
    if scene.piece.depth is not None:
        raise InputError(
            "scene key piece.depth",
            "with several views the pictures decide the depth: what is deep for one light is wide in the "
            "picture of another",
            'Leave it out, or write "auto"; [region] size_mm bounds the piece',
        )
    require_mount(scene)


def require_start(scene: ResolvedScene) -> None:
    """Refuse a start that the search cannot go on from.

    Raises:
        InputError: it is no file of knots in the scene, or holds not the knot that is asked for.
    """
    name = scene.settings.start
    if not isinstance(name, str) or not name:
        return
    if scene.settings.free_view:
        raise InputError(
            "a free view (--free view)",
            "a search that goes on from knots keeps the view that they were made for",
            "Leave it out, or leave out --start",
        )
    types = [knot.type for knot in read_start(Path(name)).knots]
    wanted = parse_knot_name(scene.piece.knot).promise
    if wanted not in types:
        raise InputError(
            f"a start of {', '.join(sorted(set(types)))} (--start)",
            f"the knot that is asked for, {wanted}, is none of them, and no step of a search changes a type",
            "Leave out --knot, or leave out --start",
        )


def require_tube(scene: ResolvedScene) -> None:
    """Refuse a tube that the printer cannot make.

    Args:
        scene: with its printer's figures.

    Raises:
        SceneError: it is too thin.
    """
    radius = scene.piece.tube_radius_mm
    if radius is not None:
        require_radius(radius, scene.printer, "scene key piece.tube_radius_mm")


def require_radius(radius: float, printer: Printer, what: str) -> None:
    """Require the same of a radius, mm, that `what` asks for."""
    if radius < printer.min_tube_radius_mm:
        raise SceneError(
            what,
            f"{radius:g} mm is thinner than {printer.name} prints",
            f"Use at least {printer.min_tube_radius_mm:g} mm, or another printer",
        )
