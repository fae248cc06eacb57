"""The paper's camera by its place, turn and focal lengths, and closed curves with points sampled on them.

Paper, section 3.1. The image plane is z = f_z, and the picture covers |x| <= f_x, |y| <= f_y of it, pixel
centres on its edges included. Lengths are in the paper's own unit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, pi, radians, sin

import torch
from torch import Tensor

from knotfab.apps.paper.outlines import Pinhole

Triple = tuple[float, float, float]
Curve = Callable[[Tensor], Tensor]  # places [n] in [0, 1) of a closed curve -> points [n, 3]


def paper_camera(
    place: Triple = (0.0, 0.0, 0.0),
    turn_rad: Triple = (0.0, 0.0, 0.0),
    focal: Triple = (1.0, 1.0, 2.0),
    near: float = 1e-3,
    far: float = 1e3,
    width: int = 256,
    height: int = 256,
) -> Pinhole:
    """Return the camera (t, theta, f, z-, z+, W, H) of the paper; defaults are its Table 1.

    `turn_rad` are the angles about x, then y, then z that take the world's axes to the camera's.
    """
    if min(focal) <= 0 or not 0 < near < far:
        raise ValueError(
            f"focal lengths and clipping depths must be positive, near before far; got {focal}, {near}, {far}"
        )
    if min(width, height) < 2:
        raise ValueError(f"an image needs 2 x 2 pixels, got {width} x {height}")
    (a, b, c) = turn_rad
    about_x = [[1.0, 0.0, 0.0], [0.0, cos(a), -sin(a)], [0.0, sin(a), cos(a)]]
    about_y = [[cos(b), 0.0, sin(b)], [0.0, 1.0, 0.0], [-sin(b), 0.0, cos(b)]]
    about_z = [[cos(c), -sin(c), 0.0], [sin(c), cos(c), 0.0], [0.0, 0.0, 1.0]]
    x, y, z = (torch.tensor(m, dtype=torch.float64) for m in (about_x, about_y, about_z))
    columns, eye = z @ y @ x, torch.tensor(place, dtype=torch.float64)
    half = 0.5 * (width - 1), 0.5 * (height - 1)
    return Pinhole(
        lambda points: (points - eye.to(points)) @ columns.to(points),
        focal, width, height, (focal[0] / half[0], focal[1] / half[1]), (-half[0], -half[1]), near, far,
    )  # fmt: skip


def camera_around(
    middle: Sequence[float],
    distance: float,
    azimuth_deg: float = 0.0,
    elevation_deg: float = 0.0,
    *,
    width: int = 256,
    height: int = 256,
    focal: Triple = (1.0, 1.0, 2.0),
) -> Pinhole:
    """Return a camera that looks at `middle` from `distance`.

    At azimuth and elevation 0 it looks along the world's z. Azimuth turns it about the world's y,
    elevation raises it towards the world's -y (up in the picture).
    """
    about_y, about_x = radians(azimuth_deg), -radians(elevation_deg)
    # way is the camera's z in the world, R_y R_x (0, 0, 1)
    way = (sin(about_y) * cos(about_x), -sin(about_x), cos(about_y) * cos(about_x))
    x, y, z = (m - distance * w for m, w in zip(middle, way, strict=True))
    return paper_camera((x, y, z), (about_x, about_y, 0.0), focal, width=width, height=height)


def circle(radius: float = 1.0, middle: Triple = (0.0, 0.0, 0.0)) -> Curve:
    """Give the paper's template (cos s, sin s, 0), with s = 2 pi times the place in [0, 1) (section 3.2)."""

    def at(places: Tensor) -> Tensor:
        s = 2 * pi * places
        flat = torch.stack([s.cos(), s.sin(), torch.zeros_like(s)], -1)
        return radius * flat + torch.tensor(middle).to(flat)

    return at


def viviani(places: Tensor, apart: float = 0.0) -> Tensor:
    """Return Viviani's curve about the origin, of diameter 2; its crossing drawn open by `apart`."""
    t = 4 * pi * places
    x = 0.5 * t.cos() + 0.5 * apart * (t / 2).cos()
    return torch.stack([x, 0.5 * t.sin(), (t / 2).sin()], -1)


def random_ring(count: int, generator: torch.Generator) -> Tensor:
    """Return [count] float64 sorted places in [0, 1), uniform (the paper's random ring-graph)."""
    return torch.rand(count, generator=generator, dtype=torch.float64).sort().values


def even_ring(count: int) -> Tensor:
    """Return [count] float64 evenly spaced places in [0, 1)."""
    return torch.arange(count, dtype=torch.float64) / count
