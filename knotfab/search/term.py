"""A further part of a search's objective that is written in torch; torch finds its gradient."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from knotfab.limits.terms import Felt, State
from knotfab.search.objective import Term, Weights
from knotfab_formats.errors import InputError


class TorchTerm(Term):
    """A function of the vertices, a tensor [N, 3] in mm, to a scalar, added to the objective.

        def low(points):
            return 0.01 * points[:, 1].relu().square().mean()

        search(problem, start, radius, settings, terms=(TorchTerm(low),))

    The picture's own term is in squared tube radii of area: choose the factor beside that. The search
    asks for this term at each iteration, in double precision.

    Raises (when the search asks):
        InputError: it gives no scalar, or its value or slope is not finite.
    """

    def __init__(self, function: Callable[[Tensor], Tensor], device: str = "cpu") -> None:
        self._function, self._device = function, device

    def __call__(self, state: State, weights: Weights) -> Felt:
        points = torch.tensor(state.points, device=self._device, requires_grad=True)
        value = self._function(points)
        name = getattr(self._function, "__name__", type(self._function).__name__)
        if not isinstance(value, Tensor) or value.numel() != 1 or not torch.isfinite(value).all():
            raise InputError(
                f"the term {name}",
                "what it gives for the vertices is no finite scalar tensor",
                "Return a tensor of one number, such as a mean.",
            )
        if not value.requires_grad:  # it does not depend on the vertices
            return float(value), np.zeros_like(state.points)
        (slope,) = torch.autograd.grad(value.reshape(()), points, allow_unused=True)
        gradient = np.zeros_like(state.points) if slope is None else slope.cpu().numpy()
        if not np.isfinite(gradient).all():
            raise InputError(
                f"the term {name}",
                f"its slope is not finite at {int((~np.isfinite(gradient).all(axis=1)).sum())} vertices",
                "Keep it away from roots and quotients of 0, by a small number added.",
            )
        return float(value.detach()), gradient
