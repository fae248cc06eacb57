"""Diagrams of polygons in space: their linking numbers, and directions that tell nothing."""

from __future__ import annotations

import numpy as np
import pytest
from knot_curves import Array, diagram

from knotfab_validators.knots.projection import diagram_of, seen_from


def test_linking_numbers_agree_with_gauss_integral() -> None:
    found = []
    for seed in range(20):
        one, other = np.random.default_rng(seed).normal(size=(2, 14, 3))
        found.append(diagram(one, other).linking_numbers().get((0, 1), 0))
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


def test_a_direction_in_which_a_sign_is_uncertain_is_left_aside() -> None:
    cross = np.array([[-1.0, 0, 0], [1, 0, 0], [1, 2, 1], [0, 2, 1], [0, -2, 1], [-1, -2, 0.5]])
    assert seen_from([cross], np.array([0.0, 0.0, 1.0])) is not None
    for hit in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]):  # along an edge
        assert seen_from([cross], np.array(hit)) is None
    over = cross.copy()
    over[3:5, 0] = 1.0  # three edges through one point of the picture
    assert seen_from([over], np.array([0.0, 0.0, 1.0])) is None
    assert diagram_of([np.random.default_rng(0).normal(size=(200, 3))], most=100) is None
