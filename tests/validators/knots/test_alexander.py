"""The Alexander polynomial by primes, against the same determinant over the rationals."""

from __future__ import annotations

import numpy as np
import pytest
from diagrams import WORDS

from knotfab_validators.knots.alexander import alexander_polynomial
from knotfab_validators.knots.planar_diagram import closed_braid


def test_the_polynomial_is_that_of_the_rational_matrix() -> None:
    """Modular arithmetic finds what plain expansion does, with large coefficients."""
    for word in (WORDS[0], WORDS[3], (1, 1, 1, -2, 1, -2, -2, 3, -2, 3)):
        plain = closed_braid(word)
        if len(plain.components) == 1:
            found = alexander_polynomial(plain)
            # Burau: det(1 - B(t)) (1 - t) / (1 - t^n) is Δ(t), checked at t = 2 up to sign and 2^k
            value = abs(burau(word, 2.0))
            exact = abs(
                sum(c * 2.0 ** (found.lowest + k) for k, c in enumerate(found.coefficients))
            )
            ratio = np.log2(value / exact)
            assert ratio == pytest.approx(round(ratio), abs=1e-9)


def burau(word: tuple[int, ...], t: float) -> float:
    n = max(map(abs, word)) + 1
    whole = np.eye(n)
    for letter in word:
        k = abs(letter) - 1
        step = np.eye(n)
        step[k : k + 2, k : k + 2] = [[1 - t, t], [1, 0]]
        whole = whole @ (step if letter > 0 else np.linalg.inv(step))
    minor = (np.eye(n) - whole)[1:, 1:]
    return float(np.linalg.det(minor) * (1 - t) / (1 - t**n))
