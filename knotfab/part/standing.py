"""Make a piece stand while it prints without supports: level feet, and break-away bars between its legs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.legs import Bar, find_legs, plan_bars
from knotfab.geometry.tube import Mesh, as_manifold, as_mesh
from knotfab.knots import Knots
from knotfab.part.plates import clean_body
from knotfab.part.pose import PrintPose
from knotfab_formats.upright import MOST_BRIDGE_MM

CUT_RADII = 0.5  # of the lowest feet, so that each stands flat


@dataclass(frozen=True)
class Standing:
    """How a piece stands: what is cut off its feet, mm, how many those are, and its bars.

    `unbraced` (k, 3): places where a leg would need a bar, and no neighbour is in reach.
    """

    cut_mm: float
    feet: int
    bars: tuple[Bar, ...]
    unbraced: Array


def stand(
    pose: PrintPose,
    bodies: list[Mesh],
    young_modulus_mpa: float,
    hidden: Callable[[Array], bool],
    in_plate: bool = False,
) -> tuple[PrintPose, list[Mesh], Standing]:
    """Cut the feet of a piece level and lay it on them, unless they end in a plate, and plan its bars.

    Args:
        pose: with the light's axis up. bodies: in its coordinates. hidden: as for `plan_bars`.

    Returns:
        The pose and the bodies, cut, without the bars, which are in the pose's coordinates.
    """
    knots = pose.knots
    cut = 0.0 if in_plate else CUT_RADII * knots.radius_mm
    legs = find_legs([knot.points for knot in knots.knots])
    planned, lacking = plan_bars(legs, knots.radius_mm, young_modulus_mpa, hidden)
    down = np.array([0.0, 0.0, -cut])
    bars = tuple(Bar(b.start + down, b.end + down, b.gap_mm) for b in planned)
    assert max((bar.gap_mm for bar in bars), default=0.0) < MOST_BRIDGE_MM
    shift = np.eye(4)
    shift[:3, 3] = down
    cuts = [_cut_level(body, cut) if cut else body for body in bodies]
    laid = replace(
        pose,
        matrix=pose.matrix @ np.linalg.inv(shift),
        knots=Knots(knots.moved(shift).knots, knots.radius_mm),
        tubes=tuple(cuts),
    )
    return laid, cuts, Standing(cut, len(legs) // 2, bars, lacking + down)


def _cut_level(body: Mesh, height: float) -> Mesh:
    """Return what of a body is above a height, laid on the bed."""
    vertices, faces = as_mesh(as_manifold(body).trim_by_plane((0.0, 0.0, 1.0), height))
    vertices[:, 2] = np.maximum(vertices[:, 2] - height, 0.0)
    return clean_body((vertices, faces))
