"""The tiled renderer against the dense formula: seconds of forward and backward, in one run.

`python -m examples.studies.renderer_table [--pixels 256] [--capsules 1000]`.
"""

from __future__ import annotations

import argparse
import statistics

import numpy as np
import torch
from torch import Tensor

from examples.measurement import Stopwatch
from knotfab.render.dense import render_dense
from knotfab.render.frame import Frame, frame_of
from knotfab.render.tiled import render_tiled
from knotfab.scene.camera import camera_of
from knotfab.scene.model import ResolvedView


def curve(capsules: int, dtype: torch.dtype) -> Tensor:
    """A closed wavy curve [n, 3] that fills much of a 180 mm frame, mm."""
    t = torch.linspace(0, 2 * np.pi, capsules + 1, dtype=dtype)[:-1]
    r = 40 + 25 * torch.cos(9 * t)
    return torch.stack([r * torch.cos(t), r * torch.sin(t), 40 * torch.cos(5 * t)], -1)


def _seconds(dense: bool, points: Tensor, frame: Frame, tau: float, chunk: int) -> float:
    watch = Stopwatch()
    ends = points.roll(-1, 0)
    image = (
        render_dense(points, ends, frame, 2.0, tau, chunk)
        if dense
        else render_tiled(points, ends, frame, 2.0, tau, 16.0)
    )
    torch.autograd.grad((image * image).sum(), points)
    return watch.wall_s


def main() -> None:
    """Print medians and their ratio, and how far the two agree in double precision."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pixels", type=int, default=256)
    parser.add_argument("--capsules", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=3)
    asked = parser.parse_args()
    view = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0)
    camera = camera_of(view, asked.pixels, asked.pixels)
    tau = 1.0
    points = curve(asked.capsules, torch.float32).requires_grad_()
    frame = frame_of(camera, torch.float32)
    # the dense formula at its own best chunk, found first
    chunks = {c: _seconds(True, points, frame, tau, c) for c in (128, 512, 2048)}
    chunk = min(chunks, key=lambda c: chunks[c])
    _seconds(False, points, frame, tau, chunk)
    dense, tiled = [], []
    for _ in range(asked.runs):
        dense.append(_seconds(True, points, frame, tau, chunk))
        tiled.extend(_seconds(False, points, frame, tau, chunk) for _ in range(5))
    slow, fast = statistics.median(dense), statistics.median(tiled)
    print(f"{asked.pixels} px, {asked.capsules} capsules, forward and backward, float32")
    print(
        f"dense (chunks of {chunk} pixels) {slow:.2f} s, tiled {1000 * fast:.1f} ms: {slow / fast:.0f} times"
    )
    small = frame_of(camera_of(view, 96, 96), torch.float64)
    exact = curve(asked.capsules, torch.float64).requires_grad_()
    results = []
    for render in (render_dense, render_tiled):
        image = render(exact, exact.roll(-1, 0), small, 2.0, tau)
        (gradient,) = torch.autograd.grad((image * image).sum(), exact)
        results.append((image.detach(), gradient))
    (image_a, grad_a), (image_b, grad_b) = results
    print(
        f"float64: image differs by {float((image_a - image_b).abs().max()):.1e}, gradient by "
        f"{float((grad_a - grad_b).norm() / grad_a.norm()):.1e} relative"
    )


if __name__ == "__main__":
    main()
