"""The one line that concludes, and what is asked about a part's unit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from validator_parts import trefoil, tube

from knotfab.verify.verifier import Files, Verifier
from knotfab_validators.check import Check, at_least, skip_check
from knotfab_validators.conclusion import ask_unit, conclude, knot_in_words
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.validate import validate
from tests.corpus.files import encode
from tests.corpus.parts import Body

CURVE = trefoil(120, 16.0)
TUBE = Mesh(*tube(CURVE, 3.0, 24))
KNOTS = Curves((CURVE,), ("3_1",), (True,), 3.0)
KIND = Check("knot_type", "pass", True, "left-handed 3_1, proved", None, "", "")


def test_a_tube_is_told_with_its_radius_its_knot_and_its_size() -> None:
    said = conclude([KIND], TUBE, KNOTS)
    assert said.startswith(
        "One closed tube, 3 mm radius, a left-handed trefoil; every required check"
    )
    assert said.endswith(" mm.") and said.count(" × ") == 2
    two = replace(KNOTS, polygons=(CURVE, CURVE + 100), types=("", ""), closed=(True, True))
    unknots = [replace(KIND, measured="unknot, proved")]
    assert conclude(unknots, None, two).startswith(
        "Two closed curves, 3 mm radius, each an unknot;"
    )


def test_what_failed_is_named_where_it_is_asked_for() -> None:
    checks = [
        at_least("tube", 1.0, 2.0, "mm", ""),
        at_least("gap", 1.0, 2.0, "mm", "", required=False),
        skip_check("shadow", "", required=True),
        skip_check("region", ""),
    ]
    said = conclude(checks, None, KNOTS)
    assert "1 required check failed: tube; 1 required check could not run: shadow." in said


def test_other_parts_are_told_as_such() -> None:
    bodies = Check("mesh_bodies", "pass", False, 2, None, "", "")
    lines = Check("centre_line", "fail", False, "no tube", None, "", "no closed tube: a ball")
    assert conclude([bodies, lines], None, None).startswith("Two bodies, no closed tube;")
    assert conclude([], None, None).startswith("No closed tube;")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("left-handed 3_1", "left-handed trefoil"),
        ("4_1, unknot", "figure-eight knot, unknot"),
        ("13_1", "13_1"),
        ("3_1#m3_1", "3_1#m3_1"),
    ],
)
def test_knots_that_have_a_word_are_told_by_it(name: str, words: str) -> None:
    assert knot_in_words(name) == words


@pytest.mark.parametrize(("scale", "asked"), [(1e-3, "--unit m"), (1.0, ""), (100.0, "than mm")])
def test_a_part_too_small_or_too_large_is_asked_for_its_unit(scale: float, asked: str) -> None:
    question = ask_unit(Mesh(scale * TUBE.vertices, TUBE.faces), "part.stl")
    assert (question is None) == (not asked)
    assert asked in (question or "")


@pytest.mark.slow
def test_a_part_in_metres_is_measured_in_its_unit(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    path.write_bytes(encode(Body(1e-3 * TUBE.vertices, TUBE.faces), "stl"))
    found = validate(path, unit="m")
    assert found.size_mm == pytest.approx(np.ptp(TUBE.vertices, axis=0), rel=1e-4)
    assert "2.98 mm radius, a left-handed trefoil;" in found.conclusion
    assert found.to_dict()["notes"] == [] and validate(path).notes != ()
    with Verifier() as verifier:
        told = verifier.submit(Files(path), unit="m").result()
    assert told.conclusion == found.conclusion
