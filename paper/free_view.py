"""Views as unknowns: poses found again from shadows, and designs with the view fixed and free.

`python -m paper.free_view [--pictures NAME ...] [--recover]` prints two tables. The first: known
knots, seen from a pose that is 10 to 15 degrees a turn and 20 % in light distance away from the start. The
second: IoU of the search's end on the project's pictures at the same iterations.
"""

from __future__ import annotations

import numpy as np
import torch

from benchmarks.measurement import Stopwatch, read_question, run_study
from examples.pictures import pictures
from knotfab.base.arrays import Array
from knotfab.design.settings import start_pose
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.problem import ViewNumbers
from knotfab.render.capsules import posed_frame
from knotfab.render.device import render
from knotfab.render.silhouette import Sheet
from knotfab.search.free_pose import ALL, Bounds, Name, one_thread, turn_of
from knotfab.search.search import search
from knotfab.start.start import make_start
from knotfab_formats.search import search_settings
from paper.fit_view import fit_view
from tests.corpus.curves import figure_eight, torus_knot

SHEET = Sheet(160, 160, 1.25)
RADII_MM = {"heart": 3.0, "stickman": 2.0, "wheel": 2.5, "spiral": 2.2, "cat": 3.0}


def angle_deg(one: ViewNumbers, other: ViewNumbers) -> float:
    """Return the angle of the turn between two views."""
    cosine = 0.5 * (np.trace(turn_of(one).T @ turn_of(other)) - 1)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def shadow_of(points: Array, numbers: ViewNumbers, sheet: Sheet = SHEET) -> torch.Tensor:
    """Return [height, width] the hard shadow (0 or 1) of one closed knot."""
    turn = torch.tensor([numbers.azimuth_deg, numbers.elevation_deg, numbers.roll_deg]).double()
    distances = torch.tensor([numbers.light_distance_mm, numbers.wall_distance_mm]).double()
    frame = posed_frame(sheet, turn, *distances)
    p = torch.as_tensor(points)
    return (render(p, p.roll(-1, 0), frame, numbers.radius_mm, 10.0) > 0.5).float()


def recoveries(seeds: int = 3) -> None:
    """Print how near the poses found come to the true ones."""
    knots = {
        "trefoil": torus_knot(2, 3, 35.0, 18.0, 160),
        "T(3,4)": torus_knot(3, 4, 35.0, 18.0, 220),
        "figure-eight": figure_eight(18.0, 200),
    }
    known: tuple[Name, ...] = ("azimuth", "elevation", "roll", "light")
    print("knot          unknowns  start  found   light   wall  radius  CPU seconds")
    print("                         deg    deg     %       %      %")
    for name, points in knots.items():
        rings = polylines_of_sizes((len(points),))
        for seed in range(seeds):
            rng = np.random.default_rng(seed)
            pose = rng.uniform(-20, 20, 3)
            astray = rng.choice([-1, 1], 3) * rng.uniform(10, 15, 3)
            truth = ViewNumbers(400.0, 100.0, 3.0, *pose.tolist())
            light = 400.0 * (1.2 if seed % 2 else 0.8)
            start = ViewNumbers(light, 100.0, 3.0, *(pose + astray).tolist())
            target = shadow_of(points, truth)
            for free in (known, ALL):
                watch = Stopwatch()
                found = fit_view(points, rings, SHEET, target, start, Bounds(free)).numbers
                print(
                    f"{name:<14} {len(free):>6} {angle_deg(start, truth):>7.1f} "
                    f"{angle_deg(found, truth):>6.2f} {found.light_distance_mm / 4 - 100:>7.2f} "
                    f"{found.wall_distance_mm - 100:>7.2f} {found.radius_mm / 0.03 - 100:>6.2f} "
                    f"{watch.cpu_s:>9.1f}",
                    flush=True,
                )


def designs(names: list[str]) -> None:
    """Print the search's IoU with the view fixed and free, each from the same radius and template."""
    settings = search_settings("draft", {})
    every = pictures()
    print("picture    radius   fixed    free   light    wall  radius   turn   CPU seconds")
    gains = []
    for name in names:
        radius = RADII_MM.get(name, 2.5)
        question = read_question(every[name]).with_depth(radius)
        problem = question.problem
        start = make_start(problem, radius, settings)
        watch = Stopwatch()
        fixed = search(problem, start, radius, settings)
        fixed_s = watch.cpu_s
        pose, settings_free = start_pose(question.scene, problem, radius, settings, "cpu")
        result = search(problem, start, radius, settings_free, pose=pose)
        free_s = watch.cpu_s - fixed_s
        n = result.numbers
        assert n is not None
        still = ViewNumbers(n.light_distance_mm, n.wall_distance_mm, n.radius_mm)
        told = "".join(f"  {line}" for line in result.feasibility.violations)
        print(
            f"{name:<10} {radius:>6.2f}  {fixed.iou_estimate:.4f}  {result.iou_estimate:.4f} "
            f"{n.light_distance_mm:>7.1f} {n.wall_distance_mm:>7.1f} {n.radius_mm:>7.3f} "
            f"{angle_deg(n, still):>6.1f}  {fixed_s:>6.1f} {free_s:>5.1f}{told}",
            flush=True,
        )
        gains.append(result.iou_estimate - fixed.iou_estimate)
    print(f"mean gain {np.mean(gains):+.4f}, least {min(gains):+.4f}")


def main(*, pictures: tuple[str, ...] = tuple(RADII_MM), recover: bool = False) -> None:
    """Print the tables."""
    with one_thread():
        recoveries()
        if not recover:
            designs(pictures)


if __name__ == "__main__":
    run_study(main)
