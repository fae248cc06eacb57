"""What a report says of pose, plates and depth; and the slicing of several plates summed up."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from reports import report_with

from knotfab.part.orient import Flattening
from knotfab.part.slicer_process import NotSliced, Sliced, sum_slicings
from knotfab.report.supports import report_posing
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import parse_scene
from knotfab_formats.print_figures import Kept, PoseFigures, Print, SlicerCheck, SlicerWarning

BOX = (np.array([[0.0, 0, 0], [10, 20, 30]]), np.zeros((0, 3), dtype=np.int32))


def part(upright: object = None, scene: str = "") -> Any:
    pose = SimpleNamespace(weighed=None, size_mm=np.array([10.0, 20.0, 30.0]))
    mounted = SimpleNamespace(
        wall=None, stand=None, upright=upright, scene=resolve(parse_scene(scene))
    )
    return SimpleNamespace(pose=pose, mounted=mounted, bodies=[BOX])


def told(piece: Any, flattening: Flattening | None = None, **more: Any) -> tuple[Print, list[str]]:
    return report_posing(replace(report_with().print, **more), piece, flattening)


def test_a_pose_that_the_mount_asks_for() -> None:
    found, notes = told(part(upright=np.eye(3)))
    assert found.pose == PoseFigures(chosen_by="the mount", height_mm=30.0, box_cm3=6.0)
    assert notes == []


@pytest.mark.parametrize(
    ("to", "proposed", "said"),
    [
        (60.0, None, ["lowered from 90 to 60"]),
        (90.0, 50.0, ["--depth 50"]),
        (60.0, 55.5, ["lowered", "55.5"]),
    ],
)
def test_a_depth_that_was_lowered_or_should_be(
    to: float, proposed: float | None, said: list[str]
) -> None:
    found, notes = told(part(), Flattening(90.0, to, proposed))
    assert len(notes) == len(said)
    assert all(text in note for text, note in zip(said, notes, strict=True))
    assert found.pose is not None and found.pose.depth_mm == Kept(90.0, to, proposed)


def test_a_piece_that_was_brought_to_its_wall() -> None:
    flattening = Flattening(90.0, 60.0, None, "it sags 1.00 mm", (100.0, 45.0))
    found, (note,) = told(part(), flattening)
    assert "At 100 mm from the wall, 90 mm deep, it sags 1.00" in note
    assert "so it was rebuilt at 45 mm, 60 mm deep." in note
    assert found.pose is not None and found.pose.wall_distance_mm == Kept(100.0, 45.0)


def test_powder_asks_for_no_supports() -> None:
    piece = part(scene="[printer]\nname = 'hp-mjf'")
    found, (note,) = report_posing(report_with().print, piece, None, printing=True)
    assert found.pose is not None and found.pose.chosen_by == "the volume of its box"
    assert "no supports" in note and "6 cm³" in note


def make_sliced(time_s: float, *, passed: bool) -> Sliced:
    check = SlicerCheck("bed", "pass" if passed else "fail", 1.0, 0.0, "mm", "over the edge")
    warning = SlicerWarning("empty layer", "", settled=True)
    return Sliced(
        "PrusaSlicer", "2.5", time_s, 1.0, 3.0, 0.5, 100, 1, (warning,), (check,),
        "prusa-slicer --output part-01.gcode part-01.3mf", {}, 2.0,
    )  # fmt: skip


def test_several_frames_are_summed_and_named() -> None:
    plates = [make_sliced(60.0, passed=True), make_sliced(90.0, passed=False)]
    both = sum_slicings({"part-01.3mf": plates[0], "part-02.3mf": plates[1]})
    assert isinstance(both, Sliced)
    assert (both.time_s, both.filament_m, both.layers, both.objects) == (150.0, 2.0, 200, 2)
    assert both.problems == ["part-02.3mf: over the edge"]
    assert [w.text.split(":")[0] for w in both.warnings] == ["part-01.3mf", "part-02.3mf"]
    assert both.command == "prusa-slicer --output part-N.gcode part-N.3mf"


def test_one_file_is_not_renamed_and_one_that_fails_decides() -> None:
    one = make_sliced(60.0, passed=True)
    assert sum_slicings({"part.3mf": one}) is one
    thin, missing = NotSliced("refused", "it is thin"), NotSliced("missing", "not installed")
    found = sum_slicings({"part-01.3mf": one, "part-02.3mf": thin})
    assert found == NotSliced("refused", "part-02.3mf: it is thin")
    assert sum_slicings({"part-01.3mf": missing, "part-02.3mf": thin}) == missing
