"""The tiled renderer: each pixel's winning capsule is found without gradient, then evaluated with it.

sigmoid(tau s) is monotone, so the maximum over capsules is the sigmoid of the largest s, and its gradient
flows through that capsule alone. Candidates come from square tiles that a capsule's shadow, grown
by the reach of the sigmoid, can touch. Cheap bounds decide between most of them; the rest are compared
by the formula of the image itself, so that single precision finds the winner of the dense formula.
"""

from __future__ import annotations

import torch
from torch import Tensor

from knotfab.render.capsules import (
    BEHIND,
    capsule_distance,
    cut_before_light,
    ray_miss,
    tensor_frame,
)
from knotfab.render.silhouette import CUTOFF, Frame, Number, number

_TILE = 4  # pixels; pairs are found on tiles of twice that
_COARSE = 2 * _TILE
_LEAST_REACH_PX = 0.1  # the squared distances of the tiles lose the last few hundredths of a pixel
_MIDDLE, _FARTHEST = 5, 2.8285  # a tile's pixel (1, 1), and how far its others are from it at most
_LOST = 8.0  # machine epsilons
_CHUNK = 1 << 15  # (capsule, tile) pairs evaluated at once, to stay in cache


def _bounds(
    a: Tensor, b: Tensor, seen: Tensor, frame: Frame, radius: float, margin_px: float
) -> tuple[Tensor, Tensor]:
    """Return the first coarse tile [n, 2] of each capsule and how many [n, 2] it can colour along u and v.

    A sphere's silhouette reaches less than r / (z - 2r) * (1 + |q|)^2 * focal beyond its centre's
    pixel, and the signed distance falls by at least one pixel in 1 + |q| beyond that. Capsules that are not
    `seen` are left out; the others are deeper than two radii.
    """
    ends = torch.stack([a, b])
    z = ends[..., 2]
    near = (z - 2 * radius).clamp_min(1e-30)
    q = ends[..., :2] / near[..., None]
    aside = 1 + q.abs().amax(-1)
    grow = radius / near * aside**2 * frame.focal_px + margin_px * (z / near) * aside + 1.0
    uv = frame.pixels(ends)
    low = (uv - grow[..., None]).amin(0)
    high = (uv + grow[..., None]).amax(0)
    visible = seen & (z > 2 * radius).all(0)
    size = torch.tensor([frame.width, frame.height], device=a.device, dtype=a.dtype)
    visible &= ((high >= 0) & (low <= size - 1)).all(-1)
    low = (low.clamp_min(0).minimum(size - 1) / _COARSE).floor().long()
    high = (high.clamp_min(0).minimum(size - 1) / _COARSE).floor().long()
    spans = torch.where(visible[:, None], high - low + 1, 0)
    return low, spans


def winners(
    a: Tensor,  # [n, 3] receiver axes
    b: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    reach_px: float,
) -> tuple[Tensor, Tensor]:
    """Return (pixel, capsule): flat indices of pixels with s > -reach_px, and the capsule of largest s.

    Not differentiable.
    """
    reach_px = max(reach_px, _LEAST_REACH_PX)
    with torch.no_grad():
        a, b, seen = cut_before_light(a, b, radius)
        low, spans = _bounds(a, b, seen, frame, radius, reach_px)
        counts = spans[:, 0] * spans[:, 1]
        capsule = torch.repeat_interleave(torch.arange(len(counts), device=a.device), counts)
        first = torch.cumsum(counts, 0) - counts
        k = torch.arange(len(capsule), device=a.device) - first[capsule]
        wide = spans[capsule, 0]
        row = k // wide
        tile_u = low[capsule, 0] + (k - row * wide)
        tile_v = low[capsule, 1] + row
        keep = _may_win(a, b, frame, radius, reach_px, capsule, tile_u, tile_v, _COARSE)
        capsule, tile_u, tile_v = capsule[keep], tile_u[keep], tile_v[keep]
        # the four quarters of each tile have tighter bounds
        quarter = torch.arange(4, device=a.device)
        capsule = capsule[:, None].expand(-1, 4).flatten()
        tile_u = (2 * tile_u[:, None] + quarter % 2).flatten()
        tile_v = (2 * tile_v[:, None] + quarter // 2).flatten()
        keep = _may_win(a, b, frame, radius, reach_px, capsule, tile_u, tile_v, _TILE)
        capsule, tile_u, tile_v = capsule[keep], tile_u[keep], tile_v[keep]
        # whole coarse tiles, so that every quarter has its place
        columns = -(-frame.width // _COARSE) * 2
        rows = -(-frame.height // _COARSE) * 2
        best = torch.full(
            (columns * rows, _TILE * _TILE), -reach_px, dtype=a.dtype, device=a.device
        )
        quadratics = _quadratics(a, b, frame)
        bounds = []
        for first_pair in range(0, len(capsule), _CHUNK):
            part = slice(first_pair, first_pair + _CHUNK)
            c, tu, tv = capsule[part], tile_u[part], tile_v[part]
            least, doubt = _tile_distance((a, b), quadratics, c, tu, tv, frame, radius)
            slot = tv * columns + tu
            best.scatter_reduce_(0, slot[:, None].expand_as(least), least, "amax")
            bounds.append((c, slot, least, doubt))
        places, rivals = [], []
        for c, slot, least, doubt in bounds:
            pair, offset = (least.add_(doubt[:, None]) >= best[slot]).nonzero(as_tuple=True)
            places.append(slot[pair] * (_TILE * _TILE) + offset)
            rivals.append(c[pair])
        winner = torch.full((best.numel(),), -1, dtype=torch.long, device=a.device)
        if places:
            _settle(winner, torch.cat(places), torch.cat(rivals), a, b, frame, radius, columns)
        found = (winner >= 0).nonzero()[:, 0]
        u, v = _pixel(found, columns)
        inside = (u < frame.width) & (v < frame.height)
        return (v * frame.width + u)[inside], winner[found][inside]


def _settle(
    winner: Tensor,  # [p], filled in
    place: Tensor,  # [k]
    rival: Tensor,  # [k]
    a: Tensor,
    b: Tensor,
    frame: Frame,
    radius: float,
    columns: int,
) -> None:
    """Choose each place's winner among its rivals; the image's own formula decides between several."""
    winner[place] = rival
    other = (winner[place] != rival).nonzero()[:, 0]
    place, rival = place[other], rival[other]
    u, v = _pixel(place, columns)
    qx, qy = (u.to(a.dtype) + frame.u0) * frame.step, (v.to(a.dtype) + frame.v0) * frame.step
    both = torch.stack([winner[place], rival])
    held, found = capsule_distance(a[both], b[both], qx, qy, radius, frame.focal_px)
    top = torch.full((len(winner),), BEHIND, dtype=a.dtype, device=a.device)
    top.scatter_reduce_(0, place, torch.maximum(held, found), "amax")
    most = top[place]
    winner[place[held < most]] = -1
    # the last of equals is taken, whatever the order in which threads wrote them
    equal = found == most
    winner.scatter_reduce_(0, place[equal], rival[equal], "amax")


def _pixel(place: Tensor, columns: int) -> tuple[Tensor, Tensor]:
    """Return the pixel (u, v) of places in the list of tiles, `columns` tiles a row."""
    # tiles are 4 x 4: shifts are much faster than divisions
    tile, inner = place >> 4, place & 15
    row = tile // columns
    return ((tile - row * columns) << 2) + (inner & 3), (row << 2) + (inner >> 2)


def _quadratics(a: Tensor, b: Tensor, frame: Frame) -> tuple[Tensor, Tensor, Tensor]:
    """Return each capsule's reference pixel [n, 2] and the coefficients [n, 3, 6] of three quadratics there.

    Also return how much rounding can change a square, [n, 2]: at the reference, and in addition per squared
    pixel of distance from there.

    The moment D x p of a pixel's ray about an end p is linear in the pixel, so the squares that the
    distance is made of (start . start, start . change, change . change, with the change from one
    end to the other) are quadratic: c0 + c1 u + c2 v + c3 u^2 + c4 u v + c5 v^2 in pixels from the
    reference, which lies near the capsule so that little is lost in the differences.
    """
    reference = frame.pixels(0.5 * (a + b)).round()
    # a capsule that reaches far out of the picture gets a place that is near the picture instead
    size = torch.tensor([frame.width, frame.height], dtype=a.dtype, device=a.device)
    reference = torch.maximum(torch.minimum(reference, 2 * size), -size)
    qx = (reference[:, 0] + frame.u0) * frame.step
    qy = (reference[:, 1] + frame.v0) * frame.step
    zero = torch.zeros_like(qx)

    def moment(p: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return d x p at the reference, and its change per pixel along u and along v: [3, n] each."""
        x, y, z = p.T
        dx, dy = x - z * qx, y - z * qy
        at = torch.stack([-dy, dx, dy * qx - dx * qy])
        # d(D x p)/du = (step, 0, 0) x p, d/dv = (0, step, 0) x p
        along_u = torch.stack([zero, -z, y]) * frame.step
        along_v = torch.stack([z, zero, -x]) * frame.step
        return at, along_u, along_v

    start, end = moment(a), moment(b)
    change = (end[0] - start[0], end[1] - start[1], end[2] - start[2])

    def product(one: tuple[Tensor, ...], two: tuple[Tensor, ...]) -> Tensor:
        (c, u, v), (d, w, x) = one, two
        terms = (c * d, c * w + u * d, c * x + v * d, u * w, u * x + v * w, v * x)
        return torch.stack([term.sum(0) for term in terms], 1)

    squares = (product(start, start), product(start, change), product(change, change))
    # all terms of a square are at most of this size
    size = squares[0] + squares[2]
    lost = torch.stack([size[:, 0], size[:, [3, 5]].amax(1)], 1)
    return reference, torch.stack(squares, 1), _LOST * torch.finfo(a.dtype).eps * lost


def _tile_distance(
    ends: tuple[Tensor, Tensor],
    quadratics: tuple[Tensor, Tensor, Tensor],
    capsule: Tensor,
    tile_u: Tensor,
    tile_v: Tensor,
    frame: Frame,
    radius: float,
) -> tuple[Tensor, Tensor]:
    """Bound `capsule_distance` of [m] capsules at the [m, 16] pixels of their tiles, by few operations.

    Returns the lower bounds, and how far [m] the upper ones lie above them at most. The squares lose
    digits that are small against the way from the reference to the tile and along the capsule, which
    matters for capsules far longer than wide.
    """
    a, b = ends
    reference, coefficients, sizes = quadratics
    c0, c1, c2, c3, c4, c5 = coefficients[capsule].unbind(-1)  # [m, 3] each
    u = (tile_u * _TILE).to(a.dtype)
    v = (tile_v * _TILE).to(a.dtype)
    x, y = (u - reference[capsule, 0])[:, None], (v - reference[capsule, 1])[:, None]
    # the quadratics are moved to the tile's first pixel
    moved = torch.stack(
        [
            c0 + x * (c1 + x * c3 + y * c4) + y * (c2 + y * c5),
            c1 + 2 * x * c3 + y * c4,
            c2 + 2 * y * c5 + x * c4,
            c3,
            c4,
            c5,
        ],
        -1,
    )
    lost = torch.addcmul(sizes[capsule, 0], x[:, 0] ** 2 + y[:, 0] ** 2, sizes[capsule, 1])
    moved[:, 0, 0] += lost
    offset = torch.arange(_TILE * _TILE, device=a.device)
    du, dv = (offset % _TILE).to(a.dtype), (offset // _TILE).to(a.dtype)
    monomials = torch.stack([torch.ones_like(du), du, dv, du * du, du * dv, dv * dv])
    square, cross, extent = (moved @ monomials).unbind(1)
    t = (-cross / extent.clamp_min(1e-30)).clamp_(0.0, 1.0)
    miss = torch.addcmul(square, t, torch.addcmul(2 * cross, t, extent)).clamp_min_(1e-30)
    along = torch.arange(_TILE, device=a.device)
    px = (u[:, None] + along + frame.u0) * frame.step
    py = (v[:, None] + along + frame.v0) * frame.step
    stretch = (1 + py * py)[:, :, None] + (px * px)[:, None, :]
    miss = miss.div_(stretch.reshape(miss.shape)).sqrt_()
    z0, z1 = a[capsule, 2], b[capsule, 2]
    depth = torch.addcmul(z0[:, None], t, (z1 - z0)[:, None]).clamp_min_(1e-30)
    # sqrt(m + lost) - sqrt(m - lost) <= 2 lost / sqrt(m + lost), whose least in the tile is this at least
    far = torch.maximum(a.norm(dim=1), b.norm(dim=1))[capsule]
    least_miss = torch.maximum(miss[:, _MIDDLE] - far * (frame.step * _FARTHEST), lost.sqrt())
    doubt = 2 * lost / least_miss.clamp_min_(1e-30) * frame.focal_px / torch.minimum(z0, z1)
    return (radius - miss).mul_(frame.focal_px).div_(depth), doubt


def _may_win(
    a: Tensor,
    b: Tensor,
    frame: Frame,
    radius: float,
    reach_px: float,
    capsule: Tensor,
    tile_u: Tensor,
    tile_v: Tensor,
    size: int,
) -> Tensor:
    """Return which (capsule, tile) pairs may hold a winner: those not beaten all over the tile.

    The distance of a pixel's ray to a segment changes by at most |p| per unit of direction (p the
    farther end), so its value at the tile's middle bounds it over the tile; depths between the ends'
    bound the signed distance. A pair whose upper bound is below the tile's best lower bound is out.
    """
    half = 0.5 * (size - 1)
    qx = (tile_u.to(a.dtype) * size + half + frame.u0) * frame.step
    qy = (tile_v.to(a.dtype) * size + half + frame.v0) * frame.step
    p, q = a[capsule], b[capsule]
    miss, _ = ray_miss(p, q, qx, qy)
    far = torch.maximum(a.norm(dim=1), b.norm(dim=1))[capsule]
    slack = far * (frame.step * half * 1.4143)
    near_scale = frame.focal_px / torch.minimum(a[:, 2], b[:, 2])[capsule]
    far_scale = frame.focal_px / torch.maximum(a[:, 2], b[:, 2])[capsule]
    inside_most, inside_least = radius - miss + slack, radius - miss - slack
    most = inside_most * torch.where(inside_most > 0, near_scale, far_scale)
    least = inside_least * torch.where(inside_least > 0, far_scale, near_scale)
    columns, rows = 2 * -(-frame.width // _COARSE), 2 * -(-frame.height // _COARSE)
    tile = tile_v * columns + tile_u
    best = torch.full((columns * rows,), -reach_px, dtype=a.dtype, device=a.device)
    best.scatter_reduce_(0, tile, least, "amax")
    kept: Tensor = most >= best[tile] - 1e-3
    return kept


def render_tiled(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: Number,
    tau: float,
    cutoff: float = CUTOFF,
    won: tuple[Tensor, Tensor] | None = None,
) -> Tensor:
    """Render the same image and gradient as `dense.render_dense` does, up to sigmoid(-cutoff).

    Differentiable in the points, and in the frame's numbers and the radius where these are tensors. `won`
    takes the winners of an earlier call: a lower bound of the image, exact for small motions wherever
    the winner did not change.
    """
    a, b = frame.local(starts), frame.local(ends)
    thick = number(radius)
    if won is None:
        fixed = tensor_frame(frame.arrays(), a.dtype, a.device)
        won = winners(a.detach(), b.detach(), fixed, thick, cutoff / tau)
    pixel, capsule = won
    a, b, _ = cut_before_light(a, b, thick)
    row = pixel // frame.width
    qx = ((pixel - row * frame.width).to(a.dtype) + frame.u0) * frame.step
    qy = (row.to(a.dtype) + frame.v0) * frame.step
    s = capsule_distance(a[capsule], b[capsule], qx, qy, radius, frame.focal_px)
    image = torch.zeros(frame.width * frame.height, dtype=a.dtype, device=a.device)
    image = image.index_put((pixel,), torch.sigmoid(tau * s))
    return image.reshape(frame.height, frame.width)
