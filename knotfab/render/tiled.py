"""The tiled renderer: each pixel's winning capsule is found without gradient, then evaluated with it.

sigmoid(tau s) is monotone, so the maximum over capsules is the sigmoid of the largest s, and its gradient
flows through that capsule alone. Candidates come from square tiles that a capsule's shadow, grown
by the reach of the sigmoid, can touch.
"""

from __future__ import annotations

import torch
from torch import Tensor

from knotfab.render.capsule import capsule_distance, ray_miss
from knotfab.render.frame import Frame

__all__ = ["CUTOFF", "render_tiled", "winners"]

CUTOFF = 40.0  # pixels with tau * s below minus this are empty: sigmoid(-40) is 4e-18
_TILE = 8
_CHUNK = 1 << 13  # (capsule, tile) pairs evaluated at once, to stay in cache


def _bounds(
    a: Tensor, b: Tensor, frame: Frame, radius: float, margin_px: float
) -> tuple[Tensor, Tensor]:
    """Integer tile ranges [n, 4] (u0, v0, u1, v1 inclusive) that a capsule can colour.

    The silhouette of a sphere reaches at most r/z * sqrt(1 + q^2) / (1 - (r/z)^2 ...) beyond its
    centre's pixel; the bound used is r / (z - r) * (1 + |q|) * focal, which is larger.
    """
    ends = torch.stack([a, b])
    z = ends[..., 2]
    near = (z - 2 * radius).clamp_min(1e-6)
    q = ends[..., :2] / near[..., None].clamp_min(1e-6)
    grow = (
        radius / near * (1 + q.abs().amax(-1)) ** 2 * frame.focal_px + margin_px * (z / near) + 1.0
    )
    uv = frame.pixels(ends)
    low = (uv - grow[..., None]).amin(0)
    high = (uv + grow[..., None]).amax(0)
    visible = (z > 2 * radius).all(0)
    size = torch.tensor([frame.width, frame.height], device=a.device, dtype=a.dtype)
    visible &= ((high >= 0) & (low <= size - 1)).all(-1)
    low = (low.clamp_min(0).minimum(size - 1) / _TILE).floor().long()
    high = (high.clamp_min(0).minimum(size - 1) / _TILE).floor().long()
    spans = torch.where(visible[:, None], high - low + 1, 0)
    return low, spans


def winners(
    a: Tensor,  # [n, 3] receiver axes
    b: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    reach_px: float,
) -> tuple[Tensor, Tensor]:
    """(pixel, capsule): flat indices of pixels with s > -reach_px, and the capsule of largest s.

    Not differentiable.
    """
    with torch.no_grad():
        low, spans = _bounds(a, b, frame, radius, reach_px)
        counts = spans[:, 0] * spans[:, 1]
        capsule = torch.repeat_interleave(torch.arange(len(counts), device=a.device), counts)
        first = torch.cumsum(counts, 0) - counts
        k = torch.arange(len(capsule), device=a.device) - first[capsule]
        wide = spans[capsule, 0]
        tile_u = low[capsule, 0] + k % wide
        tile_v = low[capsule, 1] + k // wide
        keep = _may_win(a, b, frame, radius, reach_px, capsule, tile_u, tile_v)
        capsule, tile_u, tile_v = capsule[keep], tile_u[keep], tile_v[keep]
        columns = -(-frame.width // _TILE)
        rows = -(-frame.height // _TILE)
        best = torch.full(
            (columns * rows, _TILE * _TILE), -reach_px, dtype=a.dtype, device=a.device
        )
        slots, values = [], []
        for first_pair in range(0, len(capsule), _CHUNK):
            part = slice(first_pair, first_pair + _CHUNK)
            c, tu, tv = capsule[part], tile_u[part], tile_v[part]
            s = _tile_distance(a, b, c, tu, tv, frame, radius)
            slot = tv * columns + tu
            best.scatter_reduce_(0, slot[:, None].expand_as(s), s, "amax")
            slots.append(slot)
            values.append(s)
        winner = torch.full((best.numel(),), -1, dtype=torch.long, device=a.device)
        done = 0
        for slot, s in zip(slots, values, strict=True):
            pair, offset = (s == best[slot]).nonzero(as_tuple=True)
            winner[slot[pair] * (_TILE * _TILE) + offset] = capsule[pair + done]
            done += len(slot)
        found = (winner >= 0).nonzero()[:, 0]
        tile, inner = found // (_TILE * _TILE), found % (_TILE * _TILE)
        u = (tile % columns) * _TILE + inner % _TILE
        v = (tile // columns) * _TILE + inner // _TILE
        inside = (u < frame.width) & (v < frame.height)
        return (v * frame.width + u)[inside], winner[found][inside]


def _tile_distance(
    a: Tensor,
    b: Tensor,
    capsule: Tensor,
    tile_u: Tensor,
    tile_v: Tensor,
    frame: Frame,
    radius: float,
) -> Tensor:
    """`capsule_distance` of [m] capsules at the [m, 64] pixels of their tiles, with fewer operations.

    The moment D x p is linear in the pixel, so its squares are quadratic: six coefficients about the
    tile's first pixel, and one matrix product for all its pixels.
    """
    qx = (tile_u.to(a.dtype) * _TILE + frame.u0) * frame.step
    qy = (tile_v.to(a.dtype) * _TILE + frame.v0) * frame.step
    zero = torch.zeros_like(qx)

    def moment(p: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """D x p at the first pixel, and its change per pixel along u and along v: [3, m] each."""
        x, y, z = p
        dx, dy = x - z * qx, y - z * qy
        at = torch.stack([-dy, dx, dy * qx - dx * qy])
        # d(D x p)/du = (step, 0, 0) x p, d/dv = (0, step, 0) x p
        along_u = torch.stack([zero, -z, y]) * frame.step
        along_v = torch.stack([z, zero, -x]) * frame.step
        return at, along_u, along_v

    start, end = moment(a.T[:, capsule]), moment(b.T[:, capsule])
    change = (end[0] - start[0], end[1] - start[1], end[2] - start[2])

    def product(one: tuple[Tensor, ...], two: tuple[Tensor, ...]) -> Tensor:
        (c, u, v), (d, w, x) = one, two
        terms = (c * d, c * w + u * d, c * x + v * d, u * w, u * x + v * w, v * x)
        return torch.stack([term.sum(0) for term in terms]).T

    offset = torch.arange(_TILE * _TILE, device=a.device)
    du, dv = (offset % _TILE).to(a.dtype), (offset // _TILE).to(a.dtype)
    monomials = torch.stack([torch.ones_like(du), du, dv, du * du, du * dv, dv * dv])
    square = product(start, start) @ monomials
    cross = product(start, change) @ monomials
    extent = (product(change, change) @ monomials).clamp_min(1e-30)
    t = (-cross / extent).clamp_(0.0, 1.0)
    miss = torch.addcmul(square, t, torch.addcmul(2 * cross, t, extent)).clamp_min_(1e-30)
    px, py = qx[:, None] + du * frame.step, qy[:, None] + dv * frame.step
    miss = (miss / (1.0 + px * px + py * py)).sqrt_()
    z0, z1 = a[capsule, 2, None], b[capsule, 2, None]
    depth = torch.addcmul(z0, t, z1 - z0).clamp_min_(1e-30)
    return (radius - miss) * frame.focal_px / depth


def _may_win(
    a: Tensor,
    b: Tensor,
    frame: Frame,
    radius: float,
    reach_px: float,
    capsule: Tensor,
    tile_u: Tensor,
    tile_v: Tensor,
) -> Tensor:
    """Which (capsule, tile) pairs can hold a winner: those not surely beaten all over the tile.

    The distance of a pixel's ray to a segment changes by at most |p| per unit of direction (p the
    farther end), so its value at the tile's middle bounds it over the tile; depths between the ends'
    bound the signed distance. A pair whose upper bound is below the tile's best lower bound is out.
    """
    half = 0.5 * (_TILE - 1)
    qx = (tile_u.to(a.dtype) * _TILE + half + frame.u0) * frame.step
    qy = (tile_v.to(a.dtype) * _TILE + half + frame.v0) * frame.step
    p, q = a[capsule], b[capsule]
    miss, _ = ray_miss(p, q, qx, qy)
    far = torch.maximum(a.norm(dim=1), b.norm(dim=1))[capsule]
    slack = far * (frame.step * half * 1.4143)
    near_scale = frame.focal_px / torch.minimum(a[:, 2], b[:, 2])[capsule]
    far_scale = frame.focal_px / torch.maximum(a[:, 2], b[:, 2])[capsule]
    inside_most, inside_least = radius - miss + slack, radius - miss - slack
    most = inside_most * torch.where(inside_most > 0, near_scale, far_scale)
    least = inside_least * torch.where(inside_least > 0, far_scale, near_scale)
    columns, rows = -(-frame.width // _TILE), -(-frame.height // _TILE)
    tile = tile_v * columns + tile_u
    best = torch.full((columns * rows,), -reach_px, dtype=a.dtype, device=a.device)
    best.scatter_reduce_(0, tile, least, "amax")
    return most >= best[tile] - 1e-3


def render_tiled(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    tau: float,
    cutoff: float = CUTOFF,
    won: tuple[Tensor, Tensor] | None = None,
) -> Tensor:
    """The same image and gradient as `render_dense`, up to sigmoid(-cutoff).

    `won` takes the winners of an earlier call: a lower bound of the image, exact for small motions
    wherever the winner did not change.
    """
    a, b = frame.local(starts), frame.local(ends)
    if won is None:
        won = winners(a.detach(), b.detach(), frame, radius, cutoff / tau)
    pixel, capsule = won
    qx = ((pixel % frame.width).to(a.dtype) + frame.u0) * frame.step
    qy = ((pixel // frame.width).to(a.dtype) + frame.v0) * frame.step
    s = capsule_distance(a[capsule], b[capsule], qx, qy, radius, frame.focal_px)
    image = torch.zeros(frame.width * frame.height, dtype=a.dtype, device=a.device)
    image = image.index_put((pixel,), torch.sigmoid(tau * s))
    return image.reshape(frame.height, frame.width)
