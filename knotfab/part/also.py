"""Files for other tools, on `--also`: centre lines and shadows as drawings, for cutters, plotters and CAD."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from knotfab.files.folder import OutputFolder
from knotfab.files.vectors import write_dxf, write_svg
from knotfab.mount.drawing import shadow_outlines
from knotfab.mount.placement import placement_of
from knotfab.part.assemble import Part
from knotfab.scene.camera import cameras_of
from knotfab.scene.model import ResolvedScene
from knotfab.target.read import Target

__all__ = ["write_also"]

_SHADOW_MM = 0.01  # within which a shadow's outline is a polygon


def write_also(
    folder: OutputFolder,
    part: Part,
    scene: ResolvedScene,
    targets: Sequence[Target],
    also: Collection[str],
    suffix: str = "",
) -> None:
    """Write centre-lines.svg and .dxf and the outlines shadow-NAME.svg, whichever formats `also` names.

    Centre lines are drawn where the first light throws them on its wall, so that they lie in the middle of
    the shadow; the wall is laid flat. Arguments as `write_part` has them.
    """
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
