"""Penumbra: a bound of the blur that holds and is close, whatever the wall's tilt and the lamp's size."""

from __future__ import annotations

import numpy as np
import pytest
from questions import design_under
from questions import view as lit_view
from tables import some

from knotfab.base.arrays import Array
from knotfab.effects.base import EffectContext, Shadows, World
from knotfab.effects.penumbra import PENUMBRA, blurs_mm
from knotfab.geometry.tube import sweep
from knotfab.report.effects import judge_made
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView
from knotfab_validators.shadows.lamp import blur_px
from knotfab_validators.shadows.view import view_geometry


def view(**keys: float | str) -> ResolvedView:
    return ResolvedView.model_validate({"frame_width_mm": 1024.0, "frame_height_mm": 500.0} | keys)


def true_blur(seen: ResolvedView, edge: Array, samples: int = 720) -> float:
    """The longest line of the shadow that one point casts of a ball, by its tangent rays, mm."""
    camera = camera_of(seen, 1, 1)
    normal, offset = camera.receiver[:3], camera.receiver[3]
    ray = edge - camera.eye
    far, half = np.linalg.norm(ray), 0.5 * seen.light_diameter_mm
    ray /= far
    side = np.cross(ray, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side)
    t = 2 * np.pi * np.arange(samples) / samples
    across = np.cos(t)[:, None] * side + np.sin(t)[:, None] * np.cross(ray, side)
    sine = half / far
    cosine = np.sqrt(1 - sine**2)
    through = cosine * ray + sine * across  # rays that touch the ball, through the edge
    reach = -(normal @ edge + offset) / (through @ normal)
    spots = edge + reach[:, None] * through
    return float(np.linalg.norm(spots - np.roll(spots, samples // 2, axis=0), axis=1).max())


def test_it_is_the_makers_rule() -> None:
    # a 5 mm lamp at 1 m blurs by 1.5 mm on a wall 0.3 m behind a flat piece, a little more at its near side
    seen = view(light_distance_mm=1000.0, wall_distance_mm=300.0, light_diameter_mm=5.0)
    flat = np.array([[0.1, 0, 0], [0, 0.1, 0], [-0.1, 0, 0]])
    found = PENUMBRA.magnitude(EffectContext((seen,), flat, 2.0, 0.25))
    assert found == pytest.approx(5.0 * (300.0 + 2.0) / (1000.0 - 2.0), rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("count", some([8, 25], 2))
def test_it_bounds_the_truth_and_closely(count: int) -> None:
    rng = np.random.default_rng(7)
    ratios = []
    for _ in range(count):
        keys = {
            "light_distance_mm": rng.uniform(200, 2000),
            "wall_distance_mm": rng.uniform(40, 400),
            "light_diameter_mm": rng.uniform(1, 60),
            "wall_tilt_deg": rng.uniform(-30, 30),
        }
        seen, radius = view(**keys), rng.uniform(0.5, 4)
        depth = min(0.35 * keys["light_distance_mm"], 0.8 * keys["wall_distance_mm"])
        points = rng.uniform(-1, 1, (12, 3)) * [80, 80, depth / 2]
        surface = rng.normal(size=(120, 3))
        surface *= radius / np.linalg.norm(surface, axis=1)[:, None]
        bounds = blurs_mm(Shadows.from_points(seen, points), radius)
        worst = points[bounds.argmax()] + surface
        truth = max(true_blur(seen, edge, 72) for edge in worst)
        ratios.append(float(bounds.max()) / truth)
    assert min(ratios) >= 1.0 and np.median(ratios) <= 1.008


@pytest.mark.parametrize("sides", [8, 16])
def test_it_bounds_what_the_validators_measure_on_the_mesh(sides: int) -> None:
    """Bends towards the lamp have mitres that stand out of the round tube; the bound covers them."""
    t = 2 * np.pi * np.arange(60) / 60
    points = np.column_stack([50 * np.cos(t), 50 * np.sin(t), 20 * np.sin(8 * t)])
    made, seen = design_under(World(), points), lit_view(light_diameter_mm=20.0)
    made.scene.views, made.settings.mesh_sides = (seen,), sides
    judge_made(made, made.scene, None, None)
    vertices, _ = sweep(points, 2.0, sides)
    widest = blur_px(vertices, view_geometry(seen, 1024, 1024), 20.0)
    assert widest <= made.result.effects["penumbra"].magnitude < 1.02 * widest


@pytest.mark.parametrize("keys", [{"light_diameter_mm": 0.0}, {"kind": "eye"}])
def test_no_lamp_no_blur(keys: dict[str, float | str]) -> None:
    assert not blurs_mm(Shadows.from_points(view(**keys), np.zeros((3, 3))), 2.0).any()


def test_of_several_views_the_one_counts_where_it_is_widest() -> None:
    near, far = view(), view(light_distance_mm=1e7)
    points = np.zeros((1, 3))

    def magnitude(*views: ResolvedView) -> float:
        return PENUMBRA.magnitude(EffectContext(views, points, 2.0, 0.25))

    assert magnitude(far, near) == magnitude(near) > 100 * magnitude(far)
