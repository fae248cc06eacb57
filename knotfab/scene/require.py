"""What a scene cannot ask for, whoever reads it."""

from __future__ import annotations

from knotfab.errors import InputError
from knotfab.scene.model import Scene

__all__ = ["require_mount"]


def require_mount(scene: Scene) -> None:
    """Refuse a mount that cannot be, before any work is done.

    Raises:
        InputError: a wall mount of a piece with several views.
    """
    if scene.mount.kind == "wall" and len(scene.views) > 1:
        raise InputError(
            "a wall mount (--mount wall)",
            f"this piece has {len(scene.views)} views: pegs that run along one light's rays stand in the "
            "picture of the other",
            "Use --mount stand, whose base lies below all pictures",
        )
