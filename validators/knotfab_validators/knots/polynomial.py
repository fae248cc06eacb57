"""Laurent polynomials in one variable with whole coefficients, exact however large."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

__all__ = ["Laurent", "laurent"]


@dataclass(frozen=True)
class Laurent:
    """Sum of coefficients[k] * t ** (lowest + k); use `laurent` to make one without zeros at the ends."""

    lowest: int
    coefficients: tuple[int, ...]

    @property
    def highest(self) -> int:
        """The largest exponent (-1 below the lowest for 0)."""
        return self.lowest + len(self.coefficients) - 1

    def __bool__(self) -> bool:
        return bool(self.coefficients)

    def __mul__(self, other: Laurent) -> Laurent:
        if not self or not other:
            return Laurent(0, ())
        product = [0] * (len(self.coefficients) + len(other.coefficients) - 1)
        for i, a in enumerate(self.coefficients):
            for j, b in enumerate(other.coefficients):
                product[i + j] += a * b
        return laurent(self.lowest + other.lowest, product)

    def reverse(self) -> Laurent:
        """Return the polynomial with 1/t for t."""
        return Laurent(-self.highest if self else 0, self.coefficients[::-1])

    def shift(self, by: int) -> Laurent:
        """Multiply by t ** by."""
        return Laurent(self.lowest + by if self else 0, self.coefficients)

    def negate(self) -> Laurent:
        """Multiply by -1."""
        return Laurent(self.lowest, tuple(-c for c in self.coefficients))

    def at_minus_one(self) -> int:
        """Return the value at t = -1."""
        value = sum(c if k % 2 == 0 else -c for k, c in enumerate(self.coefficients))
        return -value if self.lowest % 2 else value

    def at_one(self) -> int:
        """Return the value at t = 1."""
        return sum(self.coefficients)

    def text(self, variable: str = "t", half: bool = False) -> str:
        """Write it for people, highest power first; `half`: exponents count half powers."""
        terms = []
        for k in range(len(self.coefficients) - 1, -1, -1):
            c, power = self.coefficients[k], self.lowest + k
            if not c:
                continue
            size = "" if abs(c) == 1 and power else str(abs(c))
            if half:
                exponent = str(power // 2) if power % 2 == 0 else f"({power}/2)"
            else:
                exponent = str(power)
            factor = "" if not power else variable if exponent == "1" else f"{variable}^{exponent}"
            terms.append(("-" if c < 0 else "+") + size + factor)
        joined = " ".join(f"{term[0]} {term[1:]}" for term in terms)
        return (
            joined.removeprefix("+ ").replace("- ", "-", 1)
            if joined[:1] == "-"
            else joined[2:] or "0"
        )


def laurent(lowest: int, coefficients: Iterable[int]) -> Laurent:
    """Return the polynomial with the zeros at both ends taken off."""
    kept = list(coefficients)
    while kept and not kept[-1]:
        kept.pop()
    start = 0
    while start < len(kept) and not kept[start]:
        start += 1
    return Laurent(lowest + start, tuple(kept[start:])) if kept else Laurent(0, ())
