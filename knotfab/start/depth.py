"""The depth profile: where along the light's rays each stretch of the template goes.

Moving points along rays leaves the picture of a simple curve simple, so the lifted curve is still an
unknot by inspection. Among many random smooth profiles the one is taken from which the picture can
least be read elsewhere.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import erf

from knotfab.arrays import Array, Indices, Mask
from knotfab.problem import DepthChoice
from knotfab.start.legibility import legibility

__all__ = ["choose_depth", "lift"]


_CONFLICT = 0.6  # weight of strands that hide each other at the same depth, against legibility
_WAVELENGTHS = (0.65, 0.85, 1.1)  # shortest wave of a profile, in extents across the piece


def lift(curve: Array, depth: Array, light_distance: float) -> Array:
    """(n, 2) points of the plane z = 0 moved along their rays to height `depth`: (n, 3)."""
    return np.column_stack([curve * (1.0 - depth / light_distance)[:, None], depth])


def _profile(rng: np.random.Generator, arc: Array, length: float, shortest: float) -> Array:
    """A random periodic profile between about -2 and 2 whose waves are at least `shortest` long."""
    waves = max(1, int(length / shortest))
    k = np.arange(1, waves + 1)
    amplitude, phase = rng.normal(size=waves), rng.uniform(0, 2 * np.pi, waves)
    angle = 2 * np.pi * arc[:, None] / length * k + phase
    # a normal variable made uniform: the curve spends as much length in front as in the middle, so
    # that neighbouring parts of the outline are far apart in depth
    profile = 2.0 * erf((amplitude * np.cos(angle)).sum(1) / np.sqrt(waves))
    # a curve shorter than a wave keeps its slope small and goes to a depth of its own instead
    return np.asarray(
        profile * min(1.0, length / shortest) + rng.normal() * (length < 3 * shortest)
    )


def _overlapping(curves: tuple[Array, ...], radius: float) -> tuple[Indices, Indices]:
    """Pairs of points that hide each other seen from the light, so that they must differ in depth.

    Where two strands run in a stroke about one tube wide, neither can step aside without a trace.
    """
    every = np.concatenate(curves)
    curve = np.repeat(np.arange(len(curves)), [len(c) for c in curves])
    arc = np.concatenate(
        [np.cumsum(np.linalg.norm(np.roll(c, -1, axis=0) - c, axis=1)) for c in curves]
    )
    total = np.array([arc[curve == k].max() for k in range(len(curves))])[curve]
    some = np.arange(0, len(every), 2)
    pairs = some[cKDTree(every[some]).query_pairs(1.85 * radius, output_type="ndarray")]
    i, j = pairs[:, 0], pairs[:, 1]
    along = np.abs(arc[i] - arc[j])
    along = np.minimum(along, total[i] - along)
    far = (curve[i] != curve[j]) | (along > 6.0 * radius)
    return i[far], j[far]


def choose_depth(
    curves: tuple[Array, ...],
    radius: float,
    light_distance: float,
    extent_mm: float,
    target: Mask,
    candidates: int,
    seed: int,
) -> DepthChoice:
    """The least legible of `candidates` random profiles of the given extent.

    Args:
        curves: closed planar polylines [(n, 2) mm], evenly sampled.
        radius: tube radius, mm.
        light_distance: mm to the middle of the piece.
        extent_mm: extent of the centre lines along the view's axis.
        target: the picture's mask, from `legibility.stretched`.
    """
    every = np.concatenate(curves)
    across = float((every.max(0) - every.min(0)).max()) + 2 * radius
    rng = np.random.default_rng(seed)
    arcs, lengths = [], []
    for curve in curves:
        steps = np.linalg.norm(np.roll(curve, -1, axis=0) - curve, axis=1)
        arcs.append(np.concatenate([[0.0], np.cumsum(steps)[:-1]]))
        lengths.append(float(steps.sum()))
    one, other = _overlapping(curves, radius)
    best: DepthChoice | None = None
    for n in range(candidates):
        shortest = _WAVELENGTHS[n % len(_WAVELENGTHS)] * across
        raw = [_profile(rng, a, length, shortest) for a, length in zip(arcs, lengths, strict=True)]
        joined = np.concatenate(raw)
        low, high = float(joined.min()), float(joined.max())
        scale = extent_mm / max(high - low, 1e-9)
        depths = tuple((d - 0.5 * (low + high)) * scale for d in raw)
        points = np.concatenate(
            [lift(c, d, light_distance) for c, d in zip(curves, depths, strict=True)]
        )
        seen = 0.75 * legibility(points, radius, light_distance, target, 45.0)
        seen += 0.25 * legibility(points, radius, light_distance, target, 30.0)
        apart = np.linalg.norm(points[one] - points[other], axis=1)
        seen += _CONFLICT * float((apart < 2.2 * radius).sum()) / max(len(one), 1)
        if best is None or seen < best.legibility:
            best = DepthChoice(depths, seen)
    assert best is not None
    return best
