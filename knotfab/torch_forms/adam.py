"""Adam, with a rate for each tensor at each step.

torch's own optimisers load its compiler when the first one is made: a second, and, where torch comes
with Triton, an LLVM that does not bear Mesa's beside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import torch
from torch import Tensor

__all__ = ["Adam"]

_LEAST = 1e-8  # the least root mean square: no step is infinite


class Adam:
    """D. P. Kingma and J. Ba, "Adam: a method for stochastic optimization", ICLR 2015, algorithm 1.

        adam = Adam(tensors)
        adam.step(torch.autograd.grad(loss, adam.tensors), rate)

    Args:
        tensors: what is to be moved, in place.
        betas: how much of the means of gradients and of their squares a step keeps.
    """

    def __init__(
        self, tensors: Iterable[Tensor], betas: tuple[float, float] = (0.9, 0.999)
    ) -> None:
        self.tensors = list(tensors)
        self._betas, self._steps = betas, 0
        self._mean = [torch.zeros_like(t) for t in self.tensors]
        self._square = [torch.zeros_like(t) for t in self.tensors]

    @torch.no_grad()
    def step(self, gradients: Sequence[Tensor], rate: float | Sequence[float]) -> None:
        """Move against `gradients`, of each tensor, by about `rate`, of all or of each."""
        self._steps += 1
        first, second = self._betas
        rates = rate if isinstance(rate, Sequence) else [rate] * len(self.tensors)
        begun, root = 1 - first**self._steps, (1 - second**self._steps) ** 0.5
        for tensor, gradient, mean, square, length in zip(
            self.tensors, gradients, self._mean, self._square, rates, strict=True
        ):
            mean.lerp_(gradient, 1 - first)
            square.mul_(second).addcmul_(gradient, gradient, value=1 - second)
            tensor.addcdiv_(mean, (square.sqrt() / root).add_(_LEAST), value=-length / begun)
