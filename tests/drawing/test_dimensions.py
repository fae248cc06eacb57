"""Dimensions and scales: exact lengths, readable text, outlines with their holes."""

import numpy as np
import pytest
from rings import ring

from knotfab.drawing.dimensions import draw_dimension, fit_scale, length, project_outlines
from knotfab.drawing.pages import PAPERS, make_page
from knotfab.geometry.meshes import as_manifold
from knotfab.geometry.tube import sweep


@pytest.mark.parametrize(
    ("value", "text"),
    [(600.0, "600"), (1.25, "1.2"), (99.96, "100"), (-0.01, "0"), (-3.0, "-3"), (-0.4, "-0.4")],
)
def test_lengths_read_as_on_a_ruler(value: float, text: str) -> None:
    assert length(value) == text


@pytest.mark.parametrize(
    ("size", "ratio"),
    [(50.0, 1), (100.0, 1), (100.1, 1.5), (200, 2), (201, 2.5), (799, 8), (801, 10), (10_001, 150)],
)
def test_the_largest_usual_scale_that_fits(size: float, ratio: float) -> None:
    to = fit_scale(np.array([[-size / 2, 10.0], [size / 2, 0.0]]), (20.0, 30.0, 120.0, 130.0))
    assert to.ratio == pytest.approx(ratio)
    ends = to(np.array([[-size / 2, 0.0], [size / 2, 10.0]]))
    assert ends.mean(axis=0) == pytest.approx([70.0, 80.0])
    assert ends[1] - ends[0] == pytest.approx(np.array([size, 10.0]) / ratio)
    assert to.name == f"1:{ratio:g}"


@pytest.mark.parametrize("turn", range(0, 360, 30))
def test_text_of_a_dimension_can_be_read(turn: int) -> None:
    _, axes = make_page(PAPERS["a4"])
    along = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
    start = np.array([100.0, 150.0])
    draw_dimension(axes, start, start + 40 * along, (0, 0), "40")
    (text,) = axes.texts
    assert -90 < ((text.get_rotation() + 180) % 360) - 180 <= 90
    assert np.linalg.norm(np.array(text.get_position()) - (start + 20 * along)) < 1.0
    line = np.array(axes.lines[-1].get_data()).T
    assert line == pytest.approx(np.stack([start, start + 40 * along]))


def test_a_short_dimension_has_its_text_beside_it() -> None:
    _, axes = make_page(PAPERS["a4"])
    draw_dimension(axes, (100, 100), (103, 100), (0, 5), "3")
    (text,) = axes.texts
    assert text.get_position()[0] > 104 and text.get_position()[1] == pytest.approx(105, abs=1)


def test_the_outline_of_a_ring_has_a_hole() -> None:
    solid = as_manifold(sweep(ring(30.0, wave=0.0), 2.0, 32))

    def area(polygon: np.ndarray) -> float:
        x, y = polygon.T
        return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2

    front = sorted(area(p) for p in project_outlines([solid], np.eye(3)))
    assert front == pytest.approx([-np.pi * 28**2, np.pi * 32**2], rel=3e-3)
    side = project_outlines([solid], np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]))
    assert [area(p) for p in side] == pytest.approx([60 * 4 + np.pi * 4], rel=1e-2)
    both = project_outlines([solid, solid.translate((100.0, 0, 0))], np.eye(3))
    assert len(both) == 4
