"""Tell for the report how pictures and their visual hull agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from knotfab.design.agree import tell_bending
from knotfab.design.contradictions import contradictions
from knotfab.design.design import Design
from knotfab.picture.read import Target

__all__ = ["list_views", "tell_bounds"]


def list_views(
    views: Sequence[Mapping[str, Any]], made: Design, targets: Sequence[Target]
) -> list[dict[str, Any]]:
    """The validators' records of the views, each with what the maker knows of its picture.

    That is the rule by which it was read, of several views the `bound`, the IoU that no part without spill
    can beat, and the file of what is drawn where that is bent. A part may have no views.
    """
    bounds = {v.name: b.iou for v, b in zip(made.scene.views, made.bounds, strict=False)}
    files = {view.name: view.drawn_picture for view in made.scene.views}
    found = []
    for view, target in zip(views, targets, strict=False):
        told: dict[str, Any] = {**view, "silhouette": target.rule}
        if target.notes:
            told["picture_notes"] = list(target.notes)
        if bounds:
            told["bound"] = bounds[view["name"]]
            if "bending" in view:
                told["drawn"] = files[view["name"]]
        found.append(told)
    return found


def tell_bounds(made: Design, targets: Sequence[Target]) -> list[str]:
    """Tell how several pictures were made to agree, and where they contradict each other.

    A design for one view has nothing to tell: nothing contradicts a single picture.
    """
    if not made.bounds:
        return []
    bent = any(target.bending is not None for target in targets)
    said = [f"The pictures are {tell_bending(targets, made.bounds)}."] if bent else []
    return [*said, *contradictions(made.scene.views, made.bounds)]
