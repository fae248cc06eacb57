"""Limits under watch: a term that cannot be felt is not called, and leaving it out changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from questions import ask_heart, start_and_search
from region_meshes import box_mesh
from slopes import state_at

from knotfab.base.arrays import Array
from knotfab.limits import feasibility as guards
from knotfab.limits.region import REGION, outside
from knotfab.limits.terms import LENGTH, Guard, Limit, Limits
from knotfab.part.files import write_stl
from knotfab_formats.scene import SettledRegion
from knotfab_formats.search import PRESETS

QUICK = PRESETS["draft"].model_copy(
    update={
        **{"coarse_px": 64, "coarse_iterations": 12, "depth_candidates": 2},
        **{"fine_px": 64, "fine_iterations": 6, "settle_iterations": 4},
    }
)
SIDE = 100.0
SIZES: dict[str, tuple[float, float, float]] = {
    "box": (SIDE,) * 3,
    "cylinder": (SIDE, SIDE, SIDE),
    "sphere": (SIDE,) * 3,
    "mesh": (SIDE,) * 3,
}


def ring(n: int = 120) -> Array:
    t = 2 * np.pi * np.arange(n) / n
    return np.column_stack([40 * np.cos(t), 40 * np.sin(t), 6 * np.cos(5 * t)])


def limits(tmp_path: Path, kind: str = "box", length: float = 1e5) -> Limits:
    named: Any = {"kind": kind, "size_mm": SIZES[kind]}
    if kind == "mesh":
        named["file"] = str(tmp_path / "room.stl")
        box = box_mesh(SIZES[kind])
        write_stl(tmp_path / "room.stl", [(box.vertices, box.faces.astype(np.int32))])
    return Limits(2.0, 0.4, 2.2, length, SettledRegion(**named))


def value_and_slope(term: Callable[..., Any], points: Array, lim: Limits) -> tuple[float, Array]:
    value, slope = term(state_at(points), lim)
    return value, slope


def walk(steps: int, seed: int) -> list[Array]:
    """A ring that drifts and swells until it is long and far outside, by steps of up to a radius."""
    rng = np.random.default_rng(seed)
    found, points = [], ring()
    for step in range(steps):
        points = points * 1.002 + rng.normal(0, 0.02, points.shape) + [0.01 * step, 0.0, 0.004]
        found.append(points)
    return found


def test_walls_end_the_region() -> None:
    """A wall that leans over the middle: what stands behind it is pushed straight out of it."""
    normal = np.array([0.6, 0.0, 0.8])
    walls = ((*normal.tolist(), 10.0),)
    region = SettledRegion(size_mm=(200.0, 200.0, 200.0))
    points = np.random.default_rng(0).uniform(-99, 99, (500, 3))
    free, excess = outside(points, region, 2.0)[0], outside(points, region, 2.0, walls)
    assert excess[0] == pytest.approx(np.maximum(free, 2.0 - points @ normal - 10.0))
    behind = excess[0] > free
    assert 50 < behind.sum() < 450
    assert np.abs(excess[1][behind] + normal).max() < 1e-12


@pytest.mark.parametrize("kind", list(SIZES))
def test_a_region_that_is_not_felt_is_nothing(tmp_path: Path, kind: str) -> None:
    lim, guard, looks = limits(tmp_path, kind), Guard(REGION), 0
    felt = 0
    for points in walk(50, 1):
        before = guard._seen
        term = guard.term(state_at(points), lim)
        looks += guard._seen is not before
        value, slope = value_and_slope(REGION.term, points, lim)
        if term is None:
            assert value == 0.0 == np.abs(slope).max()
        else:
            felt += 1
            assert term[0] == value
    assert 5 < felt == guard.calls < 45
    assert looks - felt < 45 - felt  # and not every step was looked at


def test_a_length_that_is_not_felt_is_nothing(tmp_path: Path) -> None:
    way = walk(50, 2)
    spans = [np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).sum() for p in way]
    lim, guard = limits(tmp_path, length=float(np.median(spans))), Guard(LENGTH)
    for points in way:
        term = guard.term(state_at(points), lim)
        value, slope = value_and_slope(LENGTH.term, points, lim)
        if term is None:
            assert value == 0.0 == np.abs(slope).max()
        else:
            assert term[0] == value
    assert 5 < guard.calls < 45


@pytest.mark.parametrize("kind", [*SIZES, "length"])
def test_slopes_are_those_of_finite_differences(tmp_path: Path, kind: str) -> None:
    lim = limits(tmp_path) if kind == "length" else limits(tmp_path, kind)
    limit = LENGTH if kind == "length" else REGION
    lim = replace(lim, length=150.0)
    points, rng, h = ring() * [1.4, 1.3, 1.0] + 0.1, np.random.default_rng(3), 1e-5
    value, slope = value_and_slope(limit.term, points, lim)
    assert value > 0
    # the mean edge's part in a weight is no part of a slope: along moves that keep it there is none
    for _ in range(6):
        way = rng.normal(size=points.shape)
        way -= way.mean(axis=0)
        ahead, behind = (value_and_slope(limit.term, points + s * way, lim)[0] for s in (h, -h))
        grown = [state_at(points + s * h * way).spacing for s in (1, -1)]
        of_weight = 0.0
        if limit is REGION and kind != "mesh":
            of_weight = value / state_at(points).spacing * (grown[0] - grown[1]) / (2 * h)
        found = (ahead - behind) / (2 * h) - of_weight
        if kind == "mesh":
            assert found == pytest.approx(float((slope * way).sum()), rel=0.1, abs=0.05 * value)
        else:
            assert found == pytest.approx(float((slope * way).sum()), rel=1e-4, abs=1e-5 * value)


@pytest.mark.slow
def test_an_unfelt_limit_runs_no_code(monkeypatch: pytest.MonkeyPatch) -> None:
    def explode(*_: object) -> None:
        raise AssertionError("a limit that cannot be felt was called")

    problem = ask_heart()
    disarmed = [
        replace(one, term=explode) if one.name in ("region", "length") else one
        for one in guards.LIMITS
    ]
    monkeypatch.setattr(guards, "LIMITS", disarmed)
    result = start_and_search(problem, 4.0, QUICK, repairs=0)
    assert result.guards["region"].calls == 0 == result.guards["length"].calls
    assert result.guards["clearance"].calls == result.guards["bend"].calls == 22
    # and where the scene calls for it, it does run: the heart's box is 40 mm too small
    tight = replace(problem, region=SettledRegion(size_mm=(100.0, 100.0, 180.0)))
    with pytest.raises(AssertionError, match="cannot be felt"):
        start_and_search(tight, 4.0, QUICK, repairs=0)


@pytest.mark.slow
def test_watching_changes_no_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A budget that only comes to be felt along the walk, watched and always called: the same knots."""
    problem = ask_heart()
    free = start_and_search(problem, 4.0, QUICK, repairs=0)
    length = sum(knot.length_mm for knot in free.knots.knots)
    tight = replace(problem, length=0.995 * length)
    watched = start_and_search(tight, 4.0, QUICK, repairs=0)
    always: list[Limit] = [replace(one, slack=None) for one in guards.LIMITS]
    monkeypatch.setattr(guards, "LIMITS", always)
    called = start_and_search(tight, 4.0, QUICK, repairs=0)
    assert 0 < watched.guards["length"].calls < called.guards["length"].calls == 22
    assert (watched.knots.points == called.knots.points).all()
