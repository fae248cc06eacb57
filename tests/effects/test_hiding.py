"""Hiding: what a piece stands before of its own shadow, against sight lines followed one by one."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from questions import design_under, view
from reports import view_of_report

from knotfab.base.arrays import Array
from knotfab.effects import hiding
from knotfab.effects.base import EffectContext, Shadows, World
from knotfab.effects.hiding import ASIDE_DEG, HIDING, NOTICED, draw_strands, hide_edge
from knotfab.report.effects import judge_made, list_hidings, tell_hiding

RADIUS = 2.0
SEEN = Shadows.from_points(
    view(), np.zeros((1, 3))
)  # the wall 100 mm behind the origin, the lamp 500 before


def loop(high_mm: float, seed: int = 0) -> Array:
    """A wavy ring whose vertices are so high over the wall at least, in the wall's axes."""
    rng, t = np.random.default_rng(seed), np.linspace(0, 2 * np.pi, 240, endpoint=False)
    round_ = 40 + sum(rng.uniform(-6, 6) * np.cos(k * t + rng.uniform(0, 6)) for k in (2, 3, 5))
    up = sum(rng.uniform(0, 8) * (1 + np.cos(k * t + rng.uniform(0, 6))) for k in (1, 4))
    return np.column_stack([round_ * np.cos(t), round_ * np.sin(t), high_mm + up - up.min()])


def sees_hidden(line: Array, angle_deg: float) -> float:
    """Follow far sight lines to places on the shadow's edge, and count those that meet the tube."""
    lamp = SEEN.wall.lamp
    wide = RADIUS * lamp[2] / (lamp[2] - line[:, 2].mean())
    edge = draw_strands([SEEN.wall.cast(line)], wide).boundary
    parts = shapely.get_parts(edge)
    places = shapely.get_coordinates(
        [part.interpolate(at) for part in parts for at in np.arange(0, part.length, 0.5)]
    )
    dense = np.concatenate(
        [line + share * (np.roll(line, -1, 0) - line) for share in (0, 0.25, 0.5, 0.75)]
    )
    hidden = []
    for way in (1, -1):
        a = np.deg2rad(way * angle_deg)
        sight = np.array([np.sin(a), 0.0, np.cos(a)])
        from_wall = dense[None] - np.column_stack([places, np.zeros(len(places))])[:, None]
        off = from_wall - (from_wall @ sight)[..., None] * sight
        hidden.append((np.linalg.norm(off, axis=2).min(1) < RADIUS).mean())
    return float(np.mean(hidden))


@pytest.mark.parametrize("high_mm", [0.0, 8.0, 30.0, 90.0])
@pytest.mark.parametrize("seed", [0, 1])
def test_it_is_what_sight_lines_meet(high_mm: float, seed: int) -> None:
    line = loop(high_mm, seed)
    found = hide_edge(SEEN, [line], RADIUS)
    for angle in ASIDE_DEG:
        assert found.share[str(angle)] == pytest.approx(sees_hidden(line, angle), abs=0.02)


def test_what_lies_on_the_wall_hides_the_side_from_which_it_is_seen() -> None:
    t = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    flat = np.column_stack([40 * np.cos(t), 40 * np.sin(t), np.full(240, RADIUS)])
    share = hide_edge(SEEN, [flat], RADIUS).share
    assert share == {"30": pytest.approx(0.5, abs=0.06), "45": pytest.approx(0.5, abs=0.06)}


@pytest.mark.parametrize("seed", range(6))
def test_nothing_is_hidden_where_the_bound_is_nothing(seed: int) -> None:
    for high in np.linspace(0, 300, 7).tolist():
        line = loop(high, seed)
        bound = hiding._bound(SEEN.of_places(line), RADIUS)
        found = hide_edge(SEEN, [line], RADIUS)
        assert 0 <= bound <= 1
        if bound == 0:
            assert not any(found.share.values())
        if found.gap_mm is not None:
            moved = hide_edge(SEEN, [line + [0, 0, found.gap_mm]], RADIUS)
            assert found.share["30"] > NOTICED >= moved.share["30"]
    assert bound == 0  # far enough off


def test_an_eye_sees_the_piece_and_needs_no_wall() -> None:
    points = np.random.default_rng(0).uniform(-40, 40, (50, 3))
    assert HIDING.magnitude(EffectContext((view(kind="eye"),), points, RADIUS, 0.25)) == 0.0
    assert HIDING.magnitude(EffectContext((view(),), points, RADIUS, 0.25)) > 0.1


def test_it_is_told_with_its_remedy_and_far_off_no_code_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    line = loop(0.0) @ SEEN.wall.axes + SEEN.wall.foot
    made = design_under(World(), line)
    judge_made(made, made.scene, None, None)
    (found,) = list_hidings(made)
    assert found is not None and found.gap_mm is not None
    (said,) = tell_hiding([view_of_report(hiding=found)], made.scene)
    assert f"{100 * found.share['30']:.0f} % from 30°" in said
    assert f"--wall-distance {made.scene.views[0].wall_distance_mm + found.gap_mm:g}" in said

    def explode(*_: object) -> None:
        raise AssertionError("the piece was looked at")

    monkeypatch.setattr(hiding, "hide_edge", explode)
    made = design_under(World(), line + 300 * SEEN.wall.axes[2])
    judge_made(made, made.scene, None, None)
    assert list_hidings(made) == [None]
