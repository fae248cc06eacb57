"""Files for other tools, on `--also`: centre lines and shadows as drawings, for cutters, plotters and CAD."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from knotfab.files.folder import OutputFolder
from knotfab.files.vectors import write_dxf, write_svg
from knotfab.geometry.tube import sweep
from knotfab.mount.drawing import shadow_outlines
from knotfab.mount.modeller import ask
from knotfab.mount.placement import placement_of
from knotfab.part.assemble import Part
from knotfab.picture.read import Target
from knotfab.scene.camera import Camera, cameras_of
from knotfab_fixtures.step import write_centre_lines, write_solids
from knotfab_formats.scene import SettledScene

__all__ = ["write_also"]

_SIDES, _FEWEST_SIDES = 12, 6  # a faceted tube has between these
# a faceted tube has no more where fewer sides allow: to write each takes .4 ms
_FACETS, _MOST_FACETS = 24_000, 60_000
_SHADOW_MM = 0.01  # within which a shadow's outline is a polygon


def write_also(
    folder: OutputFolder,
    part: Part,
    scene: SettledScene,
    targets: Sequence[Target],
    also: Collection[str],
    suffix: str = "",
) -> tuple[str, ...]:
    """Write centre-lines.svg and .dxf, the outlines shadow-NAME.svg, and part.step and centre-lines.step.

    Which of them: the formats that `also` names. Those of STEP lie as part.stl does.

    Centre lines are drawn where the first light throws them on its wall, so that they lie in the middle of
    the shadow; the wall is laid flat. Arguments as `write_part` has them.

    Returns:
        Sentences for the report.
    """
    if not also:
        return ()
    assert scene.pose is not None
    cameras = cameras_of(scene.views, targets)
    places = [placement_of(part.mounted, c, v) for c, v in zip(cameras, scene.views, strict=True)]
    knots = part.pose.knots.moved(np.array(scene.pose.matrix)).knots
    lines = {f"knot-{n}": [places[0].cast(k.points)] for n, k in enumerate(knots, start=1)}
    frame = places[0].frame_mm
    if "dxf" in also:
        write_dxf(folder.file(f"centre-lines{suffix}.dxf"), lines, frame)
    if "svg" in also:
        title = f"centre lines as the light of {scene.views[0].name} throws them"
        write_svg(folder.file(f"centre-lines{suffix}.svg"), lines, frame, title)
        for view, place in zip(scene.views, places, strict=True):
            outlines = {"shadow": shadow_outlines(part.mounted, place, _SHADOW_MM)}
            path = folder.file(f"shadow-{view.name}.svg")
            write_svg(path, outlines, place.frame_mm, f"shadow of {view.name}", filled=True)
    return _write_step(folder, part, cameras[0], suffix) if "step" in also else ()


def _write_step(folder: OutputFolder, part: Part, camera: Camera, suffix: str) -> tuple[str, ...]:
    """Tubes that no smooth solid stands for are written as facets, and told."""
    knots = part.pose.knots
    lines = {f"knot {n}": k.points for n, k in enumerate(knots.knots, start=1)}
    ask(
        write_centre_lines,
        str(folder.file(f"centre-lines{suffix}.step")),
        {name: points.tolist() for name, points in lines.items()},
    )
    fixtures: dict[str, Any] = {}
    for one in part.mounted.fixtures(camera):
        number = sum(name.startswith(one.kind) for name in fixtures) + 1
        fixtures[f"{one.kind} {number}"] = one.to_dict()
    to_part = np.linalg.inv(part.pose.matrix).tolist()
    tubes: dict[str, Any] = {
        name: {"points": points.tolist(), "radius_mm": knots.radius_mm}
        for name, points in lines.items()
    }
    path = str(folder.file(f"part{suffix}.step"))
    failed = ask(write_solids, path, tubes, fixtures, to_part)
    if not failed:
        return ()
    told = []
    for name in failed:
        sides = _count_sides(len(lines[name]))
        if sides == 0:
            del tubes[name]
            why = "and has too many vertices for one of facets: take part.stl."
            told.append(
                f"{Path(path).name} lacks the tube of {name}: it bends too tightly for a smooth solid, {why}"
            )
            continue
        vertices, faces = sweep(lines[name], knots.radius_mm, sides)
        tubes[name] = {"vertices": vertices.tolist(), "faces": faces.tolist()}
        told.append(
            f"{Path(path).name} holds the tube of {name} as a solid of facets, {sides} about it: it bends "
            "too tightly for a smooth one."
        )
    if tubes or fixtures:
        ask(write_solids, path, tubes, fixtures, to_part)
    return tuple(told)


def _count_sides(vertices: int) -> int:
    """Count the facets about a tube of so many vertices; 0: it would have too many in all."""
    if 2 * _FEWEST_SIDES * vertices > _MOST_FACETS:
        return 0
    fit = _FACETS // (4 * vertices) * 2
    return min(_SIDES, max(_FEWEST_SIDES, fit))
