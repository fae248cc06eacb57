"""Searches at many settings, side by side: IoU on one yardstick against seconds."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from knotfab.errors import SceneError
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.geometry.tube import sweep
from knotfab.knots import Knots
from knotfab.problem import Problem, Start
from knotfab.scene.settings import SearchSettings
from knotfab.search.search import search
from knotfab.tradeoff.points import Point

__all__ = [
    "YARDSTICK_PX",
    "Measured",
    "facet_error_px",
    "frontier",
    "measure",
    "to_dict",
    "true_iou",
]

MakeStart = Callable[[SearchSettings], Start]
YARDSTICK_PX = 1024  # longer side of the picture on which every point is judged


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


def _run(
    problem: Problem, make: MakeStart, radius: float, settings: SearchSettings, device: str
) -> tuple[Knots, bool, int, float, float, int]:
    begun = time.perf_counter()
    result = search(problem, make(settings), radius, settings, device=device)
    feasible = result.feasible
    searched = time.perf_counter()
    faces = 0
    for knot in result.knots.knots:
        try:
            faces += len(sweep(knot.points, radius, settings.mesh_sides)[1])
        except SceneError:
            feasible = False  # bends that no tube of this radius can take
    swept = time.perf_counter()
    return result.knots, feasible, result.log.repairs, searched - begun, swept - searched, faces


def measure(
    problem: Problem,
    make: MakeStart,
    radius: float,
    points: Sequence[Point],
    repeats: int = 1,
    device: str = "cpu",
    report: Callable[[float, float | None], None] | None = None,
) -> list[Measured]:
    """Every point, `repeats` times in turn, so that what else the machine does falls on all alike.

    The search gives the same knots each time; only the seconds differ, and their median is taken.
    """
    first: dict[int, tuple[Knots, bool, int, int]] = {}
    seconds: dict[int, list[tuple[float, float]]] = {k: [] for k in range(len(points))}
    ious: dict[int, float] = {}
    for turn in range(repeats):
        for k, point in enumerate(points):
            knots, feasible, repairs, searched, swept, faces = _run(
                problem, make, radius, point.settings, device
            )
            seconds[k].append((searched, swept))
            if turn == 0:
                first[k] = (knots, feasible, repairs, faces)
                ious[k] = true_iou(problem, knots, device)
            if report is not None:
                report((turn * len(points) + k + 1) / (repeats * len(points)), max(ious.values()))
    found = []
    for k, point in enumerate(points):
        _, feasible, repairs, faces = first[k]
        found.append(
            Measured(
                point,
                ious[k],
                facet_error_px(problem, radius, point.settings.mesh_sides),
                statistics.median(s for s, _ in seconds[k]),
                statistics.median(s for _, s in seconds[k]),
                feasible,
                repairs,
                faces,
            )
        )
    return found


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
