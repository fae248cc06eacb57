"""Polygons whose thickness is known exactly."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.tube.thickness import thickness
from tests.corpus.curves import circle

Curve = Callable[[Array], Array]
ALLOWED = 1e-9  # relative, where the value is that of the polygon itself


@dataclass(frozen=True)
class ThicknessRow:
    """One link whose polygonal thickness is known exactly."""

    name: str
    vertices: int
    exact: float
    measured: float

    @property
    def relative_error(self) -> float:
        return abs(self.measured - self.exact) / self.exact

    @property
    def holds(self) -> bool:
        return self.relative_error <= ALLOWED


def tilt(*polygons: Array) -> list[Array]:
    """Turn the points so that no coordinate is a round number."""
    q, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    return [p @ q + [3.1, -7.7, 11.3] for p in polygons]


def _grid_knot(crosses: list[int], circles: list[int]) -> Array:
    """The lattice knot of a grid diagram: rows at height 0, columns at height 1."""
    points, column = [], 0
    while True:
        for row in (crosses[column], circles[column]):
            for height in (0, 1) if row == crosses[column] else (1, 0):
                points.append((column, row, height))
        column = crosses.index(circles[column])
        if column == 0:
            return np.array(points, dtype=np.float64)


def racetrack(straight: float, radius: float, n: int) -> Array:
    """Two half circles of n edges each, circumscribed, so that the gap is 2 `radius` exactly."""
    t = np.pi * (np.arange(n) + 0.5) / n - np.pi / 2
    half = radius / np.cos(np.pi / (2 * n)) * np.column_stack([np.cos(t), np.sin(t), 0 * t])
    shift = np.array([straight / 2, 0, 0])
    return np.concatenate([half + shift, -half - shift])


def thickness_rows() -> list[ThicknessRow]:
    """Regular polygons, stacks, Hopf links, strands at a gap, lattice links: exact polygon values."""
    cases: list[tuple[str, list[Array], float]] = []
    for n in (3, 4, 5, 6, 7, 64, 1001):
        cases.append((f"regular {n}-gon", [circle(1.0, n)], np.cos(np.pi / n)))
    cases.append(("round circle", [circle(1.0, 3000)], np.cos(np.pi / 3000)))
    for n in (5, 6, 100):
        for gap in (0.01, 0.7):
            stack = [circle(1.0, n), circle(1.0, n) + [0, 0, gap]]
            cases.append((f"two {n}-gons stacked at {gap}", stack, gap / 2))
    for n in (8, 64, 1000):  # thickness 1, ropelength 8 pi in the limit
        hopf = [circle(2.0, n), circle(2.0, n)[:, [0, 2, 1]] + [2.0, 0, 0]]
        # the chord joins the edge across and the edges beside a corner in the other polygon's middle
        exact = np.cos(np.pi / n) / np.sqrt(1 + np.sin(np.pi / n) ** 2)
        cases.append((f"tight Hopf link of {n}-gons", hopf, exact))
    for n in (6, 21):
        track = racetrack(50.0, 3.0, n)
        bend = 3.0 * np.sin(np.pi / (2 * n)) / np.cos(np.pi / (2 * n)) / np.tan(np.pi / (2 * n))
        cases.append((f"racetrack, ends of {n} edges", [track], min(bend, 3.0)))
        far = track + [0.123, 0, 1.7]
        cases.append(("two racetracks at a gap of 1.7", [track, far], 0.85))
    square = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    through = np.array([[1.0, 1, -1], [1, 1, 1], [1, 4, 1], [1, 4, -1]])
    cases.append(("lattice Hopf link", [square, through], 0.5))
    trefoil = _grid_knot([0, 1, 2, 3, 4], [2, 3, 4, 0, 1])
    cases.append(("lattice trefoil", [trefoil], 0.5))
    rows = []
    for name, polygons, exact in cases:
        measured = thickness(tilt(*polygons)).value
        rows.append(ThicknessRow(name, sum(map(len, polygons)), float(exact), measured))
    return rows


def torus_curve(p: int, q: int, large: float, small: float) -> Curve:
    """A curve that goes p times round the long way while it goes q times round the tube of radius `small`."""

    def curve(t: Array) -> Array:
        away = large + small * np.cos(q * t)
        return np.stack([away * np.cos(p * t), away * np.sin(p * t), small * np.sin(q * t)], -1)

    return curve
