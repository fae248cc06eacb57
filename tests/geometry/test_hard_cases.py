"""Sweeps at their limit, large polygons, outlines that split or vanish when inset, hard pictures."""

from math import pi

import numpy as np
import pytest
import shapely

from benchmarks.hard.curves import circle
from benchmarks.hard.pictures import HardPicture, hard_pictures
from knotfab.geometry.tube import _transport, mesh_volume, sweep
from knotfab.picture.silhouette import trace_polygon
from knotfab.start.filling import fill

# their outlines alone take seconds
SLOW = {"checkerboard", "noise", "page", "carpet", "koch", "rings", "lattice", "dots", "spiral"}


def _wave(height: float) -> tuple[np.ndarray, float]:
    """A closed curve that winds about a ring, and the angle by which its frame comes back turned."""
    s = 2 * pi * np.arange(300) / 300
    out, up = 10 + height * np.cos(3 * s), height * np.sin(3 * s)
    points = np.stack([out * np.cos(s), out * np.sin(s), up], 1)
    along = np.roll(points, -1, 0) - points
    along /= np.linalg.norm(along, axis=1)[:, None]
    mitre = along + np.roll(along, 1, 0)
    mitre /= np.linalg.norm(mitre, axis=1)[:, None]
    return points, _transport(along, mitre)[1]


def test_a_closing_twist_of_half_a_turn_closes() -> None:
    """A frame that comes back turned by exactly pi: both ways round are as short."""
    heights = np.linspace(0.0, 6.0, 120)
    turns = np.array([_wave(h)[1] for h in heights])
    jump = int(np.abs(np.diff(turns)).argmax())
    assert abs(turns[jump + 1] - turns[jump]) > pi
    low, high = heights[jump], heights[jump + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        if np.sign(_wave(middle)[1]) == np.sign(turns[jump]):
            low = middle
        else:
            high = middle
    for height in (low, high):
        points, turn = _wave(height)
        assert abs(turn) == pytest.approx(pi, abs=1e-9)
        length = float(np.linalg.norm(np.roll(points, -1, 0) - points, axis=1).sum())
        for sides in (3, 5, 64):
            vertices, faces = sweep(points, 0.3, sides)
            assert mesh_volume(vertices, faces) == pytest.approx(pi * 0.09 * length, rel=1e-5)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_scaled_tubes_are_the_same_tube(scale: float) -> None:
    points = circle(200, 10.0)
    plain, faces = sweep(points, 1.0, 24)
    scaled, same = sweep(points * scale, scale, 24)
    assert np.array_equal(faces, same)
    assert np.abs(scaled / scale - plain).max() <= 1e-9


@pytest.mark.slow
def test_a_hundred_thousand_corners_are_swept() -> None:
    points = circle(100_000, 1000.0)
    vertices, faces = sweep(points, 1.0, 4)
    length = float(np.linalg.norm(np.roll(points, -1, 0) - points, axis=1).sum())
    assert mesh_volume(vertices, faces) == pytest.approx(pi * length, rel=1e-9)


def test_an_outline_of_a_hundred_thousand_corners_is_filled() -> None:
    outline = shapely.MultiPolygon([shapely.Polygon(circle(100_000, 10.0)[:, :2])])
    found = fill(outline, 2.0)
    assert len(found.curves) == 1
    assert all(np.isfinite(c).all() for c in found.curves)


@pytest.mark.parametrize(
    "case", [c for c in hard_pictures() if c.name not in SLOW], ids=lambda case: case.name
)
def test_hard_pictures_have_valid_outlines_and_templates(case: HardPicture) -> None:
    mask = case.draw()
    polygon = trace_polygon(mask)
    assert polygon.is_valid
    area = float(np.count_nonzero(mask))
    assert polygon.is_empty == (case.name in {"blank", "pixel", "strip"})
    if polygon.is_empty:
        return
    for radius in (4.0, 40.0):
        found = fill(polygon, radius)
        assert all(len(c) >= 3 and np.isfinite(c).all() for c in found.curves)
    if area > 2000:
        assert polygon.area == pytest.approx(area, rel=0.05)


def test_an_inset_that_splits_gives_one_curve_all_the_same() -> None:
    case = next(c for c in hard_pictures() if c.name == "dumbbell")
    found = fill(trace_polygon(case.draw()), 14.0)
    assert len(found.curves) == 1
    assert shapely.LinearRing(found.curves[0]).is_simple


@pytest.mark.slow
def test_noise_is_filled_at_the_tubes_own_scale() -> None:
    case = next(c for c in hard_pictures() if c.name == "noise")
    found = fill(trace_polygon(case.draw()), 8.0)
    assert 1 <= len(found.curves) < 100
