"""Centre lines run along the middle of strokes, meet exactly, and have no spurs."""

from math import cos, pi, sin

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from knotfab.picture.strokes import trace_strokes

Points = list[tuple[float, float]]
WIDTH = 12
RING: Points = [(100 + 60 * cos(t), 80 + 60 * sin(t)) for t in np.linspace(0, 2 * pi, 80)]


def drawn(*strokes: Points, width: int = WIDTH) -> NDArray[np.bool_]:
    """Strokes with round ends."""
    image = Image.new("1", (200, 160))
    draw = ImageDraw.Draw(image)
    for points in strokes:
        draw.line(points, fill=1, width=width, joint="curve")
        for x, y in points:
            r = width / 2 - 0.5
            draw.ellipse((x - r, y - r, x + r, y + r), fill=1)
    return np.asarray(image).copy()


CASES: dict[str, tuple[list[Points], int, int]] = {  # strokes, lines that they come to, free ends
    "one": ([[(20, 80), (180, 80)]], 1, 2),
    "bent": ([[(20, 130), (90, 30), (170, 120)]], 1, 2),
    "tee": ([[(20, 40), (180, 40)], [(100, 40), (100, 140)]], 3, 3),
    "cross": ([[(20, 20), (180, 140)], [(20, 140), (180, 20)]], 4, 4),
    "ring": ([RING], 1, 0),
    "pole in a ring": ([RING, [(100, 20), (100, 140)]], 3, 0),
    "two": ([[(20, 30), (180, 30)], [(20, 100), (180, 130)]], 2, 4),
}


@pytest.mark.parametrize("name", CASES)
def test_lines_follow_the_strokes(name: str) -> None:
    strokes, count, free = CASES[name]
    lines = trace_strokes(drawn(*strokes), WIDTH)
    assert len(lines) == count
    middle = shapely.union_all([shapely.LineString(s) for s in strokes])
    found = shapely.union_all([shapely.LineString(line) for line in lines])
    # a quarter of a stroke's width aside, and its ends as far as they are round
    assert shapely.hausdorff_distance(middle, found, densify=0.02) < 0.6 * WIDTH
    every = shapely.points(np.concatenate(lines))
    assert shapely.distance(every, middle).max() < 0.3 * WIDTH
    ends = [tuple(line[k]) for line in lines for k in (0, -1)]
    assert sum(ends.count(end) == 1 for end in ends) == free


@pytest.mark.parametrize("size", [0.5, 2.0])
def test_the_resolution_of_the_picture_does_not_matter(size: float) -> None:
    strokes = CASES["cross"][0]
    usual = trace_strokes(drawn(*strokes), WIDTH)
    large = np.kron(drawn(*strokes), np.ones((2, 2), dtype=bool))
    other = trace_strokes(large, 2 * WIDTH)
    if size < 1:
        half = [[(x / 2, y / 2) for x, y in stroke] for stroke in strokes]
        other = [4 * line for line in trace_strokes(drawn(*half, width=WIDTH // 2), WIDTH / 2)]
    assert len(other) == len(usual)
    one, two = (shapely.union_all([shapely.LineString(x) for x in k]) for k in (usual, other))
    scaled = shapely.transform(two, lambda p: (p + 0.5) / 2 - 0.5)
    assert shapely.hausdorff_distance(one, scaled) < 0.3 * WIDTH


def test_a_dot_is_a_short_line() -> None:
    (line,) = trace_strokes(drawn([(50, 60)]), WIDTH)
    assert 0 < np.hypot(*(line[-1] - line[0])) < WIDTH
    np.testing.assert_allclose(line.mean(axis=0), (50, 60), atol=1.5)


def test_a_hole_too_small_for_strokes_about_it_is_none() -> None:
    mask = drawn([(20, 80), (180, 80)], width=16)
    mask[79:82, 99:102] = False
    assert len(trace_strokes(mask, WIDTH)) == 1
