"""The target picture and its frame at the search's own resolution."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from knotfab.render.frame import Frame, frame_of
from knotfab.scene.camera import Camera, camera_of
from knotfab.scene.model import View

__all__ = ["frame_mm", "grid_at", "picture_at"]


def frame_mm(view: View) -> tuple[float, float]:
    """Width and height of a resolved view's frame."""
    assert view.frame_width_mm is not None and view.frame_height_mm is not None
    return view.frame_width_mm, view.frame_height_mm


def picture_at(
    view: View, mask: NDArray[np.bool_], pixels: int, perspective: bool, device: str
) -> tuple[Frame, torch.Tensor, float]:
    """(frame, target, pixel in mm) with square pixels, `pixels` on the longer side, and a margin.

    The target is the exact share of each pixel that the mask covers. Pixels need not fit the frame's
    sides a whole number of times: the margin takes up the rest.
    """
    width_mm, height_mm = frame_mm(view)
    pixel = max(width_mm, height_mm) / pixels
    margin = max(6, pixels // 16)
    width, height = (max(1, round(side / pixel)) + 2 * margin for side in (width_mm, height_mm))
    exact = view.model_copy(
        update={"frame_width_mm": width * pixel, "frame_height_mm": height * pixel}
    )
    frame = frame_of(camera_of(exact, width, height), torch.float32, device)
    if not perspective:
        frame = replace(frame, flat_depth=view.light_distance_mm)
    rows, columns = mask.shape
    # the grown frame in the mask's own pixels, and the mask padded to hold it
    wide, high = width * pixel / width_mm * columns, height * pixel / height_mm * rows
    left, top = 0.5 * (columns - wide), 0.5 * (rows - high)
    pad_u, pad_v = int(np.ceil(-left)) + 1, int(np.ceil(-top)) + 1
    padded = np.pad(mask.astype(np.float32), ((pad_v, pad_v), (pad_u, pad_u)))
    box = (left + pad_u, top + pad_v, left + pad_u + wide, top + pad_v + high)
    coverage = Image.fromarray(padded).resize((width, height), Image.Resampling.BOX, box=box)
    target = torch.as_tensor(np.array(coverage), dtype=torch.float32, device=device)
    return frame, target, pixel


def grid_at(
    view: View, mask: NDArray[np.bool_], cell_mm: float, margin: float, more: int = 0
) -> tuple[NDArray[np.bool_], Camera]:
    """The mask looked up on about square cells, and the camera whose pixels they are.

    Args:
        margin: of the frame on each side, all outside the mask, and `more` cells beyond.
    """
    width_mm, height_mm = frame_mm(view)
    rows, columns = mask.shape
    w, h = max(8, round(width_mm / cell_mm)), max(8, round(height_mm / cell_mm))
    u = np.minimum(((np.arange(w) + 0.5) / w * columns).astype(int), columns - 1)
    v = np.minimum(((np.arange(h) + 0.5) / h * rows).astype(int), rows - 1)
    pad_u, pad_v = int(margin * w) + more, int(margin * h) + more
    wanted = np.pad(mask[np.ix_(v, u)], ((pad_v, pad_v), (pad_u, pad_u)))
    return wanted, camera_of(view, w, h).padded(pad_u, pad_v)
