"""The affine coupling layer: one coordinate is scaled and shifted by functions of the other two."""

from __future__ import annotations

import torch
from torch import Tensor, nn

__all__ = ["Coupling", "Perceptron"]


class Perceptron(nn.Module):
    """Two inputs, one hidden layer of tanh units, one output; zero everywhere at the start.

    The units' slopes are normal with standard deviation `gain`, and each unit bends along a line through
    a random point of the square [-1, 1]^2. Being bounded, a layer moves nothing without bound.
    """

    def __init__(
        self, width: int, gain: float, generator: torch.Generator, dtype: torch.dtype
    ) -> None:
        super().__init__()
        slopes = gain * torch.randn(width, 2, generator=generator, dtype=torch.float64)
        middle = 2 * torch.rand(width, 2, generator=generator, dtype=torch.float64) - 1
        self.hidden = nn.Linear(2, width, dtype=dtype)
        self.out = nn.Linear(width, 1, dtype=dtype)
        with torch.no_grad():
            self.hidden.weight.copy_(slopes)
            self.hidden.bias.copy_(-(slopes * middle).sum(1))
            self.out.weight.zero_()
            self.out.bias.zero_()

    def forward(
        self,
        uv: Tensor,  # [..., 2]
    ) -> Tensor:
        """Return [..., 1]"""
        found: Tensor = self.out(torch.tanh(self.hidden(uv)))
        return found


class Coupling(nn.Module):
    """(u, v, w) = x[order] -> (u, v, w S(u, v) + T(u, v)), put back in order; the identity at start.

    Paper, supplement, "Affine Coupling layer", with two errata mended. The inverse takes the
    coordinates in the same order as the forward pass (printed the other way round, which is wrong for
    permutations of order 3). The scale is S = exp(b tanh(s / b)), between exp(-b) and exp(b): never
    zero, where the layer would have no inverse, nor negative, where it would be a mirror.

    Args:
        order: which coordinates are u, v and w.
        width: hidden units of S and of T.
        log_scale: the bound b.
        gain: see `Perceptron`.
    """

    order: Tensor
    back: Tensor

    def __init__(
        self,
        order: Tensor,  # [3]
        width: int,
        log_scale: float,
        gain: float,
        generator: torch.Generator,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        super().__init__()
        self.log_scale = log_scale
        self.register_buffer("order", order)
        self.register_buffer("back", torch.argsort(order))
        self.scale = Perceptron(width, gain, generator, dtype)
        self.shift = Perceptron(width, gain, generator, dtype)

    def _affine(self, uv: Tensor, share: float) -> tuple[Tensor, Tensor]:
        """Scale and shift [..., 1] at `uv` [..., 2]."""
        log = self.log_scale * torch.tanh(share * self.scale(uv) / self.log_scale)
        return log.exp(), share * self.shift(uv)

    def _parts(self, points: Tensor, share: float) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return (u, v) [..., 2], w, its scale and its shift [..., 1]."""
        ordered = points[..., self.order]
        uv, w = ordered[..., :2], ordered[..., 2:]
        return uv, w, *self._affine(uv, share)

    def forward(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Return [..., 3] mapped; with a `share` below 1 by that much of the way from the identity."""
        uv, w, scale, shift = self._parts(points, share)
        return torch.cat([uv, w * scale + shift], -1)[..., self.back]

    def inverse(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Return [..., 3] mapped back."""
        uv, w, scale, shift = self._parts(points, share)
        return torch.cat([uv, (w - shift) / scale], -1)[..., self.back]
