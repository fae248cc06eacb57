"""Wall: a cylinder, a column, a lampshade or a round room, is not the flat wall that touches it."""

from __future__ import annotations

from knotfab.effects.base import Effect, EffectContext
from knotfab.scene.curved_wall import CurvedWall

__all__ = ["WALL"]


def magnitude(context: EffectContext) -> float:
    """Measure how far the picture on a flat wall would lie from that on the round one, px."""
    walls = [(view, CurvedWall.of(view)) for view in context.views]
    return max(
        (w.off_mm / view.pixel_mm for view, w in walls if w is not None),
        default=0.0,
    )


WALL = Effect(
    "wall",
    "px",
    magnitude,
    1.0,  # no more than a search leaves anyway
    "the wall is round, and takes the picture to where a flat one would have it",
)
