"""What a search is asked for one of the project's own pictures, and what it drew of it."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from examples.pictures import pictures
from knotfab.design.question import Question, ask
from knotfab.geometry.polylines import Rings
from knotfab.render.picture import CUTOFF, ViewImage
from knotfab.render.tiled import render_tiled
from knotfab.scene.model import Scene
from knotfab.target.read import read_target

__all__ = ["ask_picture", "cast_shadow"]


def ask_picture(picture: str | Image.Image) -> Question:
    """The question of the default scene: for one of the pictures by its name, or for another image."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        (pictures()[picture] if isinstance(picture, str) else picture).save(path)
        return ask(Scene(), [read_target(path)])


def cast_shadow(
    points: NDArray[np.float64], rings: Rings, radius: float, image: ViewImage
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(shadow, target) of a tube about vertices (N, 3), as masks (H, W); the tube's radius in mm."""
    p = torch.as_tensor(points, dtype=image.target.dtype)
    with torch.no_grad():
        cast = render_tiled(p, p[torch.as_tensor(rings.next)], image.frame, radius, 10.0, CUTOFF)
    return (cast > 0.5).numpy(), (image.target > 0.5).numpy()
