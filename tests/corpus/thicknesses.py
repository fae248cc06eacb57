"""Polygons whose thickness is known exactly, and smooth curves whose samples must converge to it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from knotfab_validators.tube.thickness import thickness
from tests.corpus.curves import Array, circle

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


@dataclass(frozen=True)
class ConvergenceRow:
    """A smooth curve of known reach, sampled with `vertices`, and 2, 4, 8 times as many.

    `relative_errors` are the worst of four phases of the samples, since it matters where they lie
    beside the place that decides. `orders`, how many factors of 1/2 each doubling wins, are to come
    to `expected`: 2, since sampling moves edges and chords by the square of the edge; but 1 where a
    bend decides and the edges beside it differ by a share of their length that is of first order
    in it, as they do if the parameter's speed changes there (MinRad takes the shorter for both).
    """

    name: str
    vertices: int
    reach: float
    relative_errors: tuple[float, float, float, float]
    expected: int

    @property
    def orders(self) -> tuple[float, float, float]:
        a, b, c, d = np.log2(self.relative_errors)
        return float(a - b), float(b - c), float(c - d)

    @property
    def holds(self) -> bool:
        return sum(self.orders) / 3 > self.expected - 0.2


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


def _make_oval(t: Array) -> Array:
    """An oval with four times its largest curvature beside where its parameter is fastest."""
    return np.stack([2 * np.cos(t) + 0.3 * np.sin(2 * t), np.sin(t), 0.4 * np.cos(2 * t)], -1)


def _find_reach(curve: Curve) -> float:
    """Find the smooth curve's least radius of curvature, and half its shortest critical chord."""
    from scipy.optimize import minimize, minimize_scalar

    # by the trigonometric polynomial through 256 points, whose derivatives are exact
    s = 2 * np.pi * np.arange(256) / 256
    c = np.fft.rfft(curve(s), axis=0) / 256
    c[1:] *= 2
    k = np.flatnonzero(np.abs(c).max(axis=1) > 1e-13)

    def bends(t: Array) -> Array:
        wave = np.exp(1j * np.multiply.outer(t, k))
        first, second = (((wave * (1j * k) ** d) @ c[k]).real for d in (1, 2))
        across = np.linalg.norm(np.cross(first, second), axis=1)
        radii: Array = np.linalg.norm(first, axis=1) ** 3 / across
        return radii

    def bend(t: float) -> float:
        return float(bends(np.array([t]))[0])

    t = 2 * np.pi * np.arange(2000) / 2000
    at = float(t[np.argmin(bends(t))])
    step = float(t[1])
    found = minimize_scalar(
        bend, bounds=(at - step, at + step), method="bounded", options={"xatol": 1e-12}
    )
    best = float(found.fun)
    n = 2000
    polygon = curve(t)
    rough = thickness([polygon])
    if rough.dcsd_at is not None:
        start = [2 * np.pi * (edge + part) / n for _, edge, part in rough.dcsd_at]

        def square(x: Array) -> float:
            a, b = curve(np.asarray(x))
            return float((a - b) @ (a - b))

        least = minimize(square, start, method="BFGS", options={"gtol": 1e-11})
        best = min(best, float(np.sqrt(least.fun)) / 2)
    return best


def _sample_evenly(curve: Curve, number: Array) -> Array:
    """Samples at equal steps of length, so that `number` (n,) up to n go round once."""
    fine = 2 * np.pi * np.arange(200_001) / 200_000
    length = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(curve(fine), axis=0), axis=1))]
    )
    return curve(np.interp(length[-1] * number / len(number), length, fine))


def convergence_rows() -> list[ConvergenceRow]:
    """Smooth curves sampled 1, 2, 4, 8 times as finely, against their reach."""

    def ellipse(t: Array) -> Array:
        return np.stack([2 * np.cos(t), np.sin(t), 0 * t], axis=-1)

    def unit(t: Array) -> Array:
        return np.stack([np.cos(t), np.sin(t), 0 * t], axis=-1)

    cases: list[tuple[str, Curve, float | None, bool, int]] = [
        ("circle", unit, 1.0, False, 2),
        ("ellipse 2, 1: min(b²/a, b)", ellipse, 0.5, False, 2),
        ("torus knot 2, 3, chord", torus_curve(2, 3, 3.0, 1.2), None, False, 2),
        ("torus knot 3, 2, chord", torus_curve(3, 2, 3.0, 1.0), None, False, 2),
        ("torus knot 2, 5, chord", torus_curve(2, 5, 3.0, 1.0), None, False, 2),
        ("torus curve 1, 6, bend", torus_curve(1, 6, 3.0, 0.5), None, True, 2),
        ("the same, by its parameter", torus_curve(1, 6, 3.0, 0.5), None, False, 1),
        ("skewed oval, even samples", _make_oval, None, True, 2),
        ("skewed oval, by its parameter", _make_oval, None, False, 1),
    ]
    rows = []
    for name, curve, known, even, expected in cases:
        reach = _find_reach(curve) if known is None else known
        base = 240
        errors = []
        for n in (base, 2 * base, 4 * base, 8 * base):
            worst = 0.0
            for phase in (0.0, 0.25, 0.5, 0.75):
                number = np.arange(n, dtype=np.float64) + phase
                polygon = _sample_evenly(curve, number) if even else curve(2 * np.pi * number / n)
                worst = max(worst, abs(thickness([polygon]).value - reach) / reach)
            errors.append(worst)
        a, b, c, d = errors
        rows.append(ConvergenceRow(name, base, reach, (a, b, c, d), expected))
    return rows
