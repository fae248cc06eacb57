"""Small polygons of many kinds, drawn at random: what thickness must be right on."""

from collections.abc import Callable

import numpy as np

from knotfab_validators.arrays import Array

Random = np.random.Generator
Polygons = list[Array]


def _regular(rng: Random) -> Polygons:
    n = int(rng.integers(3, 26))
    t = 2 * np.pi * np.arange(n) / n
    return [np.column_stack([np.cos(t), np.sin(t), 0 * t])]


def _stack(rng: Random) -> Polygons:
    ring = _regular(rng)[0]
    turn = rng.choice([0.0, np.pi / len(ring), rng.random()])
    c, s = np.cos(turn), np.sin(turn)
    other = ring @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return [ring, other + [0, 0, rng.choice([0.01, 0.5, 1.0])]]


def _zigzag(rng: Random) -> Polygons:
    n, height = int(rng.integers(2, 7)), rng.choice([0.2, 1.0, 3.0])
    x = np.arange(2 * n + 1) * 0.5
    there = np.column_stack([x, height * (np.arange(2 * n + 1) % 2), 0 * x])
    gap = rng.choice([1.0, 4.0])
    return [np.concatenate([there, there[::-1] * [1, rng.choice([-1, 1]), 1] + [0, gap + 3, 0]])]


def _slit(rng: Random) -> Polygons:
    """Long parallel edges, or nearly parallel by an angle from 1 to 1e-12."""
    length, gap = rng.choice([5.0, 50.0, 1000.0]), rng.choice([0.5, 1.0, 2.0])
    tilt = length * 10.0 ** rng.integers(-12, -1) * rng.choice([-1, 0, 1])
    lift = length * 10.0 ** rng.integers(-12, -1) * rng.choice([-1, 0, 1])
    split = int(rng.integers(1, 5))
    x = np.linspace(0, length, split + 1)
    back = np.linspace(length, 0, int(rng.integers(1, 5)) + 1)
    slant = gap + tilt * back / length
    upper = np.column_stack([back, slant, lift * (back / length - 0.37)])
    return [np.concatenate([np.column_stack([x, 0 * x, 0 * x]), upper])]


def _lattice(rng: Random) -> Polygons:
    """A closed walk of unit steps, mostly not simple: thickness 0 or 1/2, right angles everywhere."""
    half = rng.integers(0, 3, int(rng.integers(2, 7)))
    steps = np.eye(3)[np.concatenate([half, rng.permutation(half)])]
    steps[len(half) :] *= -1
    return [np.cumsum(rng.permutation(steps) if rng.random() < 0.5 else steps, axis=0)]


def _flat(rng: Random) -> Array:
    points = rng.normal(size=(int(rng.integers(4, 14)), 3))
    points[:, 2] = 0
    return points


def _gaussian(rng: Random) -> Polygons:
    return [rng.normal(size=(int(rng.integers(3, 20)), 3)) for _ in range(int(rng.integers(1, 4)))]


def _smooth(rng: Random) -> Polygons:
    """Random waves, sampled finely: bends and strands both decide."""
    polygons = []
    for _ in range(int(rng.integers(1, 3))):
        s = 2 * np.pi * np.arange(int(rng.integers(20, 50)))[:, None]
        s, k = s / len(s), np.arange(1, 4)
        waves = rng.normal(size=(2, 3, 3)) / k[:, None] ** 1.5
        polygons.append(np.cos(s * k) @ waves[0] + np.sin(s * k) @ waves[1])
    return polygons


def _bends(rng: Random) -> Polygons:
    """Legs joined by turns of about 180 degrees: chords at the edge of being critical."""
    n, off = int(rng.integers(1, 9)), rng.choice([0.0, 1e-12, 1e-9, 1e-6, 1e-3, 0.1])
    t = np.linspace(0, np.pi * (1 + rng.choice([-1, 1]) * off), n + 1)
    turn = np.column_stack([np.sin(t), -np.cos(t), rng.choice([0, 1e-7, 0.3]) * t])
    end = np.array([np.cos(t[-1]), np.sin(t[-1]), 0])
    leg = rng.choice([0.5, 3.0, 30.0])
    first = np.linspace(turn[0] - [leg, 0, 0], turn[0], 3)[:-1]
    last = np.linspace(turn[-1], turn[-1] + leg * end, 3)[1:]
    return [np.concatenate([first, turn, last])]


def _touching(rng: Random) -> Polygons:
    """Two crossing strands a very small or vanishing distance apart."""
    gap = rng.choice([0.0, 1e-9, 1e-6, 1e-3])
    one = np.array([[-3.0, 0, 0], [0, 0, 0], [3, 0, 0], [3, -9, 0], [-3, -9, 0]])
    other = one[:, [1, 0, 2]] * [1, 1, -1] + [rng.choice([0.0, 0.7]), rng.choice([0.0, 0.3]), gap]
    other[3:, 2] += 5
    return [one, other]


def _rods(rng: Random) -> Polygons:
    n = int(rng.integers(2, 6))
    rods = []
    for k in range(n):
        rod = np.array([[0.0, k, 0], [rng.choice([4, 7]), k, 0]])
        rods.append(rod if k % 2 == 0 else rod[::-1])
    away = [[-3.0, n, 9], [-3, -1, 9]]
    return [np.concatenate([*rods, away])]


KINDS: dict[str, Callable[[Random], Polygons]] = {
    "regular": _regular,
    "stacked": _stack,
    "zigzag": _zigzag,
    "slit": _slit,
    "lattice": _lattice,
    "planar": lambda rng: [_flat(rng)],
    "gaussian": _gaussian,
    "smooth": _smooth,
    "bends": _bends,
    "touching": _touching,
    "rods": _rods,
}


def place(polygons: Polygons, rng: Random) -> Polygons:
    """Perhaps turned, scaled by 1e-6 to 1e6, or moved far away (up to 1e6 of its size)."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if rng.random() < 0.6 else np.eye(3)
    scale = rng.choice([1.0, 1e-6, 1e6])
    shift = rng.choice([0.0, 1.0, 1e6]) * rng.normal(size=3)
    return [(p @ turn + shift) * scale for p in polygons]
