"""Knots and links in space by formulas and braids, their diagrams, and what the validators say of them."""

from collections.abc import Sequence

import numpy as np

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.knot_types import knot_types
from knotfab_validators.knots.planar_diagram import Laurent, PlanarDiagram
from knotfab_validators.knots.projection import diagram_of
from knotfab_validators.knots.reduction import general_position, may_pierce


def curves(*polygons: Array, types: tuple[str, ...] | None = None) -> Curves:
    n = len(polygons)
    return Curves(polygons, types or ("unknot",) * n, (True,) * n, 1.0)


def ring(n: int = 100, radius: float = 1.0) -> Array:
    s = 2 * np.pi * np.arange(n) / n
    return radius * np.column_stack([np.cos(s), np.sin(s), 0 * s])


def torus_knot(p: int, q: int, n: int = 400) -> Array:
    """T(p, q) with p turns about the axis; left-handed for p, q > 0."""
    s = 2 * np.pi * np.arange(n) / n
    r = 2 + np.cos(q * s)
    return np.column_stack([r * np.cos(p * s), r * np.sin(p * s), np.sin(q * s)])


def figure_eight(n: int = 400) -> Array:
    s = 2 * np.pi * np.arange(n) / n
    r = 2 + np.cos(2 * s)
    return np.column_stack([r * np.cos(3 * s), r * np.sin(3 * s), np.sin(4 * s)])


def borromean(n: int = 80) -> list[Array]:
    s = 2 * np.pi * np.arange(n) / n
    oval = np.column_stack([2 * np.cos(s), np.sin(s), 0 * s])
    return [oval, oval[:, [2, 0, 1]], oval[:, [1, 2, 0]]]


WHITEHEAD = (1, -2, 1, -2, -2)  # a braid


def braid(word: Sequence[int], strands: int | None = None) -> list[Array]:
    """Closure of a braid, turning counter-clockwise about z, strand 1 innermost.

    Letter k > 0: strands k and k + 1 change places, the inner one passing above (larger z), which is
    a right-handed crossing.
    """
    count = max([strands or 1, *(abs(k) + 1 for k in word)])
    slots = [*word, *[count] * max(1, 4 - len(word))]  # the slot `count` moves no strand
    seen: set[int] = set()
    found = []
    for start in range(1, count + 1):
        if start in seen:
            continue
        points: list[tuple[float, float, float]] = []
        place, slot, turn = start, 0, 2 * np.pi / (2 * len(slots))
        while True:
            if slot % len(slots) == 0:
                if slot and place == start:
                    break
                seen.add(place)
            letter = slots[slot % len(slots)]
            idle = letter == count
            inner = place == abs(letter) and not idle
            after = place + 1 if inner else place - 1 if place == abs(letter) + 1 else place
            height = 0.0 if after == place else (0.5 if inner == (letter > 0) else -0.5)
            for step, radius, z in ((0, place, 0.0), (1, (place + after) / 2, height)):
                angle = turn * (2 * slot + step)
                points.append(((2 + radius) * np.cos(angle), (2 + radius) * np.sin(angle), z))
            place, slot = after, slot + 1
        found.append(np.array(points))
    return found


def rotate(points: Array, seed: int) -> Array:
    """Turned at random, without mirroring."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return np.asarray(points @ (q * np.linalg.det(q)).T)


def mirror(points: Array) -> Array:
    return points * [1.0, 1.0, -1.0]


def zigzag(points: Array, times: int, seed: int, size: float = 0.02) -> Array:
    """Each edge cut in `times`, and every vertex moved a little."""
    s = np.arange(times)[:, None] / times
    after = np.roll(points, -1, axis=0)
    cut = (points[:, None] + s * (after - points)[:, None]).reshape(-1, 3)
    return np.asarray(cut + np.random.default_rng(seed).uniform(-size, size, cut.shape))


def filling(n: int, seed: int, rows: int = 24) -> Array:
    """A comb that fills a square: simple from above, at a random smooth depth; so an unknot."""
    rng = np.random.default_rng(seed)
    corners = [(0.0, 0.0)]
    for k in range(rows):
        corners += [(8.0, k * 4.0), (100.0, k * 4.0)][:: 1 if k % 2 == 0 else -1]
    corners += [(0.0, corners[-1][1]), (0.0, 0.0)]
    path = np.array(corners)
    length = np.concatenate([[0], np.linalg.norm(np.diff(path, axis=0), axis=1).cumsum()])
    s = np.linspace(0, length[-1], n, endpoint=False)
    angle = 2 * np.pi * s / length[-1]
    waves = [rng.normal() * np.cos(k * angle + rng.uniform(0, 7)) for k in range(1, 60)]
    depth = np.sum(waves, axis=0)
    flat = [np.interp(s, length, path[:, 0]), np.interp(s, length, path[:, 1])]
    return np.column_stack([*flat, 30 * depth / depth.std()])


def seen_from_a_lamp(points: Array, distance: float = 150.0) -> Array:
    """A projective map of space, so that the curve is simple from one point and from no side."""
    return np.column_stack([points[:, :2] * (1 - points[:, 2:] / distance), points[:, 2]])


def coil(*back: tuple[float, float, float]) -> Array:
    """A coil about the z axis that is closed by way of the points of `back`."""
    s = np.linspace(0, 1, 400)
    turns = 2 * np.pi * 12 * s
    return np.concatenate([np.column_stack([np.cos(turns), np.sin(turns), 10 * s]), back])


def move_randomly(polygon: Array, rounds: int, seed: int) -> Array:
    """A random walk of triangle moves: vertices swept to far places where no edge is in the way."""
    rng = np.random.default_rng(seed)
    at = polygon.copy()
    n = len(at)
    for i in np.concatenate([rng.permutation(n) for _ in range(rounds)]):
        a, b, c = at[i - 1], at[i], at[(i + 1) % n]
        target = b + rng.normal(0, 0.7, 3)
        others = np.flatnonzero((np.arange(n) != i) & (np.arange(n) != (i - 1) % n))
        p, q = at[others], at[(others + 1) % n]
        corners = [[np.broadcast_to(x, p.shape) for x in (end, b, target)] for end in (a, c)]
        if not any(may_pierce(u, v, w, p, q).any() for u, v, w in corners):
            at[i] = target
    return at


def random_markov(word: Sequence[int], moves: int, seed: int) -> list[int]:
    """Another braid with the same closure: conjugations, relations, insertions, stabilisations."""
    rng = np.random.default_rng(seed)
    result = list(word)
    for _ in range(moves):
        strands = max(map(abs, result), default=0) + 1
        kind, k = rng.integers(4), int(rng.integers(len(result) + 1))
        if kind == 0 and strands > 1:
            letter = int(rng.integers(1, strands)) * int(rng.choice([-1, 1]))
            result[k:k] = [letter, -letter]
        elif kind == 1:
            result = result[k:] + result[:k]
        elif kind == 2 and strands < 7:
            result.insert(k, strands * int(rng.choice([-1, 1])))
        else:
            result = _relate(result, rng)
    return result


def _relate(word: list[int], rng: np.random.Generator) -> list[int]:
    """One braid relation, where one applies: far letters commute, a b a = b a b."""
    places = list(rng.permutation(max(len(word) - 1, 0)))
    for k in places:
        a, b = word[k], word[k + 1]
        if abs(abs(a) - abs(b)) > 1:
            return [*word[:k], b, a, *word[k + 2 :]]
        if word[k + 2 : k + 3] == [a] and abs(abs(a) - abs(b)) == 1 and a * b > 0:
            return [*word[:k], b, a, b, *word[k + 3 :]]
    return word


TREFOIL = (1, 1, 1)


WORDS = [
    *[tuple(np.random.default_rng(s).choice([-3, -2, -1, 1, 2, 3], 14).tolist()) for s in range(24)],
    TREFOIL, (1, 1, 1, -2, -1, -1, -1, -2),
]  # fmt: skip


def diagram(*polygons: Array) -> PlanarDiagram:
    placed = general_position(polygons)
    assert placed is not None
    found = diagram_of(placed, most=2000)
    assert found is not None
    return found


def powers(value: Laurent | None) -> dict[int, int]:
    assert value is not None
    return {value.lowest + k: c for k, c in enumerate(value.coefficients) if c}


def judge_type(*curves: Array, promise: str = "") -> tuple[str, str]:
    """What the independent check says of the first curve alone or in its link: sentence, verdict."""
    types = knot_types(Curves(curves, (promise,) * len(curves), (True,) * len(curves), 1.0))
    return types.knots[0].sentence, types.knots[0].verdict


def linking_numbers(*curves: Array) -> list[int]:
    """The linking number of every two curves."""
    types = knot_types(Curves(curves, ("",) * len(curves), (True,) * len(curves), 1.0))
    return [n for _, _, n in types.linking.numbers]
