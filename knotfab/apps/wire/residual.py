"""The residuals that a wire fit minimises: distances, short straights, contacts, unlikeness to pictures."""

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

DEPTH_FACTOR = 2.0  # times the tolerance that is allowed along the rays of a single view
_GAP_MM = 0.05  # gap that the fit keeps between strands, for the rounding of the plan
_STRAIGHT_MARGIN_MM = 0.05  # extra length of straights, for the same reason
_CONTACT_STEP = 0.3  # wire diameters between the places that are kept apart
SAME_BEND = 0.5 * np.pi + 1.2  # diameters along the wire within which places are one strand
_STIFF_STRAIGHT = 30.0  # weight of a missing mm of straight
_STIFF_CONTACT = 24.0  # weight of an overlap, in tolerances
# least number of curve points searched to either side, and half a bend of 160 degrees in bend radii
_WINDOW, _HALF_BEND = 12, 1.4
_STIFF_DISTANCE = 20.0  # weight of a distance beyond the limit, in tolerances
_NEAR_LIMIT = 0.96  # share of the tolerance from which distances count when a picture is fitted


@dataclass
class Work:
    """The work that a plan may still do, in residuals of curve points, and when it must end."""

    points: int = 20_000_000  # about two minutes
    ends: float = np.inf  # by `time.perf_counter()`

    @property
    def over(self) -> str:
        """What has ended the work; empty while some is left."""
        late = time.perf_counter() >= self.ends
        return "--time-budget" if late else "its limit of work" if self.points <= 0 else ""


@dataclass(frozen=True)
class FitLimits:
    """The limits set by material and picture.

    `tolerance_mm` holds across the rays of the light; along them, where a change does not show in the
    shadow, `DEPTH_FACTOR` times as much is allowed.
    """

    bend_radius_mm: float
    min_straight_mm: float
    max_bend_deg: float
    wire_diameter_mm: float
    tolerance_mm: float
    light: Array | None = None  # (3,) of a single view; with several, all directions count alike
    work: Work = field(default_factory=Work)


@dataclass
class Strand:
    """A curve, and the corners of the wire that is being fitted to it."""

    points: Array  # (n, 3) of the curve
    scaled: Array  # (n, 3) the same, flattened along the light's axis
    corners: Array  # (m, 3)
    index: Indices  # (m,) rising; the curve point that belongs to each corner
    tolerance: Array  # (n,) mm, at each point

    def find_corners(self) -> Indices:
        """Return for each curve point (n,) the corner before it, which is also its straight's number."""
        n = len(self.points)
        number = np.searchsorted(self.index, np.arange(n), side="right") - 1
        return np.asarray(number % len(self.index))


def weigh_depth(offsets: Array, points: Array, light: Array | None) -> Array:
    """Divide the part of offsets (k, 3) along the light's ray through each point by `DEPTH_FACTOR`."""
    if light is None:
        return offsets
    ray = light - points
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    along = (offsets * ray).sum(axis=1)[:, None] * ray
    return np.asarray(offsets - (1.0 - 1.0 / DEPTH_FACTOR) * along)


def measure_distances(strand: Strand, wire: Wire, light: Array | None) -> tuple[WireSites, Array]:
    """Find the site on the wire nearest to each curve point, and its distance in tolerances."""
    sites, _ = find_nearest_sites(wire, strand.points, strand.find_corners())
    gap = weigh_depth(wire.at(sites) - strand.points, strand.points, light)
    return sites, np.asarray(np.linalg.norm(gap, axis=1) / strand.tolerance)


def measure_strays(strand: Strand, wire: Wire, limits: FitLimits) -> tuple[WireSites, Array, Array]:
    """Measure how far the wire strays from the curve, as it may in a turn.

    This is the opposite direction to `measure_distances`, which starts from the curve.

    Returns:
        Sites along the wire, their offsets (k, 3) from the curve in tolerances, and the derivatives
        (k, 3, 3) of these by a displacement of the wire.
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
    # the foot on the curve may lie between its points
    share = (gap * along).sum(axis=1) / np.maximum((along * along).sum(axis=1), 1e-18)
    gap = gap - np.clip(share, -0.25, 0.25)[:, None] * along
    metric = _make_metric(curve, np.zeros_like(curve), limits.light)
    metric = metric / strand.tolerance[near][:, None, None]
    return sites, np.einsum("kij,kj->ki", metric, gap), metric


def compute_residual(
    strands: list[Strand],
    corners: list[Array],
    weights: list[Array],
    limits: FitLimits,
    with_jacobian: bool,
    pictures: Sequence[GridLikeness] = (),
) -> tuple[Array, sparse.csr_matrix | None]:
    """Compute the residual vector of a fit, and its Jacobian by all corners if `with_jacobian`.

    It holds the weighted distances of the curve from the wire, strays of the wire beyond tolerance, missing
    lengths of straights, and contacts. With pictures it holds their unlikeness too, and distances count only
    near the tolerance.
    """
    offsets = np.cumsum([0] + [3 * len(c) for c in corners])
    wires = [round_corners(c, limits.bend_radius_mm) for c in corners]
    residuals: list[Array] = []
    rows: list[sparse.spmatrix] = []
    for number, (strand, wire) in enumerate(zip(strands, wires, strict=True)):
        sites, _ = find_nearest_sites(wire, strand.points, strand.find_corners())
        along = wire.tangent(sites)
        scale = np.sqrt(weights[number]) / strand.tolerance
        # sliding along the wire costs nothing
        metric = _make_metric(strand.points, along, limits.light) * scale[:, None, None]
        gap = wire.at(sites) - strand.points
        offset = np.einsum("kij,kj->ki", metric, gap)
        if pictures:
            offset, metric = _weigh_excess(offset, metric)
        residuals.append(offset.ravel())
        short = limits.min_straight_mm + _STRAIGHT_MARGIN_MM - wire.straight
        late = short > 0
        residuals.append(np.where(late, _STIFF_STRAIGHT * short, 0.0))
        if with_jacobian:
            jacobian, straights = differentiate_wire(wire, sites)
            rows.append(_put_in_columns(_join_blocks(metric) @ jacobian, offsets, number))
            push = sparse.diags(np.where(late, -_STIFF_STRAIGHT, 0.0)) @ straights
            rows.append(_put_in_columns(push, offsets, number))
        sites, offset, metric = measure_strays(strand, wire, limits)
        offset, metric = _weigh_excess(offset, metric)
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


def _weigh_excess(offset: Array, metric: Array) -> tuple[Array, Array]:
    """Weigh the part of offsets (k, 3), in tolerances, beyond the limit, and its derivative."""
    size = np.linalg.norm(offset, axis=1)
    along = offset / np.maximum(size, 1e-9)[:, None]
    held = np.where(size > _NEAR_LIMIT, _STIFF_DISTANCE, 0.0)
    outward = along[:, :, None] * np.einsum("ki,kij->kj", along, metric)[:, None, :]
    return (held * (size - _NEAR_LIMIT))[:, None] * along, held[:, None, None] * outward


def _make_metric(points: Array, along: Array, light: Array | None) -> Array:
    """Return the maps (k, 3, 3) from a displacement of the wire to its weighted offset across itself."""
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
    """Widen a strand's block to the columns of all strands."""
    left = sparse.csr_matrix((block.shape[0], int(offsets[number])))
    right = sparse.csr_matrix((block.shape[0], int(offsets[-1] - offsets[number + 1])))
    return sparse.hstack([left, block, right]).tocsr()


def measure_gaps(wires: list[Wire], limits: FitLimits) -> list[Array]:
    """Measure for each wire (m,) how near (mm) its bend and straight j come to another strand.

    Infinite where that is farther than the fit keeps strands apart.
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
    """Sample all wires, and find pairs of samples on different strands that are too close.

    Returns:
        Sites of each wire; points and wire numbers of all samples; pairs of samples (k, 2).
    """
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
    """Return residuals that push apart strands closer than the wire's diameter, and their Jacobian."""
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
    # only samples that are too close need derivatives
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


# unlikeness to pictures

_CELL = 0.4  # size of a grid cell, in wire radii as the light sees them
_STEP = 0.25  # wire radii between samples of a wire
_REACH = 2.0  # width of the border about the picture, in wire radii
_FELT = 8.0  # widths of the soft edge beyond which a cell has no gradient


@dataclass(frozen=True)
class GridLikeness:
    """A view's picture on a coarse grid, to compare with the shadow of wires.

    A cell's darkness is a logistic function of its distance from the nearest strand, and its residual the
    difference to the picture. The sum of squares is an area in squared wire radii.
    """

    geometry: ViewGeometry
    pixels: Array  # (k, 2) middles of the cells
    wanted: Array  # (k,) share of each cell that is dark in the picture
    radius: float  # of the wire, mm
    scale: float  # side of a cell, in wire radii

    @classmethod
    def for_view(cls, geometry: ViewGeometry, target: Mask, radius: float) -> GridLikeness:
        """Reduce a silhouette (height, width) on a view's pixels to a grid for a wire of a radius in mm."""
        _, (w,) = geometry.project(np.zeros((1, 3)))
        wide = radius / (w * geometry.pixel_mm)  # radius of the wire's shadow in pixels
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
        """Return the residuals of all cells (k,), and their Jacobians by each wire's corners, (k, 3 m)."""
        sampled = [space_sites(w, _STEP * self.radius)[0] for w in wires]
        counts = [len(s.piece) for s in sampled]
        points = np.concatenate([w.at(s) for w, s in zip(wires, sampled, strict=True)])
        seen, w = self.geometry.project(points)
        away, near = cKDTree(seen).query(self.pixels)
        wide = (self.radius / self.geometry.pixel_mm) / w[near]
        steep = 1.0 / (0.25 * wide)  # an edge fades over a quarter of the wire's radius
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
        """Differentiate the projected pixels of points (k, 3) by central differences, (k, 2, 3)."""
        step = 1e-4
        columns = []
        for axis in step * np.eye(3):
            ahead, behind = (self.geometry.project(points + s * axis)[0] for s in (1, -1))
            columns.append((ahead - behind) / (2 * step))
        return np.stack(columns, axis=-1)
