"""The slicer's profile beside a part is the one that the scene implies, or what differs is told."""

from math import inf
from pathlib import Path

import numpy as np
import pytest

from knotfab.part.slicer_profile import write_profile
from knotfab.scene.catalogue import resolve
from knotfab_formats.piece import Printer
from knotfab_formats.scene import Scene
from knotfab_formats.slicer_ini import FLANK_DEG, FULL, plan_walls, stiffness_share, written_wall_mm
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.printing.slicer_ini import check_slicer_ini, read_wall_mm

SCENES: dict[str, dict[str, object]] = {
    "bare": {}, "without supports": {"piece": {"supports": "none"}},
    "in a plate": {"mount": {"kind": "wall", "plate": "full"}},
    "a thick tube": {"piece": {"tube_radius_mm": 3.0, "supports": "none"}},
    "another printer": {"printer": {"name": "prusa-mini"}, "material": {"name": "petg"}},
    "shrinking": {"material": {"shrinkage_percent": 2.0}, "mount": {"kind": "wall", "plate": "full"}},
}  # fmt: skip
CHANGE = "before_layer_gcode = G92 E0\\n{if layer_num == 8}M600{endif}"
# an edit of the file: what is replaced, by what, and what is said
EDITS = {
    "strings": ("gap_fill_enabled = 0", "gap_fill_enabled = 1",
        "gap_fill_enabled is 1, and by the scene 0"),
    "script": ("post_process = ", "post_process = evil.sh", "post_process is evil.sh, and by the scene"),
    "layers": ("layer_height = 0.2", "layer_height = 0.35", "layer_height is 0.35, and by the scene 0.2"),
    "supports": ("support_material = 1", "support_material = 0", "support_material is 0"),
    "G-code": ("end_gcode = M84", "end_gcode = M84\\nM104 S300", "end_gcode is M84"),
    "M600 elsewhere": ("before_layer_gcode = G92 E0", CHANGE.replace("8", "9"), "before_layer_gcode is"),
    "M600 without a plate": ("before_layer_gcode = G92 E0", CHANGE, "before_layer_gcode is"),
    "another key": ("thumbnails = ", "thumbnails = \nraft_layers = 3", "raft_layers = 3 is none of"),
    "twice": ("perimeters = 2", "perimeters = 2\nperimeters = 2", "perimeters = 2 is none of"),
    "one loop": ("perimeters = 2", "perimeters = 1", "perimeters is 1, and by the scene 2"),
    "no key": ("perimeters = 2", "", "perimeters is missing"),
    "a full tube's": ("perimeter_extrusion_width = 0.45", "", "top_solid_layers = 3 is none of"),
    "no setting": ("perimeters = 2", "perimeters = 2\n[other]", "[other] is none of"),
}  # fmt: skip


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


# radius and nozzle, and the loops and the width of the inner ones
WALLS = {
    "a common tube": (1.66, 0.4, 2, 0.45), "as wide as loops get": (2.19, 0.4, 2, 0.644),
    "a loop more": (2.3, 0.4, 3, 0.45), "a thick tube": (5.0, 0.4, 5, 0.53),
    "a wide nozzle": (3.0, 0.6, 2, 0.808), "all wall": (0.8, 0.4, 2, 0.45),
}  # fmt: skip


@pytest.mark.parametrize("case", WALLS)
def test_loops_leave_a_core_that_costs_little_stiffness(case: str, tmp_path: Path) -> None:
    radius, nozzle, loops, width = WALLS[case]
    printer = {"nozzle_mm": nozzle, "min_tube_radius_mm": 0.8, "name": "prusa-mk4"}
    scene, file = write(tmp_path, piece={"tube_radius_mm": radius}, printer=printer)
    found = dict(line.split(" = ") for line in file.read_text().splitlines() if " = " in line)
    assert int(found["perimeters"]) == loops
    assert float(found["perimeter_extrusion_width"]) == pytest.approx(width, abs=0.002)
    wall = written_wall_mm(found)
    own: Printer = scene.printer  # type: ignore[attr-defined]
    assert wall == pytest.approx(plan_walls(own, radius).thick_mm, abs=1e-3)
    assert read_wall_mm(scene, tmp_path, own=True) == wall  # type: ignore[arg-type]
    # what it says of a section, summed over a grid: about the weaker axis, on a flank
    x, y = np.meshgrid(*2 * [np.linspace(-radius, radius, 801)])
    core = (x / max(radius - wall, 1e-9)) ** 2
    core += (y / max(radius - wall * np.sin(np.radians(FLANK_DEG)), 1e-9)) ** 2
    full = x**2 + y**2 <= radius**2
    share = (y**2)[full & (core > 1)].sum() / (y**2)[full].sum()
    assert stiffness_share(own, radius) == pytest.approx(share, abs=0.005)
    assert share >= 0.85


# how the profile beside a part was edited, and the wall that is reckoned with, mm
READ = {
    "one loop": ("perimeters = 2", "perimeters = 1", 0.45),
    "no loop": ("perimeters = 2", "perimeters = 0", 0.0),
    "full": ("solid_infill_below_area = 0", "", inf),
    "no number": ("perimeters = 2", "perimeters = many", 0.0),
    "no width": ("extrusion_width = 0.45", "", 0.0),
}


@pytest.mark.parametrize("case", READ)
def test_walls_are_read_from_the_profile_beside_the_part(case: str, tmp_path: Path) -> None:
    old, new, wall = READ[case]
    scene, file = write(tmp_path)
    lines = file.read_text().splitlines()
    assert old in lines
    file.write_text("\n".join(new if line == old else line for line in lines))
    assert read_wall_mm(scene, tmp_path, own=True) == pytest.approx(wall)  # type: ignore[arg-type]
    assert read_wall_mm(scene, tmp_path, own=False) > 0.8  # type: ignore[arg-type]


def test_a_profile_by_which_tubes_print_full_is_still_the_scenes(tmp_path: Path) -> None:
    scene, file = write(tmp_path, piece={"tube_radius_mm": 2.0})
    lines = [line for line in file.read_text().splitlines() if not line.startswith(FULL)]
    text = "\n".join(lines).replace("perimeters = 2", "perimeters = 6")
    file.write_text(text.replace("fill_density = 10%", "fill_density = 15%"))
    assert check_slicer_ini(scene, tmp_path, own=True).status == "pass"  # type: ignore[arg-type]
    assert read_wall_mm(scene, tmp_path, own=True) == inf  # type: ignore[arg-type]
    file.write_text(text.replace("fill_density = 10%", "fill_density = 12%"))
    assert check_slicer_ini(scene, tmp_path, own=True).status == "fail"  # type: ignore[arg-type]
