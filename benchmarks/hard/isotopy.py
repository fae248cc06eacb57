"""Adversarial steps against the certificate: none that it lets pass may carry a strand through another.

Steps aim one edge at the nearest other, or shake, stretch, turn and collapse the polygons at sizes from
a millionth to a thousand times their gap; neighbour lists are left to age. Each accepted step is judged
again by the exact times at which edges meet, and each run's end by knot and link invariants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.hard.crossing import linking_number, passes_through
from benchmarks.hard.curves import HardKnot
from knotfab.base.arrays import Array
from knotfab.geometry.carry import certify
from knotfab.geometry.measures import Neighbours, find_neighbours
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.knots.knot_types import knot_types

RUN = 500  # steps from a fresh start


@dataclass(frozen=True)
class Fuzzed:
    """What came of so many steps: accepted, would have crossed and refused, crossed and accepted (faults)."""

    name: str
    steps: int
    accepted: int
    crossing: int
    faults: int
    changed: int  # runs whose invariants changed


def types_of(polygons: list[Array]) -> str | None:
    """Return knot types and linking, as the validators find them; None where strands are too near to tell."""
    n = len(polygons)
    found = knot_types(Curves(tuple(polygons), ("unknot",) * n, (True,) * n, 1.0))
    if found.touching is not None or found.tangled:
        return None
    linking = sorted(abs(number) for *_, number in found.linking.numbers)
    names = sorted(str(k.identity.knots) for k in found.knots)
    return f"{names} {found.linking.state} {linking}"


def _same(before: list[Array], after: list[Array]) -> bool:
    """Tell whether the invariants agree: linking always, the rest where the validators can tell."""
    if len(before) == 2 and abs(linking_number(*before) - linking_number(*after)) > 1e-3:
        return False
    was, now = types_of(before), types_of(after)
    return was is None or now is None or was == now


def fuzz(case: HardKnot, steps: int, seed: int) -> Fuzzed:
    """Return `steps` adversarial steps from the case's polygons, a fresh start every so many."""
    rng = np.random.default_rng(seed)
    start = case.make()
    rings = polylines_of_sizes(tuple(len(p) for p in start))
    accepted = crossing = faults = changed = 0
    for first in range(0, steps, RUN):
        x = np.concatenate(start)
        near: Neighbours | None = None
        for _ in range(min(RUN, steps - first)):
            if near is None or rng.random() < 0.2:
                near = find_neighbours(x, rings, float(np.ptp(x, axis=0).max()) * 4, 2)
            step = _step(x, rings, rng)
            passes = certify(x, step, rings, near).valid
            crosses = (passes or rng.random() < 0.05) and passes_through(x, step, rings.next)
            crossing += crosses
            faults += crosses and passes
            if passes:
                accepted += 1
                x = x + step
        changed += not _same(start, rings.split(x))
    return Fuzzed(case.name, steps, accepted, crossing, faults, changed)


def _step(x: Array, rings: Polylines, rng: np.random.Generator) -> Array:
    """Return one adversarial step (N, 3)."""
    n = len(x)
    size = float(np.ptp(x, axis=0).max())
    scale = 10.0 ** rng.uniform(-6, 0.5)
    kind = rng.integers(6)
    if kind == 0:  # one edge at another's middle, and through
        i = int(rng.integers(n))
        middle = 0.5 * (x + x[rings.next])
        away = np.linalg.norm(middle - middle[i], axis=1)
        away[[i, rings.next[i], rings.previous[i]]] = np.inf
        j = int(np.argsort(away)[rng.integers(3)])
        step = np.zeros_like(x)
        step[[i, rings.next[i]]] = (middle[j] - middle[i]) * rng.uniform(0.3, 3.0)
        return step
    if kind == 1:  # one vertex anywhere
        step = np.zeros_like(x)
        step[rng.integers(n)] = rng.normal(size=3) * scale * size
        return step
    if kind == 2:  # all of them
        return np.asarray(rng.normal(size=(n, 3)) * scale * size * 0.3)
    if kind == 3:  # a shear or a collapse of all
        return np.asarray((x - x.mean(0)) @ (rng.normal(size=(3, 3)) * scale))
    if kind == 4:  # one ring, or one half of one, as a whole
        step = np.zeros_like(x)
        first = int(rng.integers(n))
        part = (rings.ring == rings.ring[first]) & (np.arange(n) >= first)
        step[part] = rng.normal(size=3) * scale * size
        return step
    # smooth along the curve
    wave = np.cos(2 * np.pi * (np.arange(n) / n * rng.integers(1, 4) + rng.random()))
    return np.asarray(wave[:, None] * rng.normal(size=3) * scale * size)
