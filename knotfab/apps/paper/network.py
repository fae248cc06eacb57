"""The paper's invertible network: rigid and coupling layers in turn, starting as the identity."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class CouplingNetwork(nn.Module):
    """An orientation-preserving homeomorphism of space, whatever its weights.

    Paper, supplement, "Network Architecture", with corrections (see `Coupling`): a rigid layer, then `depth`
    times a coupling layer and a rigid layer. Its hidden units bend inside the cube [-1, 1]^3, so points
    should have that size.

    Args:
        depth: number of coupling layers (8 in the paper).
        width: hidden units of each S and T (1024 in the paper).
        seed: of the permutations and the hidden units.
        log_scale: each layer's scale stays between exp(-log_scale) and exp(log_scale).
        gain: standard deviation of the hidden units' slopes; higher values deform finer details.
        dtype: float64 or float32. A seed gives the same network in both, up to rounding.

    Raises:
        ValueError: an argument is not positive.
    """

    def __init__(
        self,
        depth: int = 8,
        width: int = 128,
        seed: int = 0,
        *,
        log_scale: float = 1.0,
        gain: float = 3.0,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        super().__init__()
        if min(depth, width) < 1 or not (log_scale > 0 and gain > 0):
            raise ValueError(
                "depth, width, log_scale and gain must be positive, "
                f"got {depth}, {width}, {log_scale}, {gain}"
            )
        generator = torch.Generator().manual_seed(seed)
        layers: list[Rigid | Coupling] = [Rigid(dtype)]
        for _ in range(depth):
            order = torch.randperm(3, generator=generator)
            layers.append(Coupling(order, width, log_scale, gain, generator, dtype))
            layers.append(Rigid(dtype))
        self.layers = nn.ModuleList(layers)

    def forward(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Map points.

        `share` runs through an ambient isotopy from the identity (0) to the network (1).
        """
        for layer in self.layers:
            points = layer(points, share)
        return points

    def inverse(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Map points back. The error is rounding times the condition number of the map."""
        for layer in reversed(self.layers):
            assert isinstance(layer, Rigid | Coupling)
            points = layer.inverse(points, share)
        return points


class Perceptron(nn.Module):
    """A scalar field of the plane: one hidden layer of tanh units, zero everywhere at the start.

    The units' slopes are normally distributed with standard deviation `gain`, and each unit bends along a
    line through a random point of the square [-1, 1]^2. The field is bounded.
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
        """Return the scalar field at `uv`, [..., 1]."""
        found: Tensor = self.out(torch.tanh(self.hidden(uv)))
        return found


class Coupling(nn.Module):
    """An affine coupling layer: (u, v, w) = x[order] becomes (u, v, w S(u, v) + T(u, v)), put back in order.

    It starts as the identity. Paper, supplement, "Affine Coupling layer", with two corrections. The inverse
    takes the coordinates in the same order as the forward pass (the printed order is wrong for permutations
    of order 3). The scale is S = exp(b tanh(s / b)), between exp(-b) and exp(b), since zero would have no
    inverse and a negative one would mirror.

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
        """Return scale and shift [..., 1] at `uv` [..., 2]."""
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
        """Map points, with `share` below 1 only part of the way from the identity."""
        uv, w, scale, shift = self._parts(points, share)
        return torch.cat([uv, w * scale + shift], -1)[..., self.back]

    def inverse(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Map points back."""
        uv, w, scale, shift = self._parts(points, share)
        return torch.cat([uv, (w - shift) / scale], -1)[..., self.back]


def rotation(turn: Tensor) -> Tensor:
    """Return the rotation matrix [3, 3] of the quaternion (1, turn) / |(1, turn)| for `turn` [3].

    Its axis is `turn` and its angle 2 atan |turn| (Cayley). It depends smoothly on every `turn`, without the
    singularities of Euler angles.
    """
    # scaled first, since the squares of huge numbers would overflow
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
    """A rigid motion x -> R x + shift, the identity at the start.

    Paper, supplement, "Rigid Transformation layer".
    """

    def __init__(self, dtype: torch.dtype = torch.float64) -> None:
        super().__init__()
        self.turn = nn.Parameter(torch.zeros(3, dtype=dtype))
        self.shift = nn.Parameter(torch.zeros(3, dtype=dtype))

    def forward(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Move points, with `share` below 1 only part of the way from the identity."""
        return points @ rotation(share * self.turn).T + share * self.shift

    def inverse(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Move points back."""
        return (points - share * self.shift) @ rotation(share * self.turn)
