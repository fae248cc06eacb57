"""The rigid layer: a rotation about the origin, then a translation."""

from __future__ import annotations

import torch
from torch import Tensor, nn

__all__ = ["Rigid", "rotation"]


def rotation(turn: Tensor) -> Tensor:
    """Return the rotation matrix [3, 3] of the quaternion (1, turn) / |(1, turn)|, `turn` [3].

    Its axis is that of `turn`, its angle 2 atan |turn| (Cayley). Unlike Euler angles or an axis
    with an angle it has no singular place: every `turn` gives one rotation, smoothly.
    """
    # scaled first, so that the squares of huge numbers do not overflow
    size = torch.maximum(turn.abs().amax(), torch.ones_like(turn[0])).detach()
    q = torch.cat([torch.ones_like(turn[:1]) / size, turn / size])
    w, x, y, z = q / q.norm()
    rows = (
        (w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )
    return torch.stack([torch.stack(row) for row in rows])


class Rigid(nn.Module):
    """x -> R x + shift; the identity at the start. Paper, supplement, "Rigid Transformation layer"."""

    def __init__(self, dtype: torch.dtype = torch.float64) -> None:
        super().__init__()
        self.turn = nn.Parameter(torch.zeros(3, dtype=dtype))
        self.shift = nn.Parameter(torch.zeros(3, dtype=dtype))

    def forward(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Return [..., 3] moved; with a `share` below 1 by that much of the way from the identity."""
        return points @ rotation(share * self.turn).T + share * self.shift

    def inverse(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Return [..., 3] moved back."""
        return (points - share * self.shift) @ rotation(share * self.turn)
