"""Alexander polynomial of a diagram, exactly, and a quick number from it for large diagrams.

Fox's calculus on Wirtinger's presentation gives a matrix with a row for each crossing (Crowell and
Fox, "Introduction to knot theory", 1963, ch. VIII). Its minor is found modulo primes at whole
numbers, then put together: the primes are as many as Hadamard's bound on the coefficients asks for.
"""

from __future__ import annotations

import math

import numpy as np

from knotfab_validators.arrays import Ints
from knotfab_validators.knots.planar_diagram import PlanarDiagram
from knotfab_validators.knots.polynomial import Laurent, laurent

__all__ = ["alexander_polynomial", "colouring_number", "colouring_remainder"]


ROW_BITS = math.log2(6) / 2  # a row (1 - t, t, -1) has length at most sqrt(6) where |t| = 1
LARGEST_PRIME = 2**31 - 1  # products of two remainders fit in 64 bits


def alexander_polynomial(diagram: PlanarDiagram) -> Laurent:
    """Return Δ(t) in one variable, 0 for every split link, made symmetric and positive.

    For a knot: Δ(1) = 1 and Δ(t) = Δ(1/t). For a link it is fixed up to sign and powers of t only:
    here the lowest exponent is 0 and the first coefficient positive.
    """
    matrix = _wirtinger(diagram)
    knot = len(diagram.components) == 1
    if matrix is None:
        return Laurent(0, (1,)) if knot else Laurent(0, ())
    size = len(matrix)
    bound = 2 * 2 ** (ROW_BITS * size)
    residues: list[list[int]] = []
    primes: list[int] = []
    while math.prod(primes) <= bound:
        primes.append(_prime_below(primes[-1] if primes else LARGEST_PRIME + 1))
        residues.append(_determinant_modulo(matrix, primes[-1]))
    found = laurent(0, _combine(residues, primes))
    if not found:
        return found
    if knot:
        found = found.shift(-found.lowest - (len(found.coefficients) - 1) // 2)
        return found if found.at_one() > 0 else found.negate()
    found = found.shift(-found.lowest)
    return found if found.coefficients[0] > 0 else found.negate()


def colouring_number(diagram: PlanarDiagram) -> int:
    """Return ±Δ(-1) modulo the prime 2^31 - 1, the smaller of the two: a quick look at large diagrams.

    Not 1 for a knot: it is not the unknot. Not 0 for a link: it is not split.
    """
    matrix = _wirtinger(diagram)
    if matrix is None:
        return 1 if len(diagram.components) == 1 else 0
    p = LARGEST_PRIME
    value = int(_determinants((matrix[0] - matrix[1])[None] % p, p)[0])
    return min(value, p - value)


def colouring_remainder(determinant: int) -> int:
    """Return the `colouring_number` of a knot with this determinant."""
    value = determinant % LARGEST_PRIME
    return min(value, LARGEST_PRIME - value)


class _Wirtinger(tuple[Ints, Ints]):
    """Constant and linear coefficients (n, n) of the matrix in t."""

    def __len__(self) -> int:
        return int(self[0].shape[0])


def _wirtinger(diagram: PlanarDiagram) -> _Wirtinger | None:
    """Return the minor of Fox's matrix; None where it is empty or a component lies above all others."""
    count = len(diagram.crossings)
    if diagram.loops or not count:
        return None
    strand = list(range(len(diagram.component)))  # arcs that join above a crossing are one strand

    def root(arc: int) -> int:
        while strand[arc] != arc:
            strand[arc] = strand[strand[arc]]
            arc = strand[arc]
        return arc

    for _, b, _, d in diagram.crossings:
        strand[root(b)] = root(d)
    number = {r: k for k, r in enumerate(sorted({root(a) for a in range(len(strand))}))}
    if len(number) > count:
        return None
    constant = np.zeros((count, count), dtype=np.int64)
    linear = np.zeros((count, count), dtype=np.int64)
    for row, ((a, b, c, _), sign) in enumerate(zip(diagram.crossings, diagram.signs, strict=True)):
        above, coming, going = (number[root(arc)] for arc in (b, a, c))
        left, right = (coming, going) if sign > 0 else (going, coming)
        constant[row, above] += 1
        linear[row, above] -= 1
        linear[row, left] += 1
        constant[row, right] -= 1
    return _Wirtinger((constant[1:, 1:], linear[1:, 1:]))


def _determinant_modulo(matrix: _Wirtinger, p: int) -> list[int]:
    """Return coefficients of the determinant modulo a prime, from its values at 0, 1, ..., n."""
    at = np.arange(len(matrix) + 1, dtype=np.int64)
    values = _determinants((matrix[0] + at[:, None, None] * matrix[1]) % p, p)
    return _interpolate([int(v) for v in values], p)


def _determinants(matrices: Ints, p: int) -> Ints:
    """Return determinants modulo p of matrices (k, n, n), all at once."""
    work = matrices.copy()
    many, size, _ = work.shape
    result = np.ones(many, dtype=np.int64)
    each = np.arange(many)
    for k in range(size):
        pivot = k + (work[:, k:, k] != 0).argmax(axis=1)
        swapped = pivot != k
        rows = work[each, pivot].copy()
        work[each, pivot] = work[:, k]
        work[:, k] = rows
        result = np.where(swapped, p - result, result) * rows[:, k] % p
        inverse = _invert(rows[:, k], p)
        factor = work[:, k + 1 :, k] * inverse[:, None] % p
        busy = np.flatnonzero(factor.any(axis=0))
        if len(busy):
            # columns where no pivot row has an entry stay as they are
            columns = k + 1 + np.flatnonzero(rows[:, k + 1 :].any(axis=0))
            block = np.ix_(each, k + 1 + busy, columns)
            change = factor[:, busy, None] * rows[:, None, columns] % p
            work[block] = (work[block] - change) % p
    return result % p


def _invert(values: Ints, p: int) -> Ints:
    """Return 1 / v modulo p; 0 for 0."""
    return np.array([pow(int(v), -1, p) if v else 0 for v in values], dtype=np.int64)


def _interpolate(values: list[int], p: int) -> list[int]:
    """Return coefficients modulo p of the polynomial with these values at 0, 1, ... (Newton)."""
    differences = list(values)
    for step in range(1, len(values)):
        inverse = pow(step, -1, p)
        for k in range(len(values) - 1, step - 1, -1):
            differences[k] = (differences[k] - differences[k - 1]) * inverse % p
    result: list[int] = []
    for k in range(len(values) - 1, -1, -1):  # result = result * (t - k) + differences[k]
        shifted = [0, *result]
        for i, c in enumerate(result):
            shifted[i] = (shifted[i] - k * c) % p
        shifted[0] = (shifted[0] + differences[k]) % p
        result = shifted
    return result


def _combine(residues: list[list[int]], primes: list[int]) -> list[int]:
    """Return whole numbers from their remainders, of the smallest size (Chinese remainder theorem)."""
    product = math.prod(primes)
    weights = [product // p * pow(product // p, -1, p) for p in primes]
    result = []
    for of_one in zip(*residues, strict=True):
        value = sum(r * w for r, w in zip(of_one, weights, strict=True)) % product
        result.append(value - product if 2 * value > product else value)
    return result


def _prime_below(n: int) -> int:
    """Return the largest prime below n (of some 31 bits), by trial division."""
    while True:
        n -= 1
        if all(n % d for d in (2, 3, 5, 7)) and _is_prime(n):
            return n


def _is_prime(n: int) -> bool:
    """Return miller and Rabin's test with the bases 2, 3, 5, 7, which decide below 3.2e9 (Jaeschke 1993)."""
    odd, twos = n - 1, 0
    while odd % 2 == 0:
        odd, twos = odd // 2, twos + 1
    for base in (2, 3, 5, 7):
        x = pow(base, odd, n)
        if x in (1, n - 1):
            continue
        for _ in range(twos - 1):
            x = x * x % n
            if x == n - 1:
                break
        else:
            return False
    return True
