"""The Alexander and Jones polynomials of a diagram, exactly, and a quick number for large diagrams.

Fox's calculus on Wirtinger's presentation gives a matrix with a row for each crossing (Crowell and
Fox, "Introduction to knot theory", 1963, ch. VIII). Its minor is evaluated modulo primes at integers and
then combined; Hadamard's bound on the coefficients says how many primes are needed.
"""

from __future__ import annotations

import math

import numpy as np

from knotfab_validators.arrays import Ints
from knotfab_validators.knots.planar_diagram import Laurent, PlanarDiagram, laurent

ROW_BITS = math.log2(6) / 2  # a row (1 - t, t, -1) has length at most sqrt(6) where |t| = 1
LARGEST_PRIME = 2**31 - 1  # products of two remainders fit in 64 bits


def alexander_polynomial(diagram: PlanarDiagram) -> Laurent:
    """Return Δ(t), made symmetric and positive; a link has it in one variable, and 0 if it is split.

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
    """Return ±Δ(-1) modulo the prime 2^31 - 1, whichever is smaller: a quick test for large diagrams.

    A knot whose number is not 1 is knotted; a link whose number is not 0 is not split.
    """
    matrix = _wirtinger(diagram)
    if matrix is None:
        return 1 if len(diagram.components) == 1 else 0
    p = LARGEST_PRIME
    value = int(_determinants((matrix[0] - matrix[1])[None] % p, p)[0])
    return min(value, p - value)


def colouring_remainder(determinant: int) -> int:
    """Return the `colouring_number` that a knot with this determinant has."""
    value = determinant % LARGEST_PRIME
    return min(value, LARGEST_PRIME - value)


class _Wirtinger(tuple[Ints, Ints]):
    """A matrix that is linear in t: its constant and its linear coefficients, (n, n) each."""

    def __len__(self) -> int:
        return int(self[0].shape[0])


def _wirtinger(diagram: PlanarDiagram) -> _Wirtinger | None:
    """Return the minor of Fox's matrix; None if it is empty or a component lies above all others."""
    count = len(diagram.crossings)
    if diagram.loops or not count:
        return None
    strand = list(range(len(diagram.component)))  # arcs that pass over a crossing are one strand

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
    """Return the coefficients of the determinant modulo a prime, from its values at 0, 1, ..., n."""
    at = np.arange(len(matrix) + 1, dtype=np.int64)
    values = _determinants((matrix[0] + at[:, None, None] * matrix[1]) % p, p)
    return _interpolate([int(v) for v in values], p)


def _determinants(matrices: Ints, p: int) -> Ints:
    """Return the determinants modulo p of matrices (k, n, n), all at once."""
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
        pivots = rows[:, k].tolist()
        inverse = np.array([pow(v, -1, p) if v else 0 for v in pivots], dtype=np.int64)
        factor = work[:, k + 1 :, k] * inverse[:, None] % p
        busy = np.flatnonzero(factor.any(axis=0))
        if len(busy):
            # columns in which the pivot row is 0 stay as they are
            columns = k + 1 + np.flatnonzero(rows[:, k + 1 :].any(axis=0))
            block = np.ix_(each, k + 1 + busy, columns)
            change = factor[:, busy, None] * rows[:, None, columns] % p
            work[block] = (work[block] - change) % p
    return result % p


def _interpolate(values: list[int], p: int) -> list[int]:
    """Return the coefficients modulo p of the polynomial with these values at 0, 1, ... (Newton)."""
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
    """Combine remainders into the integers of smallest size (Chinese remainder theorem)."""
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
    """Return whether n is prime: Miller-Rabin with bases 2, 3, 5, 7, exact below 3.2e9 (Jaeschke 1993)."""
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


# The Jones polynomial of a diagram, exactly: the Kauffman bracket, crossing by crossing.

MOST_STATES = 2000  # ways of joining the open arcs; more would take many seconds
STARTS = 8  # starting crossings that are tried for a good order

# The smoothings of a crossing (a, b, c, d): which of its four sides are joined.
A_SMOOTHING, B_SMOOTHING = (1, 0, 3, 2), (3, 2, 1, 0)


def jones_polynomial(diagram: PlanarDiagram) -> Laurent | None:
    """Return V(t) with the exponents of t doubled: 2 stands for t, 1 for its square root.

    It is 1 for the unknot, t + t^3 - t^4 for the right-handed trefoil; exponents are odd for an even
    number of components. None if it would take too long.
    """
    bracket = _bracket(diagram)
    if bracket is None:
        return None
    # `bracket` counts every loop: it is A^5 too large for each crossing, and A^2 for each free loop
    rest = _over_loop(bracket)
    power = 2 - 5 * len(diagram.crossings) - 2 * len(diagram.loops) - 3 * diagram.writhe
    sign = -1 if diagram.writhe % 2 else 1
    # A^2 = x, and t = A^-4: x^k A^power is t to the half of -(k + power / 2)
    value = Laurent(rest.lowest + power // 2, tuple(sign * c for c in rest.coefficients))
    return value.reverse()


def _bracket(diagram: PlanarDiagram) -> Laurent | None:
    """Sum the states of Kauffman's bracket, in x = A^2.

    A smoothing contributes x or 1, a crossing that closes k loops (-x^2 - 1)^k x^(2 - k), and a free loop
    -x^2 - 1.
    """
    count = len(diagram.crossings)
    # the coefficients' absolute values sum to at most 2^crossings states of 2^loops each
    bits = 2 * count + len(diagram.loops) + 4
    factors = _loop_factors(bits)
    states: dict[tuple[int, ...], int] = {(): 1}
    frontier: tuple[int, ...] = ()
    for i in _order_crossings(diagram):
        quad = diagram.crossings[i]
        inside = [arc for arc in frontier if arc not in quad]
        new = [arc for arc in quad if arc not in frontier and quad.count(arc) == 1]
        after = tuple(inside + new)
        place = {arc: k for k, arc in enumerate(after)}
        sums: dict[tuple[int, ...], int] = {}
        for joins, value in states.items():
            mate = dict(zip(frontier, joins, strict=True))
            outside = [_follow_strand(quad, side, mate) for side in range(4)]
            kept = [mate.get(arc, arc) for arc in after]
            for smoothing, weight in ((A_SMOOTHING, value << bits), (B_SMOOTHING, value)):
                joined = list(kept)
                loops = _join_arcs(smoothing, outside, joined, place)
                key = tuple(joined)
                times = sum(sign * (weight << shift) for sign, shift in factors[loops])
                sums[key] = sums.get(key, 0) + times
        states, frontier = sums, after
        if len(states) > MOST_STATES:
            return None
    (total,) = states.values()
    for _ in diagram.loops:
        total = -(total << 2 * bits) - total
    return _digits(total, bits)


def _follow_strand(quad: tuple[int, ...], side: int, mate: dict[int, int]) -> tuple[bool, int]:
    """Follow a strand that leaves a crossing by a side to its end.

    Returns (True, the crossing's side) or (False, an open arc).
    """
    arc = quad[side]
    if arc in mate:
        end = mate[arc]
        return (True, quad.index(end)) if end in quad else (False, end)
    if quad.count(arc) == 2:
        return True, next(k for k in range(4) if k != side and quad[k] == arc)
    return False, arc


def _join_arcs(
    smoothing: tuple[int, ...],
    outside: list[tuple[bool, int]],
    joined: list[int],
    place: dict[int, int],
) -> int:
    """Join the open arcs through a smoothed crossing, in `joined`; return the number of loops closed."""
    seen = [False] * 4
    for start in range(4):
        inner, first = outside[start]
        if inner or seen[start]:
            continue
        here = start
        while True:
            seen[here] = True
            here = smoothing[here]
            seen[here] = True
            inner, last = outside[here]
            if not inner:
                break
            here = last
        joined[place[first]], joined[place[last]] = last, first
    loops = 0
    for start in range(4):
        here = start
        if not seen[here]:
            loops += 1
        while not seen[here]:
            seen[here] = seen[smoothing[here]] = True
            here = outside[smoothing[here]][1]
    return loops


def _loop_factors(bits: int) -> tuple[tuple[tuple[int, int], ...], ...]:
    """Return the terms of (-x^2 - 1)^k x^(2 - k) for k = 0, 1, 2 loops, as (sign, shift)."""
    return (
        ((1, 2 * bits),),
        ((-1, 3 * bits), (-1, bits)),
        ((1, 4 * bits), (1, 2 * bits), (1, 2 * bits), (1, 0)),
    )


def _digits(value: int, bits: int) -> Laurent:
    """Recover a polynomial's coefficients, of either sign, from its value at 2^bits."""
    base, half = 1 << bits, 1 << (bits - 1)
    coefficients = []
    while value:
        digit = value & (base - 1)
        if digit >= half:
            digit -= base
        coefficients.append(digit)
        value = (value - digit) >> bits
    return laurent(0, coefficients)


def _over_loop(polynomial: Laurent) -> Laurent:
    """Divide a polynomial by -x^2 - 1, which leaves no remainder."""
    rest = list(polynomial.coefficients)
    quotient = [0] * max(len(rest) - 2, 0)
    for k in range(len(rest) - 1, 1, -1):
        quotient[k - 2] = -rest[k]
        rest[k - 2] -= rest[k]
    return laurent(polynomial.lowest, quotient)


def _order_crossings(diagram: PlanarDiagram) -> list[int]:
    """Order the crossings greedily so that few arcs are open at any time, from several starts."""
    count = len(diagram.crossings)
    best: tuple[int, list[int]] | None = None
    for start in range(0, count, max(1, count // STARTS)):
        order, width = _order_from(diagram, start)
        if best is None or width < best[0]:
            best = width, order
    return best[1] if best else []


def _order_from(diagram: PlanarDiagram, start: int) -> tuple[list[int], int]:
    open_arcs: set[int] = set()
    left = set(range(len(diagram.crossings)))
    order: list[int] = []
    cost = 0
    here: int | None = start
    while left:
        if here is None:
            here = min(left, key=lambda i: (-sum(a in open_arcs for a in diagram.crossings[i]), i))
        left.remove(here)
        order.append(here)
        for arc in diagram.crossings[here]:
            open_arcs ^= {arc}
        cost += 2 ** len(open_arcs)  # the number of states grows like this
        here = None
    return order, cost
