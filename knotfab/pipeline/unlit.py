"""Guess before a search how much of its picture a piece tells unlit, from the strands that it begins with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotfab.base.arrays import Array, Indices
from knotfab.design.survey import Survey
from knotfab.geometry.tube import unit
from knotfab.hold.roots import Roots, guess_roots
from knotfab_validators.shadows.told import tell

_SIDES = 6  # of a prism for each edge: a look at it has 15 cells across
_BLANK = ("rounded", "full")  # plates that tell nothing themselves


def guess_told(found: Survey) -> float | None:
    """Return the share of its picture that a piece of arches tells from the worst side; None if unknown."""
    mount, seen = found.scene.mount, found.views[0]
    if found.start is None or not found.guess.alone or mount.plate not in (*_BLANK, "roots"):
        return None
    corners, faces = _draw_strands(found.start.curves, found.radius_mm)
    parts = {"knots": faces}
    roots = guess_roots(seen.target.mask, seen.wall_mm_per_px) if mount.plate == "roots" else None
    if roots is not None:
        strips, held = _draw_roots(roots, seen.view.frame_mm, float(corners[:, 2].min()))
        held = held + len(corners)
        corners = np.concatenate([corners, strips])
        parts |= {"holder": held, "whole": np.concatenate([faces, held])}
    told = tell(corners, parts, np.eye(3), seen.target.mask)
    return None if told is None else told[0].worst.share


def _draw_strands(curves: Sequence[Array], radius: float) -> tuple[Array, Indices]:
    """Return corners (n, 3) and faces (m, 3) of a prism about each edge, however sharply the curves bend."""
    here = np.concatenate([*curves])
    along = np.concatenate([np.roll(curve, -1, axis=0) for curve in curves]) - here
    aside = unit(
        np.cross(along, np.where(abs(along[:, :1]) < abs(along[:, 1:2]), (1, 0, 0), (0, 1, 0)))
    )
    turns = np.arange(_SIDES)[:, None, None] * (2 * np.pi / _SIDES)
    ring = radius * (np.cos(turns) * aside + np.sin(turns) * unit(np.cross(along, aside)))
    corners = np.stack([here + ring, here + along + ring])  # (end, side, edge, 3)
    index = np.arange(2 * _SIDES * len(here)).reshape(corners.shape[:-1])
    low, high = index
    left, right = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    faces = np.stack([[low, left, high], [left, right, high]]).transpose(0, 2, 3, 1)
    return corners.reshape(-1, 3), faces.reshape(-1, 3)


def _draw_roots(roots: Roots, frame_mm: tuple[float, float], depth: float) -> tuple[Array, Indices]:
    """Return corners (n, 3) and faces (m, 3) of strips on the wall, at this depth."""
    middle = np.array(frame_mm) / 2
    here, there = ((roots.points[roots.ends[:, k]] - middle) * (1, -1) for k in (0, 1))
    aside = unit((there - here)[:, ::-1] * (-1, 1)) * roots.widths[:, None] / 2
    corners = np.concatenate([here - aside, here + aside, there - aside, there + aside])
    index = np.arange(len(corners)).reshape(4, -1).T
    faces = np.concatenate([index[:, :3], index[:, 1:]])
    return np.pad(corners, ((0, 0), (0, 1)), constant_values=depth), faces
