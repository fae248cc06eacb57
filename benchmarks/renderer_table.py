"""The tiled renderers against the dense formula: CPU seconds of forward and backward, one thread, in one run.

    python -m benchmarks.renderer_table [--pixels 256] [--capsules 1000] [--cut 16]

The compiled form is also held against a floor: every pixel that is coloured tested against its winner alone,
once, and evaluated once, at the rates at which the same loops run in cache.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from benchmarks.measurement import Stopwatch, run_study
from knotfab.render.dense import render_dense
from knotfab.render.frame import Frame, frame_of
from knotfab.render.tensors import render, squared_error, winners
from knotfab.render.threads import one_thread
from knotfab.render.tiled import render_tiled
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView

VIEW = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0)
RADIUS, TAU = 2.0, 1.0
Error = Callable[[Tensor], Tensor]  # the squared error of closed polylines [n, 3] with a target


def curve(capsules: int, dtype: torch.dtype) -> Tensor:
    """A closed wavy curve [n, 3] that fills much of a 180 mm frame, mm."""
    t = torch.linspace(0, 2 * np.pi, capsules + 1, dtype=dtype)[:-1]
    r = 40 + 25 * torch.cos(9 * t)
    return torch.stack([r * torch.cos(t), r * torch.sin(t), 40 * torch.cos(5 * t)], -1)


def _errors(frame: Frame, target: Tensor, cut: float, chunk: int = 4096) -> dict[str, Error]:
    """The squared error by each form."""

    def dense(p: Tensor) -> Tensor:
        seen = render_dense(p, p.roll(-1, 0), frame, RADIUS, TAU, chunk)
        return ((seen - target) ** 2).sum()

    def tiled(p: Tensor) -> Tensor:
        seen = render_tiled(p, p.roll(-1, 0), frame, RADIUS, TAU, cut)
        return ((seen - target) ** 2).sum()

    def compiled(p: Tensor) -> Tensor:
        return squared_error(p, p.roll(-1, 0), frame, RADIUS, TAU, target, cut)

    return {"dense": dense, "torch": tiled, "compiled": compiled}


def _seconds(error: Error, points: Tensor) -> float:
    watch = Stopwatch()
    torch.autograd.grad(error(points), points)
    return watch.cpu_s


def _floor_s(points: Tensor, frame: Frame, cut: float) -> float:
    """Each pixel that is coloured tested once and evaluated once, at the rates of loops in cache."""
    p = points.detach()
    coloured = len(winners(p, p.roll(-1, 0), frame, RADIUS, cut / TAU)[0])
    # one tile under very many equal capsules: nothing is pruned, everything is in cache
    small = frame_of(camera_of(VIEW, 8, 8)).tensors(torch.float32)
    many = torch.zeros(20_000, 3)
    won = winners(many, many, small, 60.0, cut / TAU)
    tests, evaluations = [], []
    for _ in range(7):
        watch = Stopwatch()
        winners(many, many, small, 60.0, cut / TAU)
        tests.append(watch.cpu_s / (64 * len(many)))
    wide = tuple(w.repeat(20_000) for w in won)
    few = many[:1].requires_grad_()
    own = (torch.zeros_like(wide[0]), torch.zeros_like(wide[1]))
    for _ in range(7):
        watch = Stopwatch()
        squared_error(few, few, small, 60.0, TAU, torch.zeros(8, 8), cut, own)
        evaluations.append(watch.cpu_s / len(own[0]))
    return coloured * (statistics.median(tests) + statistics.median(evaluations))


@one_thread()
def main(*, pixels: int = 256, capsules: int = 1000, cut: float = 16.0, runs: int = 3) -> None:
    """Print medians and their ratios, and how far the forms agree."""
    points = curve(capsules, torch.float32).requires_grad_()
    frame = frame_of(camera_of(VIEW, pixels, pixels)).tensors(torch.float32)
    target = torch.rand(pixels, pixels, generator=torch.Generator().manual_seed(1))
    # the dense formula at its own best chunk, found first
    chunks = {
        c: _seconds(_errors(frame, target, cut, c)["dense"], points) for c in (128, 512, 2048)
    }
    chunk = min(chunks, key=lambda c: chunks[c])
    errors = _errors(frame, target, cut, chunk)
    for name in ("torch", "compiled"):
        _seconds(errors[name], points)
    spent: dict[str, list[float]] = {name: [] for name in errors}
    for _ in range(runs):
        spent["dense"].append(_seconds(errors["dense"], points))
        for name in 5 * ("torch", "compiled"):
            spent[name].append(_seconds(errors[name], points))
    middle = {name: statistics.median(seconds) for name, seconds in spent.items()}
    print(f"{pixels} px, {capsules} capsules, forward and backward, float32, one thread")
    print(f"dense (chunks of {chunk} pixels) {middle['dense']:.2f} s")
    for name in ("torch", "compiled"):
        times = middle["dense"] / middle[name]
        print(f"{name:9}{1000 * middle[name]:.1f} ms: {times:.0f} times faster than dense")
    floor_s = _floor_s(points, frame, cut)
    print(
        f"compiled {middle['torch'] / middle['compiled']:.1f} times faster than torch, "
        f"{middle['compiled'] / floor_s:.1f} times the floor of {1000 * floor_s:.2f} ms"
    )
    seen = [
        f(points.detach(), points.detach().roll(-1, 0), frame, RADIUS, TAU, cut)
        for f in (render_tiled, render)
    ]
    print(f"float32: images differ by {float((seen[0] - seen[1]).abs().max()):.1e}")
    small = frame_of(camera_of(VIEW, 96, 96)).tensors(torch.float64)
    exact = curve(capsules, torch.float64).requires_grad_()
    found = [
        (float(e.detach()), torch.autograd.grad(e, exact)[0])
        for e in (f(exact) for f in _errors(small, torch.rand(96, 96).double(), 40.0).values())
    ]
    (_, grad_a), *others = found
    for name, (value, grad) in zip(("torch", "compiled"), others, strict=True):
        print(
            f"float64: {name}'s error is off by {abs(value - found[0][0]) / value:.1e}, its gradient "
            f"by {float((grad_a - grad).norm() / grad_a.norm()):.1e} relative"
        )


if __name__ == "__main__":
    run_study(main)
