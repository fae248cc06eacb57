"""The soft silhouette of capsules and its squared error: compiled on the CPU, in torch on other devices.

The torch form (`render.tiled`) is what the compiled one is held against, and the one that has slopes in the
view's own numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from knotfab.arrays import Array
from knotfab.render.clip import cut_before_light
from knotfab.render.frame import Frame, Number, number
from knotfab.render.kernels import Places, Real, evaluate, find_winners
from knotfab.render.known import known
from knotfab.render.tiled import CUTOFF, render_tiled
from knotfab.render.tiled import winners as torch_winners

__all__ = ["Winners", "render", "squared_error", "winners"]

Winners = tuple[Tensor, Tensor]  # flat indices of pixels, and the capsule that colours each


def winners(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: float,
    reach_px: float,
) -> Winners:
    """(pixel, capsule): flat indices of pixels with s > -reach_px, and the capsule of largest s.

    Not differentiable.
    """
    with torch.no_grad():
        frame = frame.fixed()
        a, b = frame.local(starts), frame.local(ends)
        if a.device.type != "cpu":
            return torch_winners(a, b, frame, radius, reach_px)
        a, b, seen = cut_before_light(a, b, radius)
    numbers, size = _numbers(frame, radius), (frame.width, frame.height)
    pixel, capsule = find_winners(_rows(a), _rows(b), seen.numpy(), numbers, *size, reach_px)
    return torch.from_numpy(pixel), torch.from_numpy(capsule)


def render(
    starts: Tensor,  # [n, 3] scene mm
    ends: Tensor,  # [n, 3]
    frame: Frame,
    radius: Number,
    tau: float,
    cutoff: float = CUTOFF,
    won: Winners | None = None,
) -> Tensor:
    """Image [height, width] of sigmoid(tau * max over capsules of the signed distance in px).

    The image and gradient of `dense.render_dense`, up to sigmoid(-cutoff). Differentiable in the points, and
    in the frame's numbers and the radius where these are tensors. `won` takes the winners of an
    earlier call: a lower bound of the image, exact for small motions wherever the winner did not change.
    """
    won = won or winners(starts, ends, frame, number(radius), cutoff / tau)
    if _torch_alone(starts, frame, radius):
        return render_tiled(starts, ends, frame, radius, tau, cutoff, won)
    scene = _Scene.of(starts, ends, frame, number(radius), tau, won)
    image: Tensor = _Image.apply(*scene.ends, scene)  # type: ignore[no-untyped-call]
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
    """Scalar: the squared difference of `render` and the target, summed over the pixels."""
    if _torch_alone(starts, frame, radius):
        return ((render(starts, ends, frame, radius, tau, cutoff, won) - target) ** 2).sum()
    won = won or winners(starts, ends, frame, number(radius), cutoff / tau)
    scene = _Scene.of(starts, ends, frame, number(radius), tau, won)
    # (g - f)^2 is g^2 - 2 g f where a pixel is coloured, and f^2 everywhere
    field = target.contiguous().numpy().ravel()
    total, slopes = scene.evaluate(field, 2.0, -2.0)
    a, b = scene.ends
    return known(total + float(field @ field), (a, slopes[:, :3]), (b, slopes[:, 3:]))


def _torch_alone(starts: Tensor, frame: Frame, radius: Number) -> bool:
    """Whether only torch's form serves: on other devices, and for slopes in the view's own numbers."""
    numbers = (frame.u0, frame.v0, frame.step, radius)
    free = any(isinstance(n, Tensor) and n.requires_grad for n in numbers)
    return free or starts.device.type != "cpu"


def _numbers(frame: Frame, radius: float) -> Array:
    """What the kernels go by: u0, v0, step, radius."""
    return np.array([number(frame.u0), number(frame.v0), number(frame.step), radius])


def _rows(points: Tensor) -> Real:
    """[n, 3] as the kernels take them."""
    return points.detach().contiguous().numpy()


@dataclass(frozen=True)
class _Scene:
    """What is rendered: the ends [n, 3] each in receiver axes with their graph, who wins, and the numbers."""

    ends: tuple[Tensor, Tensor]
    pixel: Places
    capsule: Places
    numbers: Array
    size: tuple[int, int]  # width, height
    tau: float

    @classmethod
    def of(
        cls, starts: Tensor, ends: Tensor, frame: Frame, radius: float, tau: float, won: Winners
    ) -> _Scene:
        a, b, _ = cut_before_light(frame.local(starts), frame.local(ends), radius)
        pixel, capsule = (x.numpy().astype(np.int32, copy=False) for x in won)
        size = (frame.width, frame.height)
        # the kernels look up what they are told to
        for found, count in ((pixel, frame.width * frame.height), (capsule, len(a))):
            if len(found) and not 0 <= found.min() <= found.max() < count:
                raise IndexError(f"winners of another scene: {found.max()} of {count}")
        return cls((a, b), pixel, capsule, _numbers(frame, radius), size, tau)

    def evaluate(
        self, field: Real, own: float, other: float, image: Real | None = None
    ) -> tuple[float, Array]:
        """`kernels.evaluate` here: the sum, and its gradient [n, 6]."""
        a, b = (_rows(x) for x in self.ends)
        slopes = np.zeros((len(a), 6))
        image = np.empty(0, a.dtype) if image is None else image
        places = (self.pixel, self.capsule, self.numbers, self.size[0], self.tau)
        total = evaluate(a, b, *places, field, own, other, slopes, image)
        return total, slopes


class _Image(torch.autograd.Function):
    """The flat image; its gradient works the distances out once more, which is cheaper than keeping them."""

    @staticmethod
    def forward(ctx: Any, a: Tensor, b: Tensor, scene: _Scene) -> Tensor:
        ctx.scene = scene
        image = np.zeros(scene.size[0] * scene.size[1], _rows(a).dtype)
        scene.evaluate(image, 0.0, 0.0, image)
        return torch.from_numpy(image)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, slope: Tensor) -> tuple[Tensor | None, ...]:
        _, slopes = ctx.scene.evaluate(slope.contiguous().numpy(), 0.0, 1.0)
        both = torch.from_numpy(slopes).to(slope.dtype)
        return both[:, :3], both[:, 3:], None
