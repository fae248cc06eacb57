"""Orient a piece on the bed: the rotations that are tried, and the choice among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from knotfab.base.arrays import Array
from knotfab.geometry.overhang import Estimate, Rules, Strands, estimate, strands_along
from knotfab.geometry.tube import face_normals
from knotfab.knots import Knot, Knots

# From scene to bed, in order of preference: back down (the light above), a side down, and the reverses.
AXES = (
    np.eye(3),
    np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    np.diag([1.0, -1.0, -1.0]),
    np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
)
SPHERE = 64  # directions all round
SAME_DEG = 2.0  # directions nearer to each other are one

# What a pose costs, as minutes of printing on a usual filament printer: a cubic centimetre of supports is
# many short lines, and each layer costs its lift, wipe and travel; a piece that could fall, or that hardly
# touches the bed, costs the prints that fail. Minutes as PrusaSlicer tells them of the same knot with
# more and with less supports (docs/report.md).
MINUTES_PER_CM3 = 9.0
SHORT = 1.12  # the most that the surface's own columns came to, over the estimate
MINUTES_PER_LAYER = 4.0 / 60.0
USUAL_LAYER_MM = 0.2  # fine layers cost more time in every pose alike
TIPSY_DEG = 10.0  # stands as well as any that tips later
MINUTES_TIPSY = 30.0
CONTACT_MM2 = 10.0
MINUTES_CONTACT = 5.0


@dataclass(frozen=True)
class Ranked:
    """A rotation (3, 3) from scene to bed, its estimate, and its cost."""

    turn: Array
    estimate: Estimate
    minutes: float


def estimate_minutes(found: Estimate) -> float:
    """Estimate the cost of a pose in minutes (see the constants of this module)."""
    return (
        estimate_print_minutes(found)
        + MINUTES_TIPSY * max(0.0, 1.0 - found.tip_deg / TIPSY_DEG)
        + MINUTES_CONTACT / (1.0 + found.contact_mm2 / CONTACT_MM2)
    )


def strands_of(knots: Knots, most: int = 6000) -> Strands:
    """Return the centre lines as short rods."""
    curves, closed = [k.points for k in knots.knots], [k.closed for k in knots.knots]
    return strands_along(curves, knots.radius_mm, closed, most)


def estimate_print_minutes(found: Estimate) -> float:
    """Estimate minutes for supports and layers; strands take the same in every pose."""
    return (
        MINUTES_PER_CM3 * found.filament_cm3 + MINUTES_PER_LAYER * found.height_mm / USUAL_LAYER_MM
    )


def propose_turns(strands: Strands) -> list[Array]:
    """List the rotations (3, 3) to try: axes, principal axes, faces of the hull, and all round.

    All but the scene's axes are tied to the piece, so that it does not matter how it was turned
    before.
    """
    own = _principal_axes(strands)
    up = [*own, *(-own), *_hull_faces(strands.middle), *(_spread_directions(SPHERE) @ own)]
    turns = list(AXES)
    taken = np.array([t[2] for t in AXES])
    for direction in up:
        if (taken @ direction).max() < np.cos(np.radians(SAME_DEG)):
            turns.append(_turn_to(direction, own[0]))
            taken = np.vstack([taken, direction])
    return turns


def rank_turns(strands: Strands, turns: Sequence[Array], rules: Rules) -> list[Ranked]:
    """Estimate the rotations and sort them, the best first.

    Those that keep the printer's limits come first, by their cost; the others by their supports.
    Ties keep the order of `turns`.
    """
    found = []
    for turn in turns:
        one = estimate(strands, turn, rules)
        found.append(Ranked(turn, one, estimate_minutes(one)))
    return sorted(found, key=lambda pose: _order(pose, rules))


def estimate_supports_cm3(found: Estimate) -> float:
    """Estimate the supports of a pose, with a margin for the error of estimates."""
    return SHORT * found.support_cm3


def keeps_limits(found: Estimate, rules: Rules) -> bool:
    """Return whether the printer's limits on overhangs are kept, as far as can be estimated."""
    if rules.supports:
        return (
            rules.max_support_cm3 is None or estimate_supports_cm3(found) <= rules.max_support_cm3
        )
    return found.starts == 0 and found.bridge_mm <= rules.max_bridge_mm


def _order(pose: Ranked, rules: Rules) -> tuple[bool, float]:
    within = keeps_limits(pose.estimate, rules)
    return not within, round(pose.minutes if within else pose.estimate.support_cm3, 6)


def _principal_axes(strands: Strands) -> Array:
    """Return the directions of most, middle and least extent as rows (3, 3), right-handed.

    Each of the first two points to the side of the longer tail, so that they turn with the piece.
    """
    weight = strands.length / strands.length.sum()
    away = strands.middle - weight @ strands.middle
    axes = np.linalg.eigh((away * weight[:, None]).T @ away)[1].T[::-1]
    tail = np.einsum("i,ki->k", weight, (axes @ away.T) ** 3)
    axes = axes * np.where(tail < 0, -1.0, 1.0)[:, None]
    axes[2] = np.cross(axes[0], axes[1])
    return np.asarray(axes)


def _hull_faces(points: Array) -> Array:
    """Return which way is up for a piece on the largest faces of its hull, (k, 3)."""
    try:
        hull = ConvexHull(points)
    except QhullError:  # flat: it lies on its own plane, which is a principal one
        return np.empty((0, 3))
    area = np.linalg.norm(face_normals(points[hull.simplices]), axis=1)
    # faces of the hull on which the piece could lie
    largest = np.argsort(-area, kind="stable")[:16]
    return np.asarray(-hull.equations[largest, :3])


def _spread_directions(count: int) -> Array:
    """Spread directions evenly over the sphere, on a spiral of golden angles, (count, 3)."""
    k = np.arange(count)
    z = 1.0 - (2 * k + 1) / count
    around = k * pi * (3.0 - sqrt(5.0))
    flat = np.sqrt(1.0 - z**2)
    return np.column_stack([flat * np.cos(around), flat * np.sin(around), z])


def _turn_to(up: Array, right: Array) -> Array:
    """Return the rotation that brings `up` upwards and `right`, if possible, to the right."""
    across = right - (right @ up) * up
    if np.linalg.norm(across) < 1e-6:
        other = np.eye(3)[int(np.abs(up).argmin())]
        across = other - (other @ up) * up
    across = across / np.linalg.norm(across)
    return np.stack([across, np.cross(up, across), up])


# How flat a piece must be to keep the printer's limit.

STEPS = 5  # halvings, to a thirty-second of the depth
AIM = 0.95  # a share of the limit: the search that follows lays the strands differently
ROUND_MM = 0.1


@dataclass(frozen=True)
class Flattening:
    """The changes made because supports exceed the printer's limit, or pegs or feet do not hold; mm.

    `from_mm` is the depth of the first search, `to_mm` of the one that was kept (equal if none
    followed), and `proposed_mm` what the kept one would still need, if anything. `unheld` says why
    no pegs or feet held the first; `wall_mm` are the distances of the first and the kept one from the wall.
    """

    from_mm: float
    to_mm: float
    proposed_mm: float | None
    unheld: str = ""
    wall_mm: tuple[float, float] = (0.0, 0.0)


def flatter_depth(knots: Knots, depth_mm: float, rules: Rules) -> float | None:
    """Find the largest depth, mm, at which some pose is estimated to keep `max_support_cm3`.

    The curves' depths are scaled and all else stays, so the number is a proposal for a new search.

    Args:
        knots: in scene coordinates, with centre lines that extend `depth_mm` along z.

    Returns:
        None if there is no limit, if it is kept already, or if not even a flat piece would keep it.
    """
    if rules.max_support_cm3 is None or not rules.supports or rules.powder:
        return None
    limit = AIM * rules.max_support_cm3

    def least(share: float) -> float:
        _, poses = _rank_flattened(knots, share, rules)
        return min(estimate_supports_cm3(p.estimate) for p in poses)

    low, high = 0.0, 1.0
    if least(high) <= limit or least(low) > limit:
        return None
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if least(middle) <= limit else (low, middle)
    depth = float(np.floor(low * depth_mm / ROUND_MM) * ROUND_MM)
    return depth if depth > 0 else None


def _rank_flattened(knots: Knots, share: float, rules: Rules) -> tuple[Strands, list[Ranked]]:
    """Scale the strands' depths, and rank their poses, the best first."""
    flat = np.array([1.0, 1.0, share])
    scaled = (Knot(k.points * flat, closed=k.closed) for k in knots.knots)
    # rods that stand for the strands
    strands = strands_of(Knots(tuple(scaled), knots.radius_mm), most=2000)
    return strands, rank_turns(strands, propose_turns(strands), rules)
