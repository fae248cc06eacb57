"""The distance of a wire's shadow from a picture, as residuals that a fit makes small."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree
from scipy.special import expit

from knotfab.base.arrays import Array, Mask
from knotfab.wire.arcs import Wire, WireSites, differentiate_wire, space_sites

if TYPE_CHECKING:
    from knotfab_validators.shadows.view import ViewGeometry

__all__ = ["GridLikeness"]


_CELL = 0.4  # wire radii, as the light sees them, between the pixels that are looked at
_STEP = 0.25  # wire radii between the places along a wire
_REACH = 2.0  # wire radii beyond the picture that are looked at
_FELT = 8.0  # fadings from an edge: farther, a pixel moves no strand


@dataclass(frozen=True)
class GridLikeness:
    """A view's picture on a coarse grid: what share of each cell is wanted dark.

    A cell is as dark as its distance from the nearest strand makes it (a logistic edge); its residual is that
    less what is wanted, so that the sum of squares is an area in squared wire radii.
    """

    geometry: ViewGeometry
    pixels: Array  # (k, 2)
    wanted: Array  # (k,), 0 to 1
    radius: float  # the wire's, mm
    scale: float  # root of a cell's area, in wire radii

    @classmethod
    def of(cls, geometry: ViewGeometry, target: Mask, radius: float) -> GridLikeness:
        """Make the likeness to a silhouette (height, width) on a view's pixels; the wire's radius in mm."""
        _, (w,) = geometry.project(np.zeros((1, 3)))
        wide = radius / (w * geometry.pixel_mm)  # the wire's, in pixels
        size = max(1, round(_CELL * wide))
        height, width = (n - n % size for n in target.shape)
        cells = target[:height, :width].reshape(height // size, size, width // size, size)
        shares = cells.mean(axis=(1, 3))
        rows, columns = np.nonzero(shares > 0)
        dark = cKDTree(np.column_stack([columns, rows]))
        every = np.argwhere(np.ones(shares.shape, dtype=bool))[:, ::-1]
        away, _ = dark.query(every, distance_upper_bound=_REACH * wide / size)
        near = every[np.isfinite(away)]
        pixels = near * float(size) + 0.5 * (size - 1)
        wanted = shares[near[:, 1], near[:, 0]]
        return cls(geometry, pixels, wanted, radius, size / wide)

    def residual(
        self, wires: list[Wire], with_jacobian: bool
    ) -> tuple[Array, list[sparse.csr_matrix]]:
        """Return (k,) of all cells, and how they follow the corners of each wire (k, 3 m)."""
        sampled = [space_sites(w, _STEP * self.radius)[0] for w in wires]
        counts = [len(s.piece) for s in sampled]
        points = np.concatenate([w.at(s) for w, s in zip(wires, sampled, strict=True)])
        seen, w = self.geometry.project(points)
        away, near = cKDTree(seen).query(self.pixels)
        wide = (self.radius / self.geometry.pixel_mm) / w[near]
        steep = 1.0 / (0.25 * wide)  # wire radii over which a strand's edge fades
        dark = expit((wide - away) * steep)
        residual = self.scale * (dark - self.wanted)
        if not with_jacobian:
            return residual, []
        felt = np.flatnonzero(np.abs((wide - away) * steep) < _FELT)
        used, place = np.unique(near[felt], return_inverse=True)
        slopes = self._project_slopes(points[used])[place]  # (f, 2, 3)
        towards = (self.pixels[felt] - seen[near[felt]]) / np.maximum(away[felt], 1e-9)[:, None]
        pull = self.scale * (dark * (1.0 - dark) * steep)[felt]
        rows = pull[:, None] * np.einsum("ki,kij->kj", towards, slopes)
        blocks, begun = [], 0
        for wire, sites, count in zip(wires, sampled, counts, strict=True):
            own = (used >= begun) & (used < begun + count)
            index = used[own] - begun
            part = WireSites(sites.piece[index], sites.bend[index], sites.share[index])
            number = np.cumsum(own) - 1
            mine = np.flatnonzero(own[place])
            column = 3 * number[place[mine]][:, None] + np.arange(3)
            pick = sparse.csr_matrix(
                (rows[mine].ravel(), (np.repeat(felt[mine], 3), column.ravel())),
                shape=(len(self.pixels), 3 * len(index)),
            )
            blocks.append(pick @ differentiate_wire(wire, part)[0])
            begun += count
        return residual, blocks

    def _project_slopes(self, points: Array) -> Array:
        """Return (k, 2, 3) how the pixels of points (k, 3) follow them, by central differences."""
        step = 1e-4
        columns = []
        for axis in step * np.eye(3):
            ahead, behind = (self.geometry.project(points + s * axis)[0] for s in (1, -1))
            columns.append((ahead - behind) / (2 * step))
        return np.stack(columns, axis=-1)
