"""The drawings of a mount: page sizes, figures that are there, holes at full size, the same bytes again."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pages import POINT, page_contents, page_sizes
from pieces import OFF, Kind, setup
from reports import report_with
from tables import some

from knotfab.hold.placement import placement_of
from knotfab.hold.wall import DRILLS_MM, PLAY_MM
from knotfab.part.slicer_process import NotSliced, Sliced
from knotfab.part.slicer_profile import explain_warning, read_warnings
from knotfab.render.pages import length
from knotfab.report.drill_template import write_drill_template
from knotfab.report.for_maker import (
    OPENING,
    PROVEN,
    advise_lamp,
    check_slicing,
    report_slicing,
    with_slicing,
)
from knotfab.report.setup import draw_sheets, shadow_outlines, write_setup
from knotfab.report.setup_words import costs_of, lamp_facts, lamp_name, steps_of
from knotfab_formats.errors import plain, read_as
from knotfab_formats.print_figures import Print, SlicerCheck, SlicerFigures, SlicerWarning

pytestmark = pytest.mark.slow

KINDS: tuple[Kind, ...] = ("none", "plate", "dowel", "stand")


def texts(path: Path) -> list[str]:
    """The texts of an SVG of matplotlib's, which draws them as paths and notes what they say."""
    return [t.strip() for t in re.findall(r"<!--(.*?)-->", path.read_text(encoding="utf-8"))]


def drawn(kind: Kind, folder: Path, **view: float) -> list[str]:
    mounted, scene, camera = setup(kind, **view)
    assert write_setup(folder, draw_sheets(mounted, scene, [camera]), [OFF]) == [
        "setup.pdf",
        "setup.svg",
    ]
    return texts(folder / "setup.svg")


@pytest.mark.parametrize("kind", KINDS)
def test_pages_of_a4_with_their_figures_and_the_same_bytes_again(
    kind: Kind, tmp_path: Path
) -> None:
    found = []
    for name in ("a", "b") if kind == "plate" else ("a",):
        (tmp_path / name).mkdir()
        said = drawn(kind, tmp_path / name, light_distance_mm=480.0, wall_distance_mm=90.0)
        found.append([(tmp_path / name / f).read_bytes() for f in ("setup.pdf", "setup.svg")])
    assert found[0] == found[-1]
    pdf, svg = found[0]
    sizes = page_sizes(tmp_path / "a" / "setup.pdf")  # the last has the marks for a photograph
    assert sizes == pytest.approx(np.array([[210, 297]] * 2), abs=0.005)
    head = re.search(rb'width="([\d.]+)pt" height="([\d.]+)pt"', svg)
    assert head is not None
    assert np.array(head.groups(), dtype=float) / POINT == pytest.approx([210, 297], abs=0.005)
    assert b"CreationDate" not in pdf and b"<dc:date>" not in svg
    assert {"480", "90", "570", "frame 160", "frame 120", "Setting up"} <= set(said)
    assert any("14% less alike" in line for line in said)
    if kind == "plate":
        assert {"plate 176", "plate 136", "screw holes 166", "88", "68"} <= set(said)
    else:
        assert {"80", "60"} <= set(said)  # the lamp's foot, from the frame's edges
    if kind == "dowel":
        assert {"1", "2", "3"} <= set(said)
    if kind == "stand":
        # the lengths lead from the wall to the base, from the base to the lamp, and from the desk to the lamp
        assert {"70", "455", "75", "desk"} <= set(said)


@pytest.mark.parametrize("kind", ["none", *some(("plate", "dowel", "stand"), 2)])
def test_a_leaning_wall_and_a_far_lamp_stay_on_the_page(kind: Kind, tmp_path: Path) -> None:
    said = drawn(kind, tmp_path, wall_tilt_deg=20.0, light_distance_mm=3000.0)
    assert any("3100" in line for line in said)
    assert any(
        f"{length(3100 * np.cos(np.radians(20)))} square to the wall" in line for line in said
    )
    page = max(page_contents(tmp_path / "setup.pdf"), key=len)
    at = np.array(re.findall(r"([-\d.]+) ([-\d.]+) [ml]\n", page), dtype=float) / POINT
    paper = ((np.abs(at) < 0.01) | (np.abs(at - [210, 297]) < 0.01)).all(axis=1)
    at = at[~paper]  # the sheet itself
    assert at.min() > 5 and (at.max(axis=0) < [205, 292]).all()


def test_nothing_measured_is_said(tmp_path: Path) -> None:
    mounted, scene, camera = setup("none")
    write_setup(tmp_path, draw_sheets(mounted, scene, [camera]), [None])
    assert "Not measured: too little to see, or nothing rendered." in texts(tmp_path / "setup.svg")


def test_the_shadow_is_drawn_where_it_falls(tmp_path: Path) -> None:
    mounted, _, camera = setup("none")
    points = np.concatenate(shadow_outlines(mounted, placement_of(mounted, camera)))
    vertices = mounted.bodies[0][0]
    pixels = camera.project(vertices)
    right = (pixels[:, 0] + 0.5 - 40) * 2.0
    up = (30 - pixels[:, 1] - 0.5) * 2.0
    assert points.max(axis=0) == pytest.approx([right.max(), up.max()], abs=0.1)
    assert points.min(axis=0) == pytest.approx([right.min(), up.min()], abs=0.1)


def curves(text: str) -> list[tuple[np.ndarray, float]]:
    """Middles (2,) and diameters of the circles of a page, in mm: closed paths of Bézier arcs."""
    found = []
    for path in re.findall(r"((?:[-\d.]+ [-\d.]+ m\n)(?:(?:[-\d.]+ ){6}c\n){8})", text):
        numbers = [float(x) for x in re.findall(r"[-\d.]+", path)]
        ends = np.array([numbers[2 + 6 * k + 4 : 2 + 6 * k + 6] for k in range(8)]) / POINT
        found.append((ends.mean(axis=0), float(np.ptp(ends[:, 0]))))
    return found


def test_holes_are_at_full_size_where_the_pegs_enter(tmp_path: Path) -> None:
    mounted, _, camera = setup("dowel")
    assert mounted.wall is not None
    names = write_drill_template(tmp_path, mounted, camera)
    assert names == ["drill-template-a4.pdf", "drill-template-letter.pdf"]
    place = placement_of(mounted, camera)
    for name in names:
        pages = page_contents(tmp_path / name)
        circles = [c for page in pages for c in curves(page) if c[1] < 10]  # not of letters
        assert len(circles) == 3
        wide = [peg.drill_mm for peg in mounted.wall.pegs]
        assert set(wide) <= set(DRILLS_MM)
        for peg in mounted.wall.pegs:  # a shoulder stays, and no more of it than a drill's step
            assert 0 <= peg.foot_radius_mm - peg.dowel_radius_mm < 0.25
            assert peg.drill_mm == pytest.approx(2 * peg.dowel_radius_mm + PLAY_MM)
        assert [d for _, d in circles] == pytest.approx(wide, abs=1e-3)
        middles = np.stack([m for m, _ in circles])
        assert middles - middles[0] == pytest.approx(place.holes - place.holes[0], abs=1e-3)
        assert len(page_sizes(tmp_path / name)) == 2  # words, and a frame that fits one page
    before = (tmp_path / names[0]).read_bytes()
    write_drill_template(tmp_path, mounted, camera)
    assert (tmp_path / names[0]).read_bytes() == before


def test_a_large_frame_is_tiled(tmp_path: Path) -> None:
    mounted, _, camera = setup("dowel", frame_width_mm=400.0, frame_height_mm=300.0)
    write_drill_template(tmp_path, mounted, camera)
    assert len(page_sizes(tmp_path / "drill-template-a4.pdf")) == 1 + 3 * 2


@pytest.mark.parametrize("kind", ["none", "plate", "stand"])
def test_only_dowels_are_drilled_for(kind: Kind, tmp_path: Path) -> None:
    mounted, _, camera = setup(kind)
    assert write_drill_template(tmp_path, mounted, camera) == []
    assert list(tmp_path.iterdir()) == []


# Setting up in words: steps with their figures, and what it costs to be off.


def test_steps_name_the_figures() -> None:
    words = {}
    for kind in ("none", "plate", "dowel", "stand"):
        mounted, scene, camera = setup(kind)
        place = placement_of(mounted, camera)
        words[kind] = " ".join(steps_of(mounted, place, scene.views[0]))
    assert "two holes 166 mm apart" in words["plate"] and "arrow up" in words["plate"]
    assert "600 mm off the plate's face" in words["plate"]
    assert "opposite the middle of the frame" in words["plate"]
    assert "603.8 mm from the upper and lower edges of the plate" in words["plate"]
    assert "606.4 mm from the left and right edges of the plate" in words["plate"]
    assert "the 3 numbered holes" in words["dowel"] and "11 mm deep" in words["dowel"]
    assert f"{np.hypot(600, 100):.1f} mm from every corner of the frame" in words["dowel"]
    assert "52 mm below to 52 mm above" in words["none"]
    # the lamp is at (0, 0, 500), the base at x -30 to 32, z -20 to 25, on a desk at -75
    assert "80 mm before the wall" in words["stand"] and "75 mm above the desk" in words["stand"]
    assert "475 mm in front" in words["stand"] and "1 mm to the left" in words["stand"]


def test_a_plate_without_room_for_marks_promises_none() -> None:
    mounted, scene, camera = setup("plate", margin_mm=2.4)
    said = " ".join(steps_of(mounted, placement_of(mounted, camera), scene.views[0]))
    assert "notch" not in said and "arrow" not in said


def test_costs_are_those_of_the_report() -> None:
    _, scene, _ = setup("none")
    view = scene.views[0]
    lines = costs_of(OFF, view, on_wall=False)
    assert lines[0] == "Lamp 10 mm to the side: about 14% less alike (the shadow moves 2 mm)"
    assert lines[2] == "Lamp 10 mm nearer or farther: less than 1% less alike"
    assert lines[3] == "Piece turned by 1° left or right: about 25% less alike"
    assert lines[4] == "Piece turned by 1° forward or back: about 50% less alike"
    assert len(lines) == 6
    hung = costs_of(OFF, view, on_wall=False, threads_apart_mm=80.0)
    assert hung[:3] == lines[:3] and hung[4] == lines[4]  # two threads let it lean, and no more
    assert hung[3] == "One thread 1.4 mm nearer the wall than the other: about 25% less alike"
    assert hung[5].startswith("One thread 1.4 mm longer than the other: ")
    fixed = costs_of(OFF, view, on_wall=True)
    # the lamp moves by 600 mm sin 1° = 10.47 mm
    assert fixed[3:] == [
        "Wall and piece turned by 1° left or right: about 15% less alike",
        "Wall and piece leaning by 1° forward or back: about 9% less alike",
    ]
    assert costs_of(None, view, on_wall=True) == [
        "Not measured: too little to see, or nothing rendered."
    ]
    least = replace(OFF, lamp_iou_per_mm={"right": 0.0005, "up": 0.00049, "towards": 5.0})
    told = costs_of(least, view, on_wall=False)
    assert "about 1%" in told[0] and "less than" in told[1] and "about 100%" in told[2]


def test_the_lamps_size_is_told_with_its_blur() -> None:
    _, scene, _ = setup("none")
    view = scene.views[0].model_copy(update={"light_diameter_mm": 20.0})
    assert "a spot of 20 mm; outlines blur by 4 mm" in " ".join(lamp_facts(view))
    point = view.model_copy(update={"light_diameter_mm": 0.0})
    assert "point" in " ".join(lamp_facts(point))
    # 300 x 200 mm are 360.6 mm across, of which a fifth blurs
    keys = {"light_shape": "rectangle", "light_width_mm": 300.0, "light_height_mm": 200.0}
    panel = scene.views[0].model_copy(update=keys)
    told = " ".join(lamp_facts(panel))
    assert "a rectangle of 300 x 200 mm; outlines blur by 72.1 mm" in told
    assert lamp_name(panel) == "lamp, 360.6 mm"
    leds = panel.model_copy(update={"light_shape": "leds", "light_leds": (3, 2)})
    assert "3 x 2 LEDs of 5 mm over 300 x 200 mm" in " ".join(lamp_facts(leds))
    # and neither a torch nor a bulb stands in for it
    for view in (panel, leds):
        assert "torch" not in " ".join(advise_lamp(view, 2.0))
    assert "torch" in " ".join(advise_lamp(scene.views[0], 2.0))


# Warnings are read whole and explained; check and table say what was proven by whom.


SAID = """[2024-01-01 05:32:24.0] [0x00] [trace]   Initializing StaticPrintConfigs
10 => Processing triangulated mesh
print warning: Empty layer between 0 and 15.2.

Object name: knot 2

Make sure the object is printable.
20 => Generating perimeters
print_object warning: The model has overlapping or self-intersecting facets. I tried to repair it.
something else
30 => Preparing infill
print warning: Empty layer between 0 and 15.2.

Object name: knot 2

Make sure the object is printable.
Slicing result exported to part.gcode
a line of its own
[2024-01-01 05:32:24.0] [0x00] [error]   Unable to open the file
"""
PRINT: Print = report_with().print
STABILITY = "Detected print stability issues:\n\nknot 1\n{}\n\nConsider enabling supports."

GOOD = Sliced(
    program="PrusaSlicer",
    version="2.5.0",
    time_s=3600.0,
    filament_m=12.5,
    filament_g=37.0,
    support_m=4.0,
    layers=100,
    objects=1,
    warnings=(),
    checks=(
        SlicerCheck("bed", "pass", -10.0, 0.0, "mm", "inside"),
        SlicerCheck("surface", "pass", 0.5, 1.1, "mm", "all printed"),
    ),
    command="prusa-slicer part.3mf",
    profile={"layer_height": "0.2"},
    seconds=17.0,
)


def test_warnings_are_read_whole_and_once() -> None:
    found = [warning.text for warning in read_warnings(SAID)]
    assert found == [
        "Empty layer between 0 and 15.2.\nObject name: knot 2\nMake sure the object is printable.",
        "The model has overlapping or self-intersecting facets. I tried to repair it."
        "\nsomething else",
        "a line of its own",
        "[2024-01-01 05:32:24.0] [0x00] [error]   Unable to open the file",
    ]
    assert read_warnings("") == [] == read_warnings("10 => Processing\n\n")


@pytest.mark.parametrize(
    ("text", "known", "settled"),
    [
        ("Empty layer between 0 and 15.2.", True, False),
        ("There is an object with no extrusions in the first layer.", True, False),
        ("The model has overlapping or self-intersecting facets.", True, True),
        (STABILITY.format("Long bridging extrusions"), True, True),
        (STABILITY.format("Loose extrusions, Floating object part"), True, False),
        ("(prusa-slicer:1): Gtk-WARNING **: cannot open display", True, True),
        ("A toolpath outside the print area was detected.", False, False),
        ("anything", False, False),
    ],
)
def test_what_is_known(text: str, known: bool, settled: bool) -> None:
    found = explain_warning(text)
    assert (bool(found.explanation), found.settled) == (known, settled)


def test_a_good_part() -> None:
    check = check_slicing(GOOD)
    assert (check.status, check.required, check.measured) == ("pass", True, 0)
    assert "2.5.0" in check.detail and "all printed" in check.detail
    found = with_slicing(PRINT, GOOD)
    assert (found.time_s, found.filament_m, found.filament_g) == (3600.0, 12.5, 37.0)
    assert (found.support_g, found.support_share) == pytest.approx((37.0 * 0.32, 0.32))


def test_an_explained_warning_passes_and_is_shown() -> None:
    warned = replace(GOOD, warnings=(SlicerWarning("hm", "it is fine", True),))
    assert check_slicing(warned).status == "pass"
    assert report_slicing(warned).warnings == warned.warnings


def test_what_fails() -> None:
    nobody = replace(GOOD, warnings=(SlicerWarning("odd\nthing"),))
    known = replace(GOOD, warnings=(SlicerWarning("Empty layer", "in the air"),))
    outside = replace(GOOD, checks=(replace(GOOD.checks[0], status="fail", detail="it is out"),))
    for result, word in ((nobody, "odd thing"), (known, "in the air"), (outside, "it is out")):
        check = check_slicing(result)
        assert (check.status, check.required, check.measured) == ("fail", True, 1)
        assert word in check.detail
    assert "nobody explains" in check_slicing(nobody).detail
    assert report_slicing(outside).checks[0].status == "fail"


@pytest.mark.parametrize(
    ("result", "status"),
    [
        (NotSliced("missing", "not installed", "apt-get"), "skipped"),
        (NotSliced("process", "resin"), "skipped"),
        (NotSliced("stopped", "no answer", said="10"), "skipped"),
        (NotSliced("refused", "it is thin", said="it is thin"), "fail"),
        (NotSliced("crashed", "signal 11", said="oh"), "fail"),
    ],
)
def test_parts_that_were_not_sliced(result: NotSliced, status: str) -> None:
    check = check_slicing(result)
    assert (check.status, check.required) == (status, status == "fail")
    assert check.detail.count(result.reason) == 1
    assert result.remedy in check.detail and result.said in check.detail
    table = report_slicing(result)
    assert table.program is None and table.time_s is None
    assert table.reason == result.reason
    # nothing is said to be proven by a program that did not run
    assert table.proven and all("part.stl" in record.by for record in table.proven)
    assert with_slicing(PRINT, result) == replace(PRINT, opening=OPENING)


def test_the_table() -> None:
    table = report_slicing(GOOD)
    assert read_as(SlicerFigures, plain(table)) == table
    assert {one.by.split()[0].strip(",'s") for one in table.proven} == {"knotfab", "PrusaSlicer"}
    assert table.proven == PROVEN
    for key in ("program", "version", "time_s", "filament_m", "filament_g", "layers"):
        assert getattr(table, key) == getattr(GOOD, key)


def test_the_notice_of_other_slicers_is_explained() -> None:
    for word in ("one object", "Bambu Studio", "OrcaSlicer", "not from them", "geometry only"):
        assert word in OPENING
    assert with_slicing(PRINT, None).opening == with_slicing(PRINT, GOOD).opening == OPENING
    assert report_slicing(GOOD).command == GOOD.command
