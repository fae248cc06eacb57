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


def ask(
    diameters: float, drawn: float, accept: tuple[str, ...] = (), views: int = 2
) -> tuple[Question, Start]:
    """A ring of line among discs, and a start that draws so much of it (IoU)."""
    scene = resolve(Scene())
    scene = scene.but(accuracy=scene.accuracy.but(accept=accept))
    start = Start((np.zeros((3, 3)),), "by hand", ious=(drawn, *[0.95] * (views - 1)))
    azimuths = np.arange(views) * 180.0 / views
    pictures = [ring(diameters), *[DISC] * (views - 1)]
    return Question(scene, ask_views(pictures, *azimuths.tolist())), start


# the widths are between what was drawn badly and what was drawn well: docs/scenarios.md
@pytest.mark.parametrize(
    ("views", "diameters", "enough"), [(2, 1.6, 2.5), (3, 3.8, 5.0), (4, 5.0, 10.0), (5, 5.0, 10.0)]
)
def test_thin_lines_that_the_start_misses_are_refused_with_a_size_that_does(
    views: int, diameters: float, enough: float
) -> None:
    question, start = ask(diameters, 0.6, views=views)
    with pytest.raises(SceneError, match="strokes") as refused:
        require_strokes(question, start)
    said = str(refused.value)
    wide, needed = map(float, re.findall(rf"([\d.]+) mm(?: wide|, {enough:g} times)", said))
    assert wide == pytest.approx(diameters * 2 * 1.2 * THINNEST_MM, abs=0.1)
    assert needed == pytest.approx(enough / diameters * wide, abs=0.15)
    (height,) = map(float, re.findall(r"(\d+) mm high", said))
    # the picture is 120 mm high, and all grows with it
    assert needed / wide <= height / 120.0 + 0.05 < needed / wide + 0.2
    assert ("show fewer" in said) is (views > 2)


@pytest.mark.parametrize(
    ("diameters", "drawn", "accept", "views"),
    [
        (1.6, 0.85, (), 2),
        (2.2, 0.6, (), 2),
        (9.0, 0.6, (), 2),
        (1.6, 0.6, ("unrecognisable",), 2),
        (3.8, 0.85, (), 3),
        (4.5, 0.6, (), 3),
        (3.8, 0.6, ("unrecognisable",), 3),
        (7.0, 0.6, (), 4),
    ],
)
def test_others_are_searched(
    diameters: float, drawn: float, accept: tuple[str, ...], views: int
) -> None:
    require_strokes(*ask(diameters, drawn, accept, views))
