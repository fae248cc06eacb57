"""The catalogue's other groups as tables: large images, losses, network, flow, geometry, scenes."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
import shapely

from examples.isotopy_fuzz import fuzz
from knotfab.design import design
from knotfab.scene.model import Scene
from knotfab.sweep.tube import mesh_volume, sweep
from knotfab.target.read import read_target
from knotfab.target.silhouette import polygon_of
from knotfab.template.filling import fill
from tests.hard_cases.curves import circle, hard_knots
from tests.hard_cases.measure import sampled_error
from tests.hard_cases.pictures import hard_pictures
from tests.hard_cases.rendering import large_cases
from tests.hard_cases.values import ValueCase, loss_cases, network_cases, value_error

__all__ = ["GROUPS", "Line", "groups"]

STEPS = 300  # adversarial ones, of each knot
SLOW = {"checkerboard", "noise", "carpet"}  # their outlines alone take seconds to minutes


@dataclass(frozen=True)
class Line:
    """One case: its cells under the group's heads, why it is hard, and whether it is within its bounds."""

    name: str
    why: str
    cells: tuple[str, ...]
    good: bool


def _value(case: ValueCase) -> Line:
    found = value_error(case)
    good = found.finite and found.share <= 1
    gradient = "finite"
    if case.smooth:
        gradient = f"{found.double:.0e} / {found.single:.0e}"
        good &= found.double <= 1e-6 and found.single <= 1e-3
    cells = (f"{found.condition:.0e}", f"{found.error:.0e}", f"{found.share:.3f}", gradient)
    return Line(case.name, case.why, cells, good)


def _images() -> Iterator[Line]:
    for case in large_cases():
        start = time.process_time()
        error, share = sampled_error(case)
        spent = time.process_time() - start
        cells = (str(len(case.edges)), f"{error:.0e}", f"{share:.3f}", f"{spent:.0f}")
        yield Line(case.name, case.why, cells, share <= 1 and error <= 1e-3)


def _losses() -> Iterator[Line]:
    return map(_value, loss_cases())


def _network() -> Iterator[Line]:
    return map(_value, network_cases())


def _flow() -> Iterator[Line]:
    for case in hard_knots():
        found = fuzz(case, STEPS, seed=3)
        cells = (str(found.steps), str(found.accepted), str(found.crossing), str(found.faults))
        yield Line(case.name, case.why, cells, found.faults + found.changed == 0)


def _tube(name: str, why: str, points: np.ndarray, radius: float, sides: int) -> Line:
    vertices, faces = sweep(points, radius, sides)
    length = float(np.linalg.norm(np.roll(points, -1, 0) - points, axis=1).sum())
    off = abs(mesh_volume(vertices, faces) / (pi * radius**2 * length) - 1)
    return Line(name, why, (f"{len(points)} x {sides}", f"volume {off:.0e}"), off <= 1e-5)


def _geometry() -> Iterator[Line]:
    stands_out = float(np.sqrt(2 * pi / 64 / np.sin(2 * pi / 64)))
    limit = 10.0 * float(np.cos(pi / 256)) / stands_out
    yield _tube("sweep at 0.9 / r", "a bend near the limit", circle(256, 10.0), 0.9 * limit, 64)
    yield _tube(
        "sweep at 0.999 / r", "the inner side nearly folds", circle(256, 10.0), 0.999 * limit, 64
    )
    s = 2 * pi * np.arange(300) / 300
    for height in (2.0, 4.0, 5.9):
        out = 10 + height * np.cos(3 * s)
        wave = np.stack([out * np.cos(s), out * np.sin(s), height * np.sin(3 * s)], 1)
        why = "its frame comes back turned by another angle, up to half a turn"
        yield _tube(f"closing twist, {height:g}", why, wave, 0.3, 5)
    yield _tube("100,000 corners", "a large polygon", circle(100_000, 1000.0), 1.0, 4)
    for case in hard_pictures():
        if case.name in SLOW:
            continue
        outline = polygon_of(case.draw())
        pieces, corners = len(outline.geoms), shapely.get_num_coordinates(outline)
        good, said = outline.is_valid, "nothing to fill"
        if not outline.is_empty:
            curves = fill(outline, 6.0).curves
            good &= all(bool(np.isfinite(c).all()) for c in curves)
            said = f"{len(curves)} curves"
        yield Line(case.name, case.why, (f"{pieces} pieces, {corners} corners", said), good)


SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "room enough": ("none: what the others are held against", {}),
    "length budget": ("an eighth of what is needed", {"material": {"max_length_mm": 250.0}}),
    "region": ("a third of the picture's width", {"region": {"size_mm": (60.0, 60.0, 60.0)}}),
    "bend limit": ("no corner can be drawn", {"material": {"min_bend_radius_mm": 30.0}}),
}


def _scenes() -> Iterator[Line]:
    target = read_target("text:♥")
    for name, (why, parts) in SCENES.items():
        given = {
            "schema": 1,
            "piece": {"tube_radius_mm": 2.5},
            "accuracy": {"name": "draft"},
            "views": [{"picture": "heart.png"}],
            **parts,
        }
        made = design(Scene.model_validate(given), target)
        price = made.binding[0] if made.binding else None
        cells = (
            "every limit holds" if not made.result.standing.violations else "broken",
            f"{made.result.iou_estimate:.3f}",
            " and ".join(price.limits) if price else "-",
            f"{price.iou_without:.3f}" if price else "-",
        )
        held = not made.result.standing.violations
        yield Line(name, why, cells, held and (price is None) == (not parts))


GROUPS = {
    "Large images": (("case", "N", "single, px", "share", "CPU s"), _images),
    "Losses": (("case", "condition", "single", "share", "gradient"), _losses),
    "Network": (("case", "condition", "single", "share", "gradient"), _network),
    "Flow": (("case", "steps", "accepted", "would cross", "crossed"), _flow),
    "Geometry": (("case", "size", "error or result"), _geometry),
    "Scenes that cannot be met": (
        ("case", "the piece", "IoU", "what binds", "IoU without it"),
        _scenes,
    ),
}


def groups(only: str) -> Iterator[tuple[str, Sequence[str], list[Line]]]:
    """(title, heads, lines) of each group, as they are measured; prints each line."""
    for title, (heads, measure) in GROUPS.items():
        if only and only not in title:
            continue
        print(f"\n{title}\n" + "  ".join(head.ljust(26) for head in heads))
        lines = []
        for line in measure():
            text = "  ".join(cell.ljust(26) for cell in (line.name, *line.cells))
            print(text + ("" if line.good else "  OUTSIDE"), flush=True)
            lines.append(line)
        yield title, heads, lines
