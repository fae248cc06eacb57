"""Check that the frame is large enough for a wire to draw the picture, or say how large it must be."""

from __future__ import annotations

from dataclasses import dataclass

from knotfab.base.arrays import Mask
from knotfab.picture.opening import opening_iou, thickest_radius
from knotfab.picture.silhouette import trace_polygon
from knotfab_formats.scene import Material, ResolvedView
from knotfab_formats.verdict import Check

__all__ = ["WireFrame", "measure_frame"]


ENOUGH_IOU = 0.95  # the IoU of the picture and the best that strands as thick as the wire can fill
LARGEST = 64.0  # frames beyond which no width is sought


@dataclass(frozen=True)
class WireFrame:
    """The part of one view's picture that a wire can draw in its frame.

    `width_mm` of the frame; `most_iou` of the picture and its morphological opening by the wire's
    shadow; `enough_mm` the least width in which that is `ENOUGH_IOU`; None where none would do.
    """

    view: str
    width_mm: float
    most_iou: float
    enough_mm: float | None

    def check(self, material: Material) -> Check:
        """`wire_frame`; not required, since the picture's own floor is."""
        from knotfab_validators.check import at_least

        wide = f"a frame {self.width_mm:g} mm wide"
        text = (
            f"IoU of the picture and what strands {material.wire_diameter_mm:g} mm thick can fill of "
            f"it in {wide} (view {self.view})"
        )
        if self.most_iou < ENOUGH_IOU:
            text += ": too small for this wire"
            if self.enough_mm is not None:
                text += f"; {self.enough_mm:.0f} mm and more would do"
        return at_least("wire_frame", self.most_iou, ENOUGH_IOU, "", text, required=False)


def measure_frame(mask: Mask, view: ResolvedView, material: Material) -> WireFrame:
    """Measure how much of the silhouette strands as thick as the wire can fill at most.

    Where a stroke of the picture is thinner than the wire's shadow no strand can lie in it: the
    opening of the silhouette by half that shadow is what is left. A frame s times as wide is a
    wire s times as thin.

    Args:
        mask: (H, W) the picture's silhouette.
    """
    polygon = trace_polygon(mask)
    shadow = 0.5 * material.wire_diameter_mm * view.px_per_mm(mask.shape[1])
    drawn = thickest_radius(polygon, ENOUGH_IOU, shadow / LARGEST, shadow * LARGEST)
    enough = None if drawn is None else view.frame_width_mm * shadow / drawn
    return WireFrame(view.name, view.frame_width_mm, opening_iou(polygon, shadow), enough)
