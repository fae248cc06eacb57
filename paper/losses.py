"""The paper's five losses (section 3.4), finite wherever the curve is bad.

Curves are closed polygons [knots, n, 3]. At coincident and doubled points, cusps, straight lines and
length 0 each loss has its limit where there is one; a Moebius pair at distance 0 is capped. Gradients
there are valid subgradients, never NaN.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

Region = Callable[[Tensor], Tensor]  # points [..., 3] -> signed distance [...], positive inside

_LEAST = 1e-2  # a share of the radius: no distance of the Moebius loss counts as smaller


def _norm(v: Tensor) -> Tensor:
    """Return the length over the last axis, with gradient 0 at the zero vector."""
    square = (v * v).sum(-1)
    some = square > 0
    return torch.where(some, torch.where(some, square, 1.0).sqrt(), 0.0)


def _edges(knots: Tensor) -> Tensor:
    """Return [knots, n, 3] from each point to the next."""
    return knots.roll(-1, 1) - knots


def image_loss(image: Tensor, target: Tensor) -> Tensor:
    """Return the squared norm of the difference of two images [height, width]: a sum over pixels."""
    return ((image - target) ** 2).sum()


def knot_lengths(knots: Tensor) -> Tensor:
    """Return [knots] lengths of the closed polygons."""
    return _norm(_edges(knots)).sum(1)


def length_loss(knots: Tensor, longest: float) -> Tensor:
    """Measure how far the length of all knots together exceeds the budget L0."""
    return (knot_lengths(knots).sum() - longest).clamp_min(0.0)


def random_pairs(count: int, points: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Return `count` pairs of different points out of so many, each pair as likely as any (the set B_M)."""
    u = torch.randint(points, (count,), generator=generator)
    v = torch.randint(points - 1, (count,), generator=generator)
    return u, v + (v >= u)


def mobius_loss(
    knots: Tensor,  # [knots, n, 3]
    radius: float,
    pairs: tuple[Tensor, Tensor],  # rows of knots.reshape(-1, 3)
) -> Tensor:
    """Return the mean over the pairs of (1 / d^2 - 1 / g^2) max(2 r - d, 0).

    d is the distance in space, g the shorter way along the knot (endless between two knots, so that
    knots that touch are penalised too). d counts as at least a hundredth of the radius. Pairs nearer than
    that along the knot are passed over: their limit is a twelfth of the squared curvature, which is
    little, and a polygon knows none between its corners.
    """
    u, v = pairs
    # single precision leaves nothing of a way that is hardly longer than the distance
    kind, knots = knots.dtype, knots.double()
    n = knots.shape[1]
    lengths = _norm(_edges(knots))
    whole = lengths.sum(1)
    # ways lead from each knot's first point to each of its points
    ways = lengths[:, :-1].cumsum(1)
    along = torch.cat([torch.zeros_like(ways[:, :1]), ways], 1).reshape(-1)
    flat = knots.reshape(-1, 3)
    one_way = (along[u] - along[v]).abs()
    knot = torch.div(u, n, rounding_mode="floor")
    same = knot == torch.div(v, n, rounding_mode="floor")
    g = torch.minimum(one_way, (whole[knot] - one_way).clamp_min(0.0))
    d = _norm(flat[u] - flat[v])
    least = _LEAST * radius
    # points next to each other are as far apart as the way between them: 0 less rounding
    steps = (u - v).abs()
    beside = same & ((steps == 1) | (steps == n - 1))
    counts = (d < 2 * radius) & ~(same & (g <= least)) & ~beside
    same, g, d = same[counts], g[counts], d[counts]
    apart = d.clamp_min(least)
    both = apart * torch.where(same, g, 1.0)
    # one factor at a time: the square of the product would underflow
    gap = (g - apart) / both * ((g + apart) / both)
    energy = torch.where(same, gap.clamp_min(0.0), 1 / apart**2)
    return ((energy * (2 * radius - d)).sum() / len(u)).to(kind)


def occupancy_loss(knots: Tensor, radius: float, region: Region) -> Tensor:
    """Sum over points of how far the tube's ball sticks out of the region: max(r - S(p), 0)."""
    return (radius - region(knots)).clamp_min(0.0).sum()


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Region:
    """Return the exact signed distance of an axis-parallel box, positive inside."""

    def at(points: Tensor) -> Tensor:
        one, two = (torch.tensor(x, dtype=points.dtype, device=points.device) for x in (low, high))
        excess = torch.maximum(one - points, points - two)
        return -_norm(excess.clamp_min(0.0)) - excess.amax(-1).clamp_max(0.0)

    return at


def ball(middle: tuple[float, float, float], radius: float) -> Region:
    """Return the signed distance of a ball, positive inside."""

    def at(points: Tensor) -> Tensor:
        return radius - _norm(
            points - torch.tensor(middle, dtype=points.dtype, device=points.device)
        )

    return at


def squared_curvature(knots: Tensor) -> Tensor:
    """Return [knots, n] (turning angle over the mean of both edges)^2 at each point.

    Exact on a circle up to the square of the spacing, for uneven spacings too. A cusp turns by half a turn.
    A point that coincides with a neighbour has 0: the direction of its edge is unknown.
    """
    after = _edges(knots)
    before = after.roll(1, 1)
    one, two = _norm(before), _norm(after)
    some = (one > 0) & (two > 0)
    # unit vectors first: the products of tiny edges would underflow
    p = before / torch.where(some, one, 1.0)[..., None]
    q = after / torch.where(some, two, 1.0)[..., None]
    sine, cosine = _norm(torch.linalg.cross(p, q)), (p * q).sum(-1)
    angle = torch.atan2(sine, torch.where(some, cosine, 1.0))
    mean = torch.where(some, 0.5 * (one + two), 1.0)
    return torch.where(some, (angle / mean) ** 2, 0.0)


def bending_loss(knots: Tensor, sharpest: float) -> Tensor:
    """Sum over points of how far the squared curvature exceeds the limit B0."""
    return (squared_curvature(knots) - sharpest).clamp_min(0.0).sum()
