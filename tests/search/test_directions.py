"""Directions of several views as unknowns: their slopes, their bounds, and that they are found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pieces import ring
from shapely import MultiPolygon, box

from knotfab.geometry.polylines import polylines_of
from knotfab.problem import Problem, TargetView
from knotfab.scene.camera import least_apart
from knotfab.search.free_pose import MOST_TURN_DEG, FreeDirections
from knotfab.search.objective import Objective, Weights
from knotfab_formats.scene import ResolvedView, SettledRegion
from knotfab_formats.search import SearchSettings

RADIUS, PIXELS = 4.0, 128
SETTINGS = SearchSettings(precision="double")
POINTS = np.vstack([ring(40.0, n=160, wave=20.0) * [0.6, 1.0, 1.0] + [9.0, 0.0, 5.0]])

RINGS = polylines_of([POINTS])


def views(*azimuths: float) -> tuple[TargetView, ...]:
    found = []
    for n, azimuth in enumerate(azimuths):
        view = ResolvedView(
            name=f"v{n}", azimuth_deg=azimuth, frame_width_mm=160.0, frame_height_mm=160.0
        )
        mask = np.zeros((96, 96), dtype=bool)
        mask[20:80, 30:60] = True
        found.append(TargetView(view, mask, MultiPolygon([box(-20, -30, 20, 30)])))
    return tuple(found)


def question(seen: tuple[TargetView, ...]) -> tuple[Problem, Objective]:
    problem = Problem(seen, 0.4, None, 1e6, SettledRegion(size_mm=(200.0, 200.0, 200.0)))
    images = tuple(v.image_at(RADIUS, PIXELS) for v in seen)
    double = tuple(replace(i, target=i.target.astype(np.float64)) for i in images)
    objective = Objective(double, RINGS, problem.limits(RADIUS), {}, Weights(), (3.0, 3.0))
    return problem, objective


def test_the_slope_is_that_of_finite_differences() -> None:
    problem, objective = question(views(0.0, 70.0))
    directions = FreeDirections(problem.views, RADIUS, SETTINGS)
    at = np.array([[0.0, 0.0], [70.0, 25.0]])
    step, slopes = 1e-3, []
    for turn in np.eye(2):
        found = []
        for way in (1.0, -1.0):
            directions.places_deg = at + [[0.0, 0.0], way * step * turn]
            directions.show(objective, problem)
            found.append(objective.image_term(1, POINTS, objective.tau_px(1, 0.0))[0])
        slopes.append((found[0] - found[1]) / (2 * step))
    directions.places_deg = at
    directions.show(objective, problem)
    view = problem.views[1].view.but(azimuth_deg=70.0, elevation_deg=25.0)
    slope = directions.slope(objective, 1, view, POINTS, 0.0)
    assert slope == pytest.approx(slopes, rel=2e-3)


@pytest.mark.parametrize(("starts", "away"), [("", (64.0, 0.0)), ("0.0 0.0", (66.0, 7.0))])
def test_a_view_turns_to_where_the_knots_draw_its_picture(
    starts: str, away: tuple[float, float]
) -> None:
    settings = SETTINGS.but(free_elevations_deg=starts)
    seen = tuple(v.image_at(RADIUS, 96).seen(POINTS, RINGS, RADIUS) for v in views(0.0, 70.0))
    drawn = tuple(
        replace(v, mask=mask[6:-6, 6:-6]) for v, mask in zip(views(0.0, 70.0), seen, strict=True)
    )
    turned = tuple(
        replace(v, view=v.view.but(azimuth_deg=a, elevation_deg=e))
        for v, (a, e) in zip(drawn, ((0.0, 0.0), away), strict=True)
    )
    problem, objective = question(turned)
    directions = FreeDirections(problem.views, RADIUS, settings)
    for n in range(240):
        directions.descend(objective, problem, POINTS, None, n / 240)  # type: ignore[arg-type]
    settled, points, numbers = directions.settle(problem, POINTS)
    assert points is POINTS and numbers is None
    assert settled.views[0].view.azimuth_deg == 0.0
    assert settled.views[1].view.azimuth_deg == pytest.approx(70.0, abs=0.5)
    assert settled.views[1].view.elevation_deg == pytest.approx(0.0, abs=0.5)


def test_directions_keep_their_bounds() -> None:
    problem, objective = question(views(0.0, 20.0, 45.0))
    directions = FreeDirections(problem.views, RADIUS, SETTINGS)
    least = least_apart([v.view for v in problem.views])
    for _ in range(80):
        directions.descend(objective, problem, POINTS, None, 0.0)  # type: ignore[arg-type]
    assert (np.abs(directions.places_deg - directions.first_deg) <= MOST_TURN_DEG).all()
    settled, _, _ = directions.settle(problem, POINTS)
    assert least_apart([v.view for v in settled.views]) >= 0.69 * least
