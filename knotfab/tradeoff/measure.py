"""Searches at many settings, side by side: IoU on one yardstick against seconds."""

from __future__ import annotations

import os
import pickle
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from knotfab.errors import MachineError, SceneError
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.geometry.tube import sweep
from knotfab.knots import Knots
from knotfab.pool import ONE_THREAD, Crash, Workers
from knotfab.problem import Problem
from knotfab.scene.settings import SearchSettings
from knotfab.search.search import search
from knotfab.start.filling import Template
from knotfab.start.start import make_start
from knotfab.tradeoff.points import Point

__all__ = [
    "YARDSTICK_PX",
    "Measured",
    "Study",
    "facet_error_px",
    "frontier",
    "measure",
    "run_point",
    "to_dict",
    "true_iou",
]

Run = dict[str, Any]  # search_s, sweep_s, feasible, repairs, faces, iou
YARDSTICK_PX = 1024  # longer side of the picture on which every point is judged


@dataclass(frozen=True)
class Study:
    """What every point draws, with one tube radius, mm; `template` where its filling is known."""

    problem: Problem
    radius: float
    template: Template | None = None
    device: str = "cpu"


@dataclass(frozen=True)
class Measured:
    """One point: what it reached and what it cost (medians of its runs)."""

    point: Point
    iou: float  # of the round tube at 1024 px, whatever the search itself looked at
    facet_px: float  # how far the mesh's facets are from that tube, at most, in the same pixels
    search_s: float
    sweep_s: float
    feasible: bool
    repairs: int
    faces: int

    @property
    def seconds(self) -> float:
        """Search and sweep together."""
        return self.search_s + self.sweep_s


def true_iou(problem: Problem, knots: Knots, device: str = "cpu") -> float:
    """IoU of the round tube's silhouette, at 1024 px, with the picture that it draws worst."""
    rings = polylines_of_sizes(tuple(len(k.points) for k in knots.knots))
    images = [v.image_at(knots.radius_mm, YARDSTICK_PX, device) for v in problem.views]
    return min(image.iou(knots.points, rings, knots.radius_mm) for image in images)


def facet_error_px(problem: Problem, radius: float, sides: int) -> float:
    """How far a ring of `sides` corners of the right area stands out from the round tube: r a² / 12.

    a = 2 pi / sides; seen at the piece's middle and in pixels of the yardstick.
    """
    stands_out = radius * (2 * np.pi / sides) ** 2 / 12
    views = (v.view for v in problem.views)
    return max(stands_out * v.magnification / (v.longer_mm / YARDSTICK_PX) for v in views)


def run_point(study: Study, settings: SearchSettings, judge: bool) -> Run:
    """Search and sweep a study at these settings; `iou` is None unless `judge`, as that takes a while."""
    begun = time.perf_counter()
    start = make_start(study.problem, study.radius, settings, template=study.template)
    result = search(study.problem, start, study.radius, settings, device=study.device)
    feasible = result.feasible
    searched = time.perf_counter()
    faces = 0
    for knot in result.knots.knots:
        try:
            faces += len(sweep(knot.points, study.radius, settings.mesh_sides)[1])
        except SceneError:
            feasible = False  # bends that no tube of this radius can take
    swept = time.perf_counter()
    return {
        "search_s": searched - begun,
        "sweep_s": swept - searched,
        "feasible": feasible,
        "repairs": result.log.repairs,
        "faces": faces,
        "iou": true_iou(study.problem, result.knots, study.device) if judge else None,
    }


def measure(
    study: Study,
    points: Sequence[Point],
    repeats: int = 1,
    jobs: int = 1,
    report: Callable[[float, float | None], None] | None = None,
) -> list[Measured]:
    """Every point, `repeats` times in turn, so that what else the machine does falls on all alike.

    The search gives the same knots each time; only the seconds differ, and their median is taken.

    Args:
        jobs: points side by side, in processes of one thread each. They slow each other down: their seconds
            compare with each other, not with those of points that had the machine to themselves.
        report: told the share that is done, and the best IoU so far.

    Raises:
        MachineError: a point's process ended.
    """
    runs: dict[int, list[Run]] = {k: [] for k in range(len(points))}
    asked = [(k, turn == 0) for turn in range(repeats) for k in runs]
    requests = [(points[k].settings, judge) for k, judge in asked]
    for done, (number, run) in enumerate(_run_all(study, requests, jobs), 1):
        runs[asked[number][0]].append(run)
        if report is not None:
            ious = [one["iou"] for found in runs.values() for one in found]
            report(done / len(asked), max((i for i in ious if i is not None), default=None))
    return [
        Measured(
            point,
            next(run["iou"] for run in runs[k] if run["iou"] is not None),
            facet_error_px(study.problem, study.radius, point.settings.mesh_sides),
            statistics.median(run["search_s"] for run in runs[k]),
            statistics.median(run["sweep_s"] for run in runs[k]),
            all(run["feasible"] for run in runs[k]),
            runs[k][0]["repairs"],
            runs[k][0]["faces"],
        )
        for k, point in enumerate(points)
    ]


def _run_all(
    study: Study, requests: Sequence[tuple[SearchSettings, bool]], jobs: int
) -> Iterator[tuple[int, Run]]:
    """Each request's number and its run, as they end: here one after the other, or `jobs` at a time."""
    if jobs == 1:
        for number, (settings, judge) in enumerate(requests):
            yield number, run_point(study, settings, judge)
        return
    with tempfile.TemporaryDirectory(prefix="knotfab-") as place:
        file = Path(place) / "study"
        file.write_bytes(pickle.dumps(study))
        command = [sys.executable, "-P", "-m", "knotfab.tradeoff.worker", str(file)]
        with Workers(command, jobs, env={**os.environ, **ONE_THREAD}) as workers:
            futures = {
                workers.ask({"settings": settings.model_dump(), "judge": judge}): number
                for number, (settings, judge) in enumerate(requests)
            }
            try:
                for future in as_completed(futures):
                    yield futures[future], future.result()
            except Crash as crash:
                said = f"the process of a point ended ({crash.said or crash.code})"
                raise MachineError(f"--jobs {jobs}", said, "Try --jobs 1.") from crash


def frontier(measured: Sequence[Measured]) -> list[Measured]:
    """The feasible points that no other beats in both IoU and seconds, fastest first."""
    best: list[Measured] = []
    for one in sorted((m for m in measured if m.feasible), key=lambda m: (m.seconds, -m.iou)):
        if not best or one.iou > best[-1].iou:
            best.append(one)
    return best


def to_dict(measured: Sequence[Measured]) -> list[dict[str, Any]]:
    """Rows for tradeoff.json."""
    on = {id(m) for m in frontier(measured)}
    return [
        {
            "knob": m.point.knob,
            "point": m.point.label,
            "iou": m.iou,
            "facet_error_px": m.facet_px,
            "search_s": m.search_s,
            "sweep_s": m.sweep_s,
            "feasible": m.feasible,
            "repairs": m.repairs,
            "faces": m.faces,
            "frontier": id(m) in on,
            "settings": m.point.settings.model_dump(),
        }
        for m in measured
    ]
