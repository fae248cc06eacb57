"""Invariants of a knot's diagram: its Alexander and Jones polynomials, signature, Floer homology.

None of them depends on how the knot lies; Jones polynomial, signature and Floer homology tell most
knots from their mirror images.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from knotfab_validators.knots.alexander import alexander_polynomial
from knotfab_validators.knots.floer import Floer, floer_homology
from knotfab_validators.knots.goeritz import determinant_and_signature
from knotfab_validators.knots.jones import jones_polynomial
from knotfab_validators.knots.planar_diagram import PlanarDiagram, simplify
from knotfab_validators.knots.polynomial import Laurent

__all__ = ["UNKNOT", "Disagreement", "Invariants", "invariants"]


class Disagreement(Exception):
    """Two ways to the same number gave different ones: neither is to be believed."""


@dataclass(frozen=True)
class Invariants:
    """Invariants of a knot: `jones` (exponents of t doubled) and `floer`, None where they cannot be had."""

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
        """Tell whether all that is known of both is equal: they may be one knot."""
        return (
            (self.alexander, self.signature) == (other.alexander, other.signature)
            and (None in (self.jones, other.jones) or self.jones == other.jones)
            and (None in (self.floer, other.floer) or self.floer == other.floer)
        )

    @cached_property
    def hand(self) -> int:
        """1 right-handed, -1 left-handed, 0 where none of the invariants tells it from its mirror image.

        Right-handed is where the Jones polynomial reaches farther into the positive powers, as that of
        the right-handed trefoil, t + t^3 - t^4; if it reaches as far on both sides, where the
        signature is negative; and then, where the first coefficient that differs, from outside, is
        larger among the positive powers.
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
    """Return all invariants of a knot's diagram, of some 60 crossings at most once it is simplified.

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
