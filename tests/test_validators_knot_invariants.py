"""Invariants of known knots and links, however they are sampled and turned."""

from __future__ import annotations

import numpy as np
import pytest
from validator_parts import Array, circle, tangle, trefoil

from knotfab_validators.knot_invariants import (
    determinant,
    expected_determinant,
    linking_number,
)


def torus_knot(p: int, q: int, n: int = 400) -> Array:
    t = 2 * np.pi * np.arange(n) / n
    around = 2 + np.cos(q * t)
    return np.column_stack([around * np.cos(p * t), around * np.sin(p * t), np.sin(q * t)])


def figure_eight(n: int = 300) -> Array:
    t = 2 * np.pi * np.arange(n) / n
    around = 2 + np.cos(2 * t)
    return np.column_stack([around * np.cos(3 * t), around * np.sin(3 * t), np.sin(4 * t)])


@pytest.mark.parametrize(
    ("curve", "kind"),
    [
        (circle(50), "unknot"),
        (tangle(300, 1), "unknot"),
        (torus_knot(1, 5), "unknot"),
        (trefoil(300), "trefoil"),
        (torus_knot(2, 3), "3_1"),
        (figure_eight(), "figure-eight"),
        (torus_knot(2, 5), "5_1"),
        (torus_knot(2, 7), "7_1"),
        (torus_knot(3, 4), "8_19"),
    ],
)
def test_determinants_of_known_knots(curve: Array, kind: str) -> None:
    rng = np.random.default_rng(0)
    for _ in range(4):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        assert determinant(curve @ turn) == expected_determinant(kind)


def test_a_sum_has_the_product_of_determinants() -> None:
    one, other = trefoil(200, 1.0), figure_eight(200)
    one = np.roll(one, -int(one[:, 0].argmax()), axis=0)
    other = np.roll(other, -int(other[:, 0].argmin()), axis=0)
    other = other + one[0] - other[0] + [1.0, 0, 0]
    joined = np.concatenate([one[1:], one[:1] + [0, 1e-3, 0], other[:1] + [0, 1e-3, 0], other[1:]])
    assert determinant(joined) == expected_determinant("3_1 # 4_1") == 15


def test_an_unknown_type_has_no_expected_determinant() -> None:
    assert expected_determinant("9_99") is None and expected_determinant("granny") is None
    assert expected_determinant("m3_1") == expected_determinant("Trefoil") == 3


def test_too_many_crossings_give_no_answer() -> None:
    assert determinant(np.random.default_rng(0).normal(size=(150, 3))) is None


def test_linking_numbers() -> None:
    ring = circle(60, 10.0)
    through = ring[:, [2, 0, 1]] + [0.0, 10.0, 0.0]
    assert abs(linking_number(ring, through)) == 1
    assert linking_number(ring, through[::-1]) == -linking_number(ring, through)
    assert linking_number(ring @ np.diag([1, 1, -1.0]), through @ np.diag([1, 1, -1.0])) == (
        -linking_number(ring, through)
    )
    assert linking_number(ring, through + [0.0, 11.0, 0.0]) == 0
    t = 2 * np.pi * np.arange(300) / 300
    around = 10 + 3 * np.cos(4 * t)
    coil = np.column_stack([around * np.cos(t), around * np.sin(t), 3 * np.sin(4 * t)])
    assert abs(linking_number(ring, coil)) == 4


def test_linking_numbers_agree_with_gauss_integral() -> None:
    found = []
    for seed in range(20):
        one, other = np.random.default_rng(seed).normal(size=(2, 14, 3))
        found.append(linking_number(one, other))
        assert found[-1] == pytest.approx(gauss(one, other), abs=1e-9)
    assert min(found) < 0 < max(found)


def gauss(one: Array, other: Array) -> float:
    """Gauss' double integral over all pairs of edges, each in closed form as a solid angle."""
    a, b = one[:, None], np.roll(one, -1, axis=0)[:, None]
    c, d = other[None], np.roll(other, -1, axis=0)[None]
    normals = [np.cross(c - a, d - a), np.cross(d - a, d - b)]
    normals += [np.cross(d - b, c - b), np.cross(c - b, c - a)]
    unit = [n / np.linalg.norm(n, axis=2, keepdims=True) for n in normals]
    angle = sum(
        np.arcsin(np.clip((unit[k] * unit[(k + 1) % 4]).sum(axis=2), -1, 1)) for k in range(4)
    )
    sign = np.sign((np.cross(d - c, b - a) * (c - a)).sum(axis=2))
    return float((angle * sign).sum() / (4 * np.pi))
