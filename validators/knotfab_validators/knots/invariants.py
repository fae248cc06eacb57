"""Invariants of a knot's diagram: its Alexander and Jones polynomials, signature, Floer homology.

None of them depends on how the knot lies; Jones polynomial, signature and Floer homology tell most
knots from their mirror images.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from knotfab_formats.libraries import took_part
from knotfab_validators.knots.alexander import alexander_polynomial, jones_polynomial
from knotfab_validators.knots.planar_diagram import Laurent, PlanarDiagram, faces, laurent, simplify

# Knot Floer homology of a diagram, by Ozsváth and Szabó's program: a second opinion that can prove.


# The program cannot be stopped. Within these limits hundreds of random diagrams took 1 s at most; beyond
# them some took minutes.
MOST_CROSSINGS, MOST_RANK = 26, 2000
MOST_OF_UNKNOT = 32  # crossings, if the Alexander polynomial is 1


@dataclass(frozen=True)
class Floer:
    """Ranks over the field of two elements: (Alexander grading, Maslov grading) -> rank, sorted."""

    ranks: tuple[tuple[tuple[int, int], int], ...]

    @property
    def genus(self) -> int:
        """The least genus of a surface that the knot bounds."""
        return max(alexander for (alexander, _), _ in self.ranks)

    @property
    def total(self) -> int:
        """The total rank."""
        return sum(rank for _, rank in self.ranks)

    @property
    def fibred(self) -> bool:
        """True if the knot is fibred: rank 1 on top."""
        return sum(rank for (a, _), rank in self.ranks if a == self.genus) == 1

    def euler(self) -> Laurent:
        """Return the alternating sum of the ranks, which is the Alexander polynomial."""
        genus = self.genus
        sums = [0] * (2 * genus + 1)
        for (alexander, maslov), rank in self.ranks:
            sums[alexander + genus] += -rank if maslov % 2 else rank
        return laurent(-genus, sums)

    @property
    def symmetric(self) -> bool:
        """True if rank(a, m) = rank(-a, m - 2a), as it must be."""
        ranks = dict(self.ranks)
        return all(ranks.get((-a, m - 2 * a)) == rank for (a, m), rank in self.ranks)

    def mirror(self) -> Floer:
        """Return the homology of the mirror image."""
        return Floer(tuple(sorted(((-a, -m), rank) for (a, m), rank in self.ranks)))

    def __mul__(self, other: Floer) -> Floer:
        """Return the homology of the sum of two knots."""
        sums: dict[tuple[int, int], int] = {}
        for (a, m), rank in self.ranks:
            for (b, n), more in other.ranks:
                sums[a + b, m + n] = sums.get((a + b, m + n), 0) + rank * more
        return Floer(tuple(sorted(sums.items())))


def floer_homology(diagram: PlanarDiagram, alexander: Laurent) -> Floer | None:
    """Compute the homology of a knot's simplified diagram (`planar_diagram.simplify`), or return None.

    None means that there are too many crossings, that a rank is too large (the Alexander polynomial's
    coefficients are lower bounds), or that the program is not installed or refuses. The program errs on
    diagrams that fall in two at a crossing, which simplified ones do not.
    """
    if not diagram.crossings:
        return Floer((((0, 0), 1),))
    least = sum(map(abs, alexander.coefficients))
    most = MOST_OF_UNKNOT if least == 1 else MOST_CROSSINGS
    small = len(diagram.crossings) <= most and least <= MOST_RANK
    if not small or len(diagram.components) != 1:
        return None
    try:
        from knot_floer_homology import pd_to_hfk

        took_part("knot_floer_homology", "proved the knots' types")
        found = pd_to_hfk([list(quad) for quad in diagram.crossings])
        ranks = tuple(sorted(((int(a), int(m)), int(r)) for (a, m), r in found["ranks"].items()))
    except (ImportError, ValueError, KeyError, RuntimeError):
        return None
    return Floer(ranks) if ranks else None


class Disagreement(Exception):
    """Two ways of computing one number disagree, so neither can be trusted."""


@dataclass(frozen=True)
class Invariants:
    """Invariants of a knot; `jones` (exponents of t doubled) and `floer` are None where unavailable."""

    alexander: Laurent
    signature: int
    jones: Laurent | None
    floer: Floer | None

    def mirror(self) -> Invariants:
        """Return the invariants of the mirror image."""
        return Invariants(
            self.alexander,
            -self.signature,
            self.jones.reverse() if self.jones is not None else None,
            self.floer.mirror() if self.floer is not None else None,
        )

    def __mul__(self, other: Invariants) -> Invariants:
        """Return the invariants of the sum of two knots."""
        both_jones = self.jones is not None and other.jones is not None
        both_floer = self.floer is not None and other.floer is not None
        return Invariants(
            self.alexander * other.alexander,
            self.signature + other.signature,
            self.jones * other.jones if both_jones else None,  # type: ignore[operator]
            self.floer * other.floer if both_floer else None,  # type: ignore[operator]
        )

    def fits(self, other: Invariants) -> bool:
        """Return whether all invariants known of both agree, so that they may be one knot."""
        return (
            (self.alexander, self.signature) == (other.alexander, other.signature)
            and (None in (self.jones, other.jones) or self.jones == other.jones)
            and (None in (self.floer, other.floer) or self.floer == other.floer)
        )

    @cached_property
    def hand(self) -> int:
        """1 right-handed, -1 left-handed, 0 if no invariant tells it from its mirror image.

        A knot is right-handed if its Jones polynomial reaches farther into the positive powers, as
        that of the right-handed trefoil does, t + t^3 - t^4. If it reaches equally far both ways,
        the signature must be negative. If that is 0, the first coefficients that differ, from
        outside in, must be larger among the positive powers.
        """
        if self.jones is not None:
            reach = self.jones.lowest + self.jones.highest
            if reach:
                return 1 if reach > 0 else -1
            if not self.signature:
                for low, high in self._ends(self.jones):
                    if low != high:
                        return 1 if high > low else -1
        return (self.signature < 0) - (self.signature > 0)

    @staticmethod
    def _ends(jones: Laurent) -> list[tuple[int, int]]:
        return list(zip(jones.coefficients, jones.coefficients[::-1], strict=True))

    @property
    def determinant(self) -> int:
        """|Δ(-1)|."""
        return abs(self.alexander.at_minus_one())


UNKNOT = Invariants(Laurent(0, (1,)), 0, Laurent(0, (1,)), Floer((((0, 0), 1),)))


def invariants(diagram: PlanarDiagram) -> Invariants:
    """Compute all invariants of a knot's diagram, which may have some 60 crossings once simplified.

    Raises:
        Disagreement: the Alexander polynomial is not what Floer homology or Goeritz' matrix say.
    """
    diagram = simplify(diagram)
    alexander = alexander_polynomial(diagram)
    determinant, signature = determinant_and_signature(diagram)
    if abs(alexander.at_minus_one()) != determinant:
        raise Disagreement(
            f"the determinant is {abs(alexander.at_minus_one())} by the Alexander polynomial and "
            f"{determinant} by Goeritz' matrix"
        )
    floer = floer_homology(diagram, alexander)
    if floer is not None and floer.euler() != alexander:
        raise Disagreement(
            f"the Alexander polynomial is {alexander.text()}, and {floer.euler().text()} by Floer "
            "homology"
        )
    if floer is not None and not floer.symmetric:
        raise Disagreement("Floer homology is not symmetric")
    return Invariants(alexander, signature, jones_polynomial(diagram), floer)


# Signature and determinant of a knot's diagram, from its checkerboard colouring.

Corner = tuple[int, int]  # (crossing, side): the face between that side and the next


def determinant_and_signature(diagram: PlanarDiagram) -> tuple[int, int]:
    """Return the determinant and signature of a knot's diagram: (3, -2) for the right-handed trefoil."""
    if not diagram.crossings:
        return 1, 0
    face = faces(diagram)
    # faces that meet across an arc differ in colour: sides 0 and 2 of a crossing are alike
    shaded = _colour(diagram, face)
    number = {f: k for k, f in enumerate(sorted({f for f in face.values() if not shaded[f]}))}
    size = len(number)
    matrix = [[0] * size for _ in range(size)]
    correction = 0
    for i, sign in enumerate(diagram.signs):
        # the unshaded regions lie at corners `k` and `k + 2`
        k = 0 if not shaded[face[i, 0]] else 1
        one, other = number[face[i, k]], number[face[i, k + 2]]
        # turning the upper strand counter-clockwise sweeps corners 1 and 3, which are shaded if k = 0
        eta = 1 if k == 0 else -1
        if one != other:
            for p, q in ((one, other), (other, one)):
                matrix[p][q] -= eta
                matrix[p][p] += eta
        # the shaded surface's half twist does not follow the knot's orientation there
        if (sign > 0) == (eta > 0):
            correction += eta
    return _inertia([row[1:] for row in matrix[1:]], correction)


def _inertia(matrix: list[list[int]], correction: int) -> tuple[int, int]:
    """Return |det|, and the signature less the correction, by exact symmetric elimination."""
    rows = [[Fraction(x) for x in row] for row in matrix]
    size, determinant, signature = len(rows), Fraction(1), 0
    for k in range(size):
        if not rows[k][k]:
            _make_pivot(rows, k)
        pivot = rows[k][k]
        if not pivot:
            return 0, 0
        determinant *= pivot
        signature += 1 if pivot > 0 else -1
        for i in range(k + 1, size):
            if rows[i][k]:
                factor = rows[i][k] / pivot
                rows[i] = [x - factor * y for x, y in zip(rows[i], rows[k], strict=True)]
    return abs(int(determinant)), signature - correction


def _make_pivot(rows: list[list[Fraction]], k: int) -> None:
    """Change the basis of a symmetric matrix so that its entry (k, k) is not 0, if possible."""
    for j in range(k + 1, len(rows)):
        if rows[j][j]:
            rows[k], rows[j] = rows[j], rows[k]
            for row in rows:
                row[k], row[j] = row[j], row[k]
            return
    for j in range(k + 1, len(rows)):
        if rows[k][j]:
            rows[k] = [x + y for x, y in zip(rows[k], rows[j], strict=True)]
            for row in rows:
                row[k] += row[j]
            return


def _colour(diagram: PlanarDiagram, face: dict[Corner, int]) -> dict[int, bool]:
    colour = {face[0, 0]: True}
    waiting = [face[0, 0]]
    neighbours: dict[int, set[int]] = {}
    for i in range(len(diagram.crossings)):
        for side in range(4):
            one, other = face[i, side], face[i, (side + 1) % 4]
            neighbours.setdefault(one, set()).add(other)
            neighbours.setdefault(other, set()).add(one)
    while waiting:
        here = waiting.pop()
        for there in neighbours[here]:
            if there not in colour:
                colour[there] = not colour[here]
                waiting.append(there)
    return colour
