"""The frame model against beams whose deflection is known, and against itself turned and cut up."""

from __future__ import annotations

import numpy as np
import pytest

from knotfab.mount.frame_model import GRAVITY_M_S2, deflection, round_beams

E, RHO, R = 3000.0, 1.24, 1.5
W = np.pi * R**2 * RHO * 1e-6 * GRAVITY_M_S2  # N/mm
I = np.pi / 4 * R**4  # noqa: E741
DOWN = np.array([0.0, -1.0, 0.0])


def line(length: float, pieces: int, direction: tuple[float, float, float] = (1, 0, 0)):
    joints = np.linspace(0, length, pieces + 1)[:, None] * np.array(direction, dtype=float)
    ends = np.column_stack([np.arange(pieces), np.arange(1, pieces + 1)])
    return round_beams(joints, ends, np.full(pieces, R))


@pytest.mark.parametrize("pieces", [1, 2, 7])
def test_a_cantilever_under_its_weight(pieces: int) -> None:
    beams = line(100.0, pieces)
    moved = deflection(beams, np.array([0]), E, RHO, DOWN)
    assert moved[-1] == pytest.approx([0, -W * 100.0**4 / (8 * E * I), 0], rel=1e-9, abs=1e-15)


def test_a_beam_held_at_both_ends() -> None:
    moved = deflection(line(200.0, 4), np.array([0, 4]), E, RHO, DOWN)
    assert -moved[2, 1] == pytest.approx(W * 200.0**4 / (384 * E * I), rel=1e-9)


def test_a_rod_that_hangs_is_stretched() -> None:
    moved = deflection(line(80.0, 3, (0, -1, 0)), np.array([0]), E, RHO, DOWN)
    assert -moved[-1, 1] == pytest.approx(W * 80.0**2 / (2 * E * np.pi * R**2), rel=1e-9)


def test_an_arm_twists_the_beam_that_holds_it() -> None:
    """An L in the horizontal plane: bending of both legs, and twist of the first by the second."""
    a, b = 60.0, 40.0
    joints = np.array([[0, 0, 0], [a, 0, 0], [a, 0, b]], dtype=float)
    beams = round_beams(joints, np.array([[0, 1], [1, 2]]), np.full(2, R))
    moved = deflection(beams, np.array([0]), E, RHO, DOWN)
    shear, j = E / (2 * 1.35), np.pi / 2 * R**4
    tip = W * b * a**3 / (3 * E * I) + W * a**4 / (8 * E * I)
    tip += W * b * (b / 2) * a / (shear * j) * b + W * b**4 / (8 * E * I)
    assert -moved[2, 1] == pytest.approx(tip, rel=1e-9)


def test_turning_the_world_turns_the_answer() -> None:
    rng = np.random.default_rng(1)
    joints = rng.normal(size=(12, 3)) * 30
    ends = np.column_stack([np.arange(12), np.roll(np.arange(12), -1)])
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    one = deflection(round_beams(joints, ends, np.full(12, R)), np.array([0, 5]), E, RHO, DOWN)
    other = deflection(
        round_beams(joints @ q.T, ends, np.full(12, R)), np.array([0, 5]), E, RHO, q @ DOWN
    )
    assert np.allclose(one @ q.T, other, rtol=1e-8, atol=1e-12)


def test_what_nothing_holds_is_refused() -> None:
    with pytest.raises(ValueError, match="held"):
        deflection(line(10.0, 2), np.array([], dtype=int), E, RHO, DOWN)
    with pytest.raises(ValueError, match="no length"):
        deflection(line(0.0, 2), np.array([0]), E, RHO, DOWN)
