"""Closed curves (n, 3), mm: knots and links of known type, and polygons of exactly known thickness."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.tube.thickness import thickness


def _angles(n: int) -> Array:
    return 2 * np.pi * np.arange(n) / n


def circle(radius: float = 30.0, n: int = 96) -> Array:
    """A round circle in the plane z = 0."""
    return ellipse(radius, radius, n)


def ellipse(a: float, b: float, n: int = 96) -> Array:
    """An ellipse of half axes a (x) and b (y) in the plane z = 0."""
    t = _angles(n)
    return np.column_stack([a * np.cos(t), b * np.sin(t), np.zeros(n)])


def wavy(
    radius: float = 30.0, waves: int = 5, wide: float = 6.0, high: float = 6.0, n: int = 160
) -> Array:
    """An unknot whose distance from the z axis and height swing `waves` times; simple from above."""
    t = _angles(n)
    r = radius + wide * np.cos(waves * t)
    return np.column_stack([r * np.cos(t), r * np.sin(t), high * np.sin(waves * t)])


def stadium(length: float, apart: float, n: int = 24) -> Array:
    """Two straight strands along x, `apart` between their centre lines, joined by half circles."""
    half = np.pi * (np.arange(n + 1) / n - 0.5)
    end = apart / 2 * np.column_stack([np.cos(half), np.sin(half), 0 * half])
    shift = np.array([length / 2, 0.0, 0.0])
    steps = (np.arange(1, n) / n - 0.5)[:, None] * np.array([length, 0.0, 0.0])
    side = np.array([0.0, apart / 2, 0.0])
    return np.concatenate([end + shift, side - steps, -end - shift, steps - side])


def torus_knot(p: int, q: int, major: float = 24.0, minor: float = 10.0, n: int = 200) -> Array:
    """Torus knot: p times round the z axis, q times round the ring; right-handed for p, q > 0."""
    t = _angles(n)
    r = major + minor * np.cos(q * t)
    return np.column_stack([r * np.cos(p * t), r * np.sin(p * t), -minor * np.sin(q * t)])


def figure_eight(scale: float = 11.0, n: int = 200) -> Array:
    """The knot 4_1."""
    t = _angles(n)
    r = 2 + np.cos(2 * t)
    points: Array = np.column_stack([r * np.cos(3 * t), r * np.sin(3 * t), np.sin(4 * t)])
    return points * scale


def lissajous(
    x: int, y: int, z: int, phase_x: float, phase_y: float, scale: float = 36.0, n: int = 480
) -> Array:
    """A Lissajous knot: one cosine for each axis (Bogle et al., "Lissajous knots", 1994).

    (3, 2, 7, 0.7, 0.2) is 5_2 and (3, 2, 5, 1.5, 0.2) is 6_1.
    """
    t = _angles(n)
    axes = [np.cos(x * t + phase_x), np.cos(y * t + phase_y), np.cos(z * t)]
    points: Array = scale * np.column_stack(axes)
    return points


def granny(scale: float = 0.22, n: int = 260) -> Array:
    """The sum of two trefoils of one handedness."""
    t = _angles(n)
    x = -22 * np.cos(t) - 128 * np.sin(t) - 44 * np.cos(3 * t) - 78 * np.sin(3 * t)
    y = -10 * np.cos(2 * t) - 27 * np.sin(2 * t) + 38 * np.cos(4 * t) + 46 * np.sin(4 * t)
    z = 70 * np.cos(3 * t) - 40 * np.sin(3 * t)
    return scale * np.column_stack([x, y, z])


def square(scale: float = 0.22, n: int = 300) -> Array:
    """The sum of a left and a right trefoil."""
    t = _angles(n)
    x = 11 * np.cos(t) - 43 * np.cos(3 * t) + 34 * np.cos(5 * t) - 39 * np.sin(5 * t)
    y = -22 * np.cos(t) - 128 * np.sin(t) - 44 * np.cos(3 * t) - 78 * np.sin(3 * t)
    z = 70 * np.cos(3 * t) - 40 * np.sin(3 * t) + 8 * np.cos(5 * t) - 9 * np.sin(5 * t)
    return scale * np.column_stack([x, y, z])


def hopf(radius: float = 24.0, n: int = 96) -> tuple[Array, Array]:
    """Two round circles, each through the middle of the other."""
    one = circle(radius, n)
    return one, one[:, [0, 2, 1]] + np.array([radius, 0.0, 0.0])


def whitehead(n: int = 160) -> tuple[Array, Array]:
    """The Whitehead link: linking number 0, but it does not come apart.

    A lemniscate crosses itself once and an ellipse four times, over and under in turn.
    """
    t = _angles(n)
    bow = [30 * np.cos(t) + 10 * np.cos(3 * t), 14 * np.sin(2 * t), -6 * np.sin(3 * t)]
    return ellipse(28.0, 32.6, 96), np.column_stack(bow)


def borromean(a: float = 32.0, b: float = 16.0, n: int = 96) -> tuple[Array, Array, Array]:
    """Three ellipses at right angles: no two are linked, all three are."""
    flat = ellipse(a, b, n)
    return flat, flat[:, [2, 0, 1]], flat[:, [1, 2, 0]]


def mirror(curve: Array) -> Array:
    """The curve seen in a mirror: z turned round."""
    turned: Array = curve * np.array([1.0, 1.0, -1.0])
    return turned


def bulge(curve: Array, at: int, by: Array, width: float) -> Array:
    """The curve moved by `by` (3,) at vertex `at`, by a Gaussian of `width` vertices about it."""
    n = len(curve)
    off = (np.arange(n) - at + n // 2) % n - n // 2
    moved: Array = curve + np.exp(-((off / width) ** 2))[:, None] * by
    return moved


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
