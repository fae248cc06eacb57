"""Representations of a knot's group in PSL(2, p): they tell knots and hands that polynomials do not.

Meridians go to parabolic elements, and one of them to z -> z + 1; the longitude then goes to z -> z + k.
How many representations there are for each k depends on the knot alone; its mirror image has them for
-k (Riley, "Parabolic representations of knot groups", Proc. London Math. Soc. 24, 1972; Eisermann,
"Knot colouring polynomials", Pacific J. Math. 231, 2007). A parabolic element is I + v w^T with
w = (-v_y, v_x), so an arc's colour is the vector v but for its sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from knotfab_validators.arrays import Ints
from knotfab_validators.knots.planar_diagram import PlanarDiagram

__all__ = ["PRIMES", "cusp_counts"]

PRIMES = (7, 11)  # primes that tell apart the knots of the table with all other invariants equal
MOST_GUESSES = 3  # arcs whose colours are tried out, beside the first

Relation = tuple[int, int, int, int]  # arcs below before and after a crossing, above it; its sign


def cusp_counts(knot: PlanarDiagram, prime: int) -> tuple[int, ...] | None:
    """Count the representations that send the longitude to z -> z + k, for k = 0 to prime - 1.

    None where the diagram asks for too many guesses.
    """
    arcs, relations = _wirtinger(knot)
    guessed = _guesses(max(arcs) + 1, relations, arcs[0])
    if guessed is None:
        return None
    vectors = np.array(
        [(x, y) for x in range(prime) for y in range(prime) if (x, y) <= (-x % prime, -y % prime)]
    )[1:]  # one of each two of opposite signs, without (0, 0)
    tries = np.stack(np.meshgrid(*[np.arange(len(vectors))] * len(guessed), indexing="ij"), -1)
    tries = tries.reshape(-1, len(guessed))
    colours = {arc: vectors[tries[:, k]] for k, arc in enumerate(guessed)}
    colours[arcs[0]] = np.broadcast_to([1, 0], (len(tries), 2))
    for below, after, above, sign in _order(set(colours), relations):
        if after not in colours:
            colours[after] = _turn(colours[below], colours[above], sign, prime)
        else:
            colours[below] = _turn(colours[after], colours[above], -sign, prime)
    fits = np.ones(len(tries), bool)
    for below, after, above, sign in relations:
        met = _turn(colours[below], colours[above], sign, prime)
        same, opposite = ((met - s * colours[after]) % prime == 0 for s in (1, -1))
        fits &= same.all(axis=1) | opposite.all(axis=1)
    ends = _longitude(knot, arcs, {arc: colour[fits] for arc, colour in colours.items()}, prime)
    return tuple(int(n) for n in np.bincount(ends, minlength=prime))


def _wirtinger(knot: PlanarDiagram) -> tuple[list[int], list[Relation]]:
    """Number the strand between two passages below that each arc is of, and list their relations."""
    begins = {quad[2] for quad in knot.crossings}
    numbers = np.cumsum([arc in begins for arc in range(len(knot.component))])
    strand = [int(n) % len(begins) for n in numbers]
    relations = [
        (strand[a], strand[c], strand[b], sign)
        for (a, b, c, _), sign in zip(knot.crossings, knot.signs, strict=True)
    ]
    return strand, relations


def _guesses(count: int, relations: Sequence[Relation], first: int) -> tuple[int, ...] | None:
    """Return the fewest strands whose colours, with that of the first one, give all `count` colours."""
    others = [arc for arc in range(count) if arc != first]
    for size in range(MOST_GUESSES + 1):
        for guessed in combinations(others, size):
            known = {first, *guessed}
            _order(known, relations)
            if len(known) == count:
                return guessed
    return None


def _order(known: set[int], relations: Sequence[Relation]) -> list[Relation]:
    """Return the relations in an order in which each gives one colour more; `known` grows by these."""
    order: list[Relation] = []
    grown = True
    while grown:
        grown = False
        for relation in relations:
            below, after, above, _ = relation
            if above in known and (below in known) != (after in known):
                known |= {below, after}
                order.append(relation)
                grown = True
    return order


def _turn(vectors: Ints, about: Ints, sign: int, prime: int) -> Ints:
    """Return the vectors (n, 2) carried by the parabolic elements of `about`, or by their inverses."""
    area = about[:, 0] * vectors[:, 1] - about[:, 1] * vectors[:, 0]
    return np.asarray((vectors + sign * area[:, None] * about) % prime)


def _longitude(
    knot: PlanarDiagram, strand: list[int], colours: dict[int, Ints], prime: int
) -> Ints:
    """Map the k of z -> z + k that each representation sends the longitude of the first strand to."""
    below = {a: (strand[b], s) for (a, b, _, _), s in zip(knot.crossings, knot.signs, strict=True)}
    first = colours[strand[0]]
    images = [np.broadcast_to(v, first.shape) for v in ([1, 0], [0, 1])]
    for arc in reversed(range(len(knot.component))):
        if arc in below:
            above, sign = below[arc]
            images = [_turn(image, colours[above], -sign, prime) for image in images]
    # the longitude is ((s, s k), (0, s)) with s = 1 or -1, and goes round the knot without twisting
    (s, _), (_, _) = images[0].T, images[1].T
    return np.asarray((images[1][:, 0] * s + knot.writhe) % prime)
