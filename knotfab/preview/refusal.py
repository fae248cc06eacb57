"""Refuse at once what a search would refuse after minutes, and say what would do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from knotfab.base.errors import SceneError
from knotfab.design.candidates import drawing_radius, line_radius, too_fine
from knotfab.picture.opening import opening_iou
from knotfab.picture.silhouette import trace_polygon
from knotfab.preview.likeness import recognisable_radius
from knotfab_formats.scene import ResolvedScene

if TYPE_CHECKING:
    from knotfab.preview.survey import ViewSurvey

__all__ = ["find_refusal"]

_HOPELESS = 0.45  # IoU that strokes drawn too thick reach, below which no search helps
# a share of strokes as wide as the tube that run together, above which they are no drawing
_BLOBS = 0.3
_FEW = 200  # pieces and holes of a picture whose polygons are opened


def find_refusal(
    views: Sequence[ViewSurvey], scene: ResolvedScene, sequence: bool = False
) -> SceneError | None:
    """Find the error for pictures that no tube draws so that they are known; None where a search may.

    That is a picture that nobody would know in the shadow of any tube, unless that is accepted. And one of
    thin lines: a stroke thinner than the tube is drawn too thick, at an IoU of their ratio. What the
    thinnest tube leaves out is taken to be drawn so.

    """
    if "unrecognisable" not in scene.accuracy.accept:
        for one in views:
            if not one.recognisable:
                return _unlike(one, scene)
    if len(views) > 1 or sequence or scene.piece.tube_radius_mm is not None:
        return None
    printer, (seen,) = scene.printer, views
    thinnest = printer.min_tube_radius_mm
    target, pixels = seen.target, (seen.target.width, seen.target.height)
    radius = thinnest * seen.px_per_mm
    if seen.view.lines:
        if seen.together <= _BLOBS:
            return None
        return too_fine(
            recognisable_radius(target.asked, radius),
            seen.view,
            pixels,
            printer,
            "its lines are too close together for any printable tube: as wide as one of "
            f"{2 * line_radius(seen.view):g} mm, {seen.together:.0%} of them run together",
            otherwise="",
        )
    if opening_iou(seen.polygon, radius) >= _HOPELESS:
        return None
    drawn = drawing_radius(seen.polygon, radius)
    spilled = 0.0 if drawn is None else drawn / radius
    if spilled >= _HOPELESS:
        return None
    return too_fine(
        drawn,
        seen.view,
        pixels,
        printer,
        f"it is too fine for any printable tube: {printer.name} prints none under {2 * thinnest:g} mm",
    )


def _unlike(seen: ViewSurvey, scene: ResolvedScene) -> SceneError:
    """Return the error for a picture that nobody would know in the shadow of a tube."""
    likeness, px, printer = seen.likeness, seen.px_per_mm, scene.printer
    assert likeness is not None
    given, radius = scene.piece.tube_radius_mm is not None, scene.thinnest_mm
    lost = f"which reaches an IoU of about {likeness.iou:.2f}"
    if likeness.changes:
        which = f"{likeness.changes} of its {likeness.features} pieces and holes"
        lost = f"where {which} are lost or run together"
    if likeness.features > _FEW:  # an opening of so many takes seconds, and there are many to try
        drawn = recognisable_radius(seen.target.asked, radius * px)
    else:
        drawn = drawing_radius(trace_polygon(seen.target.asked), radius * px)
    otherwise = "--accept unrecognisable to build it nevertheless"
    if given and drawn is not None and drawn >= printer.min_tube_radius_mm * px:
        otherwise = f"a thinner tube (--tube-radius {drawn / px:.2f}), or {otherwise}"
    return too_fine(
        drawn,
        seen.view,
        (seen.target.width, seen.target.height),
        printer,
        f"it is too fine for {'such a' if given else 'any printable'} tube: nobody would know "
        f"{seen.target.name} in the shadow of one {2 * radius:g} mm thick, {lost}",
        otherwise,
        "parts",
    )
