"""A closed wire as the list that a person bends from: feed, turn the wire, bend, and again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array
from knotfab.wire.arcs import Wire

__all__ = ["Bend", "BendList", "list_bends", "tool_angle_deg"]

LEAST_TURN_DEG = 0.05


@dataclass(frozen=True)
class Bend:
    """One row: feed the wire by `feed_mm` (the straight before the bend), turn it, bend it.

    `distance_mm` is measured along the straight wire from its start to where the bend begins;
    `rotation_deg` turns the wire about itself before the bend, clockwise for one who looks along
    the feed; `bend_deg` is the angle that stays, `tool_angle_deg` the one to bend to, as the wire
    springs back. The last row has no bend: the straight that ends at the joint.
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
    """The rows of one closed wire, and where its start lies in the scene.

    `start`, `direction` and `normal` (3,): the wire starts at a point along a unit direction, and
    its first bend turns towards the unit normal (before its own rotation, which is 0).
    """

    bends: tuple[Bend, ...]
    start: Array
    direction: Array
    normal: Array

    @property
    def length_mm(self) -> float:
        """The length of wire to cut, at the centre line: where the last straight ends."""
        last = self.bends[-1]
        return last.distance_mm

    @property
    def count(self) -> int:
        """The number of bends."""
        return sum(bend.bend_deg > 0 for bend in self.bends)


def tool_angle_deg(bend_deg: float, springback_percent: float) -> float:
    """Return the angle to bend to so that `bend_deg` stays: the wire gives back a share of each bend."""
    return bend_deg / (1.0 - springback_percent / 100.0)


def list_bends(wire: Wire, straight: int, springback_percent: float) -> BendList:
    """List the rows of a closed wire that starts and ends in the middle of a straight.

    Args:
        straight: the number of the straight that is cut. Bends of less than `LEAST_TURN_DEG` would
            be none at all: they stay, but say so.
    """
    m = len(wire.corners)
    order = (straight + 1 + np.arange(m)) % m
    start = 0.5 * (wire.exit[straight] + wire.entry[(straight + 1) % m])
    direction, normal = wire.before[order[0]], wire.inward[order[0]]
    across, along = normal, direction
    rows, distance = [], 0.0
    feed = 0.5 * float(wire.straight[straight])
    for j in order:
        # the direction of the bend, told from the last one's in the plane across the wire
        third = np.cross(along, across)
        rotation = float(np.rad2deg(np.arctan2(wire.inward[j] @ third, wire.inward[j] @ across)))
        turn = float(wire.turn[j])
        distance += feed
        angle = float(np.rad2deg(turn))
        rows.append(
            Bend(
                distance,
                feed,
                rotation,
                angle,
                tool_angle_deg(angle, springback_percent),
                wire.radius,
                "" if angle >= LEAST_TURN_DEG else "as good as straight",
            )
        )
        distance += wire.radius * turn
        along = np.cos(turn) * wire.before[j] + np.sin(turn) * wire.inward[j]
        across = np.cos(turn) * wire.inward[j] - np.sin(turn) * wire.before[j]
        feed = float(wire.straight[j])
    rows.append(Bend(distance + 0.5 * feed, 0.5 * feed, 0.0, 0.0, 0.0, 0.0, "joint"))
    return BendList(tuple(rows), start, direction, normal)
