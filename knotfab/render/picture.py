"""The target picture and its frame at the search's own resolution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from knotfab.geometry.polylines import Polylines
from knotfab.render.frame import Frame, frame_of
from knotfab.render.posed_frame import Sheet
from knotfab.render.silhouette import render
from knotfab.scene.camera import Camera, camera_of
from knotfab.scene.model import ResolvedView

__all__ = ["CUTOFF", "ViewImage", "grid_at", "image_at", "iou_of", "picture_at", "seen_in"]

CUTOFF = 5.0  # of a search: sigmoid(-5) = 0.7 %, what is further out pulls on nothing


@dataclass(frozen=True)
class ViewImage:
    """One view's picture at the resolution of a phase: `target` [H, W] is the coverage of `frame`."""

    frame: Frame
    target: torch.Tensor
    sheet: Sheet  # the raster, for a pose that is an unknown
    radius_px: float  # projected tube radius

    def iou(self, points: NDArray[np.float64], rings: Polylines, radius: float) -> float:
        """IoU of the tube's hard silhouette about points (N, 3) with the target's; `radius` in mm."""
        return iou_of(points, rings, self.frame, self.target, radius)


def image_at(
    view: ResolvedView, mask: NDArray[np.bool_], radius: float, pixels: int, device: str = "cpu"
) -> ViewImage:
    """The picture of a view with `pixels` on the longer side; `radius` of the tube in mm."""
    frame, target, pixel_mm = picture_at(view, mask, pixels, device)
    sheet = Sheet(frame.width, frame.height, pixel_mm, view.wall_tilt_deg)
    return ViewImage(frame, target, sheet, radius * view.magnification / pixel_mm)


def picture_at(
    view: ResolvedView, mask: NDArray[np.bool_], pixels: int, device: str = "cpu"
) -> tuple[Frame, torch.Tensor, float]:
    """(frame, target, pixel in mm) with square pixels, `pixels` on the longer side, and a margin.

    The target is the exact share of each pixel that the mask covers. Pixels need not fit the frame's
    sides a whole number of times: the margin takes up the rest.
    """
    width_mm, height_mm = view.frame_mm
    pixel = view.longer_mm / pixels
    margin = max(6, pixels // 16)
    width, height = (max(1, round(side / pixel)) + 2 * margin for side in (width_mm, height_mm))
    exact = view.model_copy(
        update={"frame_width_mm": width * pixel, "frame_height_mm": height * pixel}
    )
    frame = frame_of(camera_of(exact, width, height), torch.float32, device)
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
    view: ResolvedView, mask: NDArray[np.bool_], cell_mm: float, margin: float, more: int = 0
) -> tuple[NDArray[np.bool_], Camera]:
    """The mask looked up on about square cells, and the camera whose pixels they are.

    Args:
        margin: of the frame on each side, all outside the mask, and `more` cells beyond.
    """
    width_mm, height_mm = view.frame_mm
    rows, columns = mask.shape
    w, h = max(8, round(width_mm / cell_mm)), max(8, round(height_mm / cell_mm))
    u = np.minimum(((np.arange(w) + 0.5) / w * columns).astype(int), columns - 1)
    v = np.minimum(((np.arange(h) + 0.5) / h * rows).astype(int), rows - 1)
    pad_u, pad_v = int(margin * w) + more, int(margin * h) + more
    wanted = np.pad(mask[np.ix_(v, u)], ((pad_v, pad_v), (pad_u, pad_u)))
    return wanted, camera_of(view, w, h).padded(pad_u, pad_v)


def seen_in(
    points: NDArray[np.float64], rings: Polylines, frame: Frame, target: torch.Tensor, radius: float
) -> torch.Tensor:
    """[H, W] bool the tube's hard silhouette about points (N, 3), of the target's type and device."""
    p = torch.as_tensor(points, dtype=target.dtype, device=target.device)
    q = p[torch.as_tensor(rings.next, device=target.device)]
    with torch.no_grad():
        return render(p, q, frame, radius, 10.0, CUTOFF) > 0.5


def iou_of(
    points: NDArray[np.float64], rings: Polylines, frame: Frame, target: torch.Tensor, radius: float
) -> float:
    """IoU of the tube's hard silhouette with the target's, both at half coverage."""
    seen = seen_in(points, rings, frame, target, radius)
    wanted = target > 0.5
    union = (seen | wanted).sum()
    return float((seen & wanted).sum() / union) if union > 0 else 1.0
