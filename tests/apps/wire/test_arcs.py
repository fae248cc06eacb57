"""Wires of straights and bends: exact curves, the rows bent again, the file, and the fit."""

from __future__ import annotations

import os
import re
import sys
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest
from pieces import ring

from knotfab.apps.wire.arcs import (
    Bend,
    WireSites,
    differentiate_wire,
    find_nearest_sites,
    list_bends,
    round_corners,
    space_sites,
    tool_angle_deg,
)
from knotfab.apps.wire.files import (
    BENDERS,
    COLUMNS,
    file_of_bender,
    fill_template,
    read_bends,
    require_bender,
    write_bends,
)
from knotfab.apps.wire.fit import fit_wires
from knotfab.apps.wire.judge import (
    measure_deviation,
    measure_least_distance,
    measure_sensitivity,
    replay,
)
from knotfab.apps.wire.residual import FitLimits
from knotfab.base.disk import confined
from knotfab.base.progress import Progress
from knotfab.pipeline.options import options_from
from knotfab.pipeline.prepare import prepare_build
from knotfab.scene.catalogue import materials
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Piece
from knotfab_formats.scene import Scene

SQUARE = np.array([[0.0, 0, 0], [40, 0, 0], [40, 40, 0], [0, 40, 0]])


def make_crooked(seed: int = 0, count: int = 14) -> np.ndarray:
    angle = 2 * np.pi * np.arange(count) / count
    noise = np.random.default_rng(seed).normal(size=count)
    return np.column_stack([40 * np.cos(angle), 30 * np.sin(angle), 6 * noise])


def test_a_square_has_four_quarter_bends() -> None:
    wire = round_corners(SQUARE, 5.0)
    assert np.allclose(np.rad2deg(wire.turn), 90) and np.allclose(wire.straight, 30)
    assert wire.length_mm == pytest.approx(4 * 30 + 2 * np.pi * 5)
    middle = wire.at(WireSites(np.array([1]), np.array([True]), np.array([0.5])))
    assert middle[0] == pytest.approx([35 + 5 / np.sqrt(2), 5 - 5 / np.sqrt(2), 0])


def test_the_nearest_site_is_on_the_named_strand() -> None:
    wire = round_corners(SQUARE, 5.0)
    points = np.array([[20.0, 1, 0], [40 - 1, 1, 0]])
    sites, distance = find_nearest_sites(wire, points, np.array([0, 0]))
    assert distance == pytest.approx([1.0, np.hypot(4, 4) - 5])
    assert sites.bend.tolist() == [False, True] and sites.piece.tolist() == [0, 1]


def test_the_jacobian_is_that_of_the_curve() -> None:
    corners = make_crooked()
    wire = round_corners(corners, 2.0)
    sites, _ = space_sites(wire, 3.0)
    points, straights = differentiate_wire(wire, sites)
    step = 1e-5 * np.random.default_rng(1).normal(size=corners.shape)
    moved = round_corners(corners + step, 2.0)
    assert np.abs(points @ step.ravel() - (moved.at(sites) - wire.at(sites)).ravel()).max() < 1e-8
    assert np.abs(straights @ step.ravel() - (moved.straight - wire.straight)).max() < 1e-8


@pytest.mark.parametrize("cut", [0, 5, 13])
def test_rows_bend_the_wire_again_exactly(cut: int) -> None:
    wire = round_corners(make_crooked(), 2.0)
    rows = list_bends(wire, cut, 0.0)
    line, begins = replay(rows)
    assert np.abs(line[-1] - line[0]).max() < 1e-11
    order = (cut + 1 + np.arange(14)) % 14
    assert np.abs(begins - wire.entry[order]).max() < 1e-11
    assert rows.length_mm == pytest.approx(wire.length_mm, abs=1e-9)
    assert rows.count == 14 and rows.bends[-1].note == "joint"
    assert rows.bends[0].rotation_deg == pytest.approx(0)


def test_many_rows_do_not_let_rounding_grow() -> None:
    wire = round_corners(make_crooked(3, 400) * [10, 10, 1], 0.5)
    line, _ = replay(list_bends(wire, 0, 0.0))
    assert np.abs(line[-1] - line[0]).max() < 1e-9


def test_rotation_turns_clockwise_as_seen_along_the_feed() -> None:
    # along x, then towards y, then up: the second bend is a quarter turn from the first
    corners = np.array([[0.0, 0, 0], [30, 0, 0], [30, 30, 0], [30, 30, 30], [0, 0, 30.0]])
    rows = list_bends(round_corners(corners, 2.0), 0, 0.0)
    second = rows.bends[1]
    # fed along y, the first bend's side is -x; z lies at a right-handed turn about y from there
    assert second.rotation_deg == pytest.approx(90)


def test_springback_is_given_in_advance() -> None:
    assert tool_angle_deg(90, 0) == 90
    assert tool_angle_deg(96, 4) == pytest.approx(100)
    rows = list_bends(round_corners(SQUARE, 5.0), 0, 10.0)
    assert rows.bends[0].tool_angle_deg == pytest.approx(100)


def test_the_file_reads_back_and_stays_closed(tmp_path: Path) -> None:
    rows = list_bends(round_corners(make_crooked(), 2.0), 2, 4.0)
    path = tmp_path / "bends.csv"
    write_bends(path, rows, {"wire": "steel: 2 mm"})
    again = read_bends(path)
    assert len(again.bends) == len(rows.bends)
    for a, b in zip(rows.bends, again.bends, strict=True):
        assert b.distance_mm == pytest.approx(a.distance_mm, abs=6e-4)
        assert b.rotation_deg == pytest.approx(a.rotation_deg, abs=6e-4) and a.note == b.note
    line, _ = replay(again)
    assert np.linalg.norm(line[-1] - line[0]) < 0.02
    assert "# wire: steel: 2 mm\n" in path.read_text() and "-0.000" not in path.read_text()
    assert ",".join(COLUMNS) in path.read_text()


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("# normal", "# nrmal", "normal"),
        ("feed_mm", "feed_cm", "columns"),
        ("\n1,", "\n1,nan,", "not a number|columns"),
        ("\n1,5", "\n1,x5", "not a number"),
        ("\n1,5", "\n1,-5", "negative"),
        ("direction: 1.0", "direction: 9 9 9 1.0", "direction"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = tmp_path / "bends.csv"
    write_bends(path, list_bends(round_corners(SQUARE + [0, 0, 1], 5.0), 3, 0.0), {})
    text = path.read_text().replace("# direction: 0.0", "# direction: 1.0")
    text = text.replace("\n1,15", "\n1,5")
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=says):
        read_bends(path)


def test_deviation_is_measured_both_ways_and_across_the_rays() -> None:
    circle = ring(30.0, n=400, wave=0.0)
    lifted = circle + [0, 0, 2.0]
    light = np.array([0, 0, 1e6])
    found = measure_deviation(circle, lifted, [light])
    assert found.largest == pytest.approx(2, abs=1e-3) and found.across < 1e-3
    side = np.array([1e6, 0, 0])
    assert measure_deviation(circle, lifted, [light, side]).across == pytest.approx(2, abs=1e-3)
    wide = measure_deviation(circle, 1.02 * circle, [light])
    assert wide.across == pytest.approx(0.6, abs=0.01) == wide.largest
    bump = circle.copy()
    bump[100] *= 1.1  # a spike of the second curve counts although the first is never far
    assert measure_deviation(circle, bump, [light]).largest > 2.5
    assert measure_deviation(bump, circle, [light]).largest > 2.5


def test_another_strand_does_not_excuse_one_that_strayed() -> None:
    t = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    two = np.column_stack([30 * np.cos(2 * t), 30 * np.sin(2 * t), 1.5 * np.cos(t)])
    strayed = two.copy()
    strayed[900:1100, 2] *= -1  # for a fifth of a turn it lies where the other strand is
    assert measure_deviation(two, strayed, []).largest == pytest.approx(3, abs=0.05)


def test_least_distance_of_strands() -> None:
    circle = ring(30.0, n=300, wave=0.0)
    for gap in (1.0, 2.0, 3.0, 5.0):
        assert measure_least_distance([circle, circle + [0, 0, gap]], 2.0) == pytest.approx(
            gap, abs=0.02
        )
    assert measure_least_distance([circle], 2.0) == 6.0  # nothing is near: it is not looked for
    long = np.array([[0.0, 0, 0], [100, 0, 0], [100, 2.5, 0], [0, 2.5, 0]])
    assert measure_least_distance([long], 2.0) == pytest.approx(2.5, abs=0.02)


def test_sensitivity_of_one_bend() -> None:
    # the first bend of a square cut in a side's middle moves the end about its corner
    found = measure_sensitivity(list_bends(round_corners(SQUARE, 1e-6), 3, 0.0))
    arms = np.array([20.0, np.hypot(40, 20), np.hypot(40, 20), 20.0]) * np.pi / 180
    assert found.worst == pytest.approx(arms.max(), rel=1e-5)
    assert found.typical == pytest.approx(np.sqrt((arms**2).sum()), rel=1e-5)


# --- the fit -----------------------------------------------------------------------------------

LIMITS = FitLimits(2.0, 2.0, 160.0, 2.0, 0.475)


def make_knotted(count: int = 600) -> np.ndarray:
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    r = 17 + 6 * np.cos(3 * t)
    return np.column_stack([r * np.cos(2 * t), r * np.sin(2 * t), 8 * np.sin(3 * t)])


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.475, pytest.param(0.2, marks=pytest.mark.study)])
def test_a_circle_takes_as_few_bends_as_it_needs(tolerance: float) -> None:
    circle = ring(12.0, n=320, wave=0.0)
    (wire,) = fit_wires([circle], replace(LIMITS, tolerance_mm=tolerance))
    # corners that stand out as far as the chords lie within: at least pi / sqrt(4 t / (R - r))
    least = np.pi / np.sqrt(4 * tolerance / 10)
    assert least <= len(wire.corners) <= 1.6 * least
    line, _ = replay(list_bends(wire, 0, 0.0))
    assert measure_deviation(circle, line[:-1], []).largest <= tolerance + 0.025


@pytest.mark.slow
def test_a_trefoil_is_bent_within_all_limits() -> None:
    curve, light = make_knotted(), np.array([0, 0, 500.0])
    (wire,) = fit_wires([curve], replace(LIMITS, light=light))
    assert wire.straight.min() >= 2.0 - 0.01 and np.rad2deg(wire.turn.max()) <= 160
    line, _ = replay(list_bends(wire, 0, 0.0))
    found = measure_deviation(curve, line[:-1], [light])
    assert found.across <= 0.5 and found.largest <= 1.0
    assert measure_least_distance([line[:-1]], 2.0) >= 2.0
    assert len(wire.corners) < 80


@pytest.mark.slow
def test_hairpins_become_two_bends() -> None:
    # a race track whose ends turn at the tightest that a wire's data file allows
    side = np.linspace(0, 60, 120)[:, None]
    arc = np.linspace(0, np.pi, 30)[1:-1]
    curve = np.concatenate(
        [
            side * [1, 0, 0] + [0, -3, 0],
            np.column_stack([60 + 3 * np.sin(arc), -3 * np.cos(arc), 0 * arc]),
            side[::-1] * [1, 0, 0] + [0, 3, 0],
            np.column_stack([-3 * np.sin(arc), 3 * np.cos(arc), 0 * arc]),
        ]
    )
    (wire,) = fit_wires([curve], LIMITS)
    assert 4 <= len(wire.corners) <= 8 and wire.straight.min() >= 1.99
    line, _ = replay(list_bends(wire, 0, 0.0))
    assert measure_deviation(curve, line[:-1], []).largest <= 0.6


# Plans in a bender's words: its numbers are those of the rows, and one that cannot work is
# refused.


STEEL = materials()["steel-wire-2mm"]
BENDS = (
    Bend(12.5, 12.5, 0.0, 90.0, 94.7368, 6.0),
    Bend(31.92478, 10.0, -33.3336, 45.0, 47.368, 6.0, "as good as straight"),
    Bend(41.6, 5.0, 0.0, 0.0, 0.0, 0.0, "joint"),
)
LOOP = "{% for bend in bends %}\n", "{% endfor %}\n"
ALL = "{{ bend.feed_mm }} {{ bend.rotation_deg }} {{ bend.bend_deg }}\n"


def test_the_table_has_length_rotation_and_angle_alone() -> None:
    text = fill_template("lra", BENDS, "bends.csv", STEEL)
    head, *rows = text.splitlines()
    assert head == "length_mm,rotation_deg,angle_deg"
    assert rows == ["12.500,0.000,94.737", "10.000,-33.334,47.368", "5.000,0.000,0.000"]


def test_relative_moves_feed_the_whole_wire() -> None:
    text = fill_template("grbl", BENDS, "bends.csv", STEEL)
    moves = {a: [float(x) for x in re.findall(rf"^G1 {a}(\S+)", text, re.M)] for a in "XAB"}
    arcs = pi * 6.0 / 2 + pi * 6.0 / 4
    assert sum(moves["X"]) == pytest.approx(27.5 + arcs, abs=2e-3)
    assert moves["A"] == [0.0, -33.334] and sum(moves["B"]) == 0.0 and moves["B"][0] == 94.737
    assert "2.000 mm thick" in text and "joint" in text


@pytest.mark.parametrize("name", BENDERS)
def test_own_templates_are_whole(name: str) -> None:
    require_bender(Scene(piece=Piece(bender=name)))


def test_an_absolute_axis_is_turned_on_and_on(tmp_path: Path) -> None:
    (tmp_path / "my bender.NC").write_text("".join((LOOP[0], "A{{ bend.turned_deg }};", LOOP[1])))
    name = str(tmp_path / "my bender.NC")
    assert fill_template(name, BENDS, "b", STEEL) == "A0.000;A-33.334;A-33.334;"
    assert file_of_bender(name, "bends-01-2.csv") == "bends-01-2-my-bender.nc"
    assert file_of_bender("lra", "bends.csv") == "bends-lra.csv"


WRONG = {
    "no loop": ("G21\n", "no place for the length"),
    "no length": (ALL.replace("feed_mm", "radius_mm"), "no place for the length"),
    "no rotation": (ALL.replace("rotation_deg", "index"), "no place for the rotation"),
    "no angle": (ALL.replace("bend_deg", "note"), "no place for the angle"),
    "unknown": (ALL + "{{ bend.twist }}", "no attribute 'twist'.*A bend has index, distance_mm"),
    "unknown word": (ALL + "{{ springback }}", "'springback' is undefined"),
    "not closed": (ALL + "{% if %}", "line 3 of its template cannot be read"),
    "not numbers": (ALL + "{{ bend.note + 1 }}", "cannot be filled in"),
    "endless": ("{% macro a() %}{{ a() }}{% endmacro %}{{ a() }}", "cannot be filled in"),
    "outside": ("{{ bend.__class__.__mro__ }}", "cannot be filled in"),
    "another file": ("{% include '/etc/passwd' %}", "cannot be filled in"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_template_that_cannot_work_is_refused(tmp_path: Path, case: str) -> None:
    row, why = WRONG[case]
    path = tmp_path / "mine.gcode"
    path.write_text(row if case == "no loop" else "".join((LOOP[0], row, LOOP[1])))
    with pytest.raises(InputError, match=f"the bender .*mine.gcode: .*{why}"):
        require_bender(Scene(piece=Piece(bender=str(path))))


def test_a_file_that_is_no_template_is_refused(tmp_path: Path) -> None:
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "large").write_text("x" * 200_000)
    for name, why in (
        ("binary", "its template is no text"),
        ("large", "too much for a template"),
        ("missing", "there is no such file"),
        (".", ""),
    ):
        with pytest.raises(InputError, match=f"the bender .*{why}"):
            require_bender(Scene(piece=Piece(bender=str(tmp_path / name))))


def test_a_build_refuses_before_it_searches() -> None:
    wire, quiet = {"material": "steel-wire-2mm"}, Progress("quiet")
    with pytest.raises(InputError, match=r"the bender .*nowhere\.nc: there is no such file"):
        prepare_build(["text:C"], options_from({**wire, "bender": "nowhere.nc"}), "", quiet)
    with pytest.raises(InputError, match="--bender lra: there is no wire to bend"):
        prepare_build(["text:C"], options_from({"bender": "lra"}), "", quiet)


@pytest.mark.usefixtures("copies")
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits it")
def test_a_template_that_never_ends_and_one_that_is_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("knotfab.apps.wire.files._SECONDS", 1)
    loop = "{% for a in range(99999) %}{% for b in range(99999) %}{% endfor %}{% endfor %}"
    (tmp_path / "loop").write_text(loop)
    os.mkfifo(tmp_path / "pipe")
    for name, why in (
        (tmp_path / "loop", "takes more than 1 s"),
        (tmp_path / "pipe", "not a regular file"),
        ("/dev/zero", "not a regular file"),
    ):
        with pytest.raises(InputError, match=why):
            fill_template(str(name), BENDS, "bends", STEEL)
    with confined([tmp_path / "inside"]), pytest.raises(InputError, match="outside the folders"):
        fill_template(str(tmp_path / "loop"), BENDS, "bends", STEEL)
