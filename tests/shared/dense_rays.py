"""The dense formula: every pixel against every capsule. Slow, plain, and the tiled form's oracle."""

from __future__ import annotations

import torch
from torch import Tensor

from knotfab.render.capsules import BEHIND, capsule_distance, cut_before_light
from knotfab.render.silhouette import Frame


def render_dense(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    tau: float,
    chunk_pixels: int = 4096,
) -> Tensor:
    """Image [height, width] of sigmoid(tau * max over capsules of the signed distance in px).

    Paper, sec. 3.3 (occupancy, max over primitives), with the ray-distance silhouette.
    """
    a, b, seen = cut_before_light(frame.local(starts), frame.local(ends), radius)
    count = frame.width * frame.height
    index = torch.arange(count, device=a.device)
    image = []
    for first in range(0, count, chunk_pixels):
        pixels = index[first : first + chunk_pixels]
        qx = ((pixels % frame.width).to(a.dtype) + frame.u0) * frame.step
        qy = ((pixels // frame.width).to(a.dtype) + frame.v0) * frame.step
        s = capsule_distance(a[None], b[None], qx[:, None], qy[:, None], radius, frame.focal_px)
        s = torch.where(seen, s, BEHIND)
        image.append(torch.sigmoid(tau * s.max(dim=1).values.clamp_min(BEHIND)))
    return torch.cat(image).reshape(frame.height, frame.width)
