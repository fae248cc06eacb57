"""A PrusaSlicer profile from the scene's printer and material, and whether one can be made."""

from __future__ import annotations

import re
from pathlib import Path

from knotfab.part.slicer_process import find_slicer, read_version
from knotfab_formats.print_figures import SlicerWarning
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.slicer_ini import (
    PROFILE,
    change_above,
    imply_settings,
    layers_of_plate,
    line_width_mm,
)


def why_not_sliced(scene: ResolvedScene) -> str | None:
    """Say why a filament slicer cannot judge this piece; None if it can."""
    resin = "resin" in (scene.material.process, scene.printer.process)
    # narrower is the spot of a laser or a pixel of a screen, not a nozzle
    if resin or scene.printer.nozzle_mm < 0.1:
        return "resin: only its own slicer can say"
    if scene.printer.process == "powder":
        return "powder: no supports, and those who print it pack it"
    return None


def line_width(scene: ResolvedScene) -> float:
    """Return the width of every printed line, mm."""
    return line_width_mm(scene.printer.nozzle_mm)


def profile(scene: ResolvedScene, program: str | None = None) -> dict[str, str]:
    """Return the settings for a print of this scene, with supports that the `program` can grow."""
    asked = scene.printer, scene.material, scene.mount, scene.piece.tube_radius_mm
    return imply_settings(*asked, scene.piece.supports == "none", _support_style(program))


def _support_style(program: str | None) -> str:
    """Choose branches, which touch only a strand's underside, or else walls no wider than it.

    A grid would widen the supports to its cells, at twice the filament. A version without branches would
    refuse the file.
    """
    version = None if program is None else read_version(program)
    return "organic" if version is not None and version >= (2, 6) else "snug"  # PrusaSlicer


def write_profile(folder: Path, scene: ResolvedScene) -> None:
    """Write slicer.ini for this machine's PrusaSlicer, unless a filament slicer cannot judge the piece."""
    if why_not_sliced(scene) is None:
        found = profile(scene, find_slicer()).items()
        text = "".join(f"{key} = {value}\n" for key, value in found) + _tell_change(scene)
        (folder / PROFILE).write_text(text, encoding="utf-8")


def _tell_change(scene: ResolvedScene) -> str:
    """Write comments that offer a change of filament above the plate in which a piece stands."""
    if not scene.mount.on_feet or scene.mount.before_wall_mm:
        return ""
    layers = layers_of_plate(scene.printer, scene.material, scene.mount)
    return (
        "# A light screen and a dark piece: with this before_layer_gcode in place of that above, printers\n"
        f"# that know M600 ask for other filament above the plate, before layer {layers + 1}.\n"
        f"# before_layer_gcode = {change_above(layers)}\n"
    )


def read_profile(folder: Path) -> dict[str, str]:
    """Read the settings that `write_profile` wrote."""
    lines = (folder / PROFILE).read_text(encoding="utf-8").splitlines()
    return dict(line.split(" = ", 1) for line in lines if not line.startswith("#"))


# PrusaSlicer's warnings, and the answer of knotfab's own checks to each.


# The first pattern found in the text decides; the words are those of versions 2.5 to 2.9.
_KNOWN: tuple[tuple[str, str, bool], ...] = (
    (
        r"Empty layer between",
        "layers in which nothing is laid: what is above them hangs in the air, or is thinner than a "
        "line",
        False,
    ),
    (
        r"no extrusions in the first layer",
        "a body that does not reach the bed, or is thinner than a line there",
        False,
    ),
    (
        r"overlapping or self-intersecting facets",
        "it met a layer's outline that touches itself; knotfab's exact test of the mesh for "
        "self-intersections is what decides, and the lines laid were compared with the surface",
        True,
    ),
    (
        r"(?s)stability issues.*Floating object part",
        "a piece that begins in the air: without supports it cannot be printed",
        False,
    ),
    (
        r"stability issues|Consider enabling supports",
        "overhangs, bridges and standing are measured on the mesh against the printer's own limits: "
        "see the checks of the part's printability",
        True,
    ),
    (
        r"Low bed adhesion|Consider enabling brim",
        "little of a tube touches the bed: print it with a brim",
        True,
    ),
    (
        r"Gtk|GLib|dconf|libEGL|MESA|X11|[Dd]isplay|locale",
        "of the window system or the language of this machine, not of the part",
        True,
    ),
)

_PROGRESS = re.compile(r"^\d+ => |^Slicing result exported to |^\[\d{4}-.*\[(trace|debug|info)\]")
_START = re.compile(r"^print(?:_object)? warning: ")


def explain_warning(text: str) -> SlicerWarning:
    """Add what is known about a warning."""
    for pattern, explanation, settled in _KNOWN:
        if re.search(pattern, text):
            return SlicerWarning(text, explanation, settled)
    return SlicerWarning(text)


def read_warnings(said: str) -> list[SlicerWarning]:
    """Read the warnings in what PrusaSlicer said: all that does not report progress.

    A warning runs over several lines, up to the next line of progress; a repeated one is listed
    once. Each line that belongs to no warning is listed by itself.
    """
    blocks: list[list[str]] = []
    inside = False
    for line in said.splitlines():
        if _PROGRESS.match(line):
            inside = False
        elif _START.match(line):
            blocks.append([_START.sub("", line)])
            inside = True
        elif line.strip():
            if inside:
                blocks[-1].append(line.strip())
            else:
                blocks.append([line.strip()])
    return [explain_warning(text) for text in dict.fromkeys("\n".join(block) for block in blocks)]
