"""Thickness of thousands of small polygons of many kinds against plain enumeration."""

from __future__ import annotations

import numpy as np
import pytest
from polygon_kinds import KINDS, Polygons, place
from thickness_oracle import enumerate_chords

from knotfab_validators.tube import critical_chords
from knotfab_validators.tube.thickness import _find_turning, thickness

EACH = 150


def drawn(kind: str, seed: int) -> tuple[Polygons, list[bool]] | None:
    rng = np.random.default_rng([seed, *kind.encode()])
    polygons = place(KINDS[kind](rng), rng)
    edges = [np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1) for p in polygons]
    if min(float(e.min()) for e in edges) == 0:
        return None  # vertices that coincide are refused by the reader
    return polygons, [bool(rng.random() < 0.8) for _ in polygons]


def enumerated(polygons: Polygons, closed: list[bool]) -> float:
    """The thickness by enumeration: vertices at which nothing turns are no ends of edges for MinRad."""
    bare = [p[_find_turning(p, c)] for p, c in zip(polygons, closed, strict=True)]
    bent = [(p, c) for p, c in zip(bare, closed, strict=True) if len(p) > 2]
    min_rad = enumerate_chords(*zip(*bent, strict=True)).min_rad if bent else np.inf
    return float(min(min_rad, enumerate_chords(polygons, closed).half_dcsd))


def agrees(polygons: Polygons, closed: list[bool]) -> bool:
    """To 1e-9 of the value, and to what single coordinates of doubles are wrong by."""
    expected, found = enumerated(polygons, closed), thickness(polygons, closed).value
    size = max(float(np.ptp(p, axis=0).max()) for p in polygons)
    return found == expected or abs(found - expected) <= 1e-9 * expected + 1e-15 * size


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_as_enumerated(kind: str) -> None:
    cases = [(seed, drawn(kind, seed)) for seed in range(EACH)]
    assert sum(case is not None for _, case in cases) > EACH / 4
    assert [s for s, case in cases if case is not None and not agrees(*case)] == []


def longer(kind: str, seed: int) -> Polygons:
    """A few hundred vertices, so that arcs of several levels are paired."""
    rng = np.random.default_rng(seed)
    n = 320
    s = 2 * np.pi * np.arange(n)[:, None] / n * np.arange(1, 7)
    waves = rng.normal(size=(2, 6, 3)) / np.arange(1, 7)[:, None] ** 1.3
    if kind == "smooth":
        return [np.cos(s) @ waves[0] + np.sin(s) @ waves[1]]
    if kind == "walk":
        return [rng.normal(size=(n, 3)).cumsum(axis=0)]
    if kind == "jagged":
        return [rng.normal(size=(n, 3))]
    if kind == "lattice":
        steps = np.eye(3)[rng.integers(0, 3, n // 2)] * rng.choice([-1, 1], (n // 2, 1))
        path = np.cumsum(np.concatenate([steps, -rng.permutation(steps)]), axis=0)
        keep = np.linalg.norm(np.roll(path, -1, axis=0) - path, axis=1) > 0
        return [path[keep]]
    k = np.arange(n)
    rods = np.stack([(k // 2 + k) % 2 * 30.0, k // 2 % 13 * 1.0, k // 26 * 1.1], axis=1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return [rods @ turn]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["smooth", "walk", "jagged", "lattice", "rods"])
@pytest.mark.parametrize("blocks", [False, True])
def test_longer_polygons(kind: str, blocks: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The search goes through the tree of arcs to its leaves, and through blocks of edges paired at once."""
    monkeypatch.setattr(critical_chords, "TOP_ARCS", 4)
    monkeypatch.setattr(critical_chords, "BLOCK_LEVEL", 3)
    monkeypatch.setattr(critical_chords, "MANY_PAIRS", 0 if blocks else 10**9)
    monkeypatch.setattr(critical_chords, "PAIRS_AT_ONCE", 1000 if blocks else 150_000)
    for seed in range(2):
        polygons = longer(kind, seed)
        expected = enumerate_chords(polygons, [True])
        assert thickness(polygons).value == pytest.approx(expected.value, rel=1e-9, abs=1e-14)
        chord = critical_chords.shortest_critical_chord(polygons, [True])
        assert chord is not None
        assert chord.length / 2 == pytest.approx(expected.half_dcsd, rel=1e-9, abs=1e-14)
        assert np.linalg.norm(chord.points[1] - chord.points[0]) == pytest.approx(
            chord.length, abs=1e-12
        )


@pytest.mark.slow
def test_the_tolerance_costs_no_more_than_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tolerance of 1e-3, a million times the real one, leaves nothing more than 1e-3 off."""
    monkeypatch.setattr(critical_chords, "ANGLE_TOLERANCE", 1e-3)
    for kind in KINDS:
        for seed in range(40):
            case = drawn(kind, seed)
            if case is None or not all(case[1]):
                continue
            expected, found = enumerated(*case), thickness(*case).value
            size = max(float(np.ptp(p, axis=0).max()) for p in case[0])
            assert found <= expected * (1 + 1e-9) + 1e-15 * size, (kind, seed)
            assert found >= expected * (1 - 1e-3) - 1e-15 * size, (kind, seed)


def test_a_longer_chord_than_asked_for_is_not_returned() -> None:
    square = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    assert critical_chords.shortest_critical_chord([square], [True], up_to=1.99) is None
    found = critical_chords.shortest_critical_chord([square], [True], up_to=2.0)
    assert found is not None and found.length == 2.0
