"""Hard centre lines: links and knots of few, long edges, touching strands, tubes at their bending limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import pi

import numpy as np

from knotfab.base.arrays import Array


@dataclass(frozen=True)
class HardKnot:
    """Closed polygons whose type a step could change; `why` that is easy here."""

    name: str
    why: str
    make: Callable[[], list[Array]]


def hard_knots() -> tuple[HardKnot, ...]:
    """Return all of them, in one order."""
    return (
        HardKnot("trefoil", "12 long edges that pass each other closely", partial(_one, 2, 3, 12)),
        HardKnot("T(2,5)", "20 edges, five crossings", partial(_one, 2, 5, 20)),
        HardKnot(
            "Hopf link",
            "two hexagons through each other: one pass frees them",
            partial(hopf_link, 6),
        ),
        HardKnot("free rings", "two rings side by side: one pass links them", _apart),
        HardKnot("touching", "two rings a millionth apart", _touching),
        HardKnot("hairpin", "an unknot folded on itself: kinks may cross, or fold back", _hairpin),
    )


def circle(count: int, radius: float = 1.0) -> Array:
    """Return [count] a regular polygon in the plane z = 0."""
    s = 2 * pi * np.arange(count) / count
    return radius * np.stack([np.cos(s), np.sin(s), 0 * s], 1)


def torus_knot(p: int, q: int, count: int) -> Array:
    """Return [count, 3] T(p, q) about the z axis."""
    s = 2 * pi * np.arange(count) / count
    r = 2 + np.cos(q * s)
    return np.stack([r * np.cos(p * s), r * np.sin(p * s), np.sin(q * s)], 1)


def _one(p: int, q: int, count: int) -> list[Array]:
    return [torus_knot(p, q, count)]


def hopf_link(count: int) -> list[Array]:
    """Return two polygons [count, 3], each through the other."""
    ring = circle(count)
    return [ring, ring[:, [0, 2, 1]] + (1.0, 0.05, 0.03)]


def _apart() -> list[Array]:
    return [circle(7), circle(8) + (2.3, 0.0, 0.1)]


def _touching() -> list[Array]:
    return [circle(10), circle(10) + (0.0, 0.0, 1e-6)]


def _hairpin() -> list[Array]:
    s = np.linspace(0, 4, 9)
    there = np.stack([s, 0.05 * np.sin(3 * s), 0 * s], 1)
    return [np.concatenate([there, there[::-1] + (0.0, 0.0, 0.05)])]
