"""G-code is read as it stands: figures, lines, supports; a cut or foreign file is refused."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from slicer_parts import EXACT, Mesh, box, gcode_text, print_boxes, scene_of

from knotfab.geometry.tube import box_of
from knotfab.part.gcode import (
    BadGcode,
    Gcode,
    compare_gcode,
    compare_info,
    points_along,
    read_gcode,
)
from knotfab.part.slicer_process import find_slicer
from knotfab.part.slicer_profile import (
    line_width,
    profile,
    read_profile,
    why_not_sliced,
    write_profile,
)
from knotfab.scene.catalogue import materials, printers
from knotfab_formats.print_figures import SlicerCheck
from knotfab_formats.slicer_ini import PROFILE

SUPPORTED = """G1 X14 Y30 E1.5
;TYPE:Support material
G1 X0 Y0 F9000
G1 X100 Y0 E1
;TYPE:Support material interface
G1 X100 Y1.25 E1
;LAYER_CHANGE
;Z:0.4
G1 Z.4 F9000
;TYPE:Skirt/Brim
G1 X-7 Y.5 E3
G1 X1 Y1 E-.8
;TYPE:External perimeter
G1 X2 Y1 F9000
G1 X2 Y3 Z.6 F9000
G1 X5 Y3 E2
"""


def _write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_figures(tmp_path: Path) -> None:
    found = read_gcode(_write(tmp_path / "a.gcode", gcode_text()))
    assert (found.program, found.version) == ("PrusaSlicer", "2.5.0")
    assert found.time_s == 3723
    assert (found.filament_mm, found.filament_cm3, found.filament_g) == (100.5, 0.24, 0.3)
    assert (found.layers, found.support_share) == (1, 0.0)
    assert np.array_equal(found.start, [[10, 20, 0.2]]) and np.array_equal(
        found.end, [[14, 23, 0.2]]
    )


@pytest.mark.parametrize(
    ("text", "seconds"), [("5s", 5), ("1m 0s", 60), ("2d 1h 0m 1s", 176401), ("22h 49m 37s", 82177)]
)
def test_durations(tmp_path: Path, text: str, seconds: int) -> None:
    assert read_gcode(_write(tmp_path / "a.gcode", gcode_text(time=text))).time_s == seconds


def test_lines_of_the_part_supports_and_the_rest(tmp_path: Path) -> None:
    found = read_gcode(_write(tmp_path / "a.gcode", gcode_text(SUPPORTED)))
    part = np.array(
        [[10, 20, 0.2, 14, 23, 0.2], [14, 23, 0.2, 14, 30, 0.2], [2, 3, 0.4, 5, 3, 0.4]]
    )
    assert np.array_equal(np.hstack([found.start, found.end]), part)
    assert (found.layers, found.retractions, found.starts_per_layer) == (2, 1, 1.5)
    assert found.support_share == pytest.approx(2 / (0.5 + 1.5 + 2 + 3 + 2))
    # the extent is that of everything laid, the skirt too, but of no travel
    assert np.array_equal(found.low, [-7, 0, 0.2]) and np.array_equal(found.high, [100, 30, 0.4])


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "which program"),
        ("G28\nG1 X1 Y1 E1\n", "which program"),
        (gcode_text(tail=""), "cut off"),
        (gcode_text().replace("(normal mode)", ""), "no printing time"),
        (gcode_text().replace("[cm3]", "[oz]"), "does not give its filament"),
        (gcode_text().replace("100.50", "1.0.5"), "does not give its filament"),
        (gcode_text().replace("E.5", ""), "prints nothing"),
        (gcode_text().replace("G1 X", "G2 X"), "prints nothing"),
        (gcode_text().replace("TYPE:Perimeter", "TYPE:Support material"), "prints nothing"),
        (gcode_text().replace(";Z:0.2", ";Z:up"), "at no height"),
        (gcode_text().replace(";Z:0.2", ";Z:inf"), "not finite"),
    ],
)
def test_what_is_refused(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(BadGcode, match=why):
        read_gcode(_write(tmp_path / "a.gcode", text))


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadGcode, match="cannot be read"):
        read_gcode(tmp_path / "none.gcode")


def test_lines_that_are_no_moves_are_passed_over(tmp_path: Path) -> None:
    """Such lines hold letters for a number, bytes of no encoding, or returns before their end."""
    text = gcode_text("G1 X1.2.3 Y4 E1\nG1 Xa Y4 E1\n G1 X99 Y99 E1\nG1 X- Y4 E1")
    content = text.encode().replace(b"G92 E0", b"G92 \xff\xfe").replace(b"\n", b"\r\n")
    (tmp_path / "a.gcode").write_bytes(content)
    found = read_gcode(tmp_path / "a.gcode")
    assert np.array_equal(found.end, [[14, 23, 0.2]]) and found.time_s == 3723


def test_points_along_lines() -> None:
    start = np.array([[0.0, 0, 0], [5, 5, 5], [1, 0, 0]])
    end = np.array([[2.0, 0, 0], [5, 5, 5], [1, 2.5, 0]])
    found = points_along(start, end, 1.0)
    assert np.array_equal(found[:3], np.array([[0.5, 0, 0], [1.5, 0, 0], [5, 5, 5]]))
    assert found[3:, 1] == pytest.approx([2.5 / 6, 1.25, 12.5 / 6]) and len(found) == 6


# What the slicer made of a part, held against the part: each check rejects, and has its limit.


SCENE = scene_of(EXACT + "build_volume_mm = [100.0, 80.0, 60.0]")
LOW, HIGH = box((10, 10, 0), (10, 10, 5)), box((30, 10, 8), (10, 10, 5))


def _checks(gcode: Gcode, *meshes: Mesh) -> Mapping[str, SlicerCheck]:
    found = compare_gcode(gcode, meshes, SCENE, np.zeros(3))
    return {check.name: check for check in found}


def _failures(gcode: Gcode, *meshes: Mesh) -> set[str]:
    return {name for name, check in _checks(gcode, *meshes).items() if not check.passed}


def _move(mesh: Mesh, *by: float) -> Mesh:
    return mesh[0] + by, mesh[1]


def test_a_part_printed_as_it_is_passes() -> None:
    found = _checks(print_boxes(LOW, HIGH), LOW, HIGH)
    assert set(found) == {"bed", "place", "surface", "filament", "layers"}
    assert all(check.passed and check.detail for check in found.values())


def test_the_shift_is_that_of_the_part_on_the_bed() -> None:
    gcode = print_boxes(_move(LOW, 7, -3, 0), _move(HIGH, 7, -3, 0))
    shifted = compare_gcode(gcode, [LOW, HIGH], SCENE, np.array([7.0, -3.0, 0.0]))
    assert all(check.passed for check in shifted)
    assert _failures(gcode, LOW, HIGH) == {"place", "surface"}


def test_a_body_that_is_left_out_dropped_or_moved() -> None:
    assert _failures(print_boxes(LOW), LOW, HIGH) >= {"surface", "place", "layers"}
    dropped = _move(HIGH, 0, 0, -8)
    assert _failures(print_boxes(LOW, dropped), LOW, HIGH) == {"surface", "place", "layers"}
    inner = box((15, 12, 0), (3, 3, 5)), box((12, 15, 0), (2, 2, 5))
    around = box((0, 0, 0), (1, 40, 5)), box((40, 0, 0), (1, 40, 5))
    # between others that hold the extent, only the surface tells
    assert _failures(print_boxes(*around, inner[0]), *around, *inner) == {"surface"}
    found = _checks(print_boxes(*around, inner[0]), *around, *inner)["surface"]
    assert "shell 4" in found.detail


def test_the_bed_at_its_limit() -> None:
    """Lines are 0.5 mm wide: their axes may come as near as 0.25 mm."""
    gcode = print_boxes(LOW)
    least, most = np.array([0.25, 0.25, 0.25]), np.array([99.75, 79.75, 60.0])
    at = _checks(replace(gcode, low=least, high=most), LOW)["bed"]
    assert at.passed and at.measured == 0.0
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 0.01
        assert not _checks(replace(gcode, low=least, high=most + step), LOW)["bed"].passed
        if axis < 2:
            assert not _checks(replace(gcode, low=least - step, high=most), LOW)["bed"].passed


def test_the_place_at_its_limit() -> None:
    """The limit is one line to the sides, and one layer and a half in height."""
    gcode = print_boxes(LOW)
    for axis, limit in enumerate((0.5, 0.5, 0.375)):
        for sign in (-1, 1):
            step = np.zeros(3)
            step[axis] = sign * limit
            at = replace(gcode, start=gcode.start + step, end=gcode.end + step)
            found = _checks(at, LOW)["place"]
            assert found.passed and found.measured == 1.0
            step *= 1.01
            past = replace(gcode, start=gcode.start + step, end=gcode.end + step)
            assert not _checks(past, LOW)["place"].passed


def test_the_surface_at_its_limit() -> None:
    """The limit is two lines and a layer: 1.25 mm."""
    corners = np.array([[2.0, 2, 1], [2.5, 2, 1], [2.5, 2.5, 1], [2.5, 2, 1.5]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], dtype=np.int32)
    for reach, passes in ((1.25, True), (1.2625, False)):
        line = np.array([[2 + reach, 2.0, 1.0]])
        gcode = replace(print_boxes(LOW), start=line, end=line)
        found = _checks(gcode, (corners, faces))["surface"]
        assert (found.passed, found.limit) == (passes, 1.25)
        assert found.measured == pytest.approx(reach)


def test_filament_at_its_limits() -> None:
    gcode, volume = print_boxes(LOW), 0.5
    for share, passes in ((0.1, True), (0.099, False), (1.15, True), (1.1615, False)):
        found = _checks(replace(gcode, filament_cm3=share * volume), LOW)["filament"]
        assert found.passed == passes and found.measured == pytest.approx(share)
    # filament for supports is no part of it
    half = replace(gcode, filament_cm3=2 * volume, support_share=0.5)
    assert _checks(half, LOW)["filament"].passed
    assert not _checks(replace(half, support_share=0.0), LOW)["filament"].passed


def test_layers_at_their_limit() -> None:
    gcode = print_boxes(LOW)
    assert gcode.layers == 20
    for layers, passes in ((18, False), (19, True), (21, True), (22, False)):
        assert _checks(replace(gcode, layers=layers), LOW)["layers"].passed == passes


def test_layers_of_bodies_with_air_between() -> None:
    stacked = _move(LOW, 0, 0, 15)
    found = _checks(print_boxes(LOW, stacked), LOW, stacked)["layers"]
    assert found.passed and found.measured == 0 and "40 layers" in found.detail


def _info(*bodies: Mesh, manifold: str = "yes", off: float = 0.0, volume: float = 1.0) -> str:
    """PrusaSlicer's words on one object whose shells are boxes."""
    low, high = box_of(bodies)
    text = "[2024-01-01 00:00:00.0] [0x0] [trace]   Initializing\n[part.3mf]\n"
    for axis, (least, most) in enumerate(zip(low, high, strict=True)):
        text += f"min_{'xyz'[axis]} = {least + off:f}\nmax_{'xyz'[axis]} = {most:f}\n"
    sizes = [np.ptp(vertices, axis=0) for vertices, _ in bodies]
    size = float(sum(np.prod(s) for s in sizes)) * volume
    return text + f"manifold = {manifold}\nnumber_of_parts = {len(bodies)}\nvolume = {size:f}\n"


def test_info_of_the_file_as_it_is() -> None:
    bodies = [LOW, HIGH]
    count, check = compare_info(_info(*bodies), bodies)
    assert (count, check.passed, check.measured) == (1, True, 0.0)


def test_info_that_differs() -> None:
    bodies = [LOW, HIGH]
    for said in (
        _info(*bodies, manifold="no"),
        _info(bodies[0]),
        _info(bodies[0]) + _info(bodies[1]),  # two objects, each to be dropped onto the bed
        "",
        "[part.3mf]\nnothing = 1\n",
        _info(*bodies).replace("volume = ", "volume = x"),
    ):
        _, check = compare_info(said, bodies)
        assert not check.passed and check.detail


def test_info_at_its_limits() -> None:
    """The limits are 1/64 mm, and 1/1024 of the volume."""
    bodies = [box((0, 0, 0), (16, 8, 8))]
    for off, passes in ((0.015625, True), (-0.015625, True), (0.0158, False), (-0.0158, False)):
        assert compare_info(_info(*bodies, off=off), bodies)[1].passed == passes
    for volume, passes in ((1025, True), (1023, True), (1025.01, False), (1022.99, False)):
        _, check = compare_info(_info(*bodies, volume=volume / 1024), bodies)
        assert check.passed == passes


# The profile follows the printer and the material; what is no filament is not sliced.


def test_it_follows_the_printer_and_the_material() -> None:
    text = "[printer]\nname = 'ender-3'\nlayer_height_mm = 0.28\nnozzle_mm = 0.6\n"
    found = profile(scene_of(text + "[material]\nname = 'petg'"))
    assert found["bed_shape"] == "0x0,220x0,220x220,0x220" and found["max_print_height"] == "250"
    assert found["layer_height"] == found["first_layer_height"] == "0.28"
    assert found["nozzle_diameter"] == "0.6" and found["extrusion_width"] == "0.675"
    assert (found["filament_density"], found["temperature"]) == ("1.27", "240")
    assert found["filament_type"] == "PETG"
    # relative lengths are what read_gcode adds up, and no script of a 3MF is run
    assert found["use_relative_e_distances"] == "1" and found["post_process"] == ""


@pytest.mark.parametrize(
    ("angle", "threshold"), [(45.0, "45"), (44.9, "46"), (60.0, "30"), (0.0, "90"), (90.0, "1")]
)
def test_supports_start_at_the_printers_overhang(angle: float, threshold: str) -> None:
    """The slicer counts from the level, the printer from the vertical; 0 would mean "choose yourself"."""
    found = profile(scene_of(f"[printer]\nmax_overhang_deg = {angle}"))
    assert (found["support_material"], found["support_material_threshold"]) == ("1", threshold)


@pytest.mark.parametrize(
    ("said", "style"),
    [
        ("PrusaSlicer-2.5.0+UNKNOWN based on Slic3r", "snug"),
        ("[trace] Initializing\nPrusaSlicer-2.6.1 based on Slic3r", "organic"),
        ("PrusaSlicer-2.10.0", "organic"),
        ("no such option", "snug"),
    ],
)
def test_supports_are_branches_where_the_slicer_grows_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: str, style: str
) -> None:
    """The style is none that the slicer would refuse; without a slicer it is one that all read."""
    program = tmp_path / "prusa-slicer"
    program.write_text(f"#!/bin/sh\ncat <<'EOF'\n{said}\nEOF\n")
    program.chmod(0o755)
    monkeypatch.setattr("knotfab.part.slicer_profile.find_slicer", lambda: str(program))
    write_profile(tmp_path, scene_of())
    assert f"support_material_style = {style}\n" in (tmp_path / PROFILE).read_text()
    assert profile(scene_of())["support_material_style"] == "snug"


def test_a_printer_without_supports() -> None:
    assert profile(scene_of("[printer]\nsupports = false"))["support_material"] == "0"


def test_an_own_material_prints_like_pla_but_for_its_density() -> None:
    text = (
        "[material]\nname = 'mine'\n"
        + "\n".join(
            f"{key} = {value!r}"
            for key, value in materials()["pla"].model_dump().items()
            if key not in ("name", "density_g_cm3")
        )
        + "\ndensity_g_cm3 = 1.5"
    )
    found = profile(scene_of(text))
    assert (found["filament_density"], found["temperature"]) == ("1.5", "215")


def test_only_filament_is_sliced() -> None:
    assert why_not_sliced(scene_of()) is None
    resin = "resin: only its own slicer can say"
    assert why_not_sliced(scene_of("[printer]\nname = 'form-3'")) == resin
    assert why_not_sliced(scene_of("[printer]\nnozzle_mm = 0.1")) is None
    assert why_not_sliced(scene_of("[printer]\nnozzle_mm = 0.099")) == resin


def test_every_printer_has_a_profile_or_a_reason(tmp_path: Path) -> None:
    for name in printers():
        scene = scene_of(f"[printer]\nname = {name!r}")
        (folder := tmp_path / name).mkdir()
        write_profile(folder, scene)
        filament = scene.printer.process == "filament"
        assert (why_not_sliced(scene) is None) == (folder / PROFILE).is_file() == filament
        if filament:
            lines = (folder / PROFILE).read_text().splitlines()
            assert all(line.count(" = ") == 1 for line in lines) and len(lines) > 40
        assert line_width(scene) > scene.printer.nozzle_mm


def test_a_change_of_filament_above_a_plate_is_offered_and_changes_no_setting(
    tmp_path: Path,
) -> None:
    scene = scene_of(
        "[piece]\nsupports = 'none'\n[mount]\nplate = 'full'\nplate_thickness_mm = 1.5"
    )
    write_profile(tmp_path, scene)
    lines = (tmp_path / PROFILE).read_text().splitlines()
    (offered,) = (line for line in lines if "}M600" in line)
    # 8 layers of 0.2 mm hold 1.5 mm; the slicer counts layers from 0
    assert offered == r"# before_layer_gcode = G92 E0\n{if layer_num == 8}M600{endif}"
    assert any("before layer 9" in line for line in lines)
    assert read_profile(tmp_path) == profile(scene, find_slicer())
    assert read_profile(tmp_path)["support_material"] == "0"
