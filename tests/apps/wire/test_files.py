"""Plans in a bender's words: its numbers are those of the rows, and one that cannot work is refused."""

from __future__ import annotations

import re
from math import pi
from pathlib import Path

import pytest

from knotfab.apps.wire.arcs import Bend
from knotfab.apps.wire.files import BENDERS, file_of_bender, fill_template, require_bender
from knotfab.base.progress import Progress
from knotfab.pipeline.options import options_from
from knotfab.pipeline.prepare import prepare_build
from knotfab.scene.catalogue import materials
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Piece
from knotfab_formats.scene import Scene

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
        ("binary", "no text"),
        ("large", "too large"),
        ("missing", "No such file"),
        (".", ""),
    ):
        with pytest.raises(InputError, match=f"its template .*{why}.*one of lra, grbl"):
            require_bender(Scene(piece=Piece(bender=str(tmp_path / name))))


def test_a_build_refuses_before_it_searches() -> None:
    wire, quiet = {"material": "steel-wire-2mm"}, Progress("quiet")
    with pytest.raises(InputError, match=r"the bender .*nowhere\.nc: its template cannot be read"):
        prepare_build(["text:C"], options_from({**wire, "bender": "nowhere.nc"}), "", quiet)
    with pytest.raises(InputError, match="--bender lra: there is no wire to bend"):
        prepare_build(["text:C"], options_from({"bender": "lra"}), "", quiet)
