"""The silhouette of a sphere in closed form: the ellipse in which its tangent cone meets the image plane.

Paper, section 3.3 and supplement, "Equation of Projection of Spheres", with its erratum mended: the cone
that touches the sphere has sin(theta) = r / |p|, not tan(theta). Points are in camera coordinates
(x right, y down, z away), wholly in front of the eye: z > r.

A convex outline is known by its support function h(u), the reach along the unit vector u; then the
signed distance (positive inside) is the least of h(u) - u . q over all u, exactly. By the envelope
theorem its gradient is that of h at the minimiser, so the search for u needs no gradient, and
nothing is divided by a distance that may be zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

__all__ = ["Ellipses", "nearest_normal", "project_spheres", "support", "support_point"]

_TINY = 1e-30
_STEPS = 5  # iterations for the nearest point: from then on rounding rules


def support(
    u: Tensor,  # [..., 2] unit vectors
    centres: Tensor,  # [..., 3]
    radius: float,
    focal_z: float,
) -> Tensor:
    """Return [...] how far the silhouettes reach along `u`: the root of the dual conic.

    All arguments broadcast; differentiable with respect to `centres` wherever z > r.
    """
    z = centres[..., 2]
    along = (u * centres[..., :2]).sum(-1)
    beyond = (z - radius) * (z + radius)
    return focal_z * (z * along + radius * (along * along + beyond).sqrt()) / beyond


def support_point(u: Tensor, centres: Tensor, radius: float, focal_z: float) -> Tensor:
    """Return [..., 2] the point of the outline whose outward normal is `u` (arguments as in `support`)."""
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
        """Return the ellipses of `index`, in its order."""
        return Ellipses(self.middle[index], self.axis[index], self.major[index], self.minor[index])


def project_spheres(
    centres: Tensor,  # [n, 3]
    radius: float,
    focal_z: float,
) -> Ellipses:
    """Project spheres to ellipses in principal axes; the major axis points away from the picture's middle."""
    xy, z = centres[..., :2], centres[..., 2]
    beyond = (z - radius) * (z + radius)
    aside = (xy * xy).sum(-1)
    right = torch.zeros_like(xy)
    right[..., 0] = 1.0
    middle = (focal_z * z / beyond)[..., None] * xy
    # on the optical axis it is a circle, and any direction serves
    size = aside.sqrt()[..., None]
    axis = torch.where(size > _TINY, xy / size.clamp_min(_TINY), right)
    major = focal_z * radius * (aside + beyond).sqrt() / beyond
    return Ellipses(middle, axis, major, focal_z * radius / beyond.sqrt())


def nearest_normal(shape: Ellipses, q: Tensor, steps: int = _STEPS) -> Tensor:
    """Return [n, 2] the outward normal at each ellipse's point that is nearest to `q` [n, 2].

    Not differentiable. The outline near a point is replaced by its circle of curvature, and the nearest
    point of that circle by the point of the ellipse in its direction; again from there.
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
