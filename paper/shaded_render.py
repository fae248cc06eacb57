"""A shaded picture of the tube: diffuse, one light, soft at the edges, differentiable in the points.

Strands cover each other by depth, the front-most first; each has a soft edge over what lies behind it, so
that a picture tells which strand passes in front (the paper's future work, section 7).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from knotfab.render.capsules import capsule_distance, ray_miss
from knotfab.render.silhouette import Frame

_LAYERS = 3  # strands seen through each other's soft edges; what lies deeper is not seen
_CHUNK = 1 << 18  # (pixel, capsule) pairs evaluated at once
# a share of the squared radius: the surface's slope grows without bound towards its limb
_GRAZING = 0.01
_CUTOFF = 6.0  # tau * s below minus this is empty: sigmoid(-6) = 0.25 %


@dataclass(frozen=True)
class Shading:
    """One lamp and what it leaves; brightness runs from 0 to 1. No strand shades another."""

    lamp_mm: tuple[float, float, float]  # scene coordinates
    ambient: float = 0.15
    background: float = 0.0


@dataclass(frozen=True)
class Layers:
    """What each pixel sees, front to back: [k] flat pixels with a surface and an edge for each.

    `surface` is the capsule that the ray meets first in a strand, `edge` the one it passes deepest
    in, which decides the strand's coverage. Entry m of `layers` is layer m of its pixels.
    """

    layers: tuple[tuple[Tensor, Tensor, Tensor], ...]  # (pixel, surface, edge)


def capsule_hit(
    a: Tensor,  # [..., 3] receiver axes, mm
    b: Tensor,  # [..., 3]
    qx: Tensor,  # [...] ray direction, x/z
    qy: Tensor,  # [...]
    radius: float,
) -> tuple[Tensor, Tensor]:
    """Find where rays meet capsules first: the point [..., 3] and the unit normal there [..., 3].

    The nearest point of the axis to a ray that enters the surface is found on the cylinder, or at an
    end where that falls outside the segment. A ray that misses gets the point that it passes nearest
    to. Differentiable in `a` and `b`; near the limb the slope is bounded.
    """
    ray = torch.stack([qx, qy, torch.ones_like(qx)], -1)
    ray = ray / ray.norm(dim=-1, keepdim=True)
    edge = b - a
    square = (edge * edge).sum(-1, keepdim=True).clamp_min(1e-20)
    # across the axis: |t ray' - a'| = radius, primes for what is left without the axis's direction
    along_ray = (ray * edge).sum(-1, keepdim=True) / square
    along_a = (a * edge).sum(-1, keepdim=True) / square
    ray_across, a_across = ray - along_ray * edge, a - along_a * edge
    t = _enter(ray_across, a_across, radius)
    share = t * along_ray - along_a
    # a ray along the axis enters at the end that faces the light
    end = torch.where(share < 0.5, a, b)
    at_end = _enter(ray, end, radius)
    inside = (share >= 0) & (share <= 1)
    t = torch.where(inside, t, at_end)
    foot = torch.where(inside, a + share * edge, end)
    point = t * ray
    normal = point - foot
    return point, normal / normal.norm(dim=-1, keepdim=True).clamp_min(1e-12)


def _enter(ray: Tensor, middle: Tensor, radius: float) -> Tensor:
    """Return [..., 1] the smaller t with |t ray - middle| = radius, or of the least distance."""
    square = (ray * ray).sum(-1, keepdim=True).clamp_min(1e-12)
    near = (ray * middle).sum(-1, keepdim=True) / square
    gap = middle - near * ray
    depth = (radius * radius - (gap * gap).sum(-1, keepdim=True)).clamp_min(_GRAZING * radius**2)
    return near - (depth / square).sqrt()


def layers_of(
    a: Tensor,  # [n, 3] receiver axes
    b: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    reach_px: float,
    following: Tensor,  # [n] the capsule after each one
) -> Layers:
    """Return the front-most strands of each pixel. Not differentiable.

    A strand is a run of capsules, one following the other, that all come within `reach_px` of the
    pixel. Its place in depth is that of its first hit, or of its nearest point where it is missed.
    """
    with torch.no_grad():
        pixel, capsule, s, depth = _pairs(a, b, frame, radius, reach_px)
        run = _runs(pixel, capsule, following)
        count = int(run.max()) + 1 if len(run) else 0
        surface_rank = torch.where(s > 0, depth, 1e9 - s)  # hits by depth, misses by distance
        surface = _least(surface_rank, run, count)
        edge = _least(-s, run, count)
        layers = []
        of_run, at = pixel[surface], depth[surface]
        left = torch.arange(count, device=a.device)
        size = frame.width * frame.height
        for _ in range(_LAYERS):
            if not len(left):
                break
            first = _least(at[left], of_run[left], size)
            taken = left[first[first >= 0]]
            layers.append((of_run[taken], capsule[surface[taken]], capsule[edge[taken]]))
            kept = torch.ones(count, dtype=torch.bool, device=a.device)
            kept[taken] = False
            left = left[kept[left]]
        return Layers(tuple(layers))


def _least(value: Tensor, group: Tensor, groups: int) -> Tensor:
    """Return [groups] index of the least value in each group, -1 where it is empty."""
    order = torch.argsort(value, descending=True, stable=True)
    found = torch.full((groups,), -1, dtype=torch.long, device=value.device)
    # sorted by value inside each group: the last of a group is its least
    order = order[torch.argsort(group[order], stable=True)]
    last = torch.ones(len(order), dtype=torch.bool, device=value.device)
    sorted_group = group[order]
    last[:-1] = sorted_group[1:] != sorted_group[:-1]
    found[sorted_group[last]] = order[last]
    return found


def _pairs(
    a: Tensor, b: Tensor, frame: Frame, radius: float, reach_px: float
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return (pixel, capsule, signed distance px, entry depth mm) with s > -reach_px, by capsule boxes."""
    ends = torch.stack([a, b])
    z = ends[..., 2]
    near = (z - radius).clamp_min(1e-6)
    grow = (
        radius / near * frame.focal_px * (1 + (ends[..., :2] / near[..., None]).abs().amax(-1)) ** 2
    )
    # the signed distance falls by at least z / (z - r) of a pixel in a pixel
    grow = grow + reach_px * (z / near) * (1 + (ends[..., :2] / z[..., None]).abs().amax(-1)) + 1.0
    uv = frame.pixels(ends)
    size = torch.tensor([frame.width, frame.height], device=a.device)
    low = (uv - grow[..., None]).amin(0).ceil().long().clamp_min(0)
    high = torch.minimum((uv + grow[..., None]).amax(0).floor().long(), size - 1)
    spans = (high - low + 1).clamp_min(0)
    counts = torch.where((z > 2 * radius).all(0), spans[:, 0] * spans[:, 1], 0)
    starts = torch.cumsum(counts, 0)
    found = []
    first = 0
    while first < len(counts):
        before = int(starts[first] - counts[first])
        last = max(first + 1, int(torch.searchsorted(starts, before + _CHUNK, right=True)))
        few = torch.arange(first, min(last, len(counts)), device=a.device)
        capsule = torch.repeat_interleave(few, counts[few])
        k = torch.arange(len(capsule), device=a.device) - (starts - counts)[capsule] + before
        wide = spans[capsule, 0].clamp_min(1)
        u, v = low[capsule, 0] + k % wide, low[capsule, 1] + k // wide
        qx, qy = (u + frame.u0) * frame.step, (v + frame.v0) * frame.step
        p, q, qx, qy = a[capsule], b[capsule], qx.to(a.dtype), qy.to(a.dtype)
        miss, middle = ray_miss(p, q, qx, qy)
        s = (radius - miss) * (frame.focal_px / middle.clamp_min(1e-6))
        keep = s > -reach_px
        capsule, s = capsule[keep], s[keep]
        point, _ = capsule_hit(p[keep], q[keep], qx[keep], qy[keep], radius)
        found.append(((v * frame.width + u)[keep], capsule, s, point[:, 2]))
        first = last
    pixel, capsule, s, depth = (torch.cat(parts) for parts in zip(*found, strict=True))
    return pixel, capsule, s, depth


def _runs(pixel: Tensor, capsule: Tensor, following: Tensor) -> Tensor:
    """Return [k] the number of the strand of each pair: capsules of one pixel that follow one another."""
    n = len(following)
    key = pixel * n + capsule
    order = torch.argsort(key)
    key = key[order]
    after = pixel[order] * n + following[capsule[order]]
    at = torch.searchsorted(key, after).clamp_max(max(len(key) - 1, 0))
    joined = key[at] == after if len(key) else torch.zeros(0, dtype=torch.bool)
    # consecutive rows come first, then each ring's last capsule back to its first
    rows = torch.arange(len(key), device=key.device)
    onwards = joined & (at == rows + 1)
    starts = torch.ones(len(key), dtype=torch.long, device=key.device)
    starts[1:] = (~onwards[:-1]).long()
    run = torch.cumsum(starts, 0) - 1
    back = joined & (at < rows)
    label = torch.arange(int(run.max()) + 1 if len(run) else 0, device=key.device)
    label[run[rows[back]]] = run[at[back]]
    label = label[run]
    _, label = torch.unique(label, return_inverse=True)
    out = torch.empty_like(label)
    out[order] = label
    return out


def render_shaded(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    tau: float,
    shading: Shading,
    following: Tensor | None = None,
    seen: Layers | None = None,
) -> Tensor:
    """Render image [height, width] of the lit tube: ambient + (1 - ambient) * cosine, over the background.

    A strand's coverage is sigmoid(tau * signed distance in px), as in the silhouette; strands are laid over
    each other front to back. Differentiable with respect to the points, but for which strand is where:
    `seen` takes the layers of an earlier call. `following` tells which capsule joins the end
    of each (by default the next row, the last one closing the ring).
    """
    a, b = frame.local(starts), frame.local(ends)
    if following is None:
        following = torch.arange(len(a), device=a.device).roll(-1)
    if seen is None:
        seen = layers_of(a.detach(), b.detach(), frame, radius, _CUTOFF / tau, following)
    lamp = frame.local(torch.tensor(shading.lamp_mm, dtype=a.dtype, device=a.device))
    size = frame.width * frame.height
    image = torch.zeros(size, dtype=a.dtype, device=a.device)
    # the light that the layers so far let through
    clear = torch.ones(size, dtype=a.dtype, device=a.device)
    for pixel, surface, edge in seen.layers:
        qx = ((pixel % frame.width).to(a.dtype) + frame.u0) * frame.step
        qy = ((pixel // frame.width).to(a.dtype) + frame.v0) * frame.step
        s = capsule_distance(a[edge], b[edge], qx, qy, radius, frame.focal_px)
        cover = torch.sigmoid(tau * s)
        point, normal = capsule_hit(a[surface], b[surface], qx, qy, radius)
        to_lamp = lamp - point
        cosine = (normal * to_lamp).sum(-1) / to_lamp.norm(dim=-1)
        light = shading.ambient + (1 - shading.ambient) * cosine.clamp_min(0)
        through = clear[pixel]
        image = image.index_put((pixel,), image[pixel] + through * cover * light)
        clear = clear.index_put((pixel,), through * (1 - cover))
    return (image + clear * shading.background).reshape(frame.height, frame.width)
