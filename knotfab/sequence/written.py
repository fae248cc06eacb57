"""A frame's knots read back from its written file, in scene coordinates."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotfab.scene.model import Scene

__all__ = ["read_knots_in_scene"]


def read_knots_in_scene(path: Path, scene: Scene) -> NDArray[np.float64]:
    """(n, 3) mm: the vertices of all knots in knots.json, in their order, moved by the scene's pose.

    Raises:
        ValueError: the scene has no pose.
    """
    knots = json.loads(path.read_text(encoding="utf-8"))["knots"]
    if scene.pose is None:
        raise ValueError(f"{path.name}: a pose is needed")
    matrix = np.array(scene.pose.matrix, dtype=np.float64)
    return np.asarray(
        np.concatenate([knot["points"] for knot in knots]) @ matrix[:3, :3].T + matrix[:3, 3]
    )
