"""The paper's network and the flow on the same picture: IoU against seconds, in one figure and a table.

`python -m paper.search_compare [--picture NAME] [--seed N] [--out FOLDER]` runs each way of
searching at several numbers of iterations, with one tube radius and one spacing of samples, prints a
table and writes search-compare.png. It is scaled down to a few minutes on two cores: the paper's own
settings (width 1024, Adam at 1e-5, tens of thousands of iterations) would take days.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt

from benchmarks.measurement import Stopwatch, paint_comparison, read_question, run_study
from examples.pictures import pictures
from knotfab.base.arrays import Mask
from knotfab.knots import Knots
from knotfab.problem import Problem
from knotfab.search.flow import plan_of
from knotfab.search.search import search
from knotfab.search.state import SearchResult
from knotfab.start.filling import Template, fill
from knotfab.start.start import make_start
from knotfab_formats.scene import VERIFIED_PX
from knotfab_formats.search import PRESETS, SearchSettings

RADIUS = 0.025  # a share of the frame's width, as in the paper
SCALES = (0.25, 0.5, 1.0, 2.0)  # factors of the iterations
WAYS: dict[str, dict[str, str | int]] = {
    "inn, circle": {"method": "inn", "network_start": "circle", "network_iterations": 600},
    "inn, filling": {"method": "inn", "network_iterations": 300},
    "flow": {"method": "flow"},
    "inn+flow": {"method": "inn+flow", "network_iterations": 100},
}


def find_shadows(
    problem: Problem, knots: Knots, pixels: int = VERIFIED_PX
) -> list[tuple[Mask, Mask]]:
    """Render the round tube's shadow in each view. Returns (shadow, picture), `pixels` on the longer side."""
    images = [view.image_at(knots.radius_mm, pixels) for view in problem.views]
    points, rings, radius = knots.points, knots.rings, knots.radius_mm
    return [(image.seen(points, rings, radius), image.target > 0.5) for image in images]


@dataclass(frozen=True)
class Run:
    """One search: where it came to, and what it cost."""

    way: str
    scale: float
    repairs: int
    cpu_s: float
    result: SearchResult


def main(*, picture: str = "cat", seed: int = 0, out: Path = Path(".")) -> None:
    """Run all, print the table, draw the figure."""
    question = read_question(pictures()[picture])
    radius = round(RADIUS * question.views[0].frame_width_mm, 3)
    problem = question.with_depth(radius).problem
    template = fill(problem.polygons[0], radius)
    runs = []
    print(f"{picture}, tube radius {radius:g} mm, seed {seed}; IoU at 256 px\n")
    print(
        f"{'way':13} {'scale':>5} {'CPU s':>6} {'IoU':>7} {'type':>9} {'bend':>6} {'gap':>6}  "
        "limits not met"
    )
    for way in WAYS:
        for scale in SCALES:
            runs.append(run(problem, template, radius, way, scale, 0, seed))
            print(_line(runs[-1]), flush=True)
        runs.append(run(problem, template, radius, way, 1.0, 4, seed))
        print(_line(runs[-1]), flush=True)
    out.mkdir(parents=True, exist_ok=True)
    path = out / "search-compare.png"
    _draw(problem, runs, path)
    print(f"\nbend, gap: in units of what is required; +repairs: up to four short flows\n{path}")


def run(
    problem: Problem,
    template: Template,
    radius: float,
    way: str,
    scale: float,
    repairs: int,
    seed: int,
) -> Run:
    """Return one search with `scale` times the iterations."""
    base = PRESETS["draft"].model_dump() | WAYS[way] | {"seed": seed}
    settings = SearchSettings(**base).scaled(scale)
    watch = Stopwatch()
    start = make_start(problem, radius, settings, template=template)
    plan = replace(plan_of(settings), repairs=repairs)
    result = search(problem, start, radius, settings, plan=plan)
    return Run(way, scale, repairs, watch.cpu_s, result)


def _line(one: Run) -> str:
    state, limits = one.result.feasibility, one.result.feasibility.limits
    scale = f"{one.scale:g}" if one.repairs == 0 else f"+{one.result.log.repairs}"
    return (
        f"{one.way:13} {scale:>5} {one.cpu_s:6.1f} {one.result.iou_estimate:7.4f} "
        f"{'certified' if one.result.log.certified else 'unproved':>9} "
        f"{state.bend_mm / limits.bend_radius:6.2f} {state.gap_mm / limits.separation:6.2f}  "
        f"{', '.join(state.broken) or '-'}"
    )


def _draw(problem: Problem, runs: list[Run], path: Path) -> None:
    """Draw the IoU against seconds, and under it each way's shadow at scale 1 without repairs."""
    figure = plt.figure(figsize=(9, 7.5), layout="constrained")
    grid = figure.add_gridspec(2, len(WAYS), height_ratios=[1.6, 1])
    plot = figure.add_subplot(grid[0, :])
    for way in WAYS:
        line = sorted((r for r in runs if r.way == way and not r.repairs), key=lambda r: r.cpu_s)
        (drawn,) = plot.plot(
            [r.cpu_s for r in line], [1 - r.result.iou_estimate for r in line], "o-", label=way
        )
        for r in runs:
            if r.way == way and r.repairs:
                at = (r.cpu_s, 1 - r.result.iou_estimate)
                mark = "X" if r.result.feasibility.broken else "*"
                plot.plot(*at, mark, color=drawn.get_color(), markersize=14, markeredgecolor="k")
    plot.set(xscale="log", yscale="log", xlabel="CPU seconds", ylabel="1 - IoU (lower is better)")
    plot.set_title(
        "circles: as searched; star: repaired until every limit holds (cross: it does not)"
    )
    plot.grid(True, which="both", alpha=0.3)
    plot.legend()
    for column, way in enumerate(WAYS):
        one = next(r for r in runs if r.way == way and r.scale == 1.0 and not r.repairs)
        axes = figure.add_subplot(grid[1, column])
        axes.imshow(paint_comparison(*find_shadows(problem, one.result.knots, pixels=256)[0]))
        axes.set_axis_off()
        axes.set_title(f"{way}: {one.result.iou_estimate:.3f}", fontsize=10)
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    run_study(main)
