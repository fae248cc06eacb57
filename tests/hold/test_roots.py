"""Roots: strips that join all feet in the dark of a shadow, or say that none leads there."""

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shapely import Geometry

from knotfab.hold.roots import CORE_MM, RISES, NoWayError, lay_roots, suits_roots

HOLE_MM, WIDE_MM, MOST_MM2 = 4.0, 7.0, 10.0
DISC = shapely.Point(0, 0).buffer(40)
STROKE = shapely.box(-60, -1.5, 60, 1.5)
ELL = shapely.box(0, 0, 80, 20).union(shapely.box(0, 0, 20, 80))
RING = DISC.difference(DISC.buffer(-15))
HALVES = shapely.box(-50, 0, -0.3, 40).union(shapely.box(0.3, 0, 50, 40))
APART = shapely.box(-50, 0, -10, 40).union(shapely.box(10, 0, 50, 40))


def spread(dark: Geometry, apart: float = 15.0) -> NDArray[np.float64]:
    """Places all over a shadow."""
    x0, y0, x1, y1 = dark.bounds
    grid = np.array([(x, y) for x in np.arange(x0, x1, apart) for y in np.arange(y0, y1, apart)])
    inside = shapely.contains_xy(dark.buffer(-1), grid[:, 0] + 1.2, grid[:, 1] + 1.2)
    return grid[inside] + 1.2


def covers(feet: NDArray[np.float64]) -> Geometry:
    return shapely.union_all(shapely.points(feet)).buffer(1.4)


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize(
    ("dark", "screws"), [(DISC, 2), (STROKE, 0), (ELL, 2), (RING, 2), (HALVES, 2)]
)
def test_one_sheet_in_the_dark_holds_every_foot_and_both_pads(
    dark: Geometry, screws: int, turn: int, mirrored: bool
) -> None:
    dark = shapely.affinity.rotate(dark, 90 * turn, origin=(0, 0))
    dark = shapely.affinity.scale(dark, -1 if mirrored else 1, 1, origin=(0, 0))
    feet = spread(dark)
    found = lay_roots(dark, feet, covers(feet), HOLE_MM, WIDE_MM, MOST_MM2)
    assert found.sheet.is_valid and found.sheet.buffer(0.1).contains(covers(feet))
    assert found.sheet.difference(dark.buffer(0.2).union(covers(feet))).area <= MOST_MM2
    assert len(found.holes) == screws
    for hole in shapely.points(found.holes):
        assert found.sheet.contains(hole.buffer(HOLE_MM / 2 + 1))
        assert hole.distance(covers(feet)) > HOLE_MM / 2
    if screws:
        one, other = found.holes
        assert one[1] == pytest.approx(other[1])  # level
        across = np.ptp(np.reshape(dark.bounds, (2, 2)), axis=0)
        assert other[0] - one[0] > 0.25 * np.hypot(*across)
    assert (found.points[: len(feet)] == feet).all()
    assert ((found.widths >= 2 * CORE_MM) & (found.widths <= WIDE_MM)).all()
    # a tree: every point is reached, in one way
    count = len(found.points)
    assert len(found.ends) == count - 1
    joined = shapely.union_all(shapely.linestrings(found.points[found.ends]))
    assert joined.buffer(1e-6).geom_type == "Polygon"


def box(x0: float, y0: float, x1: float, y1: float) -> Geometry:
    return shapely.box(x0, y0, x1, y1)


HARD: dict[
    str, tuple[Geometry, list[list[float]], int | None]
] = {  # the shadow, its feet (a few all over it, or these), and the screws that fit
    "dot": (shapely.Point(5, 5).buffer(3), [[5, 5]], 0),
    "dot under its foot": (shapely.Point(5, 5).buffer(0.5), [[5, 5]], 0),
    "disc on one foot": (shapely.Point(5, 5).buffer(12), [[5, 5]], 2),
    "line thinner than a strip": (box(-60, -1.3, 60, 1.3), [[-50, 0], [50, 0]], 0),
    "line thinner than it may be": (box(-60, -0.6, 60, 0.6), [[-50, 0], [50, 0]], None),
    "feet that touch": (HALVES, [[-30, 20], [-30.2, 20], [30, 20]], 2),
    "feet in one place": (DISC, [[0, 0], [0, 0], [30, 0]], 2),
    "a hair apart": (box(-50, 0, -0.01, 40).union(box(0.01, 0, 50, 40)), [], 2),
    "corner to corner": (box(-30, -30, 0, 0).union(box(0, 0, 30, 30)), [[-15, -15], [15, 15]], 0),
    "as large as beds are": (shapely.Point(0, 0).buffer(200), [[-90, 0], [0, 90], [90, 0]], 2),
    "no shadow": (shapely.Polygon(), [[0, 0], [0.3, 0]], 0),
    "no way": (APART, [[-30, 20], [30, 20]], None),
    "strokes as thin as hairs": (box(-60, -0.01, 60, 0.01), [[-50, 0], [50, 0]], None),
}


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("name", HARD)
def test_hard_shadows_have_finite_roots_or_one_sentence(name: str, mirrored: bool) -> None:
    dark, places, screws = HARD[name]
    feet = np.array(places, dtype=float) if places else spread(dark)
    if mirrored:
        dark, feet = shapely.affinity.scale(dark, -1, 1, origin=(0, 0)), feet * [-1.0, 1.0]
    if screws is None:
        with pytest.raises(NoWayError, match="no shadow leads") as refused:
            lay_roots(dark, feet, covers(feet), HOLE_MM, WIDE_MM, MOST_MM2)
        assert "--plate rounded" in refused.value.remedy
        return
    found = lay_roots(dark, feet, covers(feet), HOLE_MM, WIDE_MM, MOST_MM2)
    assert found.sheet.is_valid and found.sheet.buffer(0.1).contains(covers(feet))
    assert np.isfinite(found.widths).all() and np.isfinite(found.points).all()
    assert len(found.holes) == screws  # without any, tape holds it


@pytest.mark.parametrize("dark", [DISC, RING])
def test_screws_are_level_and_far_apart_and_higher_where_height_is_worth_more(
    dark: Geometry,
) -> None:
    feet = spread(dark)
    low, high = (
        lay_roots(dark, feet, covers(feet), HOLE_MM, WIDE_MM, MOST_MM2, rise).holes
        for rise in RISES
    )
    assert high[:, 1].mean() > low[:, 1].mean() + 5.0
    x0, y0, x1, y1 = dark.bounds
    for holes in (low, high):
        assert np.ptp(holes[:, 1]) == 0.0
        assert np.ptp(holes[:, 0]) >= 0.25 * np.hypot(x1 - x0, y1 - y0)


def draw(dark: Geometry) -> NDArray[np.bool_]:
    x, y = np.meshgrid(np.arange(-70, 90), np.arange(-70, 90))
    return np.asarray(shapely.contains_xy(dark, x, y))


@pytest.mark.parametrize(
    ("dark", "suits"),
    [
        (DISC, True), (STROKE, False), (APART, False), (RING.difference(STROKE), False),
        (shapely.Point(0, 0).buffer(0.1), False),
    ],
)  # fmt: skip
def test_roots_that_would_tell_the_picture_do_not_suit_it(dark: Geometry, suits: bool) -> None:
    assert suits_roots(draw(dark), 1.0) is suits


@pytest.mark.parametrize("dark", [DISC, ELL, RING, HALVES])
def test_a_mirrored_shadow_has_as_much_of_roots_and_its_screws_where_a_mirror_shows_them(
    dark: Geometry,
) -> None:
    feet, found = spread(dark, 17.0), []
    for way in (np.array([1.0, 1.0]), np.array([-1.0, 1.0])):
        own = shapely.affinity.scale(dark, *way, origin=(0, 0))
        roots = lay_roots(own, way * feet, covers(way * feet), HOLE_MM, WIDE_MM, MOST_MM2)
        ways = np.linalg.norm(np.diff(roots.points[roots.ends], axis=1), axis=2).sum()
        (left, right), (high, _) = (way * roots.holes).T
        apart, middle = abs(right - left), 0.5 * (left + right)
        found.append((roots.sheet.area, ways, apart + RISES[0] * high, middle))
    one, other = np.array(found)
    assert other[:2] == pytest.approx(one[:2], rel=0.03)
    # both are sought on a grid of 2 mm, where a row more may be worth a step less
    assert other[2:] == pytest.approx(one[2:], abs=2.0)
