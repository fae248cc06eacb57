"""The drawings of a mount: page sizes, figures that are there, holes at full size, the same bytes again."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from pages import POINT, page_contents, page_sizes
from pieces import Kind, setup
from reports import report_with
from tables import some

from knotfab.hold.placement import placement_of
from knotfab.hold.wall import DRILLS_MM, PLAY_MM
from knotfab.part.slicer_process import NotSliced, Sliced
from knotfab.part.slicer_profile import explain_warning, read_warnings
from knotfab.report.drill_template import write_drill_template
from knotfab.report.for_maker import advise_lamp, check_slicing, report_slicing, with_slicing
from knotfab.report.setup import write_setup
from knotfab.report.setup_views import shadow_outlines
from knotfab.report.setup_words import lamp_facts, lamp_name, roots_steps, steps_of
from knotfab_formats.errors import plain, read_as
from knotfab_formats.print_figures import (
    Print,
    RootsFigures,
    SlicerCheck,
    SlicerFigures,
    SlicerWarning,
)

pytestmark = pytest.mark.slow

KINDS: tuple[Kind, ...] = ("none", "plate", "dowel", "stand")


def texts(path: Path) -> list[str]:
    """The texts of an SVG of matplotlib's, which draws them as paths and notes what they say."""
    return [t.strip() for t in re.findall(r"<!--(.*?)-->", path.read_text(encoding="utf-8"))]


FIGURES = {
    "none": {"80", "60"},  # the lamp's foot, from the frame's edges
    "plate": {"plate 176", "plate 136", "screw holes 166", "88", "68"},
    "dowel": {"80", "60", "1", "2", "3"},
    # from the wall to the base, from the base to the lamp, and from the desk to the lamp
    "stand": {"80", "60", "70", "455", "75", "desk"},
}


@pytest.mark.parametrize("kind", KINDS)
def test_pages_with_their_figures_and_the_same_bytes_again(kind: Kind, tmp_path: Path) -> None:
    names, found = ["setup.pdf", "setup.svg"], []
    mounted, scene, camera = setup(kind, light_distance_mm=480.0, wall_distance_mm=90.0)
    for _ in range(2 if kind == "plate" else 1):
        assert write_setup(tmp_path, mounted, scene, [camera]) == names
        found.append([(tmp_path / name).read_bytes() for name in names])
    assert found[0] == found[-1]
    pdf, svg = found[0]
    sizes = page_sizes(tmp_path / "setup.pdf")  # the last has the marks for a photograph
    assert sizes == pytest.approx(np.array([[210, 279.4]] * 2), abs=0.005)
    head = re.search(rb'width="([\d.]+)pt" height="([\d.]+)pt"', svg)
    assert head is not None
    assert np.array(head.groups(), dtype=float) / POINT == pytest.approx([210, 279.4], abs=0.005)
    assert b"CreationDate" not in pdf and b"<dc:date>" not in svg
    told = {"480", "90", "570", "frame 160", "frame 120", "Setting up", *FIGURES[kind]}
    assert told <= set(texts(tmp_path / "setup.svg"))


@pytest.mark.parametrize(
    ("tape", "screws", "said"),
    [
        ("pads", 2, "press it to the wall with double-sided tape behind its two pads"),
        ("along", 2, "press it to the wall with double-sided tape along the backs of its strips (39 cm²)"),
        ("along", 0, "Press the piece to the wall, the way up that is drawn, with double-sided tape along"),
    ],
)  # fmt: skip
def test_the_steps_say_what_is_taped(
    tape: Literal["pads", "along"], screws: int, said: str
) -> None:
    holes = np.array([[-20.0, 5.0], [20.0, 5.0]])[:screws]
    places = tuple((float(x), float(y)) for x, y in holes)
    roots = RootsFigures(
        width_mm=7.0, thickness_mm=1.6, screws=places, tape=tape, area_cm2=39.2, mass_g=7.8
    )
    steps = " ".join(roots_steps(roots, 4.0, holes))
    assert said in steps and ("nails" in steps) == bool(screws)


@pytest.mark.parametrize("kind", ["none", *some(("plate", "dowel", "stand"), 2)])
def test_a_leaning_wall_and_a_far_lamp_stay_on_the_page(kind: Kind, tmp_path: Path) -> None:
    mounted, scene, camera = setup(kind, wall_tilt_deg=20.0, light_distance_mm=3000.0)
    write_setup(tmp_path, mounted, scene, [camera])
    assert "3100" in texts(tmp_path / "setup.svg")
    page = max(page_contents(tmp_path / "setup.pdf"), key=len)
    at = np.array(re.findall(r"([-\d.]+) ([-\d.]+) [ml]\n", page), dtype=float) / POINT
    paper = ((np.abs(at) < 0.01) | (np.abs(at - [210, 279.4]) < 0.01)).all(axis=1)
    at = at[~paper]  # the sheet itself
    assert at.min() > 5 and (at.max(axis=0) < [205, 292]).all()


def test_the_shadow_is_drawn_where_it_falls() -> None:
    mounted, _, camera = setup("none")
    points = np.concatenate(shadow_outlines(mounted, placement_of(mounted, camera)))
    pixels = camera.project(mounted.bodies[0][0])
    wall = np.column_stack([pixels[:, 0] + 0.5 - 40, 30 - pixels[:, 1] - 0.5]) * 2.0
    assert points.max(axis=0) == pytest.approx(wall.max(axis=0), abs=0.1)
    assert points.min(axis=0) == pytest.approx(wall.min(axis=0), abs=0.1)


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
    assert write_drill_template(tmp_path, mounted, camera) == ["drill-template.pdf"]
    place, name = placement_of(mounted, camera), tmp_path / "drill-template.pdf"
    circles = [
        c for page in page_contents(name) for c in curves(page) if c[1] < 10
    ]  # not of letters
    assert len(circles) == 3
    wide = [peg.drill_mm for peg in mounted.wall.pegs]
    assert set(wide) <= set(DRILLS_MM)
    for peg in mounted.wall.pegs:  # a shoulder stays, and no more of it than a drill's step
        assert 0 <= peg.foot_radius_mm - peg.dowel_radius_mm < 0.25
        assert peg.drill_mm == pytest.approx(2 * peg.dowel_radius_mm + PLAY_MM)
    assert [d for _, d in circles] == pytest.approx(wide, abs=1e-3)
    middles = np.stack([m for m, _ in circles])
    assert middles - middles[0] == pytest.approx(place.holes - place.holes[0], abs=1e-3)
    assert len(page_sizes(name)) == 1  # the frame fits
    before = name.read_bytes()
    write_drill_template(tmp_path, mounted, camera)
    assert name.read_bytes() == before


def test_a_large_frame_is_tiled_and_only_dowels_are_drilled_for(tmp_path: Path) -> None:
    for kind in ("none", "plate", "stand"):
        mounted, _, camera = setup(kind)
        assert write_drill_template(tmp_path, mounted, camera) == [] == list(tmp_path.iterdir())
    mounted, _, camera = setup("dowel", frame_width_mm=400.0, frame_height_mm=300.0)
    write_drill_template(tmp_path, mounted, camera)
    assert len(page_sizes(tmp_path / "drill-template.pdf")) == 3 * 2


# Setting up in words.


STEPS: list[tuple[Kind, dict[str, float], list[str]]] = [
    (
        "plate",
        {},
        [
            *("two holes 166 mm apart", "its arrow up", "600 mm off the plate's face", "notches"),
            "opposite the middle of the frame",
            "603.8 mm from the upper and lower edges of the plate",
            "606.4 mm from the left and right edges of the plate",
        ],
    ),
    (
        "dowel",
        {},
        [
            *("the 3 numbered holes", "11 mm deep"),
            f"{np.hypot(600, 100):.1f} mm from every corner of the frame",
        ],
    ),
    ("none", {}, ["52 mm below to 52 mm above"]),
    # the lamp is at (0, 0, 500), the base at x -30 to 32, z -20 to 25, on a desk at -75
    (
        "stand",
        {},
        ["80 mm before the wall", "75 mm above the desk", "475 mm in front", "1 mm to the left"],
    ),
    # a plate without room for marks promises none
    ("plate", {"margin_mm": 2.4}, ["Screw the plate on, the way up that is drawn"]),
]


@pytest.mark.parametrize(("kind", "keys", "told"), STEPS)
def test_steps_name_the_figures(kind: Kind, keys: dict[str, float], told: list[str]) -> None:
    mounted, scene, camera = setup(kind, **keys)
    said = " ".join(steps_of(mounted, placement_of(mounted, camera), scene.views[0]))
    assert all(part in said for part in told), said
    assert ("notch" in said) == ("notches" in told)


def test_the_lamps_size_is_told_with_its_blur() -> None:
    view = setup("none")[1].views[0]
    panel = {"light_shape": "rectangle", "light_width_mm": 300.0, "light_height_mm": 200.0}
    leds = {**panel, "light_shape": "leds", "light_leds": (3, 2)}
    for keys, said, torch in (
        ({"light_diameter_mm": 20.0}, "a spot of 20 mm; outlines blur by 4 mm", True),
        ({"light_diameter_mm": 0.0}, "point", True),
        # 300 x 200 mm are 360.6 mm across, of which a fifth blurs; no torch stands in for that
        (panel, "a rectangle of 300 x 200 mm; outlines blur by 72.1 mm", False),
        (leds, "3 x 2 LEDs of 5 mm over 300 x 200 mm", False),
    ):
        lamp = view.model_copy(update=keys)
        assert said in " ".join(lamp_facts(lamp))
        assert ("torch" in " ".join(advise_lamp(lamp, 2.0))) == torch
    assert lamp_name(view.model_copy(update=panel)) == "lamp, 360.6 mm"


# Warnings are read whole and explained.


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


def test_a_part_as_the_slicer_found_it() -> None:
    check = check_slicing(GOOD)
    assert (check.status, check.required, check.measured) == ("pass", True, 0)
    assert "2.5.0" in check.detail and "all printed" in check.detail
    found = with_slicing(PRINT, GOOD)
    assert (found.time_s, found.filament_m, found.filament_g) == (3600.0, 12.5, 37.0)
    assert (found.support_g, found.support_share) == pytest.approx((37.0 * 0.32, 0.32))
    warned = replace(GOOD, warnings=(SlicerWarning("hm", "it is fine", True),))
    assert check_slicing(warned).status == "pass"
    assert report_slicing(warned).warnings == warned.warnings
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
    assert with_slicing(PRINT, result) == PRINT == with_slicing(PRINT, None)


def test_the_table_of_a_part_that_was_sliced() -> None:
    table = report_slicing(GOOD)
    assert read_as(SlicerFigures, plain(table)) == table
    for key in ("program", "version", "time_s", "filament_m", "filament_g", "layers", "command"):
        assert getattr(table, key) == getattr(GOOD, key)
