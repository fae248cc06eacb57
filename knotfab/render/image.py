"""A view's picture and frame at the resolution of a search phase."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab.base.apps import load_app
from knotfab.base.arrays import Array, Mask
from knotfab.geometry.polylines import Polylines
from knotfab.picture.silhouette import mask_iou, resample_mask, sample_mask
from knotfab.render import silhouette
from knotfab.render.silhouette import DrawnImage, Frame, Sheet, frame_of
from knotfab.scene.camera import Camera, camera_of
from knotfab_formats.scene import ResolvedView
from knotfab_formats.search import Precision, Renderer

CUTOFF = 5.0  # a search's: sigmoid(-5) = 0.7 %, and a pixel further out pulls on nothing
_KINDS: dict[Precision, type[np.floating[Any]]] = {"single": np.float32, "double": np.float64}
_HARD = 10.0  # per px: so sharp that half a pixel off an outline is empty


@dataclass(frozen=True)
class ViewImage:
    """One view's picture at the resolution of a phase: `target` (H, W) is the coverage of `frame`.

    Compiled loops draw it, by ray distance; torch draws it by the paper's renderers.
    """

    frame: Frame
    target: NDArray[np.floating[Any]]  # the precision that pictures are drawn in
    sheet: Sheet  # the raster, for a pose that is an unknown
    radius_px: float  # projected tube radius
    renderer: Renderer = "ray"

    @cached_property
    def _drawn(self) -> DrawnImage | None:
        if self.renderer == "ray":
            return None
        drawn: DrawnImage = load_app("outlines").draw_outlines(
            self.frame, self.target, self.renderer
        )
        return drawn

    def from_frame(self, frame: Frame) -> ViewImage:
        """Return the same picture seen from another frame."""
        moved = replace(self, frame=frame)
        if self._drawn is not None:
            # a cached property keeps it so
            moved.__dict__["_drawn"] = self._drawn.from_frame(frame)
        return moved

    def squared_error(
        self, points: Array, rings: Polylines, radius: float, tau: float, won: Any = None
    ) -> tuple[float, Array]:
        """Return `silhouette.squared_error` of the tube about vertices (N, 3), and its gradient there."""
        p = points.astype(self.target.dtype)
        if self._drawn is not None:
            return self._drawn.squared_error(p, rings, radius, tau, CUTOFF, won)
        given = (self.frame, radius, tau, self.target, CUTOFF, won)
        total, one, two = silhouette.squared_error(p, p[rings.next], *given)
        return total, one + two[rings.previous]

    def find_winners(self, points: Array, rings: Polylines, radius: float, tau: float) -> Any:
        """Find the capsule that colours each pixel, for calls of `squared_error` after small motions."""
        p = points.astype(self.target.dtype)
        if self._drawn is not None:
            return self._drawn.find_winners(p, rings, radius, CUTOFF / tau)
        return silhouette.winners(p, p[rings.next], self.frame, radius, CUTOFF / tau)

    def seen(self, points: Array, rings: Polylines, radius: float) -> Mask:
        """Return the hard silhouette, at half coverage, of the tube about vertices (N, 3), mm, (H, W)."""
        if self._drawn is not None:
            p = points.astype(self.target.dtype)
            return self._drawn.render(p, rings, radius, _HARD, CUTOFF) > 0.5
        return silhouette.cast(points, points[rings.next], self.frame, radius)

    def iou(self, points: Array, rings: Polylines, radius: float) -> float:
        """Return the IoU of the tube's hard silhouette with the target's; `radius` in mm."""
        return mask_iou(self.seen(points, rings, radius), self.target > 0.5)


def image_at(
    view: ResolvedView,
    mask: Mask,
    radius: float,
    pixels: int,
    precision: Precision = "single",
    renderer: Renderer = "ray",
    ends: bool = False,
) -> ViewImage:
    """Return a view's picture, `pixels` on its longer side, for a tube of `radius` mm.

    With `ends` the screen ends at the frame, and shadows beside it do not count.
    """
    frame, target, pixel_mm = _picture_at(view, mask, pixels, precision, ends)
    sheet = Sheet(frame.width, frame.height, pixel_mm, view.wall_tilt_deg)
    radius_px = radius * view.magnification / pixel_mm
    return ViewImage(frame, target, sheet, radius_px, renderer)


def _picture_at(
    view: ResolvedView, mask: Mask, pixels: int, precision: Precision, ends: bool
) -> tuple[Frame, NDArray[np.floating[Any]], float]:
    """Return frame, target and pixel size, mm, for `pixels` on the longer side; margins unless `ends`.

    The target is the exact share of each pixel that the mask covers. Pixels need not fit the frame's
    sides a whole number of times: the margin takes up the rest.
    """
    width_mm, height_mm = view.frame_mm
    pixel = view.longer_mm / pixels
    margin = 0 if ends else max(6, pixels // 16)
    width, height = (max(1, round(side / pixel)) + 2 * margin for side in (width_mm, height_mm))
    frame = frame_at(view, Sheet(width, height, pixel), precision)
    rows, columns = mask.shape
    # wide and high are the grown frame's, in the mask's own pixels
    wide, high = width * pixel / width_mm * columns, height * pixel / height_mm * rows
    left, top = 0.5 * (columns - wide), 0.5 * (rows - high)
    coverage = resample_mask(mask, width, height, (left, top, left + wide, top + high))
    return frame, coverage.astype(_KINDS[precision]), pixel


def frame_at(view: ResolvedView, sheet: Sheet, precision: Precision = "single") -> Frame:
    """Return the frame of a view for a sheet's raster, centred where the view's frame is."""
    sides = {
        "frame_width_mm": sheet.width * sheet.pixel_mm,
        "frame_height_mm": sheet.height * sheet.pixel_mm,
    }
    exact = view.but(**sides)
    return frame_of(camera_of(exact, sheet.width, sheet.height), _KINDS[precision])


def grid_at(
    view: ResolvedView,
    mask: Mask,
    cell_mm: float,
    margin: float,
    more: int = 0,
    beside: bool = False,
) -> tuple[Mask, Camera]:
    """Sample the mask on nearly square cells; return it with the camera that has them as pixels.

    Args:
        margin: margin of the frame on each side, and `more` cells beyond: all outside the mask, or inside it
            where `beside` is true.
    """
    width_mm, height_mm = view.frame_mm
    w, h = max(8, round(width_mm / cell_mm)), max(8, round(height_mm / cell_mm))
    pad_u, pad_v = int(margin * w) + more, int(margin * h) + more
    around = ((pad_v, pad_v), (pad_u, pad_u))
    wanted = np.pad(sample_mask(mask, w, h), around, constant_values=beside)
    return wanted, camera_of(view, w, h).padded(pad_u, pad_v)
