"""What a report says of pose, plates and depth; and the slicing of several plates summed up."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pieces import ring
from reports import report_with
from solids import box, move, together

from knotfab.geometry.overhang import Rules
from knotfab.geometry.tube import sweep
from knotfab.part.orient import Flattening
from knotfab.part.slicer_process import NotSliced, Sliced, sum_slicings
from knotfab.report.for_maker import tell_flatter
from knotfab.report.posing import TOOLS_MM, find_access, measure_access, report_posing, tell_access
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import parse_scene
from knotfab_formats.print_figures import (
    Flatter,
    Kept,
    PoseFigures,
    Print,
    SlicerCheck,
    SlicerWarning,
    SupportAccess,
)
from knotfab_validators.geometry.mesh import Mesh

BOX = (np.array([[0.0, 0, 0], [10, 20, 30]]), np.zeros((0, 3), dtype=np.int32))


def part(upright: object = None, scene: str = "") -> Any:
    pose = SimpleNamespace(account=None, size_mm=np.array([10.0, 20.0, 30.0]))
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


def test_powder_asks_for_neither_supports_nor_access() -> None:
    piece = part(scene="[printer]\nname = 'hp-mjf'")
    how = {"printing": True, "access": find_access(piece)}
    found, (note,) = report_posing(report_with().print, piece, None, **how)
    assert found.pose is not None and found.pose.chosen_by == "the volume of its box"
    assert "no supports" in note and "6 cm³" in note
    assert found.support_access is None


def test_what_was_sliced_is_told_with_its_supports() -> None:
    sliced = {"time_s": 5400.0, "filament_g": 20.0, "support_g": 5.0, "support_share": 0.25}
    print_, how = report_with(print=sliced).print, {"printing": True, "access": find_access(part())}
    found, _ = report_posing(print_, part(), None, **how)
    assert found.support_access is not None
    assert found.support_access.worst is None  # a box that has no face
    assert report_posing(print_, part(), None)[0].support_access is None


def test_what_less_depth_would_take_is_one_sentence() -> None:
    said = tell_flatter([Flatter(0.6, 1.5, 20.0, 5.0), Flatter(0, 0.5, 9.0, 0.0)])
    assert said.endswith(": with 60% of its depth 1.5 h and 20 g, flat 30 min and 9 g.")


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


# How supports are reached: what is open, what is shut in, and windows that only some tools pass.


def measured(*bodies: Mesh) -> SupportAccess:
    return measure_access([(b.vertices, b.faces.astype(np.int32)) for b in bodies], Rules())


def room(window: float, side: float = 40.0, wall: float = 2.0) -> Mesh:
    """A shut room on the bed; one wall leaves a slit of a height `window` open below the ceiling."""
    s, w = side, wall
    return together(
        box((0, 0, 0), (s, s, w)),
        box((0, 0, s - w), (s, s, s)),
        box((0, 0, w), (w, s, s - w)),
        box((s - w, 0, w), (s, s, s - w)),
        box((w, s - w, w), (s - w, s, s - w)),
        box((w, 0, w), (s - w, w, s - w - window)),
    )


def test_a_ring_in_the_air_is_open_to_all() -> None:
    found = measure_access([sweep(ring(40.0, 30.0, 120, wave=0.0), 2.0, 16)], Rules())
    assert set(found.reached) == set(TOOLS_MM)
    assert all(share == 1.0 for share in found.reached.values())
    assert found.worst_tool == "finger" and "100%" in tell_access(found)
    # a quarter turn to either side sees half of the underside's circumference
    assert found.area_cm2 == pytest.approx(2 * np.pi * 40 * 2.0 * np.pi / 2 / 100, rel=0.1)


@pytest.mark.slow
def test_what_is_shut_in_is_reached_by_nothing() -> None:
    found = measured(room(0.0))
    assert all(share == 0.0 for share in found.reached.values())
    assert found.worst is not None and found.worst_tool is None
    assert "needs a bent tool" in tell_access(found)
    x, y, z = found.worst
    assert 2 < x < 38 and 2 < y < 38 and z == pytest.approx(38.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("window", "largest"), [(5.0, "pliers"), (10.0, "cutter"), (20.0, "finger")]
)
def test_a_window_lets_in_what_passes_through_it(window: float, largest: str) -> None:
    found = measured(room(window))
    for name, diameter in TOOLS_MM.items():
        assert (found.reached[name] > 0) == (diameter <= TOOLS_MM[largest]), name
    shares = [found.reached[name] for name in sorted(TOOLS_MM, key=lambda n: -TOOLS_MM[n])]
    assert shares == sorted(shares)


def test_what_lies_on_the_bed_has_no_supports() -> None:
    found = measured(box((0, 0, 0), (20, 20, 3)))
    assert found.area_cm2 == 0.0 and found.worst is None
    assert all(share == 1.0 for share in found.reached.values())
    aloft = move(box((0, 0, 0), (20, 20, 3)), shift=(0, 0, 30))
    assert measured(aloft).area_cm2 == pytest.approx(4.0, rel=1e-6)
    powder = Rules(supports=False, powder=True)
    assert measure_access([(aloft.vertices, aloft.faces.astype(np.int32))], powder).worst is None
