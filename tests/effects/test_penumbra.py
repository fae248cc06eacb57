"""Penumbra: a bound of the blur that holds and is close, whatever the wall's tilt and the lamp's size."""

import numpy as np
import pytest
from questions import design_under
from questions import view as lit_view
from tables import some

from knotfab.base.arrays import Array
from knotfab.effects.base import Decision, Effect, EffectContext, Shadows, World, decide
from knotfab.effects.penumbra import PENUMBRA, blurs_mm
from knotfab.effects.survey import EFFECTS, survey
from knotfab.geometry.tube import sweep
from knotfab.report.effects import judge_made, tell_warnings
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView
from knotfab_formats.views import Switches
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


# What is simulated and why: by magnitude, by the scene's own word, and never in silence.


VIEW = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0)
CONTEXT = EffectContext((VIEW,), np.zeros((4, 3)), 2.0, 0.25)


def effect(magnitude: float) -> Effect:
    return Effect("haze", "px", lambda _: magnitude, 4.0, "the air is hazy")


@pytest.mark.parametrize(
    ("magnitude", "forced", "simulated", "warned"),
    [
        (0.9, None, False, False), (1.1, None, True, False), (0.9, True, True, False),
        (1.1, False, False, True), (0.9, False, False, False),
    ],
)  # fmt: skip
def test_on_above_the_threshold_or_by_the_scenes_word(
    magnitude: float, forced: bool | None, simulated: bool, warned: bool
) -> None:
    found = decide(effect(magnitude), CONTEXT, {"haze": forced})
    assert (found.threshold, found.magnitude) == (1.0, magnitude)
    assert found.simulated == simulated
    side = "exceeds" if magnitude > 1 else "stays below"
    assert f"{magnitude:.3g} px {side} 1 px" in found.reason
    assert ("the air is hazy" in found.reason) == (simulated and forced is None)
    told = tell_warnings({"haze": found})
    assert len(told) == warned
    assert not warned or "haze is switched off, though its 1.1 px exceeds 1 px" in told[0]


def test_what_it_does_grows_from_nothing_at_the_threshold() -> None:
    at = [decide(effect(m), CONTEXT, {}).excess for m in (0.99, 1.0, 1.01, 2.0, 100.0)]
    assert at[0] == at[1] == 0 < at[2] < 0.01
    assert at[3] == pytest.approx(0.5) and at[4] == pytest.approx(0.99)
    for forced in (True, False):  # measured below the threshold, yet without a say
        assert decide(effect(0.5), CONTEXT, {"haze": forced}).excess == 0


def test_calls_and_seconds_are_counted_by_stage() -> None:
    found = Decision(effect(2.0), 2.0, 1.0)
    assert found.where == [] and found.calls == 0
    for _ in range(3):
        with found.called("depth"):
            pass
    found.count("verification", 101, 0.5)
    assert (found.calls, found.where) == (104, ["depth", "verification"])
    assert found.seconds >= 0.5


def test_judged_anew_nothing_is_taken_back() -> None:
    found = Decision(effect(0.0), 0.9, 1.0)
    found.keep_largest(Decision(effect(0.0), 0.5, 1.0))
    assert (found.magnitude, found.simulated) == (0.9, False)
    found.keep_largest(Decision(effect(0.0), 1.5, 1.2))
    found.keep_largest(Decision(effect(0.0), 0.1, 1.2))
    assert (found.magnitude, found.threshold, found.simulated) == (1.5, 1.2, True)


def test_every_effect_has_its_switch_and_only_these() -> None:
    assert [e.name for e in EFFECTS] == list(Switches.model_fields)
    assert list(survey(CONTEXT, dict(Switches()))) == [e.name for e in EFFECTS]


def test_what_an_earlier_search_spent_is_counted() -> None:
    earlier, later = Decision(effect(9.0), 9.0, 1.0), Decision(effect(4.0), 4.0, 1.0)
    earlier.count("depth", 300, 0.1)
    later.count("depth", 20, 0.2)
    later.count("search", 1, 0.3)
    later.add(earlier)
    assert (later.calls, later.magnitude, later.where) == (321, 9.0, ["depth", "search"])
    assert later.seconds == pytest.approx(0.6)
    assert (earlier.calls, earlier.where) == (300, ["depth"])
