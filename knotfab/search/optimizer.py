"""Optimise with torch: the certified flow moves the knots, and Adam the numbers of free views."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.optim import Optimizer

from knotfab.base.arrays import Array
from knotfab.geometry.carry import certify, step_limits
from knotfab.geometry.measures import Neighbours
from knotfab.geometry.polylines import Polylines, dot, row_lengths
from knotfab.render.device import known
from knotfab.search.flow import (
    Between,
    FlowResult,
    FlowSettings,
    Loss,
    along_curve,
    find_felt,
    precondition,
)
from knotfab_formats.errors import InputError
from knotfab_formats.libraries import took_part

_LEAST = 1e-8  # Adam's epsilon


class _Light(Optimizer):
    """An optimizer without the hooks of torch's compiler, which take a second and 70 MB to load."""

    add_param_group = Optimizer.add_param_group.__wrapped__  # type: ignore[attr-defined]

    def __init__(self, tensors: Iterable[Tensor]) -> None:
        self.tensors = list(tensors)
        super().__init__(self.tensors, {})

    def __getstate__(self) -> dict[str, Any]:
        # torch's own keeps its own keys alone, and a copy would lack the rest
        return dict(self.__dict__)

    def zero_grad(self, set_to_none: bool = True) -> None:
        for tensor in self.tensors:
            tensor.grad = None


class CertifiedFlow(_Light):
    """Move the vertices of closed polylines down a loss, and never one strand through another.

        optimizer = CertifiedFlow(points, rings, radius, FlowSettings(iterations=200))
        for _ in range(200):
            optimizer.zero_grad()
            loss = objective(points)
            loss.backward()
            optimizer.step()

    A step follows the H1 gradient with momentum, evens out the edges, and is clamped. Each step taken is
    certified to be an isotopy (`geometry.carry.certify`); one that is not is halved up to six times and then
    refused.

    Args:
        points: the vertices [N, 3], mm, float64, on the CPU, with gradient.
        settings: the step size falls from `rate` to `rate_end` over `iterations` steps.
        separation: least distance of centre lines that the loss requires, mm.
    """

    def __init__(
        self,
        points: Tensor,
        rings: Polylines,
        radius: float,
        settings: FlowSettings,
        separation: float = 0.0,
    ) -> None:
        super().__init__([points])
        self.rings, self.radius, self.settings, self.separation = (
            rings,
            radius,
            settings,
            separation,
        )
        self.result = FlowResult(points.detach().numpy().copy())
        self.steps = 0
        self._near: Neighbours | None = None
        self._asked: Array | None = None  # the vertices at which neighbours were last asked for
        self._momentum, self._scale = np.zeros_like(self.result.points), 0.0

    @property
    def progress(self) -> float:
        """The share of the steps that are done, from 0 to 1."""
        return min(1.0, self.steps / max(1, self.settings.iterations - 1))

    @property
    def near(self) -> Neighbours:
        """The pairs of segments that the loss can feel at the present vertices."""
        points, same = self.result.points, self._asked is self.result.points
        self._asked = points
        if self._near is None or (not same and self._near.moved(points) > 0.3 * self.radius):
            reach = self.settings.reach
            self._near = find_felt(points, self.rings, self.radius, self.separation, reach)
        return self._near

    @torch.no_grad()
    def step(self) -> None:  # type: ignore[override]
        """Take one certified step; `result` counts steps that were shortened or refused.

        Raises:
            InputError: the vertices have no finite gradient, or other code has moved them.
        """
        (points,) = self.tensors
        # numpy's test takes a sixth of torch's
        if points.grad is None or not np.isfinite(points.grad.numpy()).all():
            why = "has no gradient" if points.grad is None else "has a gradient that is not finite"
            raise InputError(
                "the loss", f"it {why} in the vertices", "Mend it, and call backward()."
            )
        if not np.array_equal(points.numpy(), self.result.points):
            why = "something else than the optimizer moved them, which nothing certifies"
            raise InputError("the vertices", why, "Begin a new CertifiedFlow from there.")
        took_part("torch", "moved the knots")
        self._walk(points.grad.numpy())
        points.copy_(torch.from_numpy(self.result.points))
        self.steps += 1

    def _walk(self, gradient: Array) -> None:
        x, rings, radius, how = self.result.points, self.rings, self.radius, self.settings
        near = self.near
        spacing = float(row_lengths(x[rings.next] - x).mean())
        g = precondition(gradient, rings.bounds, how.smoothing * radius / spacing)
        square = float(dot(g, g).mean())
        self._scale = max(0.9 * self._scale + 0.1 * square if self.steps else square, 1e-300)
        self._momentum = how.momentum * self._momentum + (1 - how.momentum) * g
        rate = how.rate * (how.rate_end / how.rate) ** self.progress * radius
        step = -self._momentum * (rate / np.sqrt(self._scale))
        step += how.evening * along_curve(x, rings)
        length = np.sqrt(dot(step, step))
        largest = how.clamp * radius
        limit = np.minimum(step_limits(x, rings, near, largest), largest)
        step *= np.minimum(1.0, limit / np.maximum(length, 1e-300))[:, None]
        result = self.result
        for halving in range(7):
            verdict = certify(x, step, rings, near)
            if verdict.valid:
                result.points = x + step
                result.accepted += 1
                result.shortened += halving > 0
                result.least_margin = min(result.least_margin, verdict.margin)
                return
            step = 0.5 * step
        result.refused += 1
        self._momentum[:] = 0
        self._near = None


def descend(
    points: Array,
    rings: Polylines,
    objective: Loss,
    radius: float,
    settings: FlowSettings,
    report: Callable[[float, Array], None] | None = None,
    done: Callable[[Array], bool] | None = None,
    separation: float = 0.0,
    between: Between | None = None,
    terms: Sequence[Callable[[Tensor], Tensor]] = (),
) -> FlowResult:
    """Minimise `objective` from `points` (N, 3), mm, keeping the knot type.

    Args:
        objective: returns its value and gradient (N, 3) in closed form.
        report: called each iteration with (share done, points).
        done: ends the flow early when it returns True.
        between: called before each step with (points, near, iteration, progress).
        terms: torch functions of the vertices, whose values are added to the loss by autograd.
    """
    took_part("numba", "ran the loops of pictures and limits")
    vertices = torch.from_numpy(points.copy()).requires_grad_()
    optimizer = CertifiedFlow(vertices, rings, radius, settings, separation)
    result = optimizer.result

    for iteration in range(settings.iterations):
        progress = optimizer.progress
        if between is not None:
            between(result.points, optimizer.near, iteration, progress)
        value, gradient = objective(result.points, optimizer.near, progress)
        if terms:
            optimizer.zero_grad()
            loss = sum((term(vertices) for term in terms), known(value, (vertices, gradient)))
            loss.backward()  # type: ignore[no-untyped-call]
            value = loss.item()
        else:  # a graph of one node would only hand the gradient over
            vertices.grad = torch.from_numpy(gradient)
        optimizer.step()
        result.losses.append(value)
        if report is not None:
            report(progress, result.points)
        if done is not None and iteration % 10 == 9 and done(result.points):
            break
    return result


class Adam(_Light):
    """Adam (Kingma and Ba, "Adam: a method for stochastic optimization", ICLR 2015, algorithm 1).

    Unlike torch's own, each step gets its rate, for all tensors or for each.

    Args:
        tensors: moved in place.
        betas: decay of the running means of gradients and of their squares.
    """

    def __init__(
        self, tensors: Iterable[Tensor], betas: tuple[float, float] = (0.9, 0.999)
    ) -> None:
        super().__init__(tensors)
        self._betas, self._steps = betas, 0
        self._mean = [torch.zeros_like(t) for t in self.tensors]
        self._square = [torch.zeros_like(t) for t in self.tensors]

    @torch.no_grad()
    def step(self, rate: float | Sequence[float]) -> None:  # type: ignore[override]
        """Move the tensors down their gradients by about `rate`, one number or one for each."""
        self._steps += 1
        first, second = self._betas
        rates = rate if isinstance(rate, Sequence) else [rate] * len(self.tensors)
        begun, root = 1 - first**self._steps, (1 - second**self._steps) ** 0.5
        for tensor, mean, square, length in zip(
            self.tensors, self._mean, self._square, rates, strict=True
        ):
            gradient = tensor.grad
            assert gradient is not None
            mean.lerp_(gradient, 1 - first)
            square.mul_(second).addcmul_(gradient, gradient, value=1 - second)
            tensor.addcdiv_(mean, (square.sqrt() / root).add_(_LEAST), value=-length / begun)


@contextmanager
def one_thread() -> Iterator[Any]:
    """Run torch on one thread within the context.

    On small tensors its barriers cost more than they gain, above all on shared cores, and results no longer
    depend on the number of cores.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
