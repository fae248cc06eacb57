"""The slicer's profile beside a part is the one that the scene implies, or what differs is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from knotfab.part.slicer_profile import write_profile
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.printing.slicer_ini import check_slicer_ini

SCENES: dict[str, dict[str, object]] = {
    "bare": {},
    "without supports": {"piece": {"supports": "none"}},
    "in a plate": {"mount": {"kind": "wall", "plate": "full"}},
    "a thick tube": {"piece": {"tube_radius_mm": 3.0, "supports": "none"}},
    "another printer": {"printer": {"name": "prusa-mini"}, "material": {"name": "petg"}},
    "shrinking": {
        "material": {"shrinkage_percent": 2.0},
        "mount": {"kind": "wall", "plate": "full"},
    },
}
CHANGE = "before_layer_gcode = G92 E0\\n{if layer_num == 8}M600{endif}"
# an edit of the file: what is replaced, by what, and what is said
EDITS = {
    "strings": (
        "gap_fill_enabled = 0",
        "gap_fill_enabled = 1",
        "gap_fill_enabled is 1, and by the scene 0",
    ),
    "script": (
        "post_process = ",
        "post_process = evil.sh",
        "post_process is evil.sh, and by the scene",
    ),
    "layers": (
        "layer_height = 0.2",
        "layer_height = 0.35",
        "layer_height is 0.35, and by the scene 0.2",
    ),
    "supports": ("support_material = 1", "support_material = 0", "support_material is 0"),
    "G-code": ("end_gcode = M84", "end_gcode = M84\\nM104 S300", "end_gcode is M84"),
    "M600 elsewhere": (
        "before_layer_gcode = G92 E0",
        CHANGE.replace("8", "9"),
        "before_layer_gcode is",
    ),
    "M600 without a plate": ("before_layer_gcode = G92 E0", CHANGE, "before_layer_gcode is"),
    "another key": (
        "thumbnails = ",
        "thumbnails = \nraft_layers = 3",
        "raft_layers = 3 is none of",
    ),
    "twice": ("perimeters = 3", "perimeters = 3\nperimeters = 3", "perimeters = 3 is none of"),
    "no key": ("perimeters = 3", "", "perimeters is missing"),
    "no setting": ("perimeters = 3", "perimeters = 3\n[other]", "[other] is none of"),
}


def write(folder: Path, **asked: object) -> tuple[object, Path]:
    view = {"name": "front", "picture": "a.png", "frame_width_mm": 100.0, "frame_height_mm": 100.0}
    scene = resolve(Scene.model_validate({"schema": 1, "views": [view], **asked}))
    write_profile(folder, scene)
    return parse_scene(scene.model_dump(by_alias=True, mode="json")), folder / "slicer.ini"


@pytest.mark.parametrize("case", SCENES)
def test_what_a_build_writes_is_the_scenes(case: str, tmp_path: Path) -> None:
    scene, file = write(tmp_path, **SCENES[case])
    file.write_text("; a comment\n\n" + "\n".join(reversed(file.read_text().splitlines())))
    found = check_slicer_ini(scene, tmp_path, own=True)  # type: ignore[arg-type]
    assert found.status == "pass" and found.required, found.detail
    assert check_slicer_ini(scene, tmp_path, own=False).status == "skipped"  # type: ignore[arg-type]
    file.unlink()
    assert check_slicer_ini(scene, tmp_path, own=True).status == "skipped"  # type: ignore[arg-type]


def test_filament_may_change_above_the_plate(tmp_path: Path) -> None:
    scene, file = write(tmp_path, **SCENES["in a plate"])
    file.write_text(file.read_text().replace("before_layer_gcode = G92 E0", CHANGE, 1))
    assert check_slicer_ini(scene, tmp_path, own=True).status == "pass"  # type: ignore[arg-type]


@pytest.mark.parametrize("case", EDITS)
def test_each_setting_that_differs_is_told(case: str, tmp_path: Path) -> None:
    old, new, said = EDITS[case]
    scene, file = write(tmp_path, **SCENES["in a plate" if case == "M600 elsewhere" else "bare"])
    lines = file.read_text().splitlines()
    assert old in lines
    file.write_text("\n".join(new if line == old else line for line in lines))
    found = check_slicer_ini(scene, tmp_path, own=True)  # type: ignore[arg-type]
    assert found.status == "fail" and found.required and said in found.detail, found.detail


def test_loops_fill_a_tube_so_that_nothing_else_begins_in_it(tmp_path: Path) -> None:
    for radius, nozzle in ((3.0, 0.4), (1.66, 0.4), (3.0, 0.6)):
        printer = {"nozzle_mm": nozzle, "min_tube_radius_mm": 0.8}
        _, file = write(tmp_path, piece={"tube_radius_mm": radius}, printer=printer)
        loops = int(
            next(line for line in file.read_text().splitlines() if "perimeters = " in line)[-1]
        )
        assert radius <= loops * 1.125 * nozzle < radius + 2.25 * nozzle
