"""Knot Floer homology of a diagram, by Ozsváth and Szabó's program: a second opinion that can prove.

It finds the genus (Ozsváth and Szabó, "Holomorphic disks and genus bounds", Geom. Topol. 8, 2004) and
whether the knot is fibred (Ghiggini, Amer. J. Math. 130, 2008; Ni, Invent. Math. 170, 2007). So rank 1
is the unknot alone, genus 1 with rank 1 on top the trefoils and the figure-eight alone, and the
homology of T(2, 5) belongs to it alone (Farber, Reinoso and Wang, "Fixed-point-free pseudo-Anosovs
and the cinquefoil", 2022).
"""

from __future__ import annotations

from dataclasses import dataclass

from knotfab_validators.knots.planar_diagram import PlanarDiagram
from knotfab_validators.knots.polynomial import Laurent, laurent

__all__ = ["Floer", "floer_homology"]

# The program cannot be stopped. In some hundreds of random diagrams it took 1 s at most within these;
# beyond them some took minutes.
MOST_CROSSINGS, MOST_RANK = 26, 2000
MOST_OF_UNKNOT = 32  # crossings, where the Alexander polynomial is 1


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
        """The rank of all of it."""
        return sum(rank for _, rank in self.ranks)

    @property
    def fibred(self) -> bool:
        """True if the knot is fibred: rank 1 on top."""
        return sum(rank for (a, _), rank in self.ranks if a == self.genus) == 1

    def euler(self) -> Laurent:
        """Return alternating sum of the ranks, which is the Alexander polynomial."""
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
    """Return the homology of a knot's simplified diagram (`planar_diagram.simplify`), or None.

    None means: too many crossings, a rank too large (the coefficients of the Alexander polynomial
    bound it from below), or the program is not installed or refuses. It errs on diagrams that fall
    in two at a crossing, which simplified ones do not.
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

        found = pd_to_hfk([list(quad) for quad in diagram.crossings])
        ranks = tuple(sorted(((int(a), int(m)), int(r)) for (a, m), r in found["ranks"].items()))
    except (ImportError, ValueError, KeyError, RuntimeError):
        return None
    return Floer(ranks) if ranks else None
