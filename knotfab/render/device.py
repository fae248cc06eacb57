"""Silhouettes of tensors: compiled loops, and torch for gradients in the view's own numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from knotfab.base.arrays import Array
from knotfab.render import silhouette
from knotfab.render.capsules import capsule_distance, cut_before_light
from knotfab.render.silhouette import CUTOFF, Capsules, Frame, Number, number

Winners = tuple[Tensor, Tensor]  # flat indices of pixels, and the capsule that colours each


def winners(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    reach_px: float,
) -> Winners:
    """Return `silhouette.winners` of tensors. Not differentiable."""
    found = silhouette.winners(_rows(starts), _rows(ends), frame.arrays(), radius, reach_px)
    pixel, capsule = (torch.from_numpy(x).long() for x in found)
    return pixel, capsule


def render(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: Number,
    tau: float,
    cutoff: float = CUTOFF,
    won: Winners | None = None,
) -> Tensor:
    """Render tensors by `silhouette.render`: the largest capsule at each pixel, up to sigmoid(-cutoff).

    Differentiable in the points, and in the frame's numbers and the radius where these are tensors. `won`
    takes the winners of an earlier call: a lower bound of the image, exact wherever they did not change.
    """
    if _torch_alone(frame, radius):
        return render_torch(starts, ends, frame, radius, tau, cutoff, won)
    image: Tensor = _Image.apply(  # type: ignore[no-untyped-call]
        starts, ends, frame.arrays(), number(radius), tau, cutoff, won
    )
    return image.reshape(frame.height, frame.width)


def render_torch(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: Number,
    tau: float,
    cutoff: float = CUTOFF,
    won: tuple[Tensor, Tensor] | None = None,
) -> Tensor:
    """Render by torch's own operations: slower than `render`, and the oracle of its hard cases.

    sigmoid(tau s) is monotone, so the maximum over capsules is the sigmoid of the largest s, and its gradient
    flows through that capsule alone. Arguments are as for `render`.
    """
    a, b = frame.local(starts), frame.local(ends)
    thick = number(radius)
    pixel, capsule = won or winners(starts, ends, frame, thick, cutoff / tau)
    a, b, _ = cut_before_light(a, b, thick)
    row = pixel // frame.width
    qx = ((pixel - row * frame.width).to(a.dtype) + frame.u0) * frame.step
    qy = (row.to(a.dtype) + frame.v0) * frame.step
    s = capsule_distance(a[capsule], b[capsule], qx, qy, radius, frame.focal_px)
    image = torch.zeros(frame.width * frame.height, dtype=a.dtype, device=a.device)
    image = image.index_put((pixel,), torch.sigmoid(tau * s))
    return image.reshape(frame.height, frame.width)


def squared_error(
    starts: Tensor,
    ends: Tensor,
    frame: Frame,
    radius: Number,
    tau: float,
    target: Tensor,  # [height, width]
    cutoff: float = CUTOFF,
    won: Winners | None = None,
) -> Tensor:
    """Return a scalar, the squared difference of `render` and the target, summed over the pixels."""
    if _torch_alone(frame, radius):
        return ((render(starts, ends, frame, radius, tau, cutoff, won) - target) ** 2).sum()
    given = (frame.arrays(), number(radius), tau, _rows(target), cutoff, _places(won))
    total, one, two = silhouette.squared_error(_rows(starts), _rows(ends), *given)
    return known(total, (starts, one), (ends, two))


def _torch_alone(frame: Frame, radius: Number) -> bool:
    """Return whether only torch can draw: for gradients in the view's own numbers."""
    numbers = (frame.u0, frame.v0, frame.step, radius)
    return any(isinstance(n, Tensor) and n.requires_grad for n in numbers)


def _rows(points: Tensor) -> Any:
    """Convert rows to the arrays that the kernels take."""
    return points.detach().contiguous().numpy()


def _places(won: Winners | None) -> silhouette.Winners | None:
    if won is None:
        return None
    pixel, capsule = (x.numpy().astype(np.int32) for x in won)
    return pixel, capsule


class _Image(torch.autograd.Function):
    """The flat image; the backward pass recomputes distances, which is cheaper than storing them."""

    @staticmethod
    def forward(ctx: Any, starts: Tensor, ends: Tensor, frame: Frame, *rest: Any) -> Tensor:
        radius, tau, cutoff, won = rest
        given = (frame, radius, tau, cutoff, _places(won))
        ctx.seen = Capsules.render(_rows(starts), _rows(ends), *given)
        return torch.from_numpy(ctx.seen.image())

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor | None, ...]:
        _, one, two = ctx.seen.evaluate(_rows(slope), 0.0, 1.0)
        both = (torch.from_numpy(x).to(slope.dtype) for x in (one, two))
        return (*both, None, None, None, None, None)


# A number whose gradient is known in closed form, as a node of torch's graph.


def known(value: float, *parts: tuple[Tensor, Array]) -> Tensor:
    """Return the scalar `value` as a node of the graph; `parts` pair tensors with its known gradients."""
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
