"""Refusals of what no search, mount or print can meet, before any work is done."""

from __future__ import annotations

from pathlib import Path

from knotfab.base.errors import SceneError
from knotfab.knots import read_start
from knotfab_formats.errors import InputError
from knotfab_formats.knots import parse_knot_name
from knotfab_formats.piece import Printer
from knotfab_formats.scene import MOST_VIEWS, ResolvedScene


def require_mount(scene: ResolvedScene) -> None:
    """Refuse an impossible mount before any work is done.

    Raises:
        InputError: a wall mount of a piece with several views.
    """
    if scene.mount.kind == "wall" and len(scene.views) > 1:
        raise InputError(
            "a wall mount (--mount wall)",
            f"this piece has {len(scene.views)} views: pegs that run along one light's rays stand in the "
            "picture of the other",
            "Use --mount stand, whose base lies below all pictures, or --mount hang",
        )


def require_several(scene: ResolvedScene) -> None:
    """Refuse settings that several views exclude for a physical reason, and too many views.

    Raises:
        InputError: naming the key and what to do.
    """
    if len(scene.views) > MOST_VIEWS:
        raise InputError(
            f"{len(scene.views)} pictures for one part",
            f"half a turn is all that they have, and more than {MOST_VIEWS} leave each other nothing",
            "Give fewer, or add --sequence for one part each",
        )
    if scene.piece.depth is not None:
        raise InputError(
            "a depth (--depth)",
            "with several views the pictures decide the depth: what is deep for one light is wide in the "
            "picture of another",
            'Leave it out, or write "auto"; [region] size_mm bounds the piece',
        )
    require_supports(scene)
    require_mount(scene)


def require_supports(scene: ResolvedScene) -> None:
    """Refuse `supports = "none"` where a piece could not stand without them, or never needs them.

    Raises:
        InputError: `why_supported`.
    """
    if scene.piece.supports == "none" and (why := why_supported(scene)) is not None:
        raise InputError(name_standing(scene), *why)


def name_standing(scene: ResolvedScene) -> str:
    """Name a piece that is to print without supports, by the option that asks for it."""
    if scene.mount.on_feet:
        return f"a piece on its own feet, without supports (--plate {scene.mount.plate})"
    return "a piece without supports (--supports none)"


def why_supported(scene: ResolvedScene) -> tuple[str, str] | None:
    """Say why no piece of this scene can print without supports, and the remedy; None if one may.

    That is so for a material or printer other than filament, a flat piece, several views, and a mount that
    holds the piece off the bed.
    """
    process = next(
        (p for p in (scene.material.process, scene.printer.process) if p != "filament"), None
    )
    why = {
        "resin": "resin hangs from a plate while it hardens, and only supports hold it there",
        "powder": "powder carries a piece wherever it lies, and no supports are printed",
    }.get(process or "")
    leave = "Leave it out"
    if why is not None:
        return why, leave
    if scene.piece.depth == 0:
        return (
            "a flat piece has no depth for the arches in which its strands would stand",
            "Leave out --depth, or leave out --supports: what is flat lies on the bed with few supports",
        )
    if len(scene.views) > 1:
        return (
            "strands stand on the bed in arches along one light's axis, and the picture of another light "
            "fixes their height",
            "Leave it out, or give one picture",
        )
    if scene.mount.kind == "hang":
        return None  # its eyelets stand on posts that rise from strands
    if (scene.mount.asked or scene.mount.plate == "pegs") and not scene.mount.on_feet:
        held = "a stand holds" if scene.mount.kind == "stand" else "pegs hold"
        return (
            f"{held} it off the bed, and its strands would begin in mid-air",
            "Leave out --mount, and it stands by its own feet"
            if scene.mount.kind == "stand"
            else "Use --plate roots or --plate rounded, in which it stands by its own feet",
        )
    return None


def stand_alone(scene: ResolvedScene, knots: int) -> ResolvedScene:
    """Return the scene of a piece that prints without supports: on a flat wall it stands in roots.

    If the scene gives the wall's distance, only several loose knots do.
    """
    mount, view = scene.mount, scene.views[0]
    near = scene.is_one_shadow and "wall_distance_mm" not in view.model_fields_set
    plain = not view.wall_tilt_deg and mount.foot != "dowel"
    if plain and mount.plate == "auto" and scene.on_wall(max(knots, 2) if near else knots):
        mount = mount.but(plate="roots")
    elif mount.plate == "none":
        mount = mount.but(kind="none")
    return scene.but(piece=scene.piece.but(supports="none"), mount=mount)


def require_start(scene: ResolvedScene) -> None:
    """Refuse a start from which the search cannot go on.

    Raises:
        InputError: it is not a file of knots in the scene, or lacks the requested knot.
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
    """Refuse a radius, mm, wanted by `what`, that is too thin for the printer."""
    if radius < printer.min_tube_radius_mm:
        raise SceneError(
            what,
            f"{radius:g} mm is thinner than {printer.name} prints",
            f"Use at least --tube-radius {printer.min_tube_radius_mm:g}, or another --printer",
        )


def require_sequence(scene: ResolvedScene) -> None:
    """Refuse settings that a sequence excludes or does not support.

    Raises:
        InputError: naming the key and what to do.
    """
    if len(scene.views) != 1:
        raise InputError(
            "the scene",
            f"it has {len(scene.views)} views, and a sequence is seen from one side",
            "Leave one [[views]] in it, or leave out --sequence",
        )
    if scene.material.shrinkage_percent:
        raise InputError(
            "scene key material.shrinkage_percent",
            "the frames on their ring are written as they are to be",
            "Leave it out and scale by the slicer, or leave out --sequence",
        )
    if scene.settings.start:
        raise InputError(
            "a start (--start)",
            "a sequence begins with a template of its first frame",
            "Leave it out, or leave out --sequence",
        )
