"""Check that the slicer's profile beside a part is the one that the scene implies."""

from __future__ import annotations

from pathlib import Path

from knotfab_formats.errors import short
from knotfab_formats.slicer_ini import (
    PROFILE,
    STYLES,
    change_above,
    imply_settings,
    layers_of_plate,
)
from knotfab_formats.verdict import Check
from knotfab_validators.check import BadFile, read_bytes, skip_check
from knotfab_validators.files.scene import Scene

NAME = "slicer_ini"
MOST_BYTES = 100_000
MOST_SAID = 4  # keys that are named


def check_slicer_ini(scene: Scene, folder: Path, own: bool) -> Check:
    """Check `slicer_ini`: every setting is the scene's, and there is none besides.

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
        lines = read_bytes(path, MOST_BYTES).decode("utf-8").splitlines()
    except (BadFile, UnicodeDecodeError) as error:
        return Check(NAME, "fail", True, "not read", None, "", short(str(error)))
    wrong = []
    for line in (line.strip() for line in lines):
        key, sign, value = (word.strip() for word in line.partition("="))
        if not line or line[0] in "#;":
            continue
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
