"""Derendering: a bent trefoil is fitted to a shaded picture of the true one, and to its silhouette alone.

`python -m paper.shaded [--out DIR]` prints how far the vertices are from the truth before and after
each fit, and draws shaded.png.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from scipy.spatial import cKDTree
from torch import Tensor

from benchmarks.measurement import run_study
from knotfab.base.arrays import Array
from knotfab.geometry.carry import certify
from knotfab.geometry.measures import find_neighbours
from knotfab.geometry.polylines import Polylines, polylines_of_sizes
from knotfab.render.capsules import tensor_frame
from knotfab.render.silhouette import Frame, frame_of
from knotfab.render.tiled import render_tiled
from knotfab.scene.camera import camera_of
from knotfab.search.optimizer import Adam
from knotfab_formats.scene import ResolvedView
from paper.shaded_render import Shading, render_shaded
from tests.corpus.curves import torus_knot

Render = Callable[[Tensor, float], Tensor]  # (points, tau) -> image

RADIUS_MM = 7.0
_RATE_MM, _LAST = 0.8, 0.1  # step of a harmonic at the start, and its share at the end
_SHARPER = (0.8, 1.2, 2.0)  # tau per pixel, one after the other
SHADING = Shading(lamp_mm=(150.0, 200.0, 500.0))


@dataclass(frozen=True)
class Trial:
    """A knot, a bent copy of it, and a view of both."""

    truth: Array  # (n, 3) mm
    start: Array
    rings: Polylines
    frame: Frame

    def shade(self, points: Tensor, tau: float) -> Tensor:
        """Return [h, w] the lit picture of a knot at `points`."""
        return render_shaded(points, points.roll(-1, 0), self.frame, RADIUS_MM, tau, SHADING)

    def silhouette(self, points: Tensor, tau: float) -> Tensor:
        """Return [h, w] the silhouette of a knot at `points`."""
        return render_tiled(points, points.roll(-1, 0), self.frame, RADIUS_MM, tau)


def trial(samples: int = 120, pixels: int = 72, bend_mm: float = 12.0, seed: int = 1) -> Trial:
    """Return a trefoil, and a copy whose points go up to `bend_mm` astray, most of it in depth, smoothly."""
    truth = torus_knot(2, 3, 38.0, 18.0, samples)
    rng = np.random.default_rng(seed)
    s = 2 * np.pi * np.arange(samples) / samples
    waves = np.stack([np.cos(k * s + rng.uniform(0, 2 * np.pi)) for k in range(1, 6)], 1)
    astray = waves @ (rng.normal(size=(5, 3)) * [1.0, 1.0, 3.0])
    astray *= bend_mm / np.linalg.norm(astray, axis=1).max()
    view = ResolvedView(frame_width_mm=160.0, frame_height_mm=160.0)
    frame = tensor_frame(frame_of(camera_of(view, pixels, pixels)), torch.float64)
    return Trial(truth, truth + astray, polylines_of_sizes((samples,)), frame)


def fit(at: Trial, render: Render, iterations: int = 150, waves: int = 6) -> Array:
    """Return the points (n, 3) that descent finds for `render`'s picture of the truth, mm.

    Adam on the first `waves` harmonics of the displacement, so that depth, on which the picture depends
    least, moves as readily as the rest. Each step is certified to keep the knot type, or left out.
    """
    truth = torch.as_tensor(at.truth)
    with torch.no_grad():
        targets = [(tau, render(truth, tau)) for tau in _SHARPER]
    s = 2 * np.pi * np.arange(len(truth))[:, None] / len(truth) * np.arange(waves + 1)
    basis = torch.as_tensor(np.concatenate([np.cos(s), np.sin(s[:, 1:])], axis=1))
    weights = torch.zeros(basis.shape[1], 3, dtype=truth.dtype, requires_grad=True)
    adam = Adam([weights], betas=(0.8, 0.95))
    points = at.start
    for iteration in range(iterations):
        progress = iteration / iterations
        tau, target = targets[int(progress * len(targets))]
        before = weights.detach().clone()
        moved = torch.as_tensor(at.start) + basis @ weights
        error = ((render(moved, tau) - target) ** 2).sum()
        adam.zero_grad()
        error.backward()
        adam.step(_RATE_MM * _LAST**progress)
        step = (basis @ (weights.detach() - before)).numpy()
        near = find_neighbours(points, at.rings, 4.0 * RADIUS_MM, 6)
        if certify(points, step, at.rings, near).valid:
            points = points + step
        else:
            with torch.no_grad():
                weights.copy_(before)
    return points


def curve_distance(points: Array, truth: Array) -> float:
    """Return Root-mean-square distance of the vertices `points` from the closed curve `truth`, mm."""
    share = np.arange(20)[:, None, None] / 20
    dense = (truth + share * (np.roll(truth, -1, axis=0) - truth)).reshape(-1, 3)
    return float(np.sqrt((cKDTree(dense).query(points)[0] ** 2).mean()))


def main(*, out: Path = Path("shaded-out"), pixels: int = 72) -> None:
    """Fit both ways, print the distances and draw what was seen."""
    out.mkdir(parents=True, exist_ok=True)
    at = trial(pixels=pixels)
    torch.set_num_threads(1)
    found = {
        "from the silhouette": fit(at, at.silhouette),
        "from the shaded picture": fit(at, at.shade),
    }
    shown = {"truth": at.truth, "start": at.start, **found}
    figure = Figure(figsize=(10.0, 5.2), layout="constrained")
    axes = figure.subplots(2, len(shown))
    print("                          off by (mm, rms)   along the view's axis")
    side = ResolvedView(frame_width_mm=160.0, frame_height_mm=160.0, azimuth_deg=90.0)
    beside = tensor_frame(frame_of(camera_of(side, 256, 256)), torch.float64)
    front = camera_of(side.model_copy(update={"azimuth_deg": 0.0}), 256, 256)
    ahead = tensor_frame(frame_of(front), torch.float64)
    for column, (name, points) in enumerate(shown.items()):
        off, deep = curve_distance(points, at.truth), float(np.abs(points - at.truth)[:, 2].mean())
        print(f"{name:<25} {off:>12.2f} {deep:>18.2f}")
        p = torch.as_tensor(points)
        for axis, frame in zip(axes[:, column], (ahead, beside), strict=True):
            image = render_shaded(p, p.roll(-1, 0), frame, RADIUS_MM, 2.0, SHADING)
            axis.imshow(image.numpy(), cmap="gray", vmin=0, vmax=1)
            axis.set_axis_off()
        axes[0, column].set_title(f"{name}\n{off:.2f} mm off", fontsize=9)
        axes[1, column].set_title("from the side", fontsize=8)
    figure.savefig(out / "shaded.png", dpi=110)
    print(out / "shaded.png")


if __name__ == "__main__":
    run_study(main)
