"""The drawings of a build that is to be printed: how to set the piece up, and where to drill."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from knotfab.files.folder import OutputFolder
from knotfab.mount.drawing import write_setup
from knotfab.mount.drill_template import write_drill_template
from knotfab.part.assemble import Part
from knotfab.scene.camera import Camera
from knotfab.scene.model import ResolvedScene

__all__ = ["write_drawings"]


def write_drawings(
    folder: OutputFolder,
    part: Part,
    scene: ResolvedScene,
    cameras: Sequence[Camera],
    verdict: Mapping[str, Any],
    suffix: str = "",
) -> list[str]:
    """Write setup.pdf, setup.svg and, for dowels, the drill templates; returns their names.

    Args:
        cameras: of all views, on the pixels of their pictures. verdict: the validators', whose views
            say what a misplaced lamp costs. suffix: of the files' names.
    """
    views = verdict.get("views") or [{} for _ in cameras]
    costs = [view.get("misplacement") for view in views]
    names = write_setup(folder.work, part.mounted, scene, cameras, costs, suffix)
    return [*names, *write_drill_template(folder.work, part.mounted, cameras[0], suffix)]
