"""Whether what an effect does in a design grows from nothing: pieces just below and just above its threshold.

`python -m benchmarks.threshold_table [--accuracy NAME] [--seeds N] [PICTURE ...]`: for the effects
that shape a piece, a lamp's diameter, how far off people place it, and a wall's radius at 0.99 and at 1.01 of
the threshold, with several seeds each, all of one tube; IoU on both sides, the difference of the means, and
the spread over the seeds.
No design asks the other effects: they change no piece. Then IoU of the same picture seen from above and
below.
"""

from __future__ import annotations

import statistics
from typing import Any, Literal

import numpy as np
from PIL import Image

from benchmarks.measurement import read_question, run_study
from examples.pictures import pictures
from knotfab.base.progress import Progress
from knotfab.design.design import choose_tube
from knotfab.design.question import Question
from knotfab.effects.base import EffectContext
from knotfab.effects.wall import WALL
from knotfab.search.search import search
from knotfab.start.start import make_start
from knotfab.tradeoff.measure import true_iou
from knotfab_formats.scene import Placing, Scene, View
from knotfab_formats.search import PRESETS, SearchSettings

NAMES = ("heart", "anchor")
SIDES = (0.99, 1.01)  # of the threshold
FROM_DEG = (0.0, 40.0, -40.0)


def ask(image: Image.Image, radius: float, lamp_mm: float = 5.0, **keys: Any) -> Question:
    """What is asked of one picture with keys of its view, for a tube of this radius, mm.

    `lamp_mm`: how far off people place the lamp; they turn nothing.
    """
    placing = Placing(lamp_mm=lamp_mm, turn_deg=0.0)
    scene = Scene(views=(View(**keys),), placing=placing)
    return read_question(image, scene).with_depth(radius)


def build(question: Question, radius: float, settings: SearchSettings) -> float:
    """IoU of the piece that is searched for."""
    start = make_start(question.problem, radius, settings)
    return true_iou(question.problem, search(question.problem, start, radius, settings).knots)


def share_of_threshold(
    question: Question, effect: str, radius: float, settings: SearchSettings
) -> float:
    """The magnitude that decides in a design, over the threshold."""
    if effect != "wall":
        decision = make_start(question.problem, radius, settings).effects[effect]
        return decision.magnitude / decision.threshold
    views = tuple(target.view for target in question.problem.views)
    context = EffectContext(views, np.zeros((0, 3)), radius, settings.tolerance_px)
    return WALL.magnitude(context) / WALL.threshold(settings.tolerance_px)


def main(*names: str, accuracy: Literal[*PRESETS] = "standard", seeds: int = 3) -> None:
    """Print the table."""
    settings = PRESETS[accuracy]
    seeded = [settings.model_copy(update={"seed": seed}) for seed in range(seeds)]
    # the key of a view or of placing, a first value, and the power of it that the magnitude goes by
    keys = {
        "penumbra": ("light_diameter_mm", 1.0, 1),
        "misplacement": ("lamp_mm", 1.0, 1),
        "wall": ("wall_radius_mm", 30000.0, -1),
    }
    for name in names or NAMES:
        image = pictures()[name]
        _, radius, _, _ = choose_tube(read_question(image), settings, Progress("quiet"))
        for effect, (key, value, power) in keys.items():
            ious, places = [], []
            for side in SIDES:
                for _ in range(2):  # the magnitude is nearly in proportion
                    question = ask(image, radius, **{key: value})
                    share = share_of_threshold(question, effect, radius, settings)
                    value *= (side / share) ** power
                question = ask(image, radius, **{key: value})
                places.append(share_of_threshold(question, effect, radius, settings))
                ious.append([build(question, radius, seed) for seed in seeded])
            off = statistics.mean(ious[1]) - statistics.mean(ious[0])
            spread = max(max(side) - min(side) for side in ious)
            told = "; ".join(
                f"at {place:.3f} {' '.join(f'{iou:.4f}' for iou in side)}"
                for place, side in zip(places, ious, strict=True)
            )
            print(f"{name:<9} {effect:<12} {told}; off {off:+.4f}, spread {spread:.4f}", flush=True)
        seen = [build(ask(image, radius, elevation_deg=a), radius, settings) for a in FROM_DEG]
        told = ", ".join(f"{a:g}° {iou:.4f}" for a, iou in zip(FROM_DEG, seen, strict=True))
        print(f"{name:<9} elevation {told}", flush=True)


if __name__ == "__main__":
    run_study(main)
