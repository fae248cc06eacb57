"""What a wide lamp is worth as an effect: pieces searched for it against the same searched for a point.

`python -m benchmarks.lamp_table [--accuracy NAME] [--lamp MM] [NAME ...]`: the project's own pictures
under one lamp, the effect `penumbra` off and on in the search; the shadows of both are averaged over that
lamp by the validators. For each: brightness error, IoU at half light, IoU of the point's shadow, legibility
at 45 degrees and CPU seconds of depth and search; then the means.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Literal

import numpy as np
from PIL import Image

from benchmarks.grace_table import read
from benchmarks.measurement import read_question, run_study
from examples.pictures import pictures
from knotfab.base.progress import Progress
from knotfab.design.design import choose_tube
from knotfab.effects.penumbra import PENUMBRA
from knotfab.geometry.meshes import join_meshes
from knotfab.geometry.tube import sweep
from knotfab.knots import Knots
from knotfab.problem import TargetView
from knotfab.search.search import search
from knotfab.start.legibility import stretch_mask
from knotfab.start.start import make_start
from knotfab_formats.scene import Scene, View
from knotfab_formats.search import PRESETS, SearchSettings
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.frame import padded_mask, working_frame
from knotfab_validators.shadows.penumbra import measure_penumbra
from knotfab_validators.shadows.render import SilhouetteRenderer
from knotfab_validators.shadows.view import view_geometry

HEADINGS = ("error", "half light", "point", "leg45", "s")
PIXELS = 512


def compare(image: Image.Image, accuracy: str, lamp_mm: float) -> list[list[float]]:
    """Two pieces of one tube, the effect off and on: the figures of `HEADINGS` of each."""
    settings = PRESETS[accuracy]
    scene = Scene(views=(View(light_diameter_mm=lamp_mm),))
    question, radius, _, _ = choose_tube(read_question(image, scene), settings, Progress("quiet"))
    found = []
    for switch in ("off", "auto"):
        problem = replace(question.problem, switches={PENUMBRA.name: switch})
        begun = time.process_time()
        start = make_start(problem, radius, settings)
        knots = search(problem, start, radius, settings).knots
        spent = time.process_time() - begun
        found.append([*look(problem.views[0], knots, settings), spent])
    return found


def look(target: TargetView, knots: Knots, settings: SearchSettings) -> list[float]:
    """The figures of `HEADINGS` but for the seconds."""
    view, mask = target.view, target.mask
    vertices, faces = join_meshes(
        [sweep(k.points, knots.radius_mm, settings.mesh_sides) for k in knots.knots]
    )
    frame = working_frame(mask.shape[1], mask.shape[0], PIXELS)
    seen = view_geometry(view, mask.shape[1], mask.shape[0]).resample(frame)
    wanted = padded_mask(mask, frame)
    with SilhouetteRenderer(vertices, faces.astype(np.int64)) as renderer:
        sharp = renderer.render(seen)
        soft = measure_penumbra(
            renderer, vertices, seen, wanted, sharp, frame, view, settings.tolerance_px
        )
    legible = read(knots, view.light_distance_mm, stretch_mask(mask), 45.0)
    return [soft.brightness_error, soft.iou, overlap(sharp, wanted).iou, legible]


def main(*names: str, accuracy: Literal[*PRESETS] = "standard", lamp: float = 20.0) -> None:
    """Print the table."""
    print(f"{'':<12}" + "".join(f"{h:>22}" for h in HEADINGS), flush=True)
    every = []
    for name, image in pictures().items():
        if names and name not in names:
            continue
        off, on = compare(image, accuracy, lamp)
        every.append([off, on])
        print(
            f"{name:<12}" + "".join(f"{a:>13.4f} ->{b:7.4f}" for a, b in zip(off, on, strict=True)),
            flush=True,
        )
    found = np.array(every)
    off, on = found.mean(axis=0)
    print(f"{'mean':<12}" + "".join(f"{a:>13.4f} ->{b:7.4f}" for a, b in zip(off, on, strict=True)))
    share = np.mean(found[:, 1] / found[:, 0], axis=0)
    print(
        f"error {share[0] - 1:+.1%} on average, {on[0] / off[0] - 1:+.1%} of the means, time {share[4]:.2f}"
    )


if __name__ == "__main__":
    run_study(main)
