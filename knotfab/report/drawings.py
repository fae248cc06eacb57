"""The drawings of a build that is to be printed: how to set the piece up, and where to drill."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from knotfab.files.folder import OutputFolder
from knotfab.mount.drawing import write_setup
from knotfab.mount.drill_template import write_drill_template
from knotfab.part.assemble import Part
from knotfab.scene.camera import camera_of
from knotfab.scene.model import ResolvedScene
from knotfab.target.read import Target

__all__ = ["write_drawings"]


def write_drawings(
    folder: OutputFolder,
    part: Part,
    scene: ResolvedScene,
    target: Target,
    verdict: Mapping[str, Any],
) -> list[str]:
    """Write setup.pdf, setup.svg and, for dowels, the drill templates; returns their names.

    Args:
        verdict: the validators', whose first view says what a misplaced lamp costs.
    """
    camera = camera_of(scene.views[0], target.width, target.height)
    views = verdict.get("views") or [{}]
    names = write_setup(folder.work, part.mounted, scene, camera, views[0].get("misplacement"))
    return [*names, *write_drill_template(folder.work, part.mounted, camera)]
