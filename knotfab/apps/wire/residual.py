"""Residuals that a fit of straights and bends makes small: distances, short straights, touching wires."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree
from scipy.special import expit

from knotfab.apps.wire.arcs import (
    Wire,
    WireSites,
    differentiate_wire,
    find_nearest_sites,
    round_corners,
    space_sites,
)
from knotfab.base.arrays import Array, Indices, Mask

if TYPE_CHECKING:
    from knotfab_validators.shadows.view import ViewGeometry


DEPTH_FACTOR = 2.0  # along the rays of a single view so many times the tolerance is allowed
_GAP_MM = 0.05  # the gap that the fit keeps between wires, for the rounding of the plan
_STRAIGHT_MARGIN_MM = 0.05
_CONTACT_STEP = 0.3  # wire diameters between the places that are kept apart
# diameters along the wire: places nearer than that are no two strands
SAME_BEND = 0.5 * np.pi + 1.2
_STIFF_STRAIGHT = 30.0  # weight of a missing mm of straight
_STIFF_CONTACT = 24.0
# points of the curve to either side of where a place of the wire is looked for, at least; the half of a
# bend of 160 degrees, in radii of it
_WINDOW, _HALF_BEND = 12, 1.4
_STIFF_DISTANCE = 20.0
_NEAR_LIMIT = 0.96  # share of the tolerance from which a distance counts beside a picture


@dataclass
class Work:
    """Bounds a plan's work: points of the curves that may still be asked, and until when."""

    points: int = 20_000_000  # some two minutes
    ends: float = np.inf  # by `time.perf_counter()`

    @property
    def over(self) -> str:
        """What has ended the work; empty while there is some left."""
        late = time.perf_counter() >= self.ends
        return "--time-budget" if late else "its limit of work" if self.points <= 0 else ""


@dataclass(frozen=True)
class FitLimits:
    """The limits that material and picture set (mm, degrees).

    `tolerance_mm` holds across the ray from the light; along it, where the shadow does not see a
    change, `DEPTH_FACTOR` times as much.
    """

    bend_radius_mm: float
    min_straight_mm: float
    max_bend_deg: float
    wire_diameter_mm: float
    tolerance_mm: float
    work: Work = field(default_factory=Work)


@dataclass
class Strand:
    """One knot in the making: the curve's points, the wire, and which point is at which corner."""

    points: Array
    scaled: Array
    corners: Array
    index: Indices  # (m,) rising; the point of the curve that each corner stands for
    tolerance: Array  # (n,) mm, at each point

    def near(self) -> Indices:
        """Return (n,) the corner whose straight each point lies about."""
        n = len(self.points)
        number = np.searchsorted(self.index, np.arange(n), side="right") - 1
        return np.asarray(number % len(self.index))


def weigh_depth(offsets: Array, points: Array, light: Array | None) -> Array:
    """Return offsets (k, 3) with their part along the light's ray through each point divided."""
    if light is None:
        return offsets
    ray = light - points
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    along = (offsets * ray).sum(axis=1)[:, None] * ray
    return np.asarray(offsets - (1.0 - 1.0 / DEPTH_FACTOR) * along)


def measure_distances(strand: Strand, wire: Wire, light: Array | None) -> tuple[WireSites, Array]:
    """Find where on the wire each point of the curve is met, and the distance as a share of the tolerance."""
    sites, _ = find_nearest_sites(wire, strand.points, strand.near())
    gap = weigh_depth(wire.at(sites) - strand.points, strand.points, light)
    return sites, np.asarray(np.linalg.norm(gap, axis=1) / strand.tolerance)


def measure_strays(
    strand: Strand, wire: Wire, light: Array | None, limits: FitLimits
) -> tuple[WireSites, Array, Array]:
    """Measure places along the wire, their offsets (k, 3) from the curve in tolerances, and the map (k, 3, 3)
    from a displacement there to that.

    The other way round than `measure_distances`: a wire may reach farther than its curve, as in a turn.
    """
    sites, _ = space_sites(wire, _CONTACT_STEP * limits.wire_diameter_mm)
    n, index = len(strand.points), strand.index
    span = (np.roll(index, -1) - index) % n
    share = np.where(sites.bend, 0.0, sites.share)
    guess = index[sites.piece] + np.rint(share * span[sites.piece]).astype(np.int64)
    step = float(np.linalg.norm(np.diff(strand.points, axis=0), axis=1).mean())
    reach = min(max(_WINDOW, round(_HALF_BEND * limits.bend_radius_mm / step)), n // 2)
    window = (guess[:, None] + np.arange(-reach, reach + 1)) % n
    points = wire.at(sites)
    gap = points[:, None] - strand.points[window]
    near = window[np.arange(len(points)), np.einsum("kwi,kwi->kw", gap, gap).argmin(axis=1)]
    curve, along = strand.points[near], strand.points[(near + 1) % n] - strand.points[near - 1]
    gap = points - curve
    # the nearest place lies up to half a step from the nearest point
    share = (gap * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-18)
    gap = gap - np.clip(share, -0.25, 0.25)[:, None] * along
    metric = _make_metric(curve, np.zeros_like(curve), light)
    metric = metric / strand.tolerance[near][:, None, None]
    return sites, np.einsum("kij,kj->ki", metric, gap), metric


def compute_residual(
    strands: list[Strand],
    corners: list[Array],
    weights: list[Array],
    light: Array | None,
    limits: FitLimits,
    with_jacobian: bool,
    pictures: Sequence[GridLikeness] = (),
) -> tuple[Array, sparse.csr_matrix | None]:
    """Return weighted distances, straights too short and contacts, and how they follow the corners.

    With pictures it is these that the wire is to draw, and only distances near the tolerance count, as
    those of the wire from the curve always do.
    """
    offsets = np.cumsum([0] + [3 * len(c) for c in corners])
    wires = [round_corners(c, limits.bend_radius_mm) for c in corners]
    residuals: list[Array] = []
    rows: list[sparse.spmatrix] = []
    for number, (strand, wire) in enumerate(zip(strands, wires, strict=True)):
        sites, _ = find_nearest_sites(wire, strand.points, strand.near())
        along = wire.tangent(sites)
        scale = np.sqrt(weights[number]) / strand.tolerance
        # sliding along the wire is free
        metric = _make_metric(strand.points, along, light) * scale[:, None, None]
        gap = wire.at(sites) - strand.points
        offset = np.einsum("kij,kj->ki", metric, gap)
        if pictures:
            offset, metric = _beyond(offset, metric)
        residuals.append(offset.ravel())
        short = limits.min_straight_mm + _STRAIGHT_MARGIN_MM - wire.straight
        late = short > 0
        residuals.append(np.where(late, _STIFF_STRAIGHT * short, 0.0))
        if with_jacobian:
            jacobian, straights = differentiate_wire(wire, sites)
            rows.append(_put_in_columns(_join_blocks(metric) @ jacobian, offsets, number))
            push = sparse.diags(np.where(late, -_STIFF_STRAIGHT, 0.0)) @ straights
            rows.append(_put_in_columns(push, offsets, number))
        sites, offset, metric = measure_strays(strand, wire, light, limits)
        offset, metric = _beyond(offset, metric)
        residuals.append(offset.ravel())
        if with_jacobian:
            block = _join_blocks(metric) @ differentiate_wire(wire, sites)[0]
            rows.append(_put_in_columns(block, offsets, number))
    for picture in pictures:
        unlike, blocks = picture.residual(wires, with_jacobian)
        residuals.append(unlike)
        if with_jacobian:
            rows.append(sparse.hstack(blocks))
    contact, contact_rows = _push_apart(wires, offsets, limits, with_jacobian)
    residuals.append(contact)
    if not with_jacobian:
        return np.concatenate(residuals), None
    if contact_rows is not None:
        rows.append(contact_rows)
    return np.concatenate(residuals), sparse.vstack(rows).tocsr()


def _beyond(offset: Array, metric: Array) -> tuple[Array, Array]:
    """Weigh the excess of offsets (k, 3), in tolerances, beyond the limit, and its derivative."""
    size = np.linalg.norm(offset, axis=1)
    along = offset / np.maximum(size, 1e-9)[:, None]
    held = np.where(size > _NEAR_LIMIT, _STIFF_DISTANCE, 0.0)
    outward = along[:, :, None] * np.einsum("ki,kij->kj", along, metric)[:, None, :]
    return (held * (size - _NEAR_LIMIT))[:, None] * along, held[:, None, None] * outward


def _make_metric(points: Array, along: Array, light: Array | None) -> Array:
    """Make (k, 3, 3) the map from a displacement of the wire to its weighted offset across itself."""
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    if light is None:
        return np.asarray(across)
    ray = light - points
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    return np.asarray(
        (np.eye(3) - (1 - 1 / DEPTH_FACTOR) * ray[:, :, None] * ray[:, None, :]) @ across
    )


def _join_blocks(blocks: Array) -> sparse.csr_matrix:
    n = len(blocks)
    return sparse.csr_matrix(
        sparse.bsr_matrix((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n))
    )


def _put_in_columns(block: sparse.spmatrix, offsets: Indices, number: int) -> sparse.csr_matrix:
    """Return a strand's block in the columns of all strands."""
    left = sparse.csr_matrix((block.shape[0], int(offsets[number])))
    right = sparse.csr_matrix((block.shape[0], int(offsets[-1] - offsets[number + 1])))
    return sparse.hstack([left, block, right]).tocsr()


def measure_gaps(wires: list[Wire], limits: FitLimits) -> list[Array]:
    """Measure (m,) for each wire: how near its bend and straight j come to another strand (mm).

    Infinite where that is farther than what the fit keeps, a diameter and a gap.
    """
    sampled, points, owner, pairs = _find_contacts(wires, limits, 0.5 * _CONTACT_STEP)
    gaps = [np.full(len(w.corners), np.inf) for w in wires]
    piece = np.concatenate([s.piece for s in sampled])
    distance = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    for end in pairs.T:
        for k, gap in enumerate(gaps):
            own = owner[end] == k
            np.minimum.at(gap, piece[end[own]], distance[own])
    return gaps


def _find_contacts(
    wires: list[Wire], limits: FitLimits, step: float
) -> tuple[list[WireSites], Array, Indices, Indices]:
    """Find places along all wires, their points and wires, and the pairs (k, 2) that are too near."""
    least = limits.wire_diameter_mm + _GAP_MM
    spaced = [space_sites(w, step * limits.wire_diameter_mm) for w in wires]
    sampled = [sites for sites, _ in spaced]
    points = np.concatenate([w.at(s) for w, s in zip(wires, sampled, strict=True)])
    owner = np.repeat(np.arange(len(wires)), [len(s.piece) for s in sampled])
    along = np.concatenate([a for _, a in spaced])
    length = np.array([w.length_mm for w in wires])
    pairs = cKDTree(points).query_pairs(least, output_type="ndarray").reshape(-1, 2)
    a, b = pairs.T
    apart = np.abs(along[a] - along[b])
    apart = np.minimum(apart, length[owner[a]] - apart)
    keep = (owner[a] != owner[b]) | (apart > SAME_BEND * limits.wire_diameter_mm)
    return sampled, points, owner, pairs[keep]


def _push_apart(
    wires: list[Wire], offsets: Indices, limits: FitLimits, with_jacobian: bool
) -> tuple[Array, sparse.csr_matrix | None]:
    """Return residuals that push apart strands nearer than the wire's diameter."""
    sampled, points, owner, pairs = _find_contacts(wires, limits, _CONTACT_STEP)
    if not len(pairs):
        return np.zeros(0), None
    a, b = pairs.T
    offset = points[a] - points[b]
    distance = np.linalg.norm(offset, axis=1)
    stiff = _STIFF_CONTACT / limits.tolerance_mm
    push = stiff * (limits.wire_diameter_mm + _GAP_MM - distance)
    if not with_jacobian:
        return push, None
    # only the places that are too near move anything
    used, place = np.unique(pairs, return_inverse=True)
    first_of = np.searchsorted(owner, np.arange(len(wires)))
    blocks = []
    for k, (wire, sites) in enumerate(zip(wires, sampled, strict=True)):
        own = used[owner[used] == k] - first_of[k]
        part = WireSites(sites.piece[own], sites.bend[own], sites.share[own])
        blocks.append(_put_in_columns(differentiate_wire(wire, part)[0], offsets, k))
    jacobian = sparse.vstack(blocks).tocsr()
    unit = (offset / np.maximum(distance, 1e-9)[:, None]).ravel()
    row, axis = np.repeat(np.arange(len(a)), 3), np.arange(3)
    shape = (len(a), jacobian.shape[0])
    first, second = (
        sparse.csr_matrix((unit, (row, (3 * end[:, None] + axis).ravel())), shape=shape)
        for end in place.reshape(-1, 2).T
    )
    return push, -stiff * (first - second) @ jacobian


# The distance of a wire's shadow from a picture, as residuals that a fit makes small.


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
