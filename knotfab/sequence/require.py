"""Refuse what a sequence cannot have before any work is done."""

from __future__ import annotations

from knotfab.base.errors import InputError
from knotfab_formats.scene import ResolvedScene

__all__ = ["require_sequence"]


def require_sequence(scene: ResolvedScene) -> None:
    """Refuse what makes no sense for a sequence, or is not there for it.

    Raises:
        InputError: naming the key and what to do.
    """
    if len(scene.views) != 1:
        raise InputError(
            "the scene",
            f"it has {len(scene.views)} views, and a sequence is seen from one side",
            "Leave one [[views]] in it, or leave out --sequence",
        )
    if scene.views[0].wall_radius_mm is not None:
        raise InputError(
            "scene key views.wall_radius_mm",
            "frames of a sequence are registered to each other on a flat wall",
            "Leave it out, or leave out --sequence",
        )
    if scene.views[0].cut_out:
        raise InputError(
            "--subject",
            "a rectangle is about the subject of one picture, not of all frames",
            "Cut the frames out beforehand, or leave out --sequence",
        )
    if scene.material.shrinkage_percent:
        raise InputError(
            "scene key material.shrinkage_percent",
            "the frames on their ring are written as they are to be",
            "Leave it out and scale by the slicer, or leave out --sequence",
        )
    if scene.settings.start:
        raise InputError(
            "a start (--start)",
            "a sequence begins with a template of its first frame",
            "Leave it out, or leave out --sequence",
        )
