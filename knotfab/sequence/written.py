"""A frame's knot read back from its written file, in scene coordinates."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotfab.scene.model import Scene

__all__ = ["read_knot_in_scene"]


def read_knot_in_scene(path: Path, scene: Scene) -> NDArray[np.float64]:
    """(n, 3) mm: the vertices of the one knot in knots.json, moved by the scene's pose.

    Raises:
        ValueError: the file holds more knots than one, or the scene no pose.
    """
    knots = json.loads(path.read_text(encoding="utf-8"))["knots"]
    if len(knots) != 1 or scene.pose is None:
        raise ValueError(f"{path.name}: one knot and a pose are needed")
    matrix = np.array(scene.pose.matrix, dtype=np.float64)
    return np.asarray(np.array(knots[0]["points"]) @ matrix[:3, :3].T + matrix[:3, 3])
