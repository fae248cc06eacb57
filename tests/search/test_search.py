"""The search: feasible ends, and clear verdicts where it cannot be."""

import re
from dataclasses import replace

import numpy as np
import pytest
from questions import ask_heart, start_and_search

from knotfab.base.errors import InputError, SceneError
from knotfab.design.region import depth_extent
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.knots import Knots
from knotfab.limits.feasibility import measure_feasibility
from knotfab.problem import Problem
from knotfab.search.phases import plan_of
from knotfab.start.start import make_start
from knotfab_formats.scene import SettledRegion
from knotfab_formats.search import PRESETS, search_settings

QUICK = PRESETS["draft"].model_copy(
    update={
        **{"coarse_px": 96, "coarse_iterations": 30, "depth_candidates": 4},
        **{"fine_px": 160, "fine_iterations": 25},
    }
)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return ask_heart()


@pytest.mark.slow
def test_the_search_ends_feasible_and_certified(problem: Problem) -> None:
    result = start_and_search(problem, 3.0, QUICK)
    assert result.feasible and result.feasibility.violations == []
    assert result.log.certified
    assert result.iou_estimate > 0.97
    points = result.knots.points
    across = np.ptp(points[:, :2], axis=0).max()
    assert np.ptp(points[:, 2]) / across > 0.6


@pytest.mark.slow
def test_the_same_seed_gives_the_same_knots(problem: Problem) -> None:
    short = QUICK.model_copy(update={"coarse_iterations": 10, "fine_iterations": 5})
    seen: list[tuple[Knots, bool]] = []
    told: list[float | None] = []
    one = start_and_search(problem, 4.0, short, repairs=0)
    two = start_and_search(  # watched, which must change nothing
        problem,
        4.0,
        short,
        repairs=0,
        watch=lambda knots, certified: seen.append((knots(), certified)),
        report=lambda _, iou: told.append(iou),
    )
    assert (one.knots.points == two.knots.points).all()
    assert len(seen) == short.iterations and all(certified for _, certified in seen)
    assert (seen[-1][0].points == two.knots.points).all()
    assert told[-1] == pytest.approx(two.iou_estimate, abs=0.02)
    other = start_and_search(problem, 4.0, short.model_copy(update={"seed": 5}), repairs=0)
    assert other.knots.points.shape != one.knots.points.shape or not np.allclose(
        other.knots.points, one.knots.points
    )


@pytest.mark.slow
def test_an_impossible_bend_limit_is_told_with_its_place(problem: Problem) -> None:
    stiff = replace(problem, bend_radius=60.0)
    result = start_and_search(stiff, 4.0, QUICK, repairs=1)
    assert not result.feasible
    (told,) = [v for v in result.feasibility.violations if "bend" in v]
    assert re.search(r"bend radius .* below 60\.000 mm at \(", told)
    assert result.log.certified and result.log.repairs == 1 + plan_of(QUICK).mendings


@pytest.mark.slow
def test_a_length_budget_below_need_is_told(problem: Problem) -> None:
    result = start_and_search(replace(problem, length=200.0), 4.0, QUICK, repairs=1)
    assert not result.feasible
    assert "exceeds the budget of 200 mm" in " ".join(result.feasibility.violations)


def test_bend_radius_of_a_regular_polygon_is_its_inradius() -> None:
    n = 30
    t = np.arange(n) * 2 * np.pi / n
    polygon = np.column_stack([np.cos(t), np.sin(t), 0 * t]) * 7.0
    found = bend_radii(polygon, polylines_of_sizes((n,)))
    np.testing.assert_allclose(found, 7.0 * np.cos(np.pi / n), rtol=1e-12)


@pytest.mark.slow
def test_feasibility_finds_each_violation(problem: Problem) -> None:
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    ring = np.column_stack([40 * np.cos(t), 40 * np.sin(t), 0 * t])
    both = np.concatenate([ring, ring + [0, 0, 4.3]])
    rings = polylines_of_sizes((400, 400))
    limits = replace(problem.limits(2.0), region=SettledRegion(size_mm=(100.0, 100.0, 100.0)))
    assert "within 4.300 mm" in measure_feasibility(both, rings, limits).violations[0]
    assert measure_feasibility(both, rings, replace(limits, clearance=0.2)).violations == []
    outside = replace(limits, clearance=0.2, region=SettledRegion(size_mm=(83.9, 100.0, 100.0)))
    assert "leaves the region by 0.05" in measure_feasibility(both, rings, outside).violations[0]
    bent = replace(limits, clearance=0.2, bend_radius=41.0)
    assert "bend radius 39.99" in measure_feasibility(both, rings, bent).violations[0]


def test_unknown_search_keys_are_refused() -> None:
    with pytest.raises(InputError, match="iteration"):
        search_settings("standard", {"iteration": 5})
    with pytest.raises(InputError, match="fine_px"):
        search_settings("standard", {"fine_px": 3})
    assert search_settings("fine", {"seed": 7}).seed == 7
    standard = PRESETS["standard"]
    assert standard.scaled(0.5).coarse_iterations == standard.coarse_iterations / 2


@pytest.mark.slow
def test_a_large_clearance_is_felt_from_far_enough(problem: Problem) -> None:
    # neighbour lists of four radii would miss strands that must keep 5.2 radii apart
    wide = replace(problem, clearance=4.0)
    sparse = make_start(wide, 2.5, QUICK, spacing=3.0)
    result = start_and_search(wide, 2.5, QUICK, sparse)
    assert result.feasibility.gap_mm >= 9.0


def test_a_resolved_depth_is_found_again(problem: Problem) -> None:
    (polygon,) = problem.polygons
    region = SettledRegion(size_mm=(200.0, 200.0, 72.0))
    depth = depth_extent(None, polygon, region, 1.836)
    assert depth is not None
    assert depth_extent(depth, polygon, region, 1.836) == depth
    with pytest.raises(SceneError, match="no room"):
        depth_extent(None, polygon, SettledRegion(size_mm=(200.0, 200.0, 7.0)), 2.0)
