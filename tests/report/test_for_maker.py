"""Warnings are read whole and explained; check and table say what was proven by whom."""

from __future__ import annotations

from dataclasses import replace

import pytest
from reports import report_with

from knotfab.part.slicer_process import NotSliced, Sliced
from knotfab.part.slicer_profile import explain_warning, read_warnings
from knotfab.report.for_maker import (
    OPENING,
    PROVEN,
    check_slicing,
    report_slicing,
    tell_kept,
    with_slicing,
)
from knotfab_formats.errors import plain, read_as
from knotfab_formats.report import Print, SlicerCheck, SlicerFigures, SlicerWarning

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


def test_gcode_that_is_asked_for_and_not_there_is_told() -> None:
    missing = NotSliced("missing", "PrusaSlicer is not installed", "Install it.")
    assert tell_kept(missing) == ["No G-code is kept: PrusaSlicer is not installed. Install it."]
    assert tell_kept(GOOD) == tell_kept(None) == []
