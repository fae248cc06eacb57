"""Silhouettes of tensors: compiled loops on the CPU, torch on devices and for gradients in the view."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.autograd.function import once_differentiable

from knotfab.base.apps import load_app
from knotfab.base.arrays import Array, Real
from knotfab.geometry.polylines import Polylines
from knotfab.render import silhouette
from knotfab.render.capsules import tensor_frame
from knotfab.render.silhouette import CUTOFF, Capsules, DrawnImage, Frame, Number, number
from knotfab.render.tiled import render_tiled
from knotfab.render.tiled import winners as torch_winners
from knotfab_formats.search import Renderer

Winners = tuple[Tensor, Tensor]  # flat indices of pixels, and the capsule that colours each


def winners(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    reach_px: float,
) -> Winners:
    """Return `silhouette.winners` of tensors. Not differentiable."""
    if starts.device.type == "cpu":
        found = silhouette.winners(_rows(starts), _rows(ends), frame.arrays(), radius, reach_px)
        pixel, capsule = (torch.from_numpy(x).long() for x in found)
        return pixel, capsule
    with torch.no_grad():
        fixed = tensor_frame(frame.arrays(), starts.dtype, starts.device)
        return torch_winners(fixed.local(starts), fixed.local(ends), fixed, radius, reach_px)


def render(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: Number,
    tau: float,
    cutoff: float = CUTOFF,
    won: Winners | None = None,
) -> Tensor:
    """Render tensors by `silhouette.render`: the image of `dense.render_dense`, up to sigmoid(-cutoff).

    Differentiable in the points, and in the frame's numbers and the radius where these are tensors. `won`
    takes the winners of an earlier call.
    """
    if _torch_alone(starts, frame, radius):
        won = won or winners(starts, ends, frame, number(radius), cutoff / tau)
        return render_tiled(starts, ends, frame, radius, tau, cutoff, won)
    image: Tensor = _Image.apply(  # type: ignore[no-untyped-call]
        starts, ends, frame.arrays(), number(radius), tau, cutoff, won
    )
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
    if _torch_alone(starts, frame, radius):
        return ((render(starts, ends, frame, radius, tau, cutoff, won) - target) ** 2).sum()
    given = (frame.arrays(), number(radius), tau, _rows(target), cutoff, _places(won))
    total, one, two = silhouette.squared_error(_rows(starts), _rows(ends), *given)
    return known(total, (starts, one), (ends, two))


def _torch_alone(starts: Tensor, frame: Frame, radius: Number) -> bool:
    """Return whether only torch can draw: on other devices, and for gradients in the view's own numbers."""
    numbers = (frame.u0, frame.v0, frame.step, radius)
    free = any(isinstance(n, Tensor) and n.requires_grad for n in numbers)
    return free or starts.device.type != "cpu"


def _rows(points: Tensor) -> Any:
    """Convert rows to the arrays that the kernels take."""
    return points.detach().contiguous().numpy()


def _places(won: Winners | None) -> silhouette.Winners | None:
    if won is None:
        return None
    pixel, capsule = (x.numpy().astype(np.int32) for x in won)
    return pixel, capsule


@dataclass(frozen=True)
class DeviceImage:
    """A picture [height, width] and its frame on a device, called with arrays and answering in arrays."""

    frame: Frame
    target: Tensor

    @classmethod
    def from_arrays(cls, frame: Frame, target: Real, device: str) -> DeviceImage:
        """Move a picture and its frame, given as arrays, to a device."""
        there = torch.as_tensor(target, device=device)
        return cls(tensor_frame(frame, there.dtype, device), there)

    def from_frame(self, frame: Frame) -> DeviceImage:
        """Return the same picture, seen from another frame of arrays."""
        there = self.target
        return replace(self, frame=tensor_frame(frame, there.dtype, there.device))

    def squared_error(
        self, points: Real, rings: Polylines, radius: float, tau: float, cutoff: float, won: Any
    ) -> tuple[float, Array]:
        """Return the squared difference of tube and picture, and its gradient in the vertices (N, 3)."""
        p, q = self._ends(points, rings, slopes=True)
        error = self._error(p, q, radius, tau, cutoff, won)
        (slope,) = torch.autograd.grad(error, p)
        return float(error.detach()), slope.cpu().numpy().astype(np.float64)

    def find_winners(
        self, points: Real, rings: Polylines, radius: float, reach_px: float
    ) -> Winners:
        """Find the winners of the tube about vertices (N, 3)."""
        return winners(*self._ends(points, rings), self.frame, radius, reach_px)

    def render(
        self, points: Real, rings: Polylines, radius: float, tau: float, cutoff: float
    ) -> Real:
        """Render the tube about vertices (N, 3)."""
        with torch.no_grad():
            image = self._image(*self._ends(points, rings), radius, tau, cutoff)
        return np.asarray(image.cpu().numpy())

    def _image(self, p: Tensor, q: Tensor, radius: float, tau: float, cutoff: float) -> Tensor:
        return render(p, q, self.frame, radius, tau, cutoff)

    def _error(
        self, p: Tensor, q: Tensor, radius: float, tau: float, cutoff: float, won: Any
    ) -> Tensor:
        return squared_error(p, q, self.frame, radius, tau, self.target, cutoff, won)

    def _ends(self, points: Real, rings: Polylines, slopes: bool = False) -> tuple[Tensor, Tensor]:
        p = torch.as_tensor(points, dtype=self.target.dtype, device=self.target.device)
        p.requires_grad_(slopes)
        return p, p[torch.as_tensor(rings.next, device=p.device)]


def draw_on(
    device: str, frame: Frame, target: NDArray[np.floating[Any]], renderer: Renderer
) -> DrawnImage:
    """Return the picture on a device, drawn by ray distance or by one of the paper's renderers."""
    if renderer == "ray":
        return DeviceImage.from_arrays(frame, target, device)
    there = DeviceImage.from_arrays(frame, target.astype(np.float64), device)
    drawn: DrawnImage = load_app("outlines").OutlineImage(there.frame, there.target, renderer)
    return drawn


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
