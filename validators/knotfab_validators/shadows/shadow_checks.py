"""The checks that follow from verified views: `shadow`, `shadow_exact`, `outline`, `wrong_outline`."""

from __future__ import annotations

from collections.abc import Mapping

from knotfab_formats.checks import SHADOWS
from knotfab_validators.arrays import Array
from knotfab_validators.check import Check, at_least, at_most, skip_check
from knotfab_validators.shadows.outline_stretch import WRONG_PX
from knotfab_validators.shadows.verify_view import VerifiedView

__all__ = ["shadow_checks", "skip_shadow_checks"]

# a share of the frame, darkened by a mount whose pegs hide in the tube's shadow
MOST_INTRUSION = 0.001


def skip_shadow_checks(why: str, *, required: bool) -> list[Check]:
    """Return all of them, skipped for one reason."""
    return [skip_check(name, why, required=required) for name in SHADOWS]


def shadow_checks(
    views: Mapping[str, VerifiedView],
    vertices: Array,
    *,
    iou_floor: float | None,
    max_outline_px: float,
    no_rendering: str | None,
    polygons_decide: bool,
    mount: str = "none",
    changed: Mapping[str, str] | None = None,
) -> list[Check]:
    """Return the shadow's checks; each takes the worst view, and its detail names it.

    `shadow`: IoU of the rendered shadow and the picture, at least `iou_floor` (None: no floor is
    asked); what a stand darkens beside the tube is left out, for `intrusion` says it, and
    the picture is changed as its view has it drawn (`changed` says how, by the view's name). Where
    nothing was rendered (`no_rendering` says why) it is skipped, though required, unless
    `polygons_decide`.
    `shadow_exact`: pixels at which rendering and exact polygons disagree away from the outline, at
    most 0. `outline`: distance from the exact tube's shadow.
    `vertices` (n, 3) are the part's, in its own coordinates: places are named there.
    `intrusion`: the share of the frame that a mount darkens outside picture and knots, at most
    `MOST_INTRUSION` on a wall mount. `wrong_outline`: the longest stretch along which the outlines
    of shadow and picture are farther apart than `WRONG_PX`, for information.
    """
    checks = [
        _check_shadow(views, iou_floor, no_rendering, polygons_decide, mount, changed or {}),
        _check_exact(views, no_rendering),
        _check_outline(views, vertices, max_outline_px),
    ]
    if mount != "none":
        checks.append(_check_intrusion(views, mount))
    return [*checks, _check_wrong_outline(views)]


def _check_shadow(
    views: Mapping[str, VerifiedView],
    iou_floor: float | None,
    no_rendering: str | None,
    polygons_decide: bool,
    mount: str,
    changed: Mapping[str, str],
) -> Check:
    if no_rendering is not None and not polygons_decide:
        return skip_check("shadow", no_rendering, required=True)
    name = min(views, key=lambda n: views[n].judged.iou)
    by = "rendered" if no_rendering is None else "exact polygons alone"
    return at_least(
        "shadow",
        views[name].judged.iou,
        iou_floor,
        "",
        f"IoU of the file's shadow and the picture, view {name} ({by})"
        + _say_changed(views[name], changed.get(name))
        + (", without what its mount darkens" if mount in ("stand", "hang") else "")
        + ("" if iou_floor is not None else "; no floor is asked"),
        required=iou_floor is not None,
    )


def _check_exact(views: Mapping[str, VerifiedView], no_rendering: str | None) -> Check:
    if no_rendering is not None:
        why = f"nothing to compare with: {no_rendering}"
        return skip_check("shadow_exact", why, required=False)
    name = max(views, key=lambda n: views[n].stray_px or 0)
    view = views[name]
    return at_most(
        "shadow_exact",
        float(view.stray_px or 0),
        0.0,
        "px",
        "pixels farther than one from the outline at which rendering and exact polygons "
        f"disagree, view {name} (IoU {view.whole.iou:.5f} and {view.exact_iou:.5f})",
    )


def _check_outline(
    views: Mapping[str, VerifiedView], vertices: Array, max_outline_px: float
) -> Check:
    known = {n: v.outline_px for n, v in views.items() if v.outline_px is not None}
    if not known:
        return skip_check("outline", "not given the knots", required=False)
    name = max(known, key=lambda n: known[n])
    outline, frame = views[name].outline, views[name].frame
    assert outline is not None
    u, v = outline.where[0] - frame.pad_x, outline.where[1] - frame.pad_y
    return at_most(
        "outline",
        known[name],
        max_outline_px,
        "px",
        f"file's shadow against the exact tube's, worst at pixel ({u:.0f}, {v:.0f}) of "
        f"the {frame.width} x {frame.height} frame, view {name}",
        at=[] if (vertex := views[name].outline_vertex) is None else [vertices[vertex]],
    )


def _check_wrong_outline(views: Mapping[str, VerifiedView]) -> Check:
    name = max(views, key=lambda n: views[n].wrong.length_px)
    wrong, frame = views[name].wrong, views[name].frame
    u, v = wrong.where[0] - frame.pad_x, wrong.where[1] - frame.pad_y
    place = f", up to {wrong.off_px:.1f} px at pixel ({u:.0f}, {v:.0f}) of the frame, view {name}"
    return at_most(
        "wrong_outline",
        wrong.length_px,
        None,
        "px",
        f"longest stretch of outline more than {WRONG_PX:g} px from the picture's"
        + (place if wrong.length_px else ""),
        required=False,
    )


def _say_changed(view: VerifiedView, how: str | None) -> str:
    return f", {how}; with the picture as it is {view.whole.iou:.4f}" if how else ""


def _check_intrusion(views: Mapping[str, VerifiedView], mount: str) -> Check:
    dark = {n: v.intrusion for n, v in views.items() if v.intrusion is not None}
    if not dark:
        return skip_check("intrusion", "not given the knots", required=False)
    name = max(dark, key=lambda n: dark[n])
    return at_most(
        "intrusion",
        dark[name],
        MOST_INTRUSION if mount == "wall" else None,
        "of the frame",
        f"what the mount darkens inside the frame, outside the picture and the knots, view {name}",
        required=mount == "wall",
    )
