"""Say where the pictures of several views contradict each other, before anything is searched."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from knotfab.design.hull import HullBound
from knotfab_formats.scene import View

__all__ = ["WORTH_SAYING", "contradictions"]

WORTH_SAYING = 0.97  # a bound below this is told


def contradictions(views: Sequence[View], bounds: Sequence[HullBound]) -> list[str]:
    """A sentence for each view whose bound is low: how low, and where most is missing."""
    lines = []
    for view, bound in zip(views, bounds, strict=True):
        if bound.iou >= WORTH_SAYING:
            continue
        missing = bound.wanted & ~bound.covered
        share = missing.sum() / max(1, bound.wanted.sum())
        rows, columns = np.nonzero(missing)
        height, width = missing.shape
        up = "top" if rows.mean() < height / 3 else "bottom" if rows.mean() > 2 * height / 3 else ""
        side = "left" if columns.mean() < width / 3 else ""
        side = "right" if columns.mean() > 2 * width / 3 else side
        where = " ".join(word for word in (up, side) if word) or "middle"
        line = (
            f"view {view.name}: the other pictures leave no room for {share:.1%} of its silhouette, "
            f"most of it at the {where}: its IoU can be {bound.iou:.3f} at best without spilling elsewhere"
        )
        if bound.iou < 0.9:
            line += ". Use pictures whose silhouettes fill the same heights, or other azimuths"
        lines.append(line)
    return lines
