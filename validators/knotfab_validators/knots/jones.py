"""Jones polynomial of a diagram, exactly: the Kauffman bracket, one crossing after another.

Kauffman, "State models and the Jones polynomial", Topology 26, 1987. The crossings are taken in an
order that keeps few arcs open; for each way in which the open arcs are joined in pairs there is one
polynomial (Bar-Natan, "Fast Khovanov homology computations", 2007, has the scan). It is held as one
whole number, its value at a large power of two, from which the coefficients can be read off again.
"""

from __future__ import annotations

from knotfab_validators.knots.planar_diagram import PlanarDiagram
from knotfab_validators.knots.polynomial import Laurent, laurent

__all__ = ["jones_polynomial"]

MOST_STATES = 2000  # ways of joining the open arcs; more would take many seconds
STARTS = 8  # crossings that the order is begun from, to find a good one

# Smoothings of a crossing (a, b, c, d): which of its four sides are joined to which.
A_SMOOTHING, B_SMOOTHING = (1, 0, 3, 2), (3, 2, 1, 0)


def jones_polynomial(diagram: PlanarDiagram) -> Laurent | None:
    """Return V(t) with the exponents of t doubled: 2 stands for t, 1 for its square root.

    1 for the unknot, t + t^3 - t^4 for the right-handed trefoil; exponents are odd for an even
    number of components. None where it would take too long.
    """
    bracket = _bracket(diagram)
    if bracket is None:
        return None
    # `bracket` counts every loop, and is A^5 too large for each crossing, A^2 for each free loop
    rest = _over_loop(bracket)
    power = 2 - 5 * len(diagram.crossings) - 2 * len(diagram.loops) - 3 * diagram.writhe
    sign = -1 if diagram.writhe % 2 else 1
    # A^2 = x, and t = A^-4: x^k A^power is t to the half of -(k + power / 2)
    value = Laurent(rest.lowest + power // 2, tuple(sign * c for c in rest.coefficients))
    return value.reverse()


def _bracket(diagram: PlanarDiagram) -> Laurent | None:
    """Sum the states in x = A^2: a smoothing gives x or 1, a crossing that closes k loops (-x^2 - 1)^k x^(2 -
    k), a free loop -x^2 - 1."""
    count = len(diagram.crossings)
    # the sum of all coefficients' sizes is at most 2^crossings states of 2^loops each
    bits = 2 * count + len(diagram.loops) + 4
    factors = _loop_factors(bits)
    states: dict[tuple[int, ...], int] = {(): 1}
    frontier: tuple[int, ...] = ()
    for i in _order(diagram):
        quad = diagram.crossings[i]
        inside = [arc for arc in frontier if arc not in quad]
        new = [arc for arc in quad if arc not in frontier and quad.count(arc) == 1]
        after = tuple(inside + new)
        place = {arc: k for k, arc in enumerate(after)}
        sums: dict[tuple[int, ...], int] = {}
        for joins, value in states.items():
            mate = dict(zip(frontier, joins, strict=True))
            outside = [_outside(quad, side, mate) for side in range(4)]
            kept = [mate.get(arc, arc) for arc in after]
            for smoothing, weight in ((A_SMOOTHING, value << bits), (B_SMOOTHING, value)):
                joined = list(kept)
                loops = _connect(smoothing, outside, joined, place)
                key = tuple(joined)
                sums[key] = sums.get(key, 0) + _times(weight, factors[loops])
        states, frontier = sums, after
        if len(states) > MOST_STATES:
            return None
    (total,) = states.values()
    for _ in diagram.loops:
        total = -(total << 2 * bits) - total
    return _digits(total, bits)


def _outside(quad: tuple[int, ...], side: int, mate: dict[int, int]) -> tuple[bool, int]:
    """Find the end of a strand that leaves a crossing by a side: (True, a crossing's side) or (False, an open
    arc)."""
    arc = quad[side]
    if arc in mate:
        end = mate[arc]
        return (True, quad.index(end)) if end in quad else (False, end)
    if quad.count(arc) == 2:
        return True, next(k for k in range(4) if k != side and quad[k] == arc)
    return False, arc


def _connect(
    smoothing: tuple[int, ...],
    outside: list[tuple[bool, int]],
    joined: list[int],
    place: dict[int, int],
) -> int:
    """Join the open arcs through a smoothed crossing, in `joined`; the number of loops closed."""
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
    """Return (sign, shift) of the terms of (-x^2 - 1)^k x^(2 - k) for k = 0, 1, 2 loops."""
    return (
        ((1, 2 * bits),),
        ((-1, 3 * bits), (-1, bits)),
        ((1, 4 * bits), (1, 2 * bits), (1, 2 * bits), (1, 0)),
    )


def _times(value: int, terms: tuple[tuple[int, int], ...]) -> int:
    return sum(sign * (value << shift) for sign, shift in terms)


def _digits(value: int, bits: int) -> Laurent:
    """Return the coefficients, of either sign, of a polynomial from its value at 2^bits."""
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
    """Divide a polynomial by -x^2 - 1, which leaves nothing."""
    rest = list(polynomial.coefficients)
    quotient = [0] * max(len(rest) - 2, 0)
    for k in range(len(rest) - 1, 1, -1):
        quotient[k - 2] = -rest[k]
        rest[k - 2] -= rest[k]
    return laurent(polynomial.lowest, quotient)


def _order(diagram: PlanarDiagram) -> list[int]:
    """Return crossings so that few arcs are open at any time: greedily, from several beginnings."""
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
        cost += 2 ** len(open_arcs)  # the number of states grows so
        here = None
    return order, cost
