"""A closed wire as straights and bends: corner points whose corners are rounded by one radius."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Indices

if TYPE_CHECKING:
    from scipy import sparse

__all__ = [
    "Wire",
    "WireSites",
    "differentiate_wire",
    "find_nearest_sites",
    "round_corners",
    "space_sites",
]


LARGEST_TURN = np.deg2rad(175.0)  # a corner that turns farther has no fillet at hand


@dataclass(frozen=True)
class Wire:
    """Fillets of one radius at the corners (m, 3), mm; straight j runs from corner j to j + 1.

    Bend j leaves straight j - 1 at `entry[j]`, turns by `turn[j]` (radians) from the direction
    `before[j]` towards `inward[j]` (unit vectors (m, 3)), and meets straight j at `exit[j]`. A
    `straight` (m,), mm, is negative where two fillets overlap.
    """

    corners: Array
    radius: float
    before: Array
    inward: Array
    turn: Array
    entry: Array
    exit: Array
    straight: Array

    @property
    def length_mm(self) -> float:
        """Length along the centre line: straights, and arcs at the bend radius."""
        return float(self.straight.sum() + self.radius * self.turn.sum())

    def at(self, sites: WireSites) -> Array:
        """The points (k, 3) at `sites`."""
        j, s = sites.piece, sites.share[:, None]
        following = np.roll(self.entry, -1, axis=0)
        points = self.exit[j] + s * (following[j] - self.exit[j])
        j, bent = j[sites.bend], sites.share[sites.bend] * self.turn[j[sites.bend]]
        points[sites.bend] = self.entry[j] + self.radius * (
            np.sin(bent)[:, None] * self.before[j] + (1.0 - np.cos(bent))[:, None] * self.inward[j]
        )
        return np.asarray(points)

    def tangent(self, sites: WireSites) -> Array:
        """Unit directions (k, 3) along the wire at `sites`."""
        j = sites.piece
        angle = np.where(sites.bend, sites.share, 1.0)[:, None] * self.turn[j][:, None]
        return np.asarray(np.cos(angle) * self.before[j] + np.sin(angle) * self.inward[j])


@dataclass(frozen=True)
class WireSites:
    """Places on a wire: the number of the piece, whether its bend or its straight, and the share."""

    piece: Indices  # (k,)
    bend: NDArray[np.bool_]  # (k,)
    share: Array  # (k,), 0 to 1 along that bend or straight


def round_corners(corners: Array, radius: float) -> Wire:
    """Round the corners (m, 3), m >= 3, of a closed polygon by one bend radius (mm)."""
    edge = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(edge, axis=1)
    after = edge / np.maximum(length, 1e-12)[:, None]
    before = np.roll(after, 1, axis=0)
    cosine = np.clip((before * after).sum(axis=1), -1.0, 1.0)
    # sine and cosine together: the arc cosine alone is blind near straight on
    sine = np.linalg.norm(np.cross(before, after), axis=1)
    turn = np.arctan2(sine, cosine)
    inward = after - cosine[:, None] * before
    size = np.linalg.norm(inward, axis=1)
    # where the wire goes straight on, any direction across serves
    level = np.eye(3)[np.abs(before).argmin(axis=1)]
    across = np.cross(before, level)
    across /= np.linalg.norm(across, axis=1)[:, None]
    inward = np.where((size > 1e-12)[:, None], inward / np.maximum(size, 1e-12)[:, None], across)
    reach = radius * np.tan(np.minimum(turn, LARGEST_TURN) / 2)
    return Wire(
        corners=corners,
        radius=radius,
        before=before,
        inward=inward,
        turn=turn,
        entry=corners - reach[:, None] * before,
        exit=corners + reach[:, None] * after,
        straight=length - reach - np.roll(reach, -1),
    )


def find_nearest_sites(wire: Wire, points: Array, near: Indices) -> tuple[WireSites, Array]:
    """The place on the wire nearest to each of the points (k, 3), and the distance (k,).

    Args:
        near: (k,) the straight that each point is known to lie about; the search looks from one
            bend and straight before it to one after it, so that a strand passing close by is not
            taken for this one.
    """
    count, m = len(points), len(wire.corners)
    best = np.full(count, np.inf)
    piece, share = np.zeros(count, dtype=np.int64), np.zeros(count)
    bend = np.zeros(count, dtype=bool)
    following = np.roll(wire.entry, -1, axis=0)
    for offset in (0, 1, -1, 2):
        j = (near + offset) % m
        # the bend: the angle at which the point is seen from the arc's centre
        centre = wire.entry[j] + wire.radius * wire.inward[j]
        from_centre = points - centre
        x = -(from_centre * wire.inward[j]).sum(axis=1)
        y = (from_centre * wire.before[j]).sum(axis=1)
        turn = np.maximum(wire.turn[j], 1e-12)
        on_bend = np.clip(np.arctan2(y, x) / turn, 0.0, 1.0)
        # on the straight, s is the nearest place's share of its length
        along = following[j] - wire.exit[j]
        square = np.maximum((along * along).sum(axis=1), 1e-18)
        on_line = np.clip(((points - wire.exit[j]) * along).sum(axis=1) / square, 0.0, 1.0)
        for is_bend, s in ((True, on_bend), (False, on_line)):
            if offset == 2 and not is_bend:
                continue
            sites = WireSites(j, np.full(count, is_bend), s)
            distance = np.linalg.norm(wire.at(sites) - points, axis=1)
            closer = distance < best
            best = np.where(closer, distance, best)
            piece, share = np.where(closer, j, piece), np.where(closer, s, share)
            bend = np.where(closer, is_bend, bend)
    return WireSites(piece, bend, share), best


def space_sites(wire: Wire, step: float) -> tuple[WireSites, Array]:
    """Place sites at most about `step` mm apart in order along the wire, with their places (k,), mm."""
    pieces, bends, shares, along = [], [], [], []
    begun = 0.0
    for j in range(len(wire.corners)):
        for is_bend, length in (
            (True, wire.radius * wire.turn[j]),
            (False, max(float(wire.straight[j]), 0.0)),
        ):
            n = max(1, int(np.ceil(length / step)))
            share = (np.arange(n) + 0.5) / n
            pieces.append(np.full(n, j))
            bends.append(np.full(n, is_bend))
            shares.append(share)
            along.append(begun + share * length)
            begun += length
    sites = WireSites(np.concatenate(pieces), np.concatenate(bends), np.concatenate(shares))
    return sites, np.concatenate(along)


def _group_corners(m: int) -> list[Indices]:
    """Corners in groups whose members are at least five apart around the wire."""
    if m < 10:
        return [np.array([j]) for j in range(m)]
    whole = m - m % 5
    groups = [np.arange(c, whole, 5) for c in range(5)]
    return groups + [np.array([j]) for j in range(whole, m)]


def differentiate_wire(wire: Wire, sites: WireSites) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Differentiate points at `sites`, and the straights, by the corners: (3 k, 3 m) and (m, 3 m).

    By central differences. A point of piece j depends on corners j - 1 to j + 2, so corners that
    are five apart are moved together and the answer told apart by the piece (Curtis, Powell & Reid
    1974).
    """
    m, step = len(wire.corners), 1e-6
    rows, columns, values = [], [], []
    rows_s, columns_s, values_s = [], [], []
    number = np.arange(len(sites.piece))
    for group in _group_corners(m):
        owner = np.full(m, -1)
        for shift in (-2, -1, 0, 1):
            owner[(group + shift) % m] = group
        hit = owner[sites.piece] >= 0
        part = WireSites(sites.piece[hit], sites.bend[hit], sites.share[hit])
        column, line_hit = owner[part.piece], np.flatnonzero(owner >= 0)
        for axis in range(3):
            shift_by = np.zeros_like(wire.corners)
            shift_by[group, axis] = step
            plus = round_corners(wire.corners + shift_by, wire.radius)
            minus = round_corners(wire.corners - shift_by, wire.radius)
            slope = (plus.at(part) - minus.at(part)) / (2 * step)
            for k in range(3):
                rows.append(3 * number[hit] + k)
                columns.append(3 * column + axis)
                values.append(slope[:, k])
            rows_s.append(line_hit)
            columns_s.append(3 * owner[line_hit] + axis)
            values_s.append(((plus.straight - minus.straight) / (2 * step))[line_hit])
    from scipy import sparse

    points = sparse.csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))),
        shape=(3 * len(sites.piece), 3 * m),
    )
    straights = sparse.csr_matrix(
        (np.concatenate(values_s), (np.concatenate(rows_s), np.concatenate(columns_s))),
        shape=(m, 3 * m),
    )
    return points, straights
