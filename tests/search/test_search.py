"""The search: feasible ends, effects only where called for, and clear verdicts where it cannot be."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from questions import ask_heart, start_and_search

from knotfab.design.region import depth_extent
from knotfab.effects import survey as survey_module
from knotfab.effects.base import EffectContext, Limits
from knotfab.effects.feasibility import measure_feasibility
from knotfab.effects.penumbra import magnitude
from knotfab.effects.survey import survey
from knotfab.errors import InputError, SceneError
from knotfab.geometry.measures import bend_radii
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.problem import Problem
from knotfab.scene.model import ResolvedRegion, ResolvedView, Scene
from knotfab.scene.settings import PRESETS, search_settings
from knotfab.search.phases import plan_of
from knotfab.start.start import make_start

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
    one, two = (start_and_search(problem, 4.0, short, repairs=0) for _ in range(2))
    assert (one.knots.points == two.knots.points).all()
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


@pytest.mark.slow
def test_effects_not_called_for_run_no_code(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    def explode(*_: object) -> None:
        raise AssertionError("an effect that is not called for was simulated")

    disarmed = tuple(
        replace(e, term=explode) if e.name in ("region", "length") else e
        for e in survey_module.EFFECTS
    )
    monkeypatch.setattr(survey_module, "EFFECTS", disarmed)
    result = start_and_search(problem, 4.0, QUICK, repairs=0)
    assert not result.effects["region"].simulated
    assert not result.effects["length"].simulated
    assert result.effects["region"].seconds == 0.0
    # and where the scene calls for it, it does run
    tight = replace(problem, region=ResolvedRegion(size_mm=(100.0, 100.0, 180.0)))
    with pytest.raises(AssertionError, match="not called for"):
        start_and_search(tight, 4.0, QUICK, repairs=0)


def _situation(problem: Problem, **limits: Any) -> EffectContext:
    t = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    points = np.column_stack([50 * np.cos(t), 50 * np.sin(t), 10 * np.sin(t)])
    base = problem.limits(2.0)
    views = tuple(v.view for v in problem.views)
    return EffectContext(views, replace(base, **limits), points, polylines_of_sizes((200,)), 0.25)


def test_magnitudes_follow_the_scene(problem: Problem) -> None:
    near = survey(_situation(problem))
    assert not near["clearance"].simulated  # one lone circle
    near_view = problem.views[0].view
    far_view = near_view.model_copy(update={"light_distance_mm": 1e7, "light_diameter_mm": 0.0})
    far = survey(replace(_situation(problem), views=(far_view,)))
    assert not far["penumbra"].simulated
    # of several views the one counts where the blur is widest
    both = survey(replace(_situation(problem), views=(far_view, near_view)))
    assert both["penumbra"].magnitude == near["penumbra"].magnitude > far["penumbra"].magnitude
    assert survey(_situation(problem, length=300.0))["length"].simulated
    assert survey(_situation(problem, region=ResolvedRegion(size_mm=(100.0, 100.0, 40.0))))[
        "region"
    ].simulated
    line = near["penumbra"].to_dict()
    assert set(line) == {
        "name", "simulated", "magnitude", "threshold", "unit", "seconds", "reason",
    }  # fmt: skip


def test_penumbra_is_the_makers_rule() -> None:
    # 5 mm lamp at 1 m, wall 0.3 m behind a flat piece: 1.5 mm of blur
    view = ResolvedView(
        light_distance_mm=1000.0, wall_distance_mm=300.0, light_diameter_mm=5.0,
        frame_width_mm=1024.0, frame_height_mm=500.0,
    )  # fmt: skip
    limits = Limits(2.0, 0.4, 2.2, 1e5, ResolvedRegion(size_mm=(200.0, 200.0, 200.0)))
    flat = np.array([[10.0, 0, 0], [0, 10, 0], [-10, 0, 0]])
    found = magnitude(EffectContext((view,), limits, flat, polylines_of_sizes((3,)), 0.25))
    # the tube reaches its radius further towards the lamp
    assert found == pytest.approx(5.0 * (300.0 + 2.0) / (1000.0 - 2.0))


def test_bend_radius_of_a_regular_polygon_is_its_inradius() -> None:
    n = 30
    t = np.arange(n) * 2 * np.pi / n
    polygon = np.column_stack([np.cos(t), np.sin(t), 0 * t]) * 7.0
    found = bend_radii(polygon, polylines_of_sizes((n,)))
    np.testing.assert_allclose(found, 7.0 * np.cos(np.pi / n), rtol=1e-12)


def test_feasibility_finds_each_violation(problem: Problem) -> None:
    t = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    ring = np.column_stack([40 * np.cos(t), 40 * np.sin(t), 0 * t])
    both = np.concatenate([ring, ring + [0, 0, 4.3]])
    rings = polylines_of_sizes((400, 400))
    limits = replace(problem.limits(2.0), region=ResolvedRegion(size_mm=(100.0, 100.0, 100.0)))
    assert "within 4.300 mm" in measure_feasibility(both, rings, limits).violations[0]
    assert measure_feasibility(both, rings, replace(limits, clearance=0.2)).violations == []
    outside = replace(limits, clearance=0.2, region=ResolvedRegion(size_mm=(83.9, 100.0, 100.0)))
    assert "leaves the region by 0.05" in measure_feasibility(both, rings, outside).violations[0]
    bent = replace(limits, clearance=0.2, bend_radius=41.0)
    assert "bend radius 39.99" in measure_feasibility(both, rings, bent).violations[0]


def test_unknown_search_keys_are_refused() -> None:
    with pytest.raises(InputError, match="iteration"):
        search_settings("standard", {"iteration": 5})
    with pytest.raises(InputError, match="fine_px"):
        search_settings("standard", {"fine_px": 3})
    assert search_settings("fine", {"seed": 7}).seed == 7
    assert PRESETS["standard"].scaled(0.5).coarse_iterations == 40


@pytest.mark.slow
def test_a_large_clearance_is_felt_from_far_enough(problem: Problem) -> None:
    # neighbour lists of four radii would miss strands that must keep 5.2 radii apart
    wide = replace(problem, clearance=4.0)
    sparse = make_start(wide, 2.5, QUICK, spacing=3.0)
    result = start_and_search(wide, 2.5, QUICK, sparse)
    assert result.feasibility.gap_mm >= 9.0


def test_a_resolved_depth_is_found_again(problem: Problem) -> None:
    (polygon,), scene = problem.polygons, Scene()
    region = ResolvedRegion(size_mm=(200.0, 200.0, 72.0))
    depth = depth_extent(scene, polygon, region, 1.836)
    assert depth is not None
    piece = scene.piece.model_copy(update={"depth": depth})
    again = depth_extent(scene.model_copy(update={"piece": piece}), polygon, region, 1.836)
    assert again == depth
    with pytest.raises(SceneError, match="no room"):
        depth_extent(scene, polygon, ResolvedRegion(size_mm=(200.0, 200.0, 7.0)), 2.0)
