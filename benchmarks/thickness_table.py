"""Thickness against exact values, and what it costs: rows of tables.

`python -m benchmarks.thickness_table` prints them.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.tube.thickness import thickness
from tests.corpus.curves import circle, racetrack, thickness_rows, tilt, torus_curve


@dataclass(frozen=True)
class CostRow:
    """Seconds for many vertices."""

    name: str
    vertices: int
    value: float
    seconds: float

    @property
    def holds(self) -> bool:
        return self.seconds < 10.0


def cost_rows(n: int = 10_000) -> list[CostRow]:
    """Return seconds for n vertices of every kind, and for ten times as many of a smooth knot."""
    rng = np.random.default_rng(0)
    t = 2 * np.pi * np.arange(n) / n
    strands = np.concatenate([racetrack(900.0, 1.0 + k, 25) for k in range(n // 50)])
    k = np.arange(n)
    rods = np.stack([(k // 2 + k) % 2 * 1000.0, k // 2 % 70 * 1.0, k // 140 * 1.0], axis=1)
    unit = np.concatenate([np.eye(3), -np.eye(3)])
    long = 2 * np.pi * np.arange(10 * n) / (10 * n)
    kinds: dict[str, list[Array]] = {
        "tight torus knot 40, 41": [torus_curve(40, 41, 50.0, 20.0)(t)],
        "circle": [circle(50.0, n)],
        "Gaussian points": [rng.normal(size=(n, 3))],
        "Gaussian walk": [rng.normal(size=(n, 3)).cumsum(axis=0)],
        "lattice walk": [np.cumsum(unit[rng.integers(0, 6, n)], axis=0)],
        "bundle of parallel rods": tilt(rods),
        "nested racetracks": [p for p in np.split(strands, n // 50)],
        "100 rings stacked": [circle(50.0, n // 100) + [0, 0, k] for k in range(100)],
        "torus knot 5, 6": [torus_curve(5, 6, 50.0, 20.0)(long)],
    }
    rows = []
    for name, polygons in kinds.items():
        begun = time.perf_counter()
        value = thickness(polygons).value
        rows.append(CostRow(name, sum(map(len, polygons)), value, time.perf_counter() - begun))
    return rows


def main() -> int:
    """Print both tables; 1 unless every row holds."""
    exact, costs = thickness_rows(), cost_rows()
    print(f"{'thickness of the polygon':<34} vertices           exact  relative error")
    for row in exact:
        print(
            f"{row.name:<34} {row.vertices:>8} {row.exact:>15.12f}  {row.relative_error:14.1e}"
            f"  {'' if row.holds else 'NOT REACHED'}"
        )
    print(f"\n{'cost':<34} vertices  thickness  seconds")
    for cost in costs:
        print(
            f"{cost.name:<34} {cost.vertices:>8}  {cost.value:9.4g}  {cost.seconds:7.2f}"
            f"  {'' if cost.holds else 'NOT REACHED'}"
        )
    return int(not all(row.holds for row in (*exact, *costs)))


if __name__ == "__main__":
    raise SystemExit(main())
