"""Random depth profiles: their waves are summed as written, and a variation keeps their spread."""

from __future__ import annotations

import numpy as np
import pytest

from knotfab.start.profiles import draw_arches, draw_profile, draw_relief, sum_waves


@pytest.mark.parametrize(("points", "waves"), [(1, 1), (255, 3), (256, 40), (700, 7)])
def test_waves_are_summed_as_written(points: int, waves: int) -> None:
    rng = np.random.default_rng(points)
    angles = rng.uniform(0, 2 * np.pi, points)
    cosines, sines = rng.normal(size=(2, waves))
    of_each = angles[:, None] * np.arange(1, waves + 1)
    whole = (cosines * np.cos(of_each) - sines * np.sin(of_each)).sum(1)
    np.testing.assert_allclose(sum_waves(angles, cosines, sines), whole, atol=1e-11)


def test_a_profile_closes_and_spends_its_length_evenly_in_depth() -> None:
    rng = np.random.default_rng(3)
    arcs = [np.linspace(0, 900, 1801)]
    heights = np.concatenate([draw_profile(rng, n, 60.0, arcs).heights(arcs)[0] for n in range(40)])
    assert np.abs(heights).max() <= 2.0
    shares = np.histogram(heights, bins=4, range=(-2, 2))[0] / len(heights)
    assert shares == pytest.approx(0.25, abs=0.05)
    one = draw_profile(rng, 0, 60.0, arcs).heights(arcs)[0]
    assert abs(one[0] - one[-1]) < 2 * np.abs(np.diff(one)).max()


@pytest.mark.parametrize("change", [0.0, 0.1, 0.6])
def test_a_variation_is_as_near_as_it_is_asked_to_be(change: float) -> None:
    rng = np.random.default_rng(4)
    arcs, places = [np.linspace(0, 900, 901)], [rng.uniform(-90, 90, (900, 2))]
    profile, relief = draw_profile(rng, 1, 60.0, arcs), draw_relief(rng, 1, 60.0)
    for was, now in (
        (profile.heights(arcs)[0], profile.varied(rng, change).heights(arcs)[0]),
        (relief.heights(places)[0], relief.varied(rng, change).heights(places)[0]),
    ):
        moved = np.sqrt(((now - was) ** 2).mean())
        assert moved <= 3.0 * change * was.std()
        assert (moved > 0) == (change > 0)


@pytest.mark.parametrize(
    ("length", "top", "feet"),
    [(600.0, 80.0, (6, 12)), (200.0, 80.0, (3, 5)), (60.0, 80.0, (3, 5)), (9.0, 80.0, (0, 0))],
)
def test_arches_stand_on_feet_with_steep_flanks_and_no_peak_above_the_top(
    length: float, top: float, feet: tuple[int, int]
) -> None:
    rng, radius = np.random.default_rng(3), 1.5
    arcs = [np.linspace(0.0, length, 2001)]
    for number in range(20):
        arches = draw_arches(rng, arcs, np.array([top]), radius)
        if number % 2:
            arches = arches.varied(rng, 0.5)
        (height,) = arches.heights(arcs)
        assert 0.0 <= height.min() < 0.01
        assert height.max() <= top
        low = (height < 0.05) & (np.roll(height, 1) >= 0.05)
        assert feet[0] <= low.sum() <= feet[1]
        steep = np.degrees(np.arctan(np.abs(np.diff(height)) / np.diff(arcs[0])[:-1]))
        assert steep.max(initial=0.0) < 56.0
        if feet[0] > 0:  # but for what is rounded
            flat = (steep < 46.0).mean() * length
            assert flat <= 2.0 * feet[1] * 2.2 * radius
