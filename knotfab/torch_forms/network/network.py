"""The whole network: rigid and coupling layers in turn, the identity at the start."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from knotfab.torch_forms.network.coupling import Coupling
from knotfab.torch_forms.network.rigid import Rigid

__all__ = ["CouplingNetwork"]


class CouplingNetwork(nn.Module):
    """A homeomorphism of space that keeps its handedness, whatever its weights.

    Paper, supplement, "Network Architecture", errata mended (see `Coupling`): a rigid layer, then `depth`
    times a coupling layer and a rigid layer. Feed it points of order 1: its hidden units bend inside
    the cube [-1, 1]^3.

    Args:
        depth: number of coupling layers (8 in the paper).
        width: hidden units of each S and T (1024 in the paper).
        seed: seed of the permutations and of the hidden units.
        log_scale: each layer's scale stays between exp(-log_scale) and exp(log_scale).
        gain: standard deviation of the hidden units' slopes; higher bends in finer places.
        dtype: float64 or float32. A seed gives the same network in both, up to rounding.

    Raises:
        ValueError: when an argument is not positive.
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
        """Return [..., 3] mapped.

        `share` leads through homeomorphisms from the identity (0) to the network (1), continuously:
        an ambient isotopy.
        """
        for layer in self.layers:
            points = layer(points, share)
        return points

    def inverse(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Return [..., 3] mapped back: `inverse(forward(x)) = x` up to rounding times the map's condition."""
        for layer in reversed(self.layers):
            assert isinstance(layer, Rigid | Coupling)
            points = layer.inverse(points, share)
        return points
