"""Model a closed wire as straights and bends: a polygon whose corners are rounded by one radius."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Indices

if TYPE_CHECKING:
    from scipy import sparse

LARGEST_TURN = np.deg2rad(175.0)  # fillets of sharper corners are computed as of this one


@dataclass(frozen=True)
class Wire:
    """A closed polygon with a fillet of one radius at each corner; straight j runs from corner j to j + 1.

    Bend j leaves straight j - 1 at `entry[j]`, turns by `turn[j]` (radians) from the direction
    `before[j]` towards `inward[j]` (unit vectors (m, 3)), and meets straight j at `exit[j]`. The
    lengths `straight` (m,), mm, are negative where two fillets overlap.
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
        """Return the points (k, 3) at `sites`."""
        j, s = sites.piece, sites.share[:, None]
        following = np.roll(self.entry, -1, axis=0)
        points = self.exit[j] + s * (following[j] - self.exit[j])
        j, bent = j[sites.bend], sites.share[sites.bend] * self.turn[j[sites.bend]]
        points[sites.bend] = self.entry[j] + self.radius * (
            np.sin(bent)[:, None] * self.before[j] + (1.0 - np.cos(bent))[:, None] * self.inward[j]
        )
        return np.asarray(points)

    def tangent(self, sites: WireSites) -> Array:
        """Return unit directions (k, 3) along the wire at `sites`."""
        j = sites.piece
        angle = np.where(sites.bend, sites.share, 1.0)[:, None] * self.turn[j][:, None]
        return np.asarray(np.cos(angle) * self.before[j] + np.sin(angle) * self.inward[j])


@dataclass(frozen=True)
class WireSites:
    """Places on a wire. Piece j is bend j and the straight after it."""

    piece: Indices  # (k,)
    bend: NDArray[np.bool_]  # (k,) whether the place is on the bend, not the straight
    share: Array  # (k,), 0 to 1 along that bend or straight


def round_corners(corners: Array, radius: float) -> Wire:
    """Round the corners (m, 3), m >= 3, of a closed polygon by one bend radius (mm)."""
    around = np.stack([np.roll(corners, 1, axis=0), corners, np.roll(corners, -1, axis=0)], axis=1)
    before, inward, turn, entry, leave = _round_middle(around, radius)
    # negative where the straight runs backwards
    straight = (np.roll(before, -1, axis=0) * (np.roll(entry, -1, axis=0) - leave)).sum(axis=1)
    return Wire(corners, radius, before, inward, turn, entry, leave, straight)


def _round_middle(around: Array, radius: float) -> tuple[Array, Array, Array, Array, Array]:
    """Return the fillet at the middle one of three corners (..., 3, 3): fields `before` to `exit` of Wire."""
    edge = around[..., 1:, :] - around[..., :-1, :]
    edge /= np.maximum(np.linalg.norm(edge, axis=-1), 1e-12)[..., None]
    before, after = edge[..., 0, :], edge[..., 1, :]
    cosine = (before * after).sum(axis=-1)
    inward = after - cosine[..., None] * before
    size = np.linalg.norm(inward, axis=-1)
    # from sine and cosine: the arc cosine alone is inexact for small turns
    turn = np.arctan2(size, cosine)
    # where the wire goes straight on, any perpendicular direction will do
    across = np.cross(before, np.eye(3)[np.abs(before).argmin(axis=-1)])
    across /= np.linalg.norm(across, axis=-1)[..., None]
    inward = np.where(
        (size > 1e-12)[..., None], inward / np.maximum(size, 1e-12)[..., None], across
    )
    reach = radius * np.tan(np.minimum(turn, LARGEST_TURN) / 2)[..., None]
    corner = around[..., 1, :]
    return before, inward, turn, corner - reach * before, corner + reach * after


def find_nearest_sites(wire: Wire, points: Array, near: Indices) -> tuple[WireSites, Array]:
    """Find the place on the wire nearest to each point (k, 3), and the distance (k,).

    Args:
        near: (k,) the straight near which each point is known to lie. Only that piece and its neighbours
            are searched, so that another strand passing close by is not taken for this one.
    """
    count, m = len(points), len(wire.corners)
    best = np.full(count, np.inf)
    piece, share = np.zeros(count, dtype=np.int64), np.zeros(count)
    bend = np.zeros(count, dtype=bool)
    following = np.roll(wire.entry, -1, axis=0)
    for offset in (0, 1, -1, 2):
        j = (near + offset) % m
        # on the bend: the point's angle about the centre of the arc
        centre = wire.entry[j] + wire.radius * wire.inward[j]
        from_centre = points - centre
        x = -(from_centre * wire.inward[j]).sum(axis=1)
        y = (from_centre * wire.before[j]).sum(axis=1)
        turn = np.maximum(wire.turn[j], 1e-12)
        on_bend = np.clip(np.arctan2(y, x) / turn, 0.0, 1.0)
        # on the straight: the foot of the perpendicular
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
    """Return sites at most about `step` mm apart, in order, and their distances (k,) along the wire, mm."""
    bent = wire.radius * wire.turn
    lengths = np.column_stack([bent, np.maximum(wire.straight, 0.0)]).ravel()
    counts = np.maximum(1, np.ceil(lengths / step).astype(np.int64))
    piece = np.repeat(np.arange(len(lengths)), counts)
    first = np.repeat(np.cumsum(counts) - counts, counts)
    share = (np.arange(len(piece)) - first + 0.5) / counts[piece]
    along = (np.cumsum(lengths) - lengths)[piece] + share * lengths[piece]
    return WireSites(piece // 2, piece % 2 == 0, share), along


def differentiate_wire(wire: Wire, sites: WireSites) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Differentiate the points at `sites` and the lengths of the straights by the corners.

    A fillet depends on its corner and the two neighbours, and is differentiated by central differences. A
    point of piece j lies between fillets j and j + 1, so it depends on corners j - 1 to j + 2.

    Returns:
        Jacobians (3 k, 3 m) and (m, 3 m).
    """
    m, step = len(wire.corners), 1e-6
    around = wire.corners[(np.arange(m)[:, None] + np.arange(-1, 2)) % m][:, None]
    shifts = step * np.eye(9).reshape(9, 3, 3)
    ahead, behind = (_round_middle(around + s * shifts, wire.radius) for s in (1, -1))
    # derivatives by the coordinates of three corners: (m, 9, 3), of the turn (m, 9)
    before, inward, turn, entry, leave = (
        (a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)
    )
    j, s = sites.piece, sites.share[:, None, None]
    slopes = np.zeros((len(j), 12, 3))
    slopes[:, :9] = (1.0 - s) * leave[j]
    slopes[:, 3:] += s * entry[(j + 1) % m]
    j, s = j[sites.bend], s[sites.bend]
    angle = s * wire.turn[j][:, None, None]
    sine, cosine = np.sin(angle), np.cos(angle)
    sweep = cosine * wire.before[j][:, None] + sine * wire.inward[j][:, None]
    swept = s * turn[j][:, :, None] * sweep + sine * before[j] + (1.0 - cosine) * inward[j]
    slopes[sites.bend, :9] = entry[j] + wire.radius * swept
    slopes[sites.bend, 9:] = 0.0
    # to first order only movements of its ends along the straight change its length
    lengths = np.zeros((m, 12))
    along = np.roll(wire.before, -1, axis=0)[:, :, None]
    lengths[:, :9] = -(leave @ along)[:, :, 0]
    lengths[:, 3:] += (np.roll(entry, -1, axis=0) @ along)[:, :, 0]
    return _by_corners(slopes, sites.piece, m), _by_corners(lengths[:, :, None], np.arange(m), m)


def _by_corners(slopes: Array, piece: Indices, m: int) -> sparse.csr_matrix:
    """Spread slopes (k, 12, d), by the corners j - 1 to j + 2 of each piece j, into a matrix (d k, 3 m)."""
    from scipy import sparse

    k, _, d = slopes.shape
    corner = (piece[:, None] + np.arange(-1, 3)) % m
    column = np.repeat((3 * corner[:, :, None] + np.arange(3)).reshape(k, 12), d, axis=0)
    values = slopes.transpose(0, 2, 1).ravel()
    begins = 12 * np.arange(d * k + 1)
    return sparse.csr_matrix((values, column.ravel(), begins), shape=(d * k, 3 * m))


LEAST_TURN_DEG = 0.05  # bends by less are noted as straight


@dataclass(frozen=True)
class Bend:
    """One row of a bending plan: feed the wire by `feed_mm`, rotate it, bend it.

    `distance_mm` is where the bend begins, measured from the start along the straight wire.
    `rotation_deg` rotates the wire about its axis before the bend, clockwise as seen along the feed.
    `bend_deg` is the angle that stays, `tool_angle_deg` the one to bend to, since the wire springs back.
    The last row has no bend: it is the straight that ends at the joint.
    """

    distance_mm: float
    feed_mm: float
    rotation_deg: float
    bend_deg: float
    tool_angle_deg: float
    radius_mm: float
    note: str = ""


@dataclass(frozen=True)
class BendList:
    """The bending plan of one closed wire, and how the wire lies in the scene.

    It starts at the point `start` along the unit vector `direction`, and its first bend turns towards the
    unit vector `normal`.
    """

    bends: tuple[Bend, ...]
    start: Array
    direction: Array
    normal: Array

    @property
    def length_mm(self) -> float:
        """The length of wire to cut, along the centre line."""
        return self.bends[-1].distance_mm

    @property
    def count(self) -> int:
        """The number of bends."""
        return sum(bend.bend_deg > 0 for bend in self.bends)


def tool_angle_deg(bend_deg: float, springback_percent: float) -> float:
    """Return the angle to bend to so that `bend_deg` stays after springback, a share of the tool's angle."""
    return bend_deg / (1.0 - springback_percent / 100.0)


def list_bends(wire: Wire, straight: int, springback_percent: float) -> BendList:
    """Make the bending plan of a closed wire, which starts and ends in the middle of a straight.

    Args:
        straight: index of the straight to cut.
    """
    m = len(wire.corners)
    order = (straight + 1 + np.arange(m)) % m
    start = 0.5 * (wire.exit[straight] + wire.entry[(straight + 1) % m])
    direction, normal = wire.before[order[0]], wire.inward[order[0]]
    across, along = normal, direction
    rows, distance = [], 0.0
    feed = 0.5 * float(wire.straight[straight])
    for j in order:
        # angle from the last bend's direction to this one's, across the wire
        third = np.cross(along, across)
        rotation = float(np.rad2deg(np.arctan2(wire.inward[j] @ third, wire.inward[j] @ across)))
        turn = float(wire.turn[j])
        distance += feed
        angle = float(np.rad2deg(turn))
        tool = tool_angle_deg(angle, springback_percent)
        note = "" if angle >= LEAST_TURN_DEG else "as good as straight"
        rows.append(Bend(distance, feed, rotation, angle, tool, wire.radius, note))
        distance += wire.radius * turn
        along = np.cos(turn) * wire.before[j] + np.sin(turn) * wire.inward[j]
        across = np.cos(turn) * wire.inward[j] - np.sin(turn) * wire.before[j]
        feed = float(wire.straight[j])
    rows.append(Bend(distance + 0.5 * feed, 0.5 * feed, 0.0, 0.0, 0.0, 0.0, "joint"))
    return BendList(tuple(rows), start, direction, normal)
