"""Legs of strands that stand in arches, and the bars that brace slender ones to their neighbours."""

import numpy as np
import pytest

from knotfab.base.arrays import Array
from knotfab.geometry.legs import (
    BAR_MM,
    MOST_BAR_MM,
    SUNK_MM,
    Bar,
    Leg,
    find_legs,
    hide_behind,
    plan_bars,
)
from knotfab_formats.upright import longest_free_leg_mm

RADIUS, PLA = 1.66, 2300.0
MOST = longest_free_leg_mm(RADIUS, PLA)


def ring(heights: tuple[float, ...], across_mm: float = 200.0, shift: float = 0.0) -> Array:
    """A closed line of straight legs, up to these heights and down to the bed, `across_mm` apart in plan."""
    corners = np.array([z for height in heights for z in (0.0, height)])
    count = len(corners)
    s = np.linspace(0.0, count, 400 * count, endpoint=False)
    z = np.interp(s, np.arange(count + 1), [*corners, 0.0])
    angle, half = 2 * np.pi * s / count, across_mm / 2
    return np.column_stack([half * np.cos(angle) + shift, half * np.sin(angle), z])


@pytest.mark.parametrize(("heights", "legs"), [((30.0, 40.0, 50.0), 6), ((30.0, 0.5), 2)])
def test_a_leg_goes_from_each_valley_to_each_peak_beside_it(
    heights: tuple[float, ...], legs: int
) -> None:
    found = find_legs([ring(heights)])
    assert len(found) == legs
    for leg in found:
        assert leg.points[0, 2] < 0.6 < 29.0 < leg.points[-1, 2]


@pytest.mark.parametrize(
    ("height", "across_mm", "apart_mm", "hidden", "bars", "lacking"),
    [
        (0.5 * MOST, 40.0, 5.0, True, False, False),  # short: it needs none
        (0.88 * MOST, 40.0, 5.0, True, False, False),  # long, but where two legs are one
        (2.0 * MOST, 100.0, 90.0, True, True, True),  # near its own valley alone
        (1.6 * MOST, 60.0, 2 * RADIUS + 3.0, True, True, False),
        (1.6 * MOST, 60.0, 2 * RADIUS + MOST_BAR_MM + 1.0, True, True, True),
        (1.6 * MOST, 60.0, 2 * RADIUS + 3.0, False, False, True),  # it would show
    ],
)
def test_bars_are_where_legs_would_sway_and_a_neighbour_is_near(
    height: float, across_mm: float, apart_mm: float, hidden: bool, bars: bool, lacking: bool
) -> None:
    """Two rings, one within the other, whose legs stand side by side."""
    inner, outer = (ring((height,) * 3, across) for across in (across_mm, across_mm + 2 * apart_mm))
    planned, lacks = plan_bars(find_legs([inner, outer]), RADIUS, PLA, lambda _: hidden)
    assert ((len(planned) > 0), (len(lacks) > 0)) == (bars, lacking)
    for bar in planned:
        assert bar.start[2] == bar.end[2] and bar.gap_mm <= MOST_BAR_MM


@pytest.mark.parametrize(("seen_mm", "bars"), [(0.02, True), (-0.02, False)])
def test_a_bar_is_hidden_in_all_its_width(seen_mm: float, bars: bool) -> None:
    """What is looked at are the corners of the box that is printed, not its middle alone."""
    inner, outer = (ring((1.6 * MOST,) * 3, across) for across in (60.0, 66.0 + 4 * RADIUS))
    legs, most = find_legs([inner, outer]), 0.5 * BAR_MM[0] + seen_mm
    free, _ = plan_bars(legs, RADIUS, PLA)
    assert free
    lines = [(bar.start, bar.half_width() / (0.5 * BAR_MM[0])) for bar in free]

    def hidden(points: Array) -> bool:
        """Whether they are within a strip along one of the bars."""
        asides = [np.abs((points - start) @ left).max() for start, left in lines]
        return bool(min(asides) <= most)

    planned, _ = plan_bars(legs, RADIUS, PLA, hidden)
    assert bool(planned) == bars
    corners = [bar.make_body()[0] for bar in planned]
    assert all(hidden(body) for body in corners)


def test_where_the_best_place_has_no_neighbour_the_next_one_down_has_the_bar() -> None:
    """A low arch beside a tall one, and less steep, is near it below alone."""
    tall, low = ring((1.3 * MOST,) * 3, 60.0), ring((0.6 * MOST,) * 3, 60.0 + 4 * RADIUS + 4.0)
    planned, lacking = plan_bars(find_legs([tall, low]), RADIUS, PLA)
    assert not len(lacking)
    assert sum(bar.start[2] < 0.4 * MOST for bar in planned) >= 3


@pytest.mark.parametrize("lean", [0.0, 0.4, 0.6, 0.7])
@pytest.mark.parametrize("between", [False, True])
def test_a_leg_that_leans_towards_the_bar_is_in_nobodys_way(lean: float, between: bool) -> None:
    """Two parallel legs, and perhaps a third strand that passes between them."""
    way = np.array([lean, 0.0, np.sqrt(1 - lean**2)])
    line = np.arange(0.0, 1.5 * MOST, 0.4)[:, None] * way
    apart = np.array([7.0, 0.0, 0.0]) + np.array([2 * RADIUS, 0.0, 0.0])
    legs = [Leg(0, line), Leg(1, line + apart)]
    if between:
        legs.append(Leg(2, line + 0.5 * apart + np.array([0.0, 0.5, 0.0])))
    bars, lacking = plan_bars(legs, RADIUS, PLA)
    assert len(bars) and not len(lacking)
    # with a strand between them, no bar goes past it
    assert all((bar.gap_mm < 3.0) == between for bar in bars)


@pytest.mark.parametrize("height", [0.77, 0.8, 0.83, 0.86, 0.89])
def test_a_bar_is_below_the_roof_of_its_arch(height: float) -> None:
    """Just below a rounded peak its two legs have met at the top of a bar that is free at its middle."""
    curve = ring((height * MOST,) * 3, 44.0)
    window = np.hanning(round(8.0 / (np.pi * 44.0 / 2400)))
    wide = np.take(curve[:, 2], np.arange(-len(window), len(curve) + len(window)), mode="wrap")
    smooth = np.convolve(wide, window / window.sum(), "same")
    curve[:, 2] = smooth[len(window) : -len(window)]
    bars, _ = plan_bars(find_legs([curve]), RADIUS, PLA)
    roof = curve[:, 2].max() - RADIUS
    assert all(bar.start[2] + 0.5 * BAR_MM[1] < roof for bar in bars)


def test_a_bar_is_the_box_that_it_is_listed_as() -> None:
    one = ring((1.6 * MOST,) * 3, 60.0)
    other = one * [1.2, 1.2, 1.0]
    bars, _ = plan_bars(find_legs([one, other]), RADIUS, PLA)
    for bar in bars:
        vertices, faces = bar.make_body()
        listed = bar.record()
        a, b = np.array(listed["from"]), np.array(listed["to"])
        corners = vertices[faces]
        volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum()
        length = np.linalg.norm(b - a)
        assert length == pytest.approx(bar.gap_mm + 2 * SUNK_MM)
        assert volume / 6 == pytest.approx(length * BAR_MM[0] * BAR_MM[1])
        np.testing.assert_allclose(vertices.mean(axis=0), (a + b) / 2)


@pytest.mark.parametrize(("rise_mm", "lacks"), [(1.0, True), (8.0, False)])
def test_two_legs_are_joined_above_the_valley_that_they_share(rise_mm: float, lacks: bool) -> None:
    """In a layer of the valley's tube they are one strand, which a bar would join with itself."""
    legs = []
    for side in (-4.0, 4.0):
        corners = [[0, 0, 2], [side, 0, 2], [side, MOST, 2 + rise_mm], [side, MOST, 2 + MOST]]
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        at, s = np.cumsum([0, *lengths]), np.arange(0.0, lengths.sum(), 0.4)
        legs.append(Leg(0, np.column_stack([np.interp(s, at, c) for c in np.transpose(corners)])))
    planned, lacking = plan_bars(legs, RADIUS, PLA)
    assert (len(lacking) > 0) == lacks
    assert all(bar.start[2] > 2 + RADIUS for bar in planned)


def test_a_pixel_hides_what_is_nearer_to_its_middle_than_to_others() -> None:
    rng = np.random.default_rng(6)
    mask = rng.random((7, 9)) < 0.5
    hidden = hide_behind(mask, np.eye(3, 4))
    row, column = (rng.integers(-1, size + 1, 300) for size in mask.shape)
    u, v = np.stack([column, row]) + rng.uniform(-0.49, 0.49, (2, 300))
    within = np.pad(mask, 1)[row + 1, column + 1]
    for n, w in enumerate(rng.uniform(0.5, 2.0, 300)):
        assert hidden(w * np.array([[u[n], v[n], 1.0]])) == within[n]


def test_a_leg_stands_free_from_its_foot_or_its_last_tie() -> None:
    up = np.linspace(0.0, 40.0, 101)[:, None] * [0.0, 0.0, 1.0]
    ties = np.array(
        [[1.0, 0.0, 12.0], [1.0, 0.0, 30.0], [9.0, 0.0, 36.0]]
    )  # the last is another leg's
    free = Leg(0, up).list_free(ties, 1.5)
    assert free[:25] == pytest.approx(up[:25, 2]) and free.max() <= 18.0
    assert free[60] == pytest.approx(24.0 - 12.0, abs=1.5) and free[-1] == pytest.approx(
        10.0, abs=1.5
    )
    assert Leg(0, up).list_free(np.empty((0, 3)), 1.5) == pytest.approx(up[:, 2])


def test_a_bar_moves_with_its_piece() -> None:
    turn = np.array(
        [[0.0, -2.0, 0.0, 5.0], [2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, 1.0], [0, 0, 0, 1]]
    )
    bar = Bar(np.array([1.0, 0.0, 3.0]), np.array([4.0, 0.0, 3.0]), 3.0).moved(turn)
    assert (*bar.start, *bar.end, bar.gap_mm) == pytest.approx((5, 2, 7, 5, 8, 7, 6))


@pytest.mark.parametrize(
    "turn",
    [np.diag([-1.0, 1.0]), np.diag([1.0, -1.0]), -np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])],
)
def test_a_piece_mirrored_or_turned_in_plan_has_its_bars_there(turn: Array) -> None:
    apart = 2 * RADIUS + 3.0
    rings = [
        ring((1.6 * MOST, 2.1 * MOST, 1.2 * MOST), across) for across in (60.0, 60.0 + 2 * apart)
    ]

    def bars_of(way: Array) -> Array:
        whole = np.block([[way, np.zeros((2, 1))], [np.zeros((1, 2)), 1.0]])
        legs = find_legs([points @ whole.T for points in rings])
        bars, lacking = plan_bars(legs, RADIUS, PLA, thrifty=True)
        ends = np.array([(bar.start, bar.end) for bar in bars]).reshape(-1, 3)
        return np.concatenate([ends, lacking]) @ whole

    own = bars_of(np.eye(2))
    assert len(own) > 4
    np.testing.assert_allclose(bars_of(turn), own, atol=1e-6)
