"""What is said of the views: what the maker knows of their pictures, and what would keep what is lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from knotfab.design.agree import tell_bending
from knotfab.design.design import Design
from knotfab.design.hull import contradictions
from knotfab.picture.read import Target
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import (
    Contrast,
    Recognition,
    Sag,
    View,
)


def list_views(
    views: Sequence[View],
    made: Design,
    targets: Sequence[Target],
    contrasts: Sequence[Contrast | None],
    sags: Sequence[Sag | None],
) -> list[View]:
    """List the validators' views, each with what the maker knows of its picture and measured of its effects.

    That is the rule by which the picture was read, of several views the `bound`, the IoU that no part without
    spill can beat, and the file of what is drawn where that is bent. A part may have no views.
    """
    bounds = {v.name: b.iou for v, b in zip(made.scene.views, made.bounds, strict=False)}
    files = {view.name: view.drawn_picture for view in made.scene.views}
    each = zip(views, targets, contrasts, sags, strict=False)
    return [
        replace(
            view,
            silhouette=target.rule,
            picture_notes=tuple(target.notes) or None,
            bound=bounds.get(view.name),
            drawn=files[view.name] if bounds and view.bending is not None else None,
            contrast=contrast,
            sag=sag,
        )
        for view, target, contrast, sag in each
    ]


def tell_bounds(made: Design, targets: Sequence[Target]) -> list[str]:
    """Return how several pictures were made to agree, and where they contradict each other.

    A design for one view has nothing to tell: nothing contradicts a single picture.
    """
    if not made.bounds:
        return []
    bent = any(target.bending is not None for target in targets)
    said = [f"The pictures are {tell_bending(targets, made.bounds)}."] if bent else []
    return [*said, *contradictions(made.scene.views, made.bounds)]


def advise_widening(verdict: Recognition | None, scene: SettledScene) -> list[str]:
    """Give what to do where thin strokes are lost that could be widened to what the tube draws; nothing else.

    A verdict's loss says how wide it is, and how wide the tube's shadow. A larger picture is not advised: its
    strokes, once they are wider than one tube and not yet as wide as two, are drawn no better.

    Args:
        scene: of the piece, or of a sequence's first frame.
    """
    if verdict is None or verdict.word in ("faithful", "good") or scene.views[0].thicken_mm:
        return []
    thin = [
        loss
        for loss in verdict.lost
        if loss.what in ("piece", "stroke", "text") and 0.0 < loss.size_mm < loss.needed_mm
    ]
    if not thin:
        return []
    least = min(thin, key=lambda loss: loss.size_mm)
    return [
        f"What is lost is as thin as {least.size_mm:.1f} mm, and the tube's shadow is "
        f"{least.needed_mm:.1f} mm wide: --thicken auto widens thin strokes to it."
    ]
