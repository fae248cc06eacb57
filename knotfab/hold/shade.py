"""Find where a mount may run unseen: pixels of every view that picture and knots darken anyway.

Matter that lies behind dark pixels in every view, or below every frame, changes no shadow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.geometry.polylines import arc_lengths, number_runs, project
from knotfab.hold.struts import (
    SAMPLE_RADII,
    Candidates,
    Sites,
    list_struts,
    off_segments,
    opens_slowly,
    ring_neighbours,
    sample_strands,
    tangents,
)
from knotfab.knots import Knots
from knotfab.picture.silhouette import fit_size, sample_mask
from knotfab.render.silhouette import cast, frame_of
from knotfab.scene.camera import Camera
from knotfab_formats.scene import VERIFIED_PX

SLACK_PX = 1.0  # a hidden strip stays inside by this: half a pixel on each side
HIDDEN_SHARE = 0.75  # a hidden strut's radius over the tube's
LOOKS = 12  # along a member, for whether it is hidden
AT_ONCE = 2000  # members whose shadows are looked at a pixel apart
ACROSS = (-0.8, -0.4, 0.0, 0.4, 0.8)  # places in half widths at which a strip's shadow is looked at


class MountShadows:
    """The shadows of one piece in all its views; what a member darkens is looked up in each."""

    def __init__(
        self, knots: Knots, cameras: Sequence[Camera], targets: Sequence[Mask], ends: bool = False
    ) -> None:
        self.views = tuple(
            MountShadow(knots, camera, target, ends)
            for camera, target in zip(cameras, targets, strict=True)
        )

    def twin(self) -> MountShadows:
        """Copy the shadows, so that members can be added to the copy only."""
        found = copy(self)
        found.views = tuple(copy(view) for view in self.views)
        return found

    @property
    def pixels(self) -> float:
        """The mean number of pixels of a frame, over all views."""
        return sum(view.pixels for view in self.views) / max(len(self.views), 1)

    def add(self, some: Candidates) -> None:
        """Darken what members cover."""
        for view in self.views:
            view.add(some)

    def darken(self, some: Candidates) -> Array:
        """Return the share of each frame that only members darken, (views,)."""
        return np.array([view.darken(some) for view in self.views])

    def hidden(self, some: Candidates) -> Mask:
        """Return whether each member's whole shadow lies where the picture is dark, in all views, (n,)."""
        return self._in_all(some, MountShadow.hidden)

    def behind_knots(self, some: Candidates) -> Mask:
        """Return whether each member's whole shadow lies in the knots', in all views, (n,)."""
        return self._in_all(some, MountShadow.behind_knots)

    def _in_all(self, some: Candidates, unseen: Callable[[MountShadow, Candidates], Mask]) -> Mask:
        """Return what `unseen` says of each member, (n,), if it says so in all views."""
        found = np.ones(len(some), dtype=bool)
        for view in self.views:
            left = np.flatnonzero(found)
            found[left] = unseen(view, some.take(left))
        return found

    def cost(
        self, some: Candidates, samples: int = 40, across: tuple[float, ...] = ACROSS
    ) -> Array:
        """Estimate how many more pixels members would darken, over all views, (n,)."""
        return np.asarray(sum(view.cost(some, samples, across) for view in self.views))


class MountShadow:
    """The dark pixels of one view's frame, at `VERIFIED_PX`, and those that a mount adds.

    Below the frame there is no picture and all counts as dark. Beside and above it all is light,
    unless the screen ends there (`ends`).

    Attributes:
        camera: that of the frame's fine pixels. own: (H + 2, W + 2), dark where the knots are, with a row or
            column on each side of the frame. before: dark where picture or knots are. dark: the same with
            the members that were added.
    """

    def __init__(self, knots: Knots, camera: Camera, target: Mask, ends: bool = False) -> None:
        width, height = fit_size(camera.width, camera.height, VERIFIED_PX)
        self.camera = camera.resized(width, height)
        self.before = np.zeros((height + 2, width + 2), dtype=bool)
        self.before[1:-1, 1:-1] = sample_mask(target, width, height)
        self.before[-1] = True
        if ends:
            self.before[0] = self.before[:, 0] = self.before[:, -1] = True
        self.magnification = self._magnification()
        self._frame = frame_of(self.camera, np.float32, stretched=True)
        self.own = np.zeros_like(self.before)
        ahead = knots.points[knots.rings.next]
        self.own[1:-1, 1:-1] = cast(knots.points, ahead, self._frame, knots.radius_mm)
        self.before |= self.own
        self.dark = self.before.copy()
        self._depth = np.asarray(distance_transform_edt(self.before))

    @property
    def pixels(self) -> int:
        """The number of pixels of the frame."""
        return self.camera.width * self.camera.height

    def add(self, some: Candidates) -> None:
        """Darken what members cover."""
        self.dark = self.dark | self._cast(some)

    def darken(self, some: Candidates) -> float:
        """Return the share of the frame that only members darken, outside picture and knots."""
        more = self._cast(some) & ~self.before
        return float(more[1:-1, 1:-1].sum()) / self.pixels

    def hidden(self, some: Candidates) -> Mask:
        """Return whether each member's whole shadow lies where picture or knots are dark anyway, (n,)."""
        found = np.ones(len(some), dtype=bool)
        # the middle first: few candidates are left for the rest
        for t in np.argsort(np.abs(np.linspace(0, 1, LOOKS) - 0.5)) / (LOOKS - 1):
            left = np.flatnonzero(found)
            start = some.start[left]
            uv, half = self._seen(start + t * (some.end[left] - start), some.radius[left])
            found[left] = self._depth[self._cell(uv)] >= half + SLACK_PX
        return found

    def behind_knots(self, some: Candidates) -> Mask:
        """Return whether each member's whole shadow lies in that of the knots, (n,).

        The shadow is sampled along the member, at most a pixel apart.
        """
        depth = np.asarray(distance_transform_edt(self.own))
        a, half_a = self._seen(some.start, some.radius)
        b, half_b = self._seen(some.end, some.radius)
        steps = np.ceil(np.linalg.norm(b - a, axis=1)).astype(np.int64) + 1
        light = np.zeros(len(some), dtype=bool)
        for some_at_once in np.array_split(np.arange(len(some)), len(some) // AT_ONCE + 1):
            run, number = number_runs(steps[some_at_once])
            n = some_at_once[run]
            t = number / np.maximum(steps[n] - 1, 1)
            there = a[n] + t[:, None] * (b[n] - a[n])
            half = half_a[n] + t * (half_b[n] - half_a[n])
            light[n[depth[self._cell(there)] < half + SLACK_PX / 2]] = True
        return ~light

    def cost(
        self, some: Candidates, samples: int = 40, across: tuple[float, ...] = ACROSS
    ) -> Array:
        """Estimate how many more pixels of the frame members would darken, (n,).

        Each shadow is sampled at `samples` places along it, and at the shares `across` of half its width.
        """
        a, half_a = self._seen(some.start, some.radius)
        b, half_b = self._seen(some.end, some.radius)
        along = b - a
        length = np.linalg.norm(along, axis=1)
        normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.maximum(length, 1e-9)[:, None]
        light, aside = np.zeros(len(some)), np.array(across)[:, None]
        for t in (np.arange(samples) + 0.5) / samples:
            # evenly in the picture, not in space: both ends are nearly equally far from the light
            middle, half = a + t * along, half_a + t * (half_b - half_a)
            there = middle + (aside * half)[:, :, None] * normal
            for dark in self.dark[self._cell(there)]:
                light += ~dark * half
        cost: Array = light * 2 * length / (samples * len(across))
        return cost

    def _seen(self, points: Array, radius: Array | float) -> tuple[Array, Array]:
        """Return where points are seen, px (n, 2), and how many px the radius covers (n,)."""
        seen = project(points, self.camera.projection)
        return seen.places, radius * self.magnification / seen.depth

    def _magnification(self) -> float:
        """Return how many pixels a millimetre across the view covers on the receiver, at most."""
        c = self.camera
        across, down = np.linalg.norm(c.du), np.linalg.norm(c.dv)
        out = c.receiver[:3]
        view = c.corner + 0.5 * (c.width * c.du + c.height * c.dv) - c.eye
        slant = abs(float(out @ view)) / float(np.linalg.norm(view))
        return float(1.0 / (min(across, down) * slant))

    def _cell(self, uv: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        height, width = self.before.shape
        whole = np.rint(uv).astype(np.int64) + 1
        # np.clip asks for the limits of its type at each call, which takes longer than small arrays do
        row, column = np.maximum(whole[..., 1], 0), np.maximum(whole[..., 0], 0)
        return np.minimum(row, height - 1), np.minimum(column, width - 1)

    def _cast(self, some: Candidates) -> Mask:
        """Draw the pixels that members cover; the margins stay light."""
        covered = np.zeros_like(self.before)
        for radius in np.unique(some.radius):
            own = some.take(some.radius == radius)
            covered[1:-1, 1:-1] |= cast(own.start, own.end, self._frame, float(radius))
        return covered


def near_struts(sites: Sites, tube_mm: float) -> Candidates:
    """List struts between strands that are near each other."""
    from scipy.spatial import cKDTree

    # a hidden strut has at most 20 tube radii
    pairs = cKDTree(sites.point).query_pairs(20.0 * tube_mm, output_type="ndarray")
    return list_struts(sites, pairs.astype(np.int64), tube_mm, HIDDEN_SHARE * tube_mm)


def hidden_struts(sites: Sites, shadows: MountShadows, tube_mm: float) -> Candidates:
    """List struts between near strands that lie in every view's shadow from end to end."""
    every = near_struts(sites, tube_mm)
    return every.take(shadows.hidden(every))


# Rays for pegs: from tube to wall along the light, in the tube's shadow, clear of all strands.

LEAST_SINE = 0.6  # between tube and ray: a peg that leaves along its tube would graze it
JOINT_RADII = 3.0  # tube radii of arc on each side of a peg's top that belong to its joint


@dataclass(frozen=True)
class Rays:
    """The light rays through the vertices of the knots, (n,) in the knots' order.

    `top` and `foot` (n, 3) are where a ray leaves the tube's middle and where it meets the wall,
    mm. If it is `free`, a peg may run along it whose radius is `share` of that of the tube's shadow.
    `tangent` (n, 3) are the tube's unit directions.
    """

    knot: Indices
    vertex: Indices
    top: Array
    foot: Array
    tangent: Array
    free: Mask
    share: Array

    @property
    def length_mm(self) -> Array:
        """From top to foot, (n,)."""
        return np.asarray(np.linalg.norm(self.foot - self.top, axis=1))


def free_rays(knots: Knots, camera: Camera, peg_share: float, clearance_mm: float) -> Rays:
    """Find the rays on which a round peg is hidden and touches nothing but its own joint.

    Whatever lies on a ray behind a point of the tube, no farther from it than the tube's radius
    magnified from the light, is in the tube's shadow (design, section 8). A peg is a cone that
    fills `peg_share` of that. It is free if every other stretch of tube behind its top stays
    `clearance_mm` away.

    Args:
        knots: in scene coordinates. camera: the light and its wall.
        peg_share: the peg's radius over that of the tube's shadow, above 0 and at most 1.

    Raises:
        ValueError: the peg would be thicker than the tube's shadow.
    """
    if not 0 < peg_share <= 1:
        raise ValueError(f"a peg of {peg_share} tubes does not hide behind the tube")
    knot = np.concatenate([np.full(len(k.points), i) for i, k in enumerate(knots.knots)])
    vertex = np.concatenate([np.arange(len(k.points)) for k in knots.knots])
    top = knots.points
    tangent = np.concatenate([tangents(k.points) for k in knots.knots])
    light, foot = camera.eye, camera.cast(top)
    away = top - light
    unit = away / np.linalg.norm(away, axis=1)[:, None]
    sine = np.linalg.norm(np.cross(unit, tangent), axis=1)
    free = sine >= LEAST_SINE
    free &= _clear_rays(knots, light, knot, top, foot, peg_share, clearance_mm)
    return Rays(knot, vertex, top, foot, tangent, free, np.full(len(knot), peg_share))


def _clear_rays(
    knots: Knots,
    light: Array,
    knot: Indices,
    top: Array,
    foot: Array,
    share: float,
    clearance: float,
) -> Mask:
    """Return whether all tubes keep clear of each peg but at its own joint, (n,).

    Seen from the light a ray is a point, and what may touch it lies near that point: samples of the
    centre lines are looked up on the unit sphere about the light, and measured in space.
    """
    from scipy.spatial import cKDTree

    samples, owner, arc, perimeter = sample_strands(knots)
    arc_of_vertex = np.concatenate([arc_lengths(k.points)[:-1] for k in knots.knots])
    distance_of = np.linalg.norm(samples - light, axis=1)
    unit = (foot - light) / np.linalg.norm(foot - light, axis=1)[:, None]
    length = np.linalg.norm(foot - top, axis=1)
    step = SAMPLE_RADII * knots.radius_mm
    # between two samples the line comes nearer by no more than the last term
    gap = knots.radius_mm + clearance
    gap += step**2 / (8 * gap)
    to_top = np.linalg.norm(top - light, axis=1)
    tree = cKDTree((samples - light) / distance_of[:, None])
    widest = gap / float(distance_of.min()) + share * knots.radius_mm / to_top
    near = tree.query_ball_point(unit, 1.01 * widest)
    ray = np.repeat(np.arange(len(top)), [len(n) for n in near])
    found = np.concatenate([np.asarray(n, dtype=np.int64) for n in near])
    along, distance = off_segments(samples[found], top[ray], unit[ray], length[ray])
    apart = np.abs(arc[found] - arc_of_vertex[ray])
    apart = np.minimum(apart, perimeter[owner[found]] - apart)
    own = (owner[found] == knot[ray]) & (apart <= JOINT_RADII * knots.radius_mm)
    clear = np.ones(len(top), dtype=bool)
    width = share * knots.radius_mm * (1 + along / to_top[ray])
    close = distance < gap + width
    clear[ray[close & ~own]] = False
    # within its joint a strand may touch the peg, but must leave it at once
    joint = np.flatnonzero(close & own)
    ray, found = ray[joint], found[joint]
    back, ahead = ring_neighbours(np.bincount(owner, minlength=len(knots.knots)))
    forward = (arc[found] - arc_of_vertex[ray]) % perimeter[owner[found]]
    onward = np.where(forward <= perimeter[owner[found]] / 2, ahead[found], back[found])
    _, there = off_segments(samples[onward], top[ray], unit[ray], length[ray])
    pace = np.linalg.norm(samples[onward] - samples[found], axis=1)
    contact = knots.radius_mm + width[joint]
    clear[ray[opens_slowly(distance[joint], there, pace, contact, clearance)]] = False
    return clear
