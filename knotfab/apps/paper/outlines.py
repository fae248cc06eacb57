"""Render a view by the distance to outlines in the image plane, of capsules or of ellipses.

The paper's renderers (section 3.3), with the interface of `DrawnImage`, for comparison with the ray
distance. They run only in torch, in double precision, which conics need.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import hypot
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from knotfab.apps.paper.ellipse import (
    Outlines,
    clip_segments,
    outline_capsules,
    outline_distance,
    support,
)
from knotfab.base.arrays import Array, Real
from knotfab.geometry.polylines import Polylines
from knotfab.render.capsules import tensor_frame
from knotfab.render.silhouette import Frame, least_depth, number


@dataclass(frozen=True)
class Pinhole:
    """A pinhole camera, x right, y down, z away from the eye, in any unit of length.

    `local` maps world to camera coordinates, [..., 3]. `focal` are half the picture's width and height on the
    image plane, and the plane's depth. `pitch` is the distance of neighbouring pixel centres there, and
    `corner` the place of the first, in pitches. What lies before `near` or beyond `far` is not seen.
    """

    local: Callable[[Tensor], Tensor]
    focal: tuple[float, float, float]
    width: int
    height: int
    pitch: tuple[float, float]
    corner: tuple[float, float]
    near: float
    far: float = 1e9  # not infinity, which would have no gradient

    def plane(self, u: Tensor, v: Tensor) -> Tensor:
        """Map pixel columns and rows [...] to points [..., 2] of the image plane (the paper's set Q)."""
        places = zip((u, v), self.corner, self.pitch, strict=True)
        return torch.stack([(at + first) * pitch for at, first, pitch in places], -1)

    def half_diagonal(self, pixels: int) -> float:
        """Return half the diagonal between the pixel centres of a square, on the image plane."""
        return 0.5 * (pixels - 1) * hypot(*self.pitch)


@dataclass(frozen=True)
class OutlineImage:
    """A `DrawnImage` of a picture [height, width]: capsules along edges, or ellipses at vertices."""

    frame: Frame
    target: Tensor
    renderer: Literal["capsule", "ellipse"] = "capsule"

    def from_frame(self, frame: Frame) -> OutlineImage:
        """Return the same picture, seen from another frame of arrays."""
        return replace(self, frame=tensor_frame(frame, self.target.dtype))

    def squared_error(
        self, points: Real, rings: Polylines, radius: float, tau: float, cutoff: float, won: Any
    ) -> tuple[float, Array]:
        """Return the squared difference of tube and picture, and its gradient in the vertices (N, 3)."""
        p, q = self._ends(points, rings, slopes=True)
        error = ((self._image(p, q, radius, tau, cutoff, won) - self.target) ** 2).sum()
        (slope,) = torch.autograd.grad(error, p)
        return float(error.detach()), slope.numpy().astype(np.float64)

    def find_winners(self, points: Real, rings: Polylines, radius: float, reach_px: float) -> Won:
        """Find which primitive is largest at each pixel within reach of one."""
        eye = self._eye(radius)
        return winners(*self._ends(points, rings), eye, radius, reach_px * eye.pitch[0])

    def render(
        self, points: Real, rings: Polylines, radius: float, tau: float, cutoff: float
    ) -> Real:
        """Render the tube about vertices (N, 3)."""
        with torch.no_grad():
            image = self._image(*self._ends(points, rings), radius, tau, cutoff)
        return np.asarray(image.numpy())

    def _image(
        self, p: Tensor, q: Tensor, radius: float, tau: float, cutoff: float, won: Won | None = None
    ) -> Tensor:
        eye, ends = self._eye(radius), None if self.renderer == "ellipse" else q
        return render_outlines(p, ends, eye, radius, tau / eye.pitch[0], cutoff, won)

    def _eye(self, radius: float) -> Pinhole:
        """Return the camera of the frame, with the image plane at depth 1; whole spheres are seen."""
        f, pitch = self.frame, number(self.frame.step)
        focal = 0.5 * f.width * pitch, 0.5 * f.height * pitch, 1.0
        size, corner = (f.width, f.height), (number(f.u0), number(f.v0))
        return Pinhole(f.local, focal, *size, (pitch, pitch), corner, least_depth(radius) - radius)

    def _ends(self, points: Real, rings: Polylines, slopes: bool = False) -> tuple[Tensor, Tensor]:
        p = torch.as_tensor(points, dtype=self.target.dtype)
        p.requires_grad_(slopes)
        return p, p if self.renderer == "ellipse" else p[torch.as_tensor(rings.next)]


def draw_outlines(
    frame: Frame, target: Real, renderer: Literal["capsule", "ellipse"]
) -> OutlineImage:
    """Return a picture, given with its frame as arrays, drawn by one of the paper's renderers."""
    there = torch.as_tensor(target.astype(np.float64))
    return OutlineImage(tensor_frame(frame, there.dtype), there, renderer)


# images sigmoid(tau S) of the signed distance S to outlines

REACH = 16.0  # pixels with tau S below -16 are empty: sigmoid(-16) is 1e-7
_SQUARES = 256  # most squares on the coarsest level
_EMPTY = -1e9  # signed distance to nothing
_TINY = 1e-30

Won = tuple[Tensor, Tensor]  # indices of pixels, and of the primitive that wins each


def winners(
    starts: Tensor,  # [n, 3] world
    ends: Tensor,  # [n, 3]
    camera: Pinhole,
    radius: float,
    reach: float,
) -> Won:
    """Find the pixels with S > -reach, and the primitive with the largest S at each.

    Primitives are capsules, or spheres where start and end are the same. Squares of pixels are halved level
    by level, and only primitives that may win a square are kept. Not differentiable.
    """
    with torch.no_grad():
        a, b, index = clip_segments(
            camera.local(starts), camera.local(ends), radius, camera.near, camera.far
        )
        shape = outline_capsules(a, b, radius, camera.focal[2])
        width, height = camera.width, camera.height
        size = 1
        while -(-width // size) * -(-height // size) > _SQUARES:
            size *= 2
        columns, rows = -(-width // size), -(-height // size)
        squares = torch.arange(columns * rows, device=a.device).repeat_interleave(len(index))
        kind = torch.arange(len(index), device=a.device).repeat(columns * rows)
        u, v = squares % columns * size, squares // columns * size
        while True:
            keep = _may_win(shape, kind, u, v, size, camera, reach)
            kind, u, v = kind[keep], u[keep], v[keep]
            if size == 1:
                break
            size //= 2
            kind = kind.repeat(4)
            u = torch.cat([u, u + size, u, u + size])
            v = torch.cat([v, v, v + size, v + size])
        q = camera.plane(u.to(a.dtype), v.to(a.dtype))
        s, _, _ = outline_distance(shape.at(kind), q, radius, camera.focal[2])
        pixel = v * width + u
        best = torch.full((width * height,), -reach, dtype=a.dtype, device=a.device)
        best.scatter_reduce_(0, pixel, s, "amax")
        first = torch.full((width * height,), len(index), dtype=torch.long, device=a.device)
        won = s == best[pixel]
        # of equals the first wins, so that the result is deterministic
        first.scatter_reduce_(0, pixel[won], kind[won], "amin")
        pixel = ((first < len(index)) & (best > -reach)).nonzero()[:, 0]
        return pixel, index[first[pixel]]


def _may_win(
    shape: Outlines, kind: Tensor, u: Tensor, v: Tensor, size: int, camera: Pinhole, reach: float
) -> Tensor:
    """Return which pairs [m] of square and primitive may hold a winner.

    The square must lie in the image, and the primitive must not surely be beaten there. Bounds: an outline
    contains the flat capsule with its ellipses' smallest half axis, and lies in that with the largest.
    """
    half = 0.5 * (size - 1)
    q = camera.plane(u.to(shape.a.dtype) + half, v.to(shape.a.dtype) + half)
    start, way = shape.first.middle, shape.second.middle - shape.first.middle
    square = (way * way).sum(-1).clamp_min(_TINY)
    least = torch.minimum(shape.first.minor, shape.second.minor)[kind]
    most = torch.maximum(shape.first.major, shape.second.major)[kind]
    x, y = (q - start[kind]).unbind(-1)
    ex, ey = way[kind].unbind(-1)
    t = ((x * ex + y * ey) / square[kind]).clamp_(0.0, 1.0)
    away = torch.hypot(x - t * ex, y - t * ey)
    slack = camera.half_diagonal(size) + 1e-6 * (1.0 + most)
    low, high = least - away - slack, most - away + slack
    columns = -(-camera.width // size)
    rows = -(-camera.height // size)
    inside = (u < camera.width) & (v < camera.height)
    square_of = torch.where(inside, v // size * columns + u // size, columns * rows)
    best = torch.full((columns * rows + 1,), -reach, dtype=q.dtype, device=q.device)
    best.scatter_reduce_(0, square_of, low, "amax")
    return inside & (high >= best[square_of])


def signed_distance(
    starts: Tensor,  # [m, 3] world
    ends: Tensor,  # [m, 3]
    q: Tensor,  # [m, 2] on the image plane
    camera: Pinhole,
    radius: float,
) -> Tensor:
    """Return the exact signed distance [m] of q to the outlines of capsules, positive inside.

    Differentiable with respect to the points, with a subgradient where two places of an outline are equally
    near. It is -1e9 for primitives that are clipped away.
    """
    a, b, index = clip_segments(
        camera.local(starts), camera.local(ends), radius, camera.near, camera.far
    )
    focal_z = camera.focal[2]
    _, u, share = outline_distance(
        outline_capsules(a, b, radius, focal_z), q[index], radius, focal_z
    )
    one, two = support(u, a, radius, focal_z), support(u, b, radius, focal_z)
    s = (1 - share) * one + share * two - (u * q[index]).sum(-1)
    empty = torch.full((len(q),), _EMPTY, dtype=q.dtype, device=q.device)
    return empty.index_put((index,), s)


def render_outlines(
    starts: Tensor,  # [n, 3] world
    ends: Tensor | None,  # [n, 3]; None: the ellipse renderer
    camera: Pinhole,
    radius: float,
    tau: float,
    reach: float = REACH,
    won: Won | None = None,
) -> Tensor:
    """Render the image [height, width] of capsules or spheres, exact up to sigmoid(-reach).

    Differentiable with respect to the points. `tau` is per unit of the image plane. With the winners `won`
    of an earlier call the result is a lower bound, exact where the winner is still the same.
    """
    b = starts if ends is None else ends
    if won is None:
        won = winners(starts, b, camera, radius, reach / tau)
    pixel, kind = won
    u, v = (pixel % camera.width).to(starts.dtype), (pixel // camera.width).to(starts.dtype)
    s = signed_distance(starts[kind], b[kind], camera.plane(u, v), camera, radius)
    image = torch.zeros(camera.width * camera.height, dtype=starts.dtype, device=starts.device)
    image = image.index_put((pixel,), torch.sigmoid(tau * s))
    return image.reshape(camera.height, camera.width)
