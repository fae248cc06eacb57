"""The paper's template and its random ring sampling: points at sorted random places of a closed curve."""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import torch
from torch import Tensor

Curve = Callable[[Tensor], Tensor]  # places [n] in [0, 1) of a closed curve -> points [n, 3]


def circle(radius: float = 1.0, middle: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Curve:
    """Give the paper's template (cos s, sin s, 0), with s = 2 pi times the place in [0, 1) (section 3.2)."""

    def at(places: Tensor) -> Tensor:
        s = 2 * pi * places
        flat = torch.stack([s.cos(), s.sin(), torch.zeros_like(s)], -1)
        return radius * flat + torch.tensor(middle, dtype=s.dtype, device=s.device)

    return at


def random_ring(count: int, generator: torch.Generator) -> Tensor:
    """Return [count] float64 sorted places in [0, 1), uniform (the paper's random ring-graph)."""
    return torch.rand(count, generator=generator, dtype=torch.float64).sort().values


def even_ring(count: int) -> Tensor:
    """Return [count] float64 evenly spaced places in [0, 1)."""
    return torch.arange(count, dtype=torch.float64) / count
