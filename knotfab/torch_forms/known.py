"""A number whose gradient is known in closed form, as a node of torch's graph."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from knotfab.base.arrays import Array

__all__ = ["known"]


def known(value: float, *parts: tuple[Tensor, Array]) -> Tensor:
    """Return the scalar `value`; `parts` are tensors that it depends on, and its gradient in each."""
    tensors = [tensor for tensor, _ in parts]
    gradients = [gradient for _, gradient in parts]
    return _Known.apply(value, gradients, *tensors)  # type: ignore[no-untyped-call,no-any-return]


class _Known(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, value: float, gradients: list[Array], *tensors: Tensor) -> Tensor:
        ctx.parts = [torch.from_numpy(g).to(t) for g, t in zip(gradients, tensors, strict=True)]
        return tensors[0].new_tensor(value)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor | None, ...]:
        return None, None, *(slope * part for part in ctx.parts)
