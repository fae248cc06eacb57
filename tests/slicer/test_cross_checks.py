"""What the slicer made of a part, held against the part: each check rejects, and has its limit."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from slicer_parts import EXACT, Mesh, box, print_boxes, scene_of

from knotfab.geometry.meshes import box_of
from knotfab.slicer.cross_checks import compare_gcode, compare_info
from knotfab.slicer.gcode import Gcode
from knotfab_formats.report import SlicerCheck

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
    for share, passes in ((0.15, True), (0.1485, False), (1.15, True), (1.1615, False)):
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
