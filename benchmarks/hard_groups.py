"""The catalogue's other groups as tables: images, losses, network, flow, geometry, light, strokes, scenes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import pi
from typing import Any

import numpy as np
import shapely
import torch
from matplotlib.axes import Axes

from benchmarks.hard.curves import circle, hard_knots
from benchmarks.hard.isotopy import fuzz
from benchmarks.hard.light import LampCase, WallCase, lamp_cases, wall_cases, wall_shares
from benchmarks.hard.measure import FORMS, image, sampled_error
from benchmarks.hard.pictures import hard_pictures
from benchmarks.hard.rendering import RenderCase, large_cases
from benchmarks.hard.strokes import stroke_cases, trace
from benchmarks.hard.terms import term_cases
from benchmarks.hard.value_error import slope_excess, value_error
from benchmarks.hard.values import ValueCase, loss_cases, network_cases
from benchmarks.hard_sheets import (
    Draw,
    draw_image,
    draw_knots,
    draw_loss,
    draw_map,
    draw_outline,
    draw_rays,
    draw_shadow,
    draw_tube,
)
from benchmarks.measurement import Stopwatch
from knotfab.base.arrays import Array
from knotfab.design.design import Design, design_knots
from knotfab.geometry.tube import mesh_volume, sweep
from knotfab.picture.read import Target, read_target
from knotfab.picture.silhouette import trace_polygon
from knotfab.render.frame import frame_of
from knotfab.render.tensors import render
from knotfab.scene.camera import camera_of
from knotfab.start.filling import fill
from knotfab_formats.scene import Scene

STEPS = 300  # adversarial ones, of each knot
SLOW = {"checkerboard", "noise", "carpet"}  # their outlines alone take seconds to minutes


@dataclass(frozen=True)
class Line:
    """One case: its cells under the group's heads, why it is hard, and whether it is within its bounds.

    `draw` draws it for the group's contact sheet.
    """

    name: str
    why: str
    cells: tuple[str, ...]
    good: bool
    draw: Draw


def _value(case: ValueCase) -> Line:
    found = value_error(case)
    good = found.finite and found.share <= 1
    if case.smooth:
        gradient = f"{found.double:.0e} / {found.single:.0e}"
        good &= found.double <= 1e-6 and found.single <= 1e-3
    elif case.jumps:
        gradient = "finite"
    else:
        excess = max(slope_excess(case, t) for t in (torch.float64, torch.float32))
        gradient = "subgradient" if excess <= 1e-3 else f"outside by {excess:.0e}"
        good &= excess <= 1e-3
    cells = (f"{found.condition:.0e}", f"{found.error:.0e}", f"{found.share:.3f}", gradient)
    return Line(case.name, case.why, cells, good, _drawn(case))


def _drawn(case: ValueCase) -> Draw:
    if case.move is not None:
        return partial(draw_map, move=case.move, size=case.size)
    points = case.inputs[0].clone().requires_grad_()
    (slope,) = torch.autograd.grad(case.f(points), points, allow_unused=True)
    slope = torch.zeros_like(points) if slope is None else slope
    flat, pull = (x.detach().reshape(-1, 3).numpy() for x in (points, slope))
    return partial(draw_loss, points=flat, slope=pull)


def _images() -> Iterator[Line]:
    for case in large_cases():
        watch = Stopwatch()
        error, share = (
            max(e)
            for e in zip(*(sampled_error(case, render=f) for f in FORMS.values()), strict=True)
        )
        spent = watch.cpu_s
        cells = (str(len(case.edges)), f"{error:.0e}", f"{share:.3f}", f"{spent:.0f}")
        good = share <= 1 and error <= 1e-3
        yield Line(case.name, case.why, cells, good, partial(_draw_small, case=case))


def _draw_small(place: Axes, case: RenderCase) -> None:
    shown = image(case, torch.float32)[None, None]
    draw_image(place, torch.nn.functional.avg_pool2d(shown, 32)[0, 0])


def _losses() -> Iterator[Line]:
    return map(_value, (*loss_cases(), *term_cases()))


def _network() -> Iterator[Line]:
    return map(_value, network_cases())


def _flow() -> Iterator[Line]:
    for case in hard_knots():
        found = fuzz(case, STEPS, seed=3)
        cells = (str(found.steps), str(found.accepted), str(found.crossing), str(found.faults))
        good = found.faults + found.changed == 0
        yield Line(case.name, case.why, cells, good, partial(draw_knots, polygons=case.make()))


def _tube(name: str, why: str, points: np.ndarray, radius: float, sides: int) -> Line:
    vertices, faces = sweep(points, radius, sides)
    length = float(np.linalg.norm(np.roll(points, -1, 0) - points, axis=1).sum())
    off = abs(mesh_volume(vertices, faces) / (pi * radius**2 * length) - 1)
    draw = partial(draw_tube, points=points, radius=radius)
    return Line(name, why, (f"{len(points)} x {sides}", f"volume {off:.0e}"), off <= 1e-5, draw)


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
        mask = case.draw()
        outline = trace_polygon(mask)
        pieces, corners = len(outline.geoms), shapely.get_num_coordinates(outline)
        good, said = outline.is_valid, "nothing to fill"
        curves: Sequence[Array] = ()
        if not outline.is_empty:
            curves = fill(outline, 6.0).curves
            good &= all(bool(np.isfinite(c).all()) for c in curves)
            said = f"{len(curves)} curves"
        draw = partial(draw_outline, mask=mask, curves=curves)
        yield Line(case.name, case.why, (f"{pieces} pieces, {corners} corners", said), good, draw)


def _light() -> Iterator[Line]:
    for case in wall_cases():
        error, share = wall_shares(case)
        cells = (f"off by {error:.0e} mm", f"{share:.3f}")
        yield Line(case.name, case.why, cells, share <= 1, partial(_draw_wall, case=case))
    for lamp in lamp_cases():
        true, claimed = lamp.true(), lamp.claimed()
        cells = (f"blur {true:.3g} mm", f"{true / claimed:.4f}")
        yield Line(lamp.name, lamp.why, cells, true <= claimed, partial(_draw_lamp, case=lamp))


def _draw_wall(place: Axes, case: WallCase) -> None:
    arcs = np.linspace(-case.reach, case.reach, 65)
    standing, _ = case.wall.stand(np.column_stack([arcs, 0 * arcs]))
    flat = case.wall.flatten(np.column_stack([arcs, 0 * arcs]))[:, 0]
    draw_rays(place, (0.0, case.high), standing[:, ::2], np.column_stack([flat, 0 * flat]))


def _draw_lamp(place: Axes, case: LampCase) -> None:
    side, far, low = float(np.hypot(*case.at[:2])), case.far_mm, case.at[2]
    ends = np.array([[side * (far + 100) / (far - low), -100.0]])
    draw_rays(place, (0.0, far), np.array([[side, low]]), ends, case.lamp_mm)


def _strokes() -> Iterator[Line]:
    for case in stroke_cases():
        found = trace(case)
        cells = (str(len(found.lines)), f"{found.strays:.2f}", f"{found.missed:.1%}")
        draw = partial(draw_outline, mask=case.draw(), curves=found.lines, closed=False)
        yield Line(case.name, case.why, cells, found.good, draw)


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
        made = design_knots(Scene.model_validate(given), [target])
        price = made.binding[0] if made.binding else None
        cells = (
            "every limit holds" if made.result.feasible else "broken",
            f"{made.result.iou_estimate:.3f}",
            " and ".join(price.limits) if price else "-",
            f"{price.iou_without:.3f}" if price else "-",
        )
        draw = partial(draw_shadow, target=target.mask, shadow=_shadow(made, target))
        yield Line(name, why, cells, made.result.feasible and (price is None) == (not parts), draw)


def _shadow(made: Design, target: Target) -> Array:
    """(H, W) the knots' own shadow on the picture's frame."""
    camera = camera_of(made.scene.views[0], target.width, target.height)
    frame = frame_of(camera).tensors(torch.float64)
    shadow = torch.zeros(target.height, target.width, dtype=torch.float64)
    for knot in made.knots.knots:
        p = torch.as_tensor(knot.points)
        one = render(p, p.roll(-1, 0), frame, made.knots.radius_mm, 4.0)
        shadow = torch.maximum(shadow, one)
    return np.asarray(shadow)


GROUPS = {
    "Large images": (("case", "N", "single, px", "share", "CPU s"), _images),
    "Losses": (("case", "condition", "single", "share", "gradient"), _losses),
    "Network": (("case", "condition", "single", "share", "gradient"), _network),
    "Flow": (("case", "steps", "accepted", "would cross", "crossed"), _flow),
    "Geometry": (("case", "size", "error or result"), _geometry),
    "Light": (("case", "size", "share"), _light),
    "Strokes": (("case", "lines", "strays, half widths", "ink missed"), _strokes),
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
