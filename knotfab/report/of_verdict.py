"""Tell in the report how a shadow's losses could be kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from knotfab_formats.scene import ResolvedScene

__all__ = ["advise_widening"]

_WELL = ("faithful", "good")
_STROKES = ("piece", "stroke", "text")


def advise_widening(verdict: Mapping[str, Any] | None, scene: ResolvedScene) -> list[str]:
    """Advise to widen thin strokes that are lost and could be drawn so; nothing else.

    A verdict's loss says how wide it is, and how wide the tube's shadow. A larger picture is not advised: its
    strokes, once they are wider than one tube and not yet as wide as two, are drawn no better.

    Args:
        scene: scene of the piece, or of a sequence's first frame.
    """
    if not verdict or verdict["word"] in _WELL or scene.views[0].thicken_mm != "none":
        return []
    thin = [
        loss
        for loss in verdict["lost"]
        if loss["what"] in _STROKES and 0.0 < loss["size_mm"] < loss["needed_mm"]
    ]
    if not thin:
        return []
    least = min(thin, key=lambda loss: float(loss["size_mm"]))
    return [
        f"What is lost is as thin as {least['size_mm']:.1f} mm, and the tube's shadow is "
        f"{least['needed_mm']:.1f} mm wide: --thicken auto widens thin strokes to it."
    ]
