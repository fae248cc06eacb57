"""The silhouette of a capsule in closed form: two ellipses and the quadrilateral of their common tangents.

Paper, section 3.3 and supplement, "Equation of Projection of Cylinder". The common tangents are the traces
of the two planes through the eye that touch the cylinder. These planes are found in space, so a vanishing
point at infinity or a vertical tangent needs no special case. The union is convex, and its support function
is the larger of the two ellipses'.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

_STEPS = 5  # iterations for the nearest point; more only change rounding


def support(
    u: Tensor,  # [..., 2] unit vectors
    centres: Tensor,  # [..., 3]
    radius: float,
    focal_z: float,
) -> Tensor:
    """Return the support function [...] of spheres' silhouettes in the direction `u`.

    A silhouette is the ellipse in which the tangent cone meets the image plane, and this the root of its
    dual conic. All arguments broadcast. Differentiable with respect to `centres` wherever z > r.
    """
    z = centres[..., 2]
    along = (u * centres[..., :2]).sum(-1)
    beyond = (z - radius) * (z + radius)
    return focal_z * (z * along + radius * (along * along + beyond).sqrt()) / beyond


def support_point(u: Tensor, centres: Tensor, radius: float, focal_z: float) -> Tensor:
    """Return the point [..., 2] of the outline whose outward normal is `u` (arguments as in `support`)."""
    xy, z = centres[..., :2], centres[..., 2:]
    along = (u * xy).sum(-1, keepdim=True)
    beyond = (z - radius) * (z + radius)
    root = (along * along + beyond).sqrt()
    return focal_z * (z * xy + radius * (along * xy + beyond * u) / root) / beyond


@dataclass(frozen=True)
class Ellipses:
    """Ellipses by centre, direction of the major axis and half axes."""

    middle: Tensor  # [n, 2]
    axis: Tensor  # [n, 2]
    major: Tensor  # [n]
    minor: Tensor  # [n]

    def at(self, index: Tensor) -> Ellipses:
        """Select ellipses by index."""
        return Ellipses(self.middle[index], self.axis[index], self.major[index], self.minor[index])


def project_spheres(
    centres: Tensor,  # [n, 3]
    radius: float,
    focal_z: float,
) -> Ellipses:
    """Project spheres to ellipses, whose major axes point away from the middle of the picture."""
    xy, z = centres[..., :2], centres[..., 2]
    beyond = (z - radius) * (z + radius)
    aside = (xy * xy).sum(-1)
    right = torch.zeros_like(xy)
    right[..., 0] = 1.0
    middle = (focal_z * z / beyond)[..., None] * xy
    # on the optical axis it is a circle, and any direction will do
    size = aside.sqrt()[..., None]
    axis = torch.where(size > _TINY, xy / size.clamp_min(_TINY), right)
    major = focal_z * radius * (aside + beyond).sqrt() / beyond
    return Ellipses(middle, axis, major, focal_z * radius / beyond.sqrt())


def nearest_normal(shape: Ellipses, q: Tensor, steps: int = _STEPS) -> Tensor:
    """Return the outward normal [n, 2] at the point of each ellipse that is nearest to `q` [n, 2].

    Each iteration takes the nearest point on the circle of curvature, and from it the next point of the
    ellipse. Not differentiable.
    """
    with torch.no_grad():
        a, b = shape.major, shape.minor
        d = q - shape.middle
        ax, ay = shape.axis.unbind(-1)
        x, y = d[:, 0] * ax + d[:, 1] * ay, d[:, 1] * ax - d[:, 0] * ay
        px, py = x.abs(), y.abs()
        # the centre of curvature at (a c, b s) is ((a^2 - b^2) c^3 / a, -(a^2 - b^2) s^3 / b)
        excess = (a - b) * (a + b)
        c, s = b * px, a * py
        size = torch.hypot(c, s)
        middle = size <= _TINY
        size = size.clamp_min(_TINY)
        c, s = torch.where(middle, 0.0, c / size), torch.where(middle, 1.0, s / size)
        for _ in range(steps):
            ex, ey = excess * c**3 / a, -excess * s**3 / b
            bend = torch.hypot(a * c - ex, b * s - ey)
            wx, wy = px - ex, py - ey
            scale = bend / torch.hypot(wx, wy).clamp_min(_TINY)
            # the nearest point lies in q's own quadrant
            c_next = ((wx * scale + ex) / a).clamp(0.0, 1.0)
            s_next = ((wy * scale + ey) / b).clamp(0.0, 1.0)
            size = torch.hypot(c_next, s_next)
            sound = size > _TINY
            size = size.clamp_min(_TINY)
            c, s = torch.where(sound, c_next / size, c), torch.where(sound, s_next / size, s)
        nx, ny = b * c, a * s
        size = torch.hypot(nx, ny).clamp_min(_TINY)
        nx = torch.where(x < 0, -nx, nx) / size
        ny = torch.where(y < 0, -ny, ny) / size
        return torch.stack([nx * ax - ny * ay, nx * ay + ny * ax], -1)


_TINY = 1e-30
_GRAZING = 1e-12  # least 1 - (r / h)^2; below it the eye counts as inside the cylinder


def clip_segments(
    a: Tensor,  # [n, 3] camera coordinates
    b: Tensor,  # [n, 3]
    radius: float,
    near: float,
    far: float,
) -> tuple[Tensor, Tensor, Tensor]:
    """Clip segments to where their spheres lie wholly beyond `near` and their centres before `far`.

    A sphere that reached the plane of the eye would have an unbounded silhouette. Differentiable.

    Returns:
        The ends of the segments that are left, and their indices [m].
    """
    low = near + radius
    z, change = a[:, 2], b[:, 2] - a[:, 2]
    flat = change.abs() <= 1e-9 * low
    slope = torch.where(flat, torch.ones_like(change), change)
    first, last = (low - z) / slope, (far - z) / slope
    enter = torch.where(flat, 0.0, torch.minimum(first, last)).clamp(0.0, 1.0)[:, None]
    leave = torch.where(flat, 1.0, torch.maximum(first, last)).clamp(0.0, 1.0)[:, None]
    seen = (torch.maximum(z, z + change) >= low) & (torch.minimum(z, z + change) <= far)
    index = seen.nonzero()[:, 0]
    enter, leave, start, way = enter[index], leave[index], a[index], (b - a)[index]
    # ends that are not clipped stay exactly the same
    one = torch.where(enter > 0, start + enter * way, start)
    two = torch.where(leave < 1, start + leave * way, b[index])
    return _clamp_depth(one, low), _clamp_depth(two, low), index


def _clamp_depth(points: Tensor, low: float) -> Tensor:
    """Move points that rounding put before the clipping depth back onto it."""
    return torch.cat([points[:, :2], points[:, 2:].clamp_min(low)], -1)


def tangent_normals(
    a: Tensor,  # [n, 3]
    b: Tensor,  # [n, 3]
    radius: float,
) -> tuple[Tensor, Tensor]:
    """Find the two planes through the eye that touch the cylinder about a-b. Not differentiable.

    Returns:
        Unit normals [2, n, 3], pointing to the axis (n . a = n . b = r), and whether they exist [n]. They do
        not if a segment has no length, or the eye is inside the infinite cylinder.
    """
    with torch.no_grad():
        way = b - a
        length = torch.linalg.vector_norm(way, dim=-1, keepdim=True)
        along = way / length.clamp_min(_TINY)
        aside = a - (a * along).sum(-1, keepdim=True) * along
        height = torch.linalg.vector_norm(aside, dim=-1, keepdim=True)
        foot = aside / height.clamp_min(_TINY)
        ratio = radius / height.clamp_min(_TINY)
        square = 1 - ratio * ratio
        exist = ((length > _TINY) & (square > _GRAZING))[:, 0]
        across = square.clamp_min(0.0).sqrt() * torch.linalg.cross(along, foot)
        return torch.stack([ratio * foot + across, ratio * foot - across]), exist


@dataclass(frozen=True)
class Outlines:
    """The silhouettes of n capsules, without gradient."""

    a: Tensor  # [n, 3]
    b: Tensor  # [n, 3]
    first: Ellipses
    second: Ellipses
    tangents: Tensor  # [2, n, 2] outward unit normals of the tangents, where they exist
    exist: Tensor  # [n]

    def at(self, index: Tensor) -> Outlines:
        """Select capsules by index."""
        return Outlines(
            self.a[index],
            self.b[index],
            self.first.at(index),
            self.second.at(index),
            self.tangents[:, index],
            self.exist[index],
        )


def outline_capsules(a: Tensor, b: Tensor, radius: float, focal_z: float) -> Outlines:
    """Project capsules a-b [n, 3], spheres where a = b, which must lie wholly in front of the eye."""
    with torch.no_grad():
        a, b = a.detach(), b.detach()
        normals, exist = tangent_normals(a, b, radius)
        flat = normals[..., :2]
        size = torch.linalg.vector_norm(flat, dim=-1, keepdim=True)
        return Outlines(
            a,
            b,
            project_spheres(a, radius, focal_z),
            project_spheres(b, radius, focal_z),
            -flat / size.clamp_min(_TINY),
            exist & (size > _TINY).all(0)[:, 0],
        )


def outline_distance(
    shape: Outlines,  # the outlines of n capsules
    q: Tensor,  # [n, 2] on the image plane
    radius: float,
    focal_z: float,
) -> tuple[Tensor, Tensor, Tensor]:
    """Return the signed distance [n] (positive inside), its direction u [n, 2], and the share t [n] of end b.

    It is the minimum of max(h_a, h_b) - u . q, whose minimiser is the normal at the nearest point of either
    ellipse, or that of a tangent. Any other u gives a larger value, so a poor candidate does no harm. Not
    differentiable itself: its gradient is that of (1 - t) h_a(u) + t h_b(u) with u and t held fixed.
    """
    with torch.no_grad():
        one, two = nearest_normal(shape.first, q), nearest_normal(shape.second, q)
        lines = torch.where(shape.exist[:, None], shape.tangents, one)
        u = torch.stack([one, two, lines[0], lines[1]])
        reach_a, reach_b = (support(u, p, radius, focal_z) for p in (shape.a, shape.b))
        s, best = (torch.maximum(reach_a, reach_b) - (u * q).sum(-1)).min(0)
        rows = torch.arange(len(q), device=q.device)
        u = u[best, rows]
        share = (reach_b > reach_a)[best, rows].to(q.dtype)
        # on a tangent both ends share the outline, by where q's foot lies between the points of contact
        on_a, on_b = (support_point(u, p, radius, focal_z) for p in (shape.a, shape.b))
        ux, uy = u.unbind(-1)
        span = (on_b - on_a)[:, 1] * ux - (on_b - on_a)[:, 0] * uy
        foot = (q - on_a)[:, 1] * ux - (q - on_a)[:, 0] * uy
        between = (foot / torch.where(span.abs() > _TINY, span, 1.0)).clamp(0.0, 1.0)
        line = (best >= 2) & shape.exist & (span.abs() > _TINY)
        return s, u, torch.where(line, between, share)
