"""All geometric checks that the given files allow, with what each group cost."""

from __future__ import annotations

import time
from dataclasses import replace

from .check import Check, at_least, skipped
from .knot_type import check_knot_type
from .mesh_check import NAMES as MESH_CHECKS
from .mesh_check import check_mesh
from .read_knots import Curves
from .read_mesh import Mesh
from .read_scene import Scene
from .region import check_build_volume, check_region
from .thickness import check_bend, check_length, check_thickness, thickness
from .tube_fit import check_tube

__all__ = ["part_checks"]


def part_checks(
    mesh: Mesh | None, curves: Curves | None, scene: Scene | None, seconds: dict[str, float]
) -> list[Check]:
    """Mesh, tube, thickness, bend, length, knot type, region and build volume.

    The thickness must reach the tube's radius, and with a scene half its clearance more; where no
    radius is known it is measured only. A check whose file is not given is skipped, and says so.
    Adds the seconds of each group to `seconds`.
    """
    checks: list[Check] = []
    if mesh is None:
        checks += [skipped(name, "not given the part") for name in (*MESH_CHECKS, "tube")]
    else:
        with _Clock(seconds, "mesh"):
            checks += check_mesh(mesh, curves)
        with _Clock(seconds, "tube"):
            checks.append(check_tube(mesh, curves))
    if curves is None:
        names = ("thickness", "bend", "length", "knot_type")
        checks += [skipped(name, "not given the knots") for name in names]
    else:
        with _Clock(seconds, "thickness"):
            checks += _of_curves(curves, scene)
        with _Clock(seconds, "knot type"):
            kind = check_knot_type(curves)
        # a part is built of unlinked unknots; curves alone are asked for their thickness
        checks.append(kind if mesh is not None else replace(kind, required=False))
    if scene is None:
        checks += [skipped(name, "not given the scene") for name in ("region", "build_volume")]
        return checks
    with _Clock(seconds, "region"):
        checks.append(check_region(scene.region, scene.pose, curves, mesh))
        if mesh is None:
            checks.append(skipped("build_volume", "not given the part"))
        else:
            room = scene.printer.build_volume_mm
            lacking = "the scene names a printer without its build_volume_mm"
            checks.append(
                skipped("build_volume", lacking) if room is None else check_build_volume(mesh, room)
            )
    return checks


def _of_curves(curves: Curves, scene: Scene | None) -> list[Check]:
    """Thickness, bend and length."""
    radius = curves.radius_mm
    if radius is None and scene is not None:
        radius = scene.piece.tube_radius_mm
    clearance = scene.piece.clearance_mm if scene is not None else 0.0
    required = None if radius is None else radius + clearance / 2
    if required is None:
        value = thickness(curves.polygons, curves.closed).value
        detail = "polygonal thickness (Rawdon), as a radius; no radius is given to compare it with"
        checks = [at_least("thickness", value, None, "mm", detail)]
    else:
        checks = [check_thickness(curves, required)]
    if scene is None:
        return checks + [skipped(name, "not given the scene") for name in ("bend", "length")]
    bend = scene.material.min_bend_radius_mm
    if bend is None:
        bend = required
    if bend is None:
        checks.append(skipped("bend", "neither a bend radius nor the tube's radius is given"))
    else:
        checks.append(check_bend(curves, bend))
    return [*checks, check_length(curves, scene.material.max_length_mm)]


class _Clock:
    """Adds the time spent inside to `seconds[group]`."""

    def __init__(self, seconds: dict[str, float], group: str) -> None:
        self.seconds, self.group = seconds, group

    def __enter__(self) -> None:
        self.start = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        spent = time.perf_counter() - self.start
        self.seconds[self.group] = self.seconds.get(self.group, 0.0) + spent
