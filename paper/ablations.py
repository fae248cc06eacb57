"""The paper's ablations, each a table (CSV) and a figure (PNG): what each limit, weight and number does.

`python -m paper.ablations [--only NAME] [--out DIR] [--iterations N]`. Scaled down so that all take
about 25 minutes on two quiet cores: images of 64 px and tau 25 for 256 px and 100, radius 0.1 for 0.05, 200
samples for 1000, width 128 for 1024, and Adam at 4e-4 for a few hundred iterations. The image loss is the
mean over pixels, of the size of the other losses under the paper's weights; the last row of the length
table has the printed sum.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from matplotlib.figure import Figure
from torch import Tensor

from benchmarks.measurement import run_study
from examples.pictures import pictures
from knotfab.apps.paper.outlines import render_outlines
from knotfab.base.arrays import Array
from knotfab.geometry.measures import strand_gap
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.picture.silhouette import resample_mask
from paper.camera import Curve, camera_around, circle, even_ring, paper_camera, viviani
from paper.losses import Region, box, squared_curvature
from paper.optimise import PaperView, iou, search_paper
from paper.settings import PAPER, PaperSettings

PIXELS = 64
SCALED = {
    "radius": 0.1,
    "tau": 25.0,
    "samples": 200,
    "pairs": 20_000,
    "width": 128,
    "learning_rate": 4e-4,
    "resample_every": 4,
    "image_weight": 1 / PIXELS**2,
}
# In view and away from the eye: out of the frame nothing is penalised, and coming nearer would make up
# for every limit.
VIEW = box((-1.25, -1.25, 2.4), (1.25, 1.25, 3.6))
CUBE = box((-1.25, -1.25, 1.75), (1.25, 1.25, 4.25))  # the region of three views
SMALL = (-0.8, -0.8, 2.5), (0.8, 0.8, 3.5)  # the region of the occupancy ablation


@dataclass(frozen=True)
class Row:
    """One value of an ablation: its label, figures, the first view's target and image, and the knot."""

    label: str
    figures: dict[str, float]
    target: Array
    image: Array
    knot: Array


@cache
def _picture(name: str) -> Tensor:
    """Return coverage [PIXELS, PIXELS] of one of the project's pictures, centred."""
    mask = np.asarray(pictures()[name]) < 128
    side = max(mask.shape)
    square = np.zeros((side, side), dtype=np.bool_)
    top, left = ((side - n) // 2 for n in mask.shape)
    square[top : top + mask.shape[0], left : left + mask.shape[1]] = mask
    return torch.as_tensor(resample_mask(square, PIXELS, PIXELS), dtype=torch.float64)


def _frame() -> Tensor:
    """Return a rectangle's outline as wide as the tube is in the template's plane."""
    camera = paper_camera(width=PIXELS, height=PIXELS)
    s = even_ring(800) * 8
    side, along = s.floor().long() % 8 // 2, (s / 2) % 1 * 2 - 1
    one = torch.ones_like(along)
    x = torch.stack([along, one, -along, -one])[side, torch.arange(800)]
    y = torch.stack([-one, along, one, -along])[side, torch.arange(800)]
    loop = torch.stack([1.05 * x, 0.7 * y, 3 * one], -1)
    return (render_outlines(loop, loop.roll(-1, 0), camera, 0.1, 1e4) > 0.5).double()


def _views(target: Tensor) -> list[PaperView]:
    return [PaperView(paper_camera(width=PIXELS, height=PIXELS), target)]


def _viviani_views(radius: float) -> list[PaperView]:
    """Cast the curve's shadows along three axes (parallel, as in the paper), seen in perspective."""
    middle = torch.tensor([0.0, 0.0, 3.0], dtype=torch.float64)
    views = []
    for axis, (azimuth, elevation) in enumerate([(90.0, 0.0), (0.0, 90.0), (0.0, 0.0)]):
        camera = camera_around((0, 0, 3), 3.0, azimuth, elevation, width=PIXELS, height=PIXELS)
        flat = viviani(even_ring(1000))
        flat[:, axis] = 0
        flat = flat + middle
        image = render_outlines(flat, flat.roll(-1, 0), camera, radius, 1e4)
        views.append(PaperView(camera, (image > 0.5).double()))
    return views


def _search(
    label: str,
    views: list[PaperView],
    settings: PaperSettings,
    region: Region = VIEW,
    template: Curve | None = None,
) -> Row:
    """Return a search and its figures."""
    templates = None if template is None else [template]
    found = search_paper(views, settings, templates=templates, region=region)
    knot = torch.as_tensor(found.knots[0])
    radius, ring = settings.radius, polylines_of_sizes((len(knot),))
    bends = squared_curvature(knot[None])[0]
    image = render_outlines(knot, knot.roll(-1, 0), views[0].camera, radius, settings.tau)
    figures = {
        "iou": float(np.mean(found.final_ious)),
        "length": float((knot.roll(-1, 0) - knot).norm(dim=1).sum()),
        "bend95": float(bends.quantile(0.95)),
        "outside": float((radius - region(knot)).max().clamp_min(0)),
        "clearance": strand_gap(found.knots[0], ring, 2 * radius, 10.0).gap / (2 * radius),
        "cpu_s": found.cpu_seconds,
    }
    return Row(label, figures, views[0].target.numpy(), image.numpy(), found.knots[0])


def _length(base: PaperSettings) -> Iterator[Row]:
    views = _views(_picture("plane"))
    for longest in (4.0, 8.0, 12.0, 100.0):
        yield _search(f"L0 = {longest:g}", views, base.model_copy(update={"longest": longest}))
    summed = base.model_copy(update={"longest": 4.0, "image_weight": 1.0})
    yield _search("L0 = 4, summed image loss", views, summed)


def _bend(base: PaperSettings) -> Iterator[Row]:
    for sharpest in (1.0, 3.0, 10.0, 100.0):
        limited = base.model_copy(update={"sharpest": sharpest})
        yield _search(f"B0 = {sharpest:g}", _views(_frame()), limited)


def _occupancy(base: PaperSettings) -> Iterator[Row]:
    for weight in (1e-2, 1e-3, 1e-4, 0.0):
        weighed = base.model_copy(update={"occupancy_weight": weight})
        yield _search(f"w_occ = {weight:g}", _views(_frame()), weighed, box(*SMALL))


def _mobius(base: PaperSettings) -> Iterator[Row]:
    # a template that is nearly the curve, so that the weight alone decides about the crossing
    views = _viviani_views(base.radius)
    for weight in (0.0, 1e-2, 1e-1, 1.0):
        weighed = base.model_copy(update={"mobius_weight": weight})
        yield _search(f"w_mob = {weight:g}", views, weighed, CUBE, lambda s: viviani(s, 0.3))


def _renderings(pairs: list[tuple[str, int, float]]) -> Iterator[Row]:
    """Yield the template's circle at depth 3, at the paper's radius and size: (label, samples, tau) each."""
    camera = paper_camera()
    ring = circle(1.0, (0.0, 0.0, 3.0))
    full = ring(even_ring(4000))
    exact = (render_outlines(full, full.roll(-1, 0), camera, PAPER.radius, 1e4) > 0.5).double()
    for label, samples, tau in pairs:
        for name in ("ellipse", "capsule"):
            knot = ring(even_ring(samples))
            ends = None if name == "ellipse" else knot.roll(-1, 0)
            image = render_outlines(knot, ends, camera, PAPER.radius, tau)
            figures = {
                "iou": iou(image, exact),
                "difference": float((image - exact).abs().mean() / exact.mean()),
            }
            yield Row(f"{name}, {label}", figures, exact.numpy(), image.numpy(), knot.numpy())


def _samples(base: PaperSettings) -> Iterator[Row]:
    yield from _renderings([(f"N = {n}", n, PAPER.tau) for n in (16, 64, 256, 1000)])


def _tau(base: PaperSettings) -> Iterator[Row]:
    yield from _renderings([(f"tau = {tau:g}", 1000, tau) for tau in (10.0, 100.0, 1000.0)])
    for tau in (2.5, 25.0, 100.0, 1000.0):
        soft = base.model_copy(update={"tau": tau})
        yield _search(f"searched, tau = {tau:g}", _views(_picture("heart")), soft)


def _depth(base: PaperSettings) -> Iterator[Row]:
    for depth in (1, 2, 4, 8):
        shallow = base.model_copy(update={"depth": depth})
        yield _search(f"depth {depth}", _views(_picture("plane")), shallow)


def _width(base: PaperSettings) -> Iterator[Row]:
    for width in (8, 32, 128, 512):
        narrow = base.model_copy(update={"width": width})
        yield _search(f"width {width}", _views(_picture("plane")), narrow)


# name -> (rows, what the paper shows; it gives pictures, and no figures)
ABLATIONS: dict[str, tuple[Callable[[PaperSettings], Iterator[Row]], str]] = {
    "length": (_length, "a larger budget L0 lets the picture come nearer (its Fig. ablation a)"),
    "bend": (_bend, "a small B0 gives a circle, a large one the rectangle (b)"),
    "occupancy": (_occupancy, "a large weight keeps the knot in the region, a small one not (c)"),
    "mobius": (_mobius, "a small weight leaves the tube through itself, a large one not (d)"),
    "samples": (_samples, "with few samples ellipses break up and capsules do not"),
    "tau": (_tau, "a small tau blurs; a large one is sharp, and its gradients explode"),
    "depth": (_depth, "more layers come nearer"),
    "width": (_width, "wider layers come nearer"),
}


def _table(rows: list[Row], path: Path) -> None:
    """Print the rows, and write them as CSV."""
    names = list(dict.fromkeys(name for row in rows for name in row.figures))
    print(f"{'':<28}" + "".join(f"{name:>12}" for name in names))
    with path.open("w", newline="") as file:
        sheet = csv.writer(file)
        sheet.writerow(["value", *names])
        for row in rows:
            cells = [row.figures.get(name) for name in names]
            sheet.writerow([row.label, *("" if c is None else f"{c:.6g}" for c in cells)])
            shown = ("-" if c is None else f"{c:.4g}" for c in cells)
            print(f"{row.label:<28}" + "".join(f"{cell:>12}" for cell in shown))


def _figure(rows: list[Row], title: str, path: Path) -> None:
    """Draw a column a row of the table: the image over its target, and the knot from the side."""
    figure = Figure(figsize=(2.1 * len(rows), 4.6), dpi=110, layout="constrained")
    figure.suptitle(title, fontsize=9)
    for column, row in enumerate(rows):
        axes = figure.add_subplot(2, len(rows), column + 1)
        # missing area is blue, spilt area red, right area dark
        colours = np.stack(
            [1 - row.target, 1 - np.maximum(row.target, row.image), 1 - row.image], -1
        )
        axes.imshow(colours.clip(0, 1))
        axes.set_title(f"{row.label}\nIoU {row.figures['iou']:.3f}", fontsize=7)
        axes.set_axis_off()
        space = figure.add_subplot(2, len(rows), len(rows) + column + 1, projection="3d")
        loop = np.concatenate([row.knot, row.knot[:1]])
        space.plot(loop[:, 0], loop[:, 2], -loop[:, 1], linewidth=1.2, color="#1f4e79")
        space.set_box_aspect(np.maximum(np.ptp(loop, axis=0), 0.4)[[0, 2, 1]])
        space.tick_params(labelbottom=False, labelleft=False, labelright=False, labeltop=False)
    figure.savefig(path)


def main(
    *,
    only: Literal[*ABLATIONS] | None = None,
    out: Path = Path("paper-ablations"),
    iterations: int = 600,
) -> None:
    """Rerun the ablations that are asked for."""
    out.mkdir(parents=True, exist_ok=True)
    base = PAPER.model_copy(update=SCALED | {"iterations": iterations})
    print(
        f"Scaled down: {PIXELS} px, radius {base.radius:g}, tau {base.tau:g}, N = {base.samples}, depth "
        f"{base.depth}, width {base.width}, Adam at {base.learning_rate:g}, {base.iterations} iterations, "
        "mean image loss. clearance: distance of strands in tube diameters; bend95: 95th percentile of "
        "the squared curvature; outside: of the region. The renderings are full size."
    )
    for name in [only] if only else list(ABLATIONS):
        rows_of, paper = ABLATIONS[name]
        print(f"\n{name}: the paper shows that {paper}", flush=True)
        rows = list(rows_of(base))
        _table(rows, out / f"{name}.csv")
        _figure(rows, f"{name} (scaled down). Paper: {paper}", out / f"{name}.png")


if __name__ == "__main__":
    run_study(main)
