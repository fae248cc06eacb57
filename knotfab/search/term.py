"""Add a term written in torch to a search's objective."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from knotfab.limits.terms import Felt, State
from knotfab.search.objective import Term, Weights
from knotfab_formats.errors import InputError


class TorchTerm(Term):
    """A term of the objective: a torch function from vertices [N, 3], mm, to a scalar.

        def low(points):
            return 0.01 * points[:, 1].relu().square().mean()

        search(problem, start, radius, settings, terms=(TorchTerm(low),))

    The image term is in squared tube radii of area; scale yours to match. It is evaluated at each iteration,
    in double precision.

    Raises (when it is evaluated):
        InputError: the function fails or returns no real scalar, or its value or gradient is not finite.
    """

    def __init__(self, function: Callable[[Tensor], Tensor], name: str | None = None) -> None:
        self._function = function
        self.name = name or getattr(function, "__name__", type(function).__name__)

    def loss(self, points: Tensor) -> Tensor:
        """Evaluate the term at `points` [N, 3]; a value or gradient that is not finite raises InputError."""
        felt = points.view_as(points)
        if felt.requires_grad:
            felt.register_hook(self._require_finite)  # type: ignore[no-untyped-call]
        try:
            value = self._function(felt)
        except Exception as error:
            raise self._fault(f"it fails ({type(error).__name__}: {error})", "Mend it.") from error
        if not isinstance(value, Tensor) or value.numel() != 1 or not value.is_floating_point():
            raise self._fault(
                "what it gives for the vertices is no finite scalar tensor",
                "Return a tensor of one number, such as a mean.",
            )
        if not torch.isfinite(value).all():
            raise self._fault(
                "what it gives for the vertices is no finite scalar tensor",
                "Keep it away from quotients of 0.",
            )
        return value.reshape(())

    def __call__(self, state: State, weights: Weights) -> Felt:
        points = torch.tensor(state.points, requires_grad=True)
        value = self.loss(points)
        if not value.requires_grad:  # the term does not depend on the vertices
            return float(value), 0.0 * state.points
        value.backward()  # type: ignore[no-untyped-call]
        assert points.grad is not None
        return float(value.detach()), points.grad.numpy()

    def _require_finite(self, slope: Tensor) -> None:
        if not torch.isfinite(slope).all():
            where = int((~torch.isfinite(slope).all(dim=1)).sum())
            raise self._fault(
                f"its slope is not finite at {where} of {len(slope)} vertices",
                "Keep it away from roots and quotients of 0, such as by a small number added.",
            )

    def _fault(self, why: str, remedy: str) -> InputError:
        return InputError(f"the term {self.name}", why, remedy)
