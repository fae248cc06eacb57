"""The depth profile: it keeps the picture, and descent finds what is less legible and easier to print."""

import numpy as np
import pytest
from questions import ask_heart

from knotfab.geometry.overhang import Rules, estimate, strands_along
from knotfab.part.orient import AXES
from knotfab.problem import DepthChoice, Problem
from knotfab.start.depth import choose_depth, lift
from knotfab.start.filling import Template, fill
from knotfab.start.legibility import _cover, legibility, stretch_mask


@pytest.fixture(scope="module")
def problem() -> Problem:
    return ask_heart()


@pytest.fixture(scope="module")
def template(problem: Problem) -> Template:
    return fill(problem.polygons[0], 3.0)


def _choose(
    problem: Problem, template: Template, candidates: int, overhang_deg: float | None = None
) -> DepthChoice:
    view = problem.views[0]
    light = view.view.light_distance_mm
    target = stretch_mask(view.mask)
    return choose_depth(template.curves, 3.0, light, 90.0, target, candidates, 0, overhang_deg)


def test_depth_keeps_the_picture_and_lowers_legibility(
    problem: Problem, template: Template
) -> None:
    target = stretch_mask(problem.views[0].mask)
    light = problem.views[0].view.light_distance_mm
    choice = _choose(problem, template, 12)
    joined = np.concatenate(choice.depths)
    assert np.ptp(joined) == pytest.approx(90.0)
    lifted = np.concatenate(
        [lift(c, d, light) for c, d in zip(template.curves, choice.depths, strict=True)]
    )
    flat = np.concatenate([lift(c, 0 * c[:, 0], light) for c in template.curves])
    # seen from the light nothing moved
    seen = lifted[:, :2] / (1 - lifted[:, 2:] / light)
    np.testing.assert_allclose(seen, flat[:, :2], atol=1e-9)
    spread = legibility(lifted, 3.0, light, target, 45.0)
    assert spread < legibility(flat, 3.0, light, target, 45.0) - 0.08
    assert legibility(flat, 3.0, light, target, 0.0) > 0.9


def test_more_candidates_are_less_legible_and_the_same_ones_the_same(
    problem: Problem, template: Template
) -> None:
    few, many = (_choose(problem, template, count) for count in (8, 64))
    assert many.legibility < few.legibility
    for one, other in zip(many.depths, _choose(problem, template, 64).depths, strict=True):
        np.testing.assert_array_equal(one, other)


def test_where_supports_count_the_piece_needs_fewer(problem: Problem, template: Template) -> None:
    light = problem.views[0].view.light_distance_mm

    def supports(choice: DepthChoice) -> float:
        parts = [lift(c, d, light) for c, d in zip(template.curves, choice.depths, strict=True)]
        rods = strands_along(parts, 3.0)
        return min(estimate(rods, turn, Rules()).support_cm3 for turn in AXES)

    assert supports(_choose(problem, template, 80, 45.0)) < supports(_choose(problem, template, 80))


def test_the_silhouette_is_the_union_of_discs_on_its_box() -> None:
    rng = np.random.default_rng(3)
    points, radius, grid = rng.uniform(-40, 40, (30, 2)) * [1.0, 0.6], 6.0, 48
    low, high = points.min(0) - radius, points.max(0) + radius
    middle = low + (np.arange(grid)[:, None] + 0.5) / grid * (high - low)
    x, y = np.meshgrid(middle[:, 0], middle[::-1, 1])
    away = np.hypot(x[..., None] - points[:, 0], y[..., None] - points[:, 1]).min(-1)
    np.testing.assert_array_equal(_cover(points, radius, grid), away <= radius)
