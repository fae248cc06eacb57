"""The renderers on the catalogue of hard cases: errors within what the condition allows, no NaN anywhere."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from oracles import render_dense
from tables import some

from benchmarks.hard.measure import (
    FORMS,
    Render,
    distances,
    double_error,
    forward_error,
    gradient_condition,
    gradient_error,
    image,
    sampled_error,
    subgradient_excess,
)
from benchmarks.hard.rendering import RenderCase, frame_at, large_case, render_cases
from knotfab.render.silhouette import Frame

pytestmark = pytest.mark.slow

CASES = {case.name: case for case in render_cases(samples=12_000)}


@pytest.fixture(autouse=True)
def _anomalies() -> Iterator[None]:
    with torch.autograd.set_detect_anomaly(True):
        yield


def case_of(name: str) -> RenderCase:
    return CASES[name]


FORM = pytest.mark.parametrize("render", FORMS.values(), ids=FORMS)


EACH = [(name, render) for name in CASES for render in FORMS.values()]
NAMES = [f"{name}-{form}" for name in CASES for form in FORMS]


@pytest.mark.parametrize(("name", "render"), some(EACH, 5), ids=NAMES)
def test_single_precision_is_within_its_condition(name: str, render: Render) -> None:
    case = case_of(name)
    found = forward_error(case, render)
    assert found.finite
    assert found.share <= 1.0
    assert found.image_share <= 1.0
    if case.real:
        assert found.error_px <= 1e-3


@pytest.mark.parametrize("name", some(CASES, 3))
def test_double_precision_is_near_fifty_digits(name: str) -> None:
    assert double_error(case_of(name)) <= 1.0


@pytest.mark.parametrize(("name", "render"), some(EACH, 5), ids=NAMES)
def test_gradients_are_those_of_the_image(name: str, render: Render) -> None:
    case = case_of(name)
    well = case.smooth and gradient_condition(case) < 1e-4
    found = gradient_error(case, 2 if well else 0, render)
    assert found.finite
    if well:
        assert found.double <= 1e-6
        assert found.single <= 1e-3


@FORM
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.kinks])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_gradients_at_kinks_are_subgradients(name: str, dtype: torch.dtype, render: Render) -> None:
    assert subgradient_excess(case_of(name), dtype, render=render) <= 1e-3


def test_an_invalid_gradient_is_found_out() -> None:
    # the check above must be able to fail: away from the kink the one-sided slopes are one number
    case = replace(case_of("equidistant"), kinks=((21, 20),), tau=0.5)
    assert subgradient_excess(case, torch.float64) <= 1e-3
    wrong = replace(case, radius=case.radius * 1.5)
    g, v = image(case, torch.float64), image(wrong, torch.float64)
    assert float((g - v).abs().max()) > 0.1


def test_what_is_behind_the_light_is_not_seen() -> None:
    assert float(image(case_of("behind the light"), torch.float64).max()) == 0.0
    # a segment that crosses the light's plane looks like its part in front of the plane
    case = case_of("through the light's plane")
    front = case.points.copy()
    front[0] = front[1] + (5.0 - front[1, 2]) / (front[0, 2] - front[1, 2]) * (front[0] - front[1])
    other = image(replace(case, points=front), torch.float64)
    assert torch.allclose(image(case, torch.float64), other, atol=1e-12)
    assert float(other.max()) > 0.99


def test_scaled_scenes_give_the_same_picture() -> None:
    plain = distances(case_of("ordinary"), torch.float64).s
    for name in ("millionth", "million"):
        assert torch.allclose(distances(case_of(name), torch.float64).s, plain, atol=1e-9)


@FORM
@pytest.mark.parametrize("seed", range(8))
def test_single_precision_finds_the_winners_of_the_dense_formula(seed: int, render: Render) -> None:
    # around a corner of a polygon whose edges are far longer than wide: squares lose most of a pixel
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(8, 3)) * (30, 30, 10) + (0, 0, 600)
    a = torch.as_tensor(corners, dtype=torch.float32)
    step = 2.0**-14
    u0, v0 = (corners[0, :2] / corners[0, 2] / step).round() - (100, 60)
    frame = Frame(torch.eye(3), torch.zeros(3), float(u0), float(v0), step, 200, 120)
    dense = render_dense(a, a.roll(-1, 0), frame, 0.01, 0.1)
    assert float(dense.max()) > 0.4
    tiled = render(a, a.roll(-1, 0), frame, 0.01, 0.1)
    assert float((tiled - dense).abs().max()) <= 2e-7


@FORM
@pytest.mark.parametrize(
    ("count", "side"), [(60, 1024), (1000, 512), pytest.param(4000, 1024, marks=pytest.mark.study)]
)
def test_a_large_image_is_within_its_condition(count: int, side: int, render: Render) -> None:
    error_px, share = sampled_error(large_case(count, side), render=render)
    assert error_px <= 1e-3 and share <= 1.0


finite = st.floats(-1.0, 1.0, allow_subnormal=True)
point = st.tuples(finite, finite, st.floats(-0.5, 1.0))


@settings(max_examples=6)
@given(
    points=st.lists(point, min_size=2, max_size=6),
    log_scale=st.integers(-6, 6),
    log_radius=st.floats(-6, 0),
    log_tau=st.floats(0, 6),
    dtype=st.sampled_from([torch.float32, torch.float64]),
)
# where both ends nearly lie in the light, an endless slope was once multiplied by nothing
@example([(0.0, 0.0, 0.0), (0.0, 0.0, 1e-30)], 0, 0.0, 0.0, torch.float32)
def test_any_points_give_a_finite_picture_and_gradient(
    points: list[tuple[float, float, float]],
    log_scale: int,
    log_radius: float,
    log_tau: float,
    dtype: torch.dtype,
) -> None:
    p = np.array(points) * (12.0, 12.0, 500.0) * 10.0**log_scale
    rows = np.arange(len(p))
    case = RenderCase(
        "any",
        "",
        p,
        np.stack([rows, np.roll(rows, -1)], 1),
        radius=10.0 ** (log_radius + log_scale) * 12.0,
        tau=10.0**log_tau,
        width=16,
        height=12,
        step=2.0**-8,
    )
    frame = frame_at(case, dtype)
    at = torch.as_tensor(p).to(dtype).requires_grad_()
    follow = at[torch.as_tensor(case.edges[:, 1])]
    dense = render_dense(at, follow, frame, case.radius, case.tau)
    for render in FORMS.values():
        tiled = render(at, follow, frame, case.radius, case.tau)
        assert bool(tiled.isfinite().all() and dense.isfinite().all())
        (gradient,) = torch.autograd.grad(tiled.sum() + dense.sum(), at, retain_graph=True)
        assert bool(gradient.isfinite().all())
        if dtype == torch.float64:
            assert float((tiled - dense).detach().abs().max()) <= 1e-6
