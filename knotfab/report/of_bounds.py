"""What the visual hull says of several views, for the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from knotfab.design.agree import tell_bending
from knotfab.design.contradictions import contradictions
from knotfab.design.design import Design
from knotfab.picture.read import Target

__all__ = ["add_bounds"]


def add_bounds(report: dict[str, Any], made: Design, targets: Sequence[Target]) -> None:
    """Add each view's `bound`, the IoU that no part without spill can beat, and its contradictions.

    A design for one view has none: nothing contradicts a single picture.
    """
    if not made.bounds:
        return
    by_name = {view.name: bound for view, bound in zip(made.scene.views, made.bounds, strict=True)}
    files = {view.name: view.drawn_picture for view in made.scene.views}
    for view in report["views"]:
        view["bound"] = by_name[view["name"]].iou
        if "bending" in view:
            view["drawn"] = files[view["name"]]
    report["settings"]["start_ious"] = list(made.start_ious)
    notes = report.setdefault("notes", [])
    if any(target.bending is not None for target in targets):
        notes.append(f"The pictures are {tell_bending(targets, made.bounds)}.")
    notes.extend(contradictions(made.scene.views, made.bounds))
