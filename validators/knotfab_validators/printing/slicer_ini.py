"""Check that the slicer's profile beside a part is the one that the scene implies."""

from __future__ import annotations

from math import inf
from pathlib import Path

from knotfab_formats.errors import short
from knotfab_formats.slicer_ini import (
    FULL,
    PROFILE,
    STYLES,
    change_above,
    count_full_loops,
    imply_settings,
    layers_of_plate,
    plan_walls,
    written_wall_mm,
)
from knotfab_formats.verdict import Check
from knotfab_validators.check import BadFile, read_bytes, skip_check
from knotfab_validators.files.scene import Scene

NAME = "slicer_ini"
MOST_BYTES = 100_000
MOST_SAID = 4  # keys that are named


def check_slicer_ini(scene: Scene, folder: Path, own: bool) -> Check:
    """Check `slicer_ini`: every setting is the scene's, and there is none besides.

    A profile of an earlier build, by which tubes print full, is the scene's too.

    Args:
        own: whether the part has the name of a build's; if not, the profile beside it may be for another.
    """
    path = folder / PROFILE
    if not own or not path.is_file():
        return skip_check(NAME, f"there is no {PROFILE} of this part")
    if scene.printer.stated("build_volume_mm") is None:
        return skip_check(NAME, "the scene names a printer without its figures")
    piece = scene.piece
    asked = (
        scene.printer,
        scene.material,
        scene.mount,
        piece.tube_radius_mm,
        piece.supports == "none",
    )
    wanted = {key: {value} for key, value in imply_settings(*asked, STYLES[0]).items()}
    wanted["support_material_style"] = set(STYLES)
    if scene.mount.on_feet:
        layers = layers_of_plate(scene.printer, scene.material, scene.mount)
        wanted["before_layer_gcode"].add(change_above(layers))
    try:
        lines = _read_lines(path)
    except (BadFile, UnicodeDecodeError) as error:
        return Check(NAME, "fail", True, "not read", None, "", short(str(error)))
    full = not any(line.startswith(FULL[0]) for line in lines)
    if full:
        wanted = {key: value for key, value in wanted.items() if key not in FULL}
        wanted["perimeters"] = {str(count_full_loops(scene.printer, piece.tube_radius_mm))}
        wanted["fill_density"] = {"15%"}
    wrong = []
    for line in lines:
        key, sign, value = (word.strip() for word in line.partition("="))
        allowed = wanted.pop(key, set()) if sign else set()
        if not allowed:
            wrong.append(f"{short(line)} is none of a build's settings")
        elif value not in allowed:
            wrong.append(f"{key} is {short(value)}, and by the scene {min(allowed) or 'empty'}")
    wrong += [f"{key} is missing" for key in wanted]
    if not wrong:
        return Check(
            NAME, "pass", True, 0.0, 0.0, "settings", f"of {PROFILE} that are not the scene's"
        )
    said = "; ".join(wrong[:MOST_SAID]) + ("; …" if len(wrong) > MOST_SAID else "")
    return Check(
        NAME, "fail", True, float(len(wrong)), 0.0, "settings", f"{PROFILE}: {said}: build it anew"
    )


def _read_lines(path: Path) -> list[str]:
    lines = (line.strip() for line in read_bytes(path, MOST_BYTES).decode("utf-8").splitlines())
    return [line for line in lines if line and line[0] not in "#;"]


def read_wall_mm(scene: Scene, folder: Path, own: bool) -> float:
    """Return how thick a tube's wall prints: by the profile beside the part, else by the scene's; inf: full.

    What cannot be read prints nothing that could be relied on: 0.
    """
    if {scene.printer.process, scene.material.process} != {"filament"}:
        return inf
    if not own or not (path := folder / PROFILE).is_file():
        return plan_walls(scene.printer, scene.piece.tube_radius_mm).thick_mm
    try:
        pairs = (line.partition("=") for line in _read_lines(path))
        return written_wall_mm({key.strip(): value.strip() for key, _, value in pairs})
    except (BadFile, ValueError):
        return 0.0
