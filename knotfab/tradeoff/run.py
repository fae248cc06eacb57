"""`knotfab tradeoff`: from a picture to tradeoff.json and tradeoff.png."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from knotfab import __version__
from knotfab.design.design import choose_tube
from knotfab.design.question import ask
from knotfab.errors import InputError
from knotfab.files.whole import write_whole
from knotfab.progress import Progress
from knotfab.scene.model import Scene
from knotfab.scene.settings import search_settings
from knotfab.target.read import read_target
from knotfab.tradeoff.draw import draw
from knotfab.tradeoff.measure import Measured, Study, measure, to_dict
from knotfab.tradeoff.points import Point, points

__all__ = ["Tradeoff", "tradeoff"]


@dataclass(frozen=True)
class Tradeoff:
    """What was measured, at which tube radius, and where it was written."""

    measured: list[Measured]
    radius_mm: float
    folder: Path


def tradeoff(
    scene: Scene,
    source: str,
    out: Path,
    base: Path | None = None,
    repeats: int = 1,
    device: str = "cpu",
    progress: Progress | None = None,
    chosen: Sequence[Point] | None = None,
    jobs: int = 1,
) -> Tradeoff:
    """Measure the frontier of accuracy and time for one picture on this machine.

    The radius is chosen once, by the scene's own accuracy, so that all points draw the same thing; then
    every point is searched `repeats` times in turn, `jobs` of them side by side.

    Raises:
        InputError: the picture or the folder is wrong; SceneError: no tube draws the picture.
    """
    progress = progress or Progress("quiet")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out {out}", f"it cannot be made: {error.strerror}", "Name a folder"
        ) from error
    if not os.access(out, os.W_OK):
        raise InputError(f"--out {out}", "it may not be written", "Name another folder")
    target = read_target(source, scene.views[0], base=base)
    settings = search_settings(scene.accuracy.name, scene.search)
    question, radius, _, choice = choose_tube(ask(scene, [target]), settings, progress)
    template = None if choice is None else choice.template
    study = Study(question.problem, radius, template, device)
    asked = list(chosen) if chosen is not None else points(settings)
    with progress.stage("measure"):
        measured = measure(study, asked, repeats, jobs, progress.update)
    content: dict[str, Any] = {
        "schema": 1,
        "picture": target.name,
        "tube_radius_mm": radius,
        "repeats": repeats,
        "jobs": jobs,
        "device": device,
        "version": __version__,
        "points": to_dict(measured),
    }
    write_whole(out / "tradeoff.json", json.dumps(content, indent=1).encode())
    title = f"{target.name}: what accuracy costs, tube radius {radius:.2f} mm"
    title += f", {jobs} side by side" if jobs > 1 else ""
    write_whole(out / "tradeoff.png", draw(measured, title))
    return Tradeoff(measured, radius, out)
