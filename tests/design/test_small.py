"""Two drawings of thin lines are refused where no search can mend them, with a remedy."""

from __future__ import annotations

import re

import numpy as np
import pytest
from questions import ask_views
from shapely import MultiPolygon, Point

from knotfab.base.errors import SceneError
from knotfab.design.question import Question
from knotfab.design.small import require_strokes
from knotfab.problem import Start
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene

THINNEST_MM = resolve(Scene()).printer.min_tube_radius_mm
DISC = MultiPolygon([Point(0, 0).buffer(40)])


def ring(diameters: float) -> MultiPolygon:
    """A circle of line, so many times as wide as the thinnest tube."""
    half = diameters * THINNEST_MM
    return MultiPolygon([Point(0, 0).buffer(40 + half).difference(Point(0, 0).buffer(40 - half))])


def ask(first: MultiPolygon, drawn: float, accept: tuple[str, ...] = ()) -> tuple[Question, Start]:
    scene = resolve(Scene())
    scene = scene.but(accuracy=scene.accuracy.but(accept=accept))
    start = Start((np.zeros((3, 3)),), "by hand", ious=(drawn, 0.95))
    return Question(scene, ask_views([first, DISC], 0.0, 90.0)), start


def test_thin_lines_that_the_start_misses_are_refused_with_a_size_that_does() -> None:
    question, start = ask(ring(1.6), 0.6)
    with pytest.raises(SceneError, match="strokes") as refused:
        require_strokes(question, start)
    wide, needed = map(float, re.findall(r"([\d.]+) mm(?: wide|, 2.5)", str(refused.value)))
    assert wide == pytest.approx(1.6 * 2 * 1.2 * THINNEST_MM, abs=0.1)
    assert needed == pytest.approx(2.5 / 1.6 * wide, abs=0.15)
    (height,) = map(float, re.findall(r"(\d+) mm high", str(refused.value)))
    # the picture is 120 mm high, and all grows with it
    assert needed / wide <= height / 120.0 + 0.05 < needed / wide + 0.2


@pytest.mark.parametrize(
    ("diameters", "drawn", "accept"),
    [(1.6, 0.85, ()), (2.2, 0.6, ()), (9.0, 0.6, ()), (1.6, 0.6, ("unrecognisable",))],
)
def test_others_are_searched(diameters: float, drawn: float, accept: tuple[str, ...]) -> None:
    require_strokes(*ask(ring(diameters), drawn, accept))
