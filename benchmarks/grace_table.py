"""What grace costs: picture and legibility against how much the strands bend, and how that looks.

`python -m benchmarks.grace_table [--out FILE.png] [NAME ...]` (`make grace-table`): the project's
own pictures, each searched from one start with several weights of grace; the table gives the means, the
picture every piece from four sides, without grace on the left and with the default on the right.
"""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from benchmarks.measurement import read_question, run_study
from examples.pictures import pictures
from examples.side_view import side_view
from knotfab.base.arrays import Array
from knotfab.base.progress import Progress
from knotfab.design.design import choose_tube
from knotfab.geometry.measures import measure_curvature
from knotfab.knots import Knots
from knotfab.search.search import search
from knotfab.start.legibility import legibility, stretch_mask
from knotfab.tradeoff.measure import true_iou
from knotfab_formats.search import PRESETS

WEIGHTS = (0.0, 0.005, 0.01, 0.02, 0.04, 0.08)
TURNS_DEG = (0.0, 45.0, 90.0, 180.0)
TILE_PX = 144
LABEL_PX = 72
HEADINGS = ("IoU", "least", "curvature x r", "most", "turns", "length / r", "leg45", "leg30", "s")


def main(*names: str, out: Path | None = None) -> None:
    """Print the table, and draw the pieces."""
    found: dict[float, list[list[float]]] = {weight: [] for weight in WEIGHTS}
    strips = []
    for name, image in pictures().items():
        if names and name not in names:
            continue
        settings = PRESETS["standard"]
        question, radius, start, _ = choose_tube(read_question(image), settings, Progress("quiet"))
        problem = question.problem
        mask = stretch_mask(problem.views[0].mask)
        light_mm = question.scene.views[0].light_distance_mm
        made: dict[float, Knots] = {}
        for weight in WEIGHTS:
            begun = time.process_time()
            weighed = settings.model_copy(update={"grace": weight})
            knots = search(problem, start, radius, weighed).knots
            row = [*describe(knots), *(read(knots, light_mm, mask, a) for a in (45.0, 30.0))]
            found[weight].append([true_iou(problem, knots), *row, time.process_time() - begun])
            made[weight] = knots
        strips.append(draw(name, made[0.0], made[settings.grace]))
        print(f"{name}: done", flush=True)
    print("weight  " + "  ".join(f"{h:>13}" for h in HEADINGS))
    for weight, rows in found.items():
        iou, bend, turns, length, at_45, at_30, seconds = zip(*rows, strict=True)
        mean = statistics.mean
        row = [mean(iou), min(iou), mean(bend), max(bend), mean(turns), mean(length)]
        row += [mean(at_45), mean(at_30), mean(seconds)]
        print(f"{weight:<6g}  " + "  ".join(f"{value:13.4f}" for value in row))
    if out:
        sheet = Image.fromarray(np.concatenate([np.asarray(s) for s in strips]))
        sheet.quantize(64).save(out, optimize=True)


def describe(knots: Knots) -> tuple[float, float, float]:
    """Mean curvature times radius, turns, and length in radii of all knots together."""
    lengths = np.array([knot.length_mm for knot in knots.knots])
    bends = [measure_curvature(knot.points, knots.radius_mm) for knot in knots.knots]
    mean = float(np.average([bend.mean for bend in bends], weights=lengths))
    return mean, sum(bend.turns for bend in bends), float(lengths.sum()) / knots.radius_mm


def read(knots: Knots, light_mm: float, mask: Array, angle_deg: float) -> float:
    """How well the picture can be read so many degrees aside from the light."""
    points = np.concatenate([knot.points for knot in knots.knots])
    return legibility(points, knots.radius_mm, light_mm, mask, angle_deg)


def draw(name: str, *pieces: Knots) -> Image.Image:
    """The pieces beside each other, each from four sides."""
    strip = Image.new("RGB", (LABEL_PX + len(pieces) * len(TURNS_DEG) * TILE_PX, TILE_PX), "white")
    ImageDraw.Draw(strip).text((4, TILE_PX // 2), name, fill="black")
    left = LABEL_PX
    for knots in pieces:
        curves = [knot.points for knot in knots.knots]
        points = np.concatenate(curves)
        turns = np.deg2rad(TURNS_DEG)
        across = np.outer(points[:, 0], np.cos(turns)) - np.outer(points[:, 2], np.sin(turns))
        reach = float(max(np.abs(across).max(), np.abs(points[:, 1]).max())) + knots.radius_mm
        for turn in TURNS_DEG:
            tile = side_view(curves, knots.radius_mm, reach, TILE_PX, turn)
            strip.paste(tile, (left, 0))
            left += TILE_PX
    return strip


if __name__ == "__main__":
    run_study(main)
