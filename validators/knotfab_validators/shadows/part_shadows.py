"""Check, report and draw the shadows of a written part, view by view."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from knotfab_formats.verdict import SHADOWS, Check, Colours
from knotfab_formats.verdict import View as ViewFound
from knotfab_validators.arrays import Array
from knotfab_validators.check import at_least, at_most, skip_check, time_stage
from knotfab_validators.files.picture import bend_of
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.colours import (
    LampShadow,
    check_colours,
    measure_colours,
    write_colours,
)
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.frame import write_compare, write_shadow
from knotfab_validators.shadows.lamp import check_half_light
from knotfab_validators.shadows.outlines import WRONG_PX
from knotfab_validators.shadows.part_view import (
    PosedPart,
    ViewShadow,
    pose_part,
    see_view,
    tell_view,
)
from knotfab_validators.shadows.render import CannotRender, SilhouetteRenderer
from knotfab_validators.shadows.verdict_rules import check_recognisable, worst_verdict
from knotfab_validators.shadows.verify_view import VerifiedView

if TYPE_CHECKING:
    from knotfab_formats.views import View
    from knotfab_validators.files.scene import Scene

SKIP_RENDER = "shadow-render"


def verify_shadows(
    mesh: Mesh,
    curves: Curves | None,
    scene: Scene,
    folder: Path,
    skip: Collection[str],
    pictures_dir: str | PathLike[str] | None,
    seconds: dict[str, float],
) -> tuple[list[Check], list[ViewFound], Colours | None]:
    """Check a part's shadows; return the checks, the findings of each view, and those on mixed colours.

    Args:
        folder: where the scene's pictures lie. skip: with `SKIP_RENDER` the exact polygons decide
            alone. pictures_dir: where to write each view's pictures; None: nowhere.

    Raises:
        ValueError: a picture cannot be read, or the part reaches the light.
    """
    part = pose_part(mesh, curves, scene, folder, seconds)
    renderer, no_rendering = _open_renderer(part, skip)
    into = None if pictures_dir is None else Path(pictures_dir)
    seen: list[ViewShadow] = []
    views: list[ViewFound] = []
    try:
        for view in scene.views:
            seen.append(see_view(part, view, renderer, seen))
            views.append(tell_view(part, seen[-1]))
            if into is not None:
                with time_stage(seconds, "pictures"):
                    _write_pictures(seen[-1], into)
        mixes = scene.share_wall and scene.lamps.mode == "mix"
        colours = _mix_colours(part, seen, into) if mixes else None
    finally:
        if renderer is not None:
            renderer.close()
    return _check(part, seen, views, colours, no_rendering, skip), views, colours


def _open_renderer(
    part: PosedPart, skip: Collection[str]
) -> tuple[SilhouetteRenderer | None, str | None]:
    """Open a renderer of the posed part, or say why there is none."""
    if SKIP_RENDER in skip:
        return None, "left out on request"
    with time_stage(part.seconds, "renderer"):
        try:
            return SilhouetteRenderer(part.vertices, part.mesh.faces), None
        except CannotRender as error:
            return None, str(error)


def _write_pictures(seen: ViewShadow, into: Path) -> None:
    """Write a view's shadow, the soft one too, and its difference from the picture."""
    found, name = seen.found, seen.view.name
    write_shadow(into / f"shadow-{name}.png", found.shadow, found.frame)
    if seen.soft is not None:
        write_shadow(into / f"soft-{name}.png", seen.soft.soft, found.frame)
    write_compare(into / f"compare-{name}.png", seen.wanted, found.shadow, found.frame)


def _mix_colours(part: PosedPart, seen: Sequence[ViewShadow], into: Path | None) -> Colours:
    """Mix the lamps' light on one screen, and write the pictures of it."""
    lamps = []
    for one in seen:
        found, hidden = one.found, one.found.shadow if one.soft is None else one.soft.soft
        tube_mm = None if found.tube_px is None else found.tube_px * one.fine.pixel_mm
        lamps.append(LampShadow(one.view, one.geometry, hidden, found.target, tube_mm))
    with time_stage(part.seconds, "colours"):
        mix = measure_colours(lamps, part.scene, part.folder, found.frame, part.caster, part.points)
        if into is not None:
            write_colours(into, mix)
    return mix.found


def _check(
    part: PosedPart,
    seen: Sequence[ViewShadow],
    views: Sequence[ViewFound],
    colours: Colours | None,
    no_rendering: str | None,
    skip: Collection[str],
) -> list[Check]:
    """Check shapes, soft shadows and mixed colours, and whether a person would know the pictures."""
    scene = part.scene
    floor = scene.iou_floor
    checks = shadow_checks(
        {one.view.name: one.found for one in seen},
        part.mesh.vertices,
        iou_floor=floor,
        max_outline_px=scene.outline_px,
        no_rendering=no_rendering,
        polygons_decide=SKIP_RENDER in skip,
        mount=scene.mount.kind,
        bars=scene.piece.supports == "none",
        changed={view.name: _say_prepared(view) for view in scene.views},
        pictures={view.name: view.picture for view in scene.views},
    )
    half_lit: dict[str, float] = {}  # IoU of the picture with the half-light shadow, by view
    for one in seen:
        if one.soft is not None:
            beside = one.found.shadow & ~one.found.of_tube  # the stand's part of the shadow
            half_lit[one.view.name] = overlap(one.soft.dark & ~beside, one.found.drawn).iou
    if half_lit:
        checks.append(check_half_light(half_lit, floor))
    accepted = "unrecognisable" in scene.accuracy.accept
    known = check_recognisable(worst_verdict(views), accepted=accepted)
    coloured = [] if colours is None else check_colours(colours, scene.iou_floor)
    return [*checks, *coloured, known]


def _say_prepared(view: View) -> str:
    """Say how the picture was changed before it was drawn."""
    said = []
    if view.thicken_mm:
        said.append(f"its strokes widened to {view.thicken_mm:g} mm as they are drawn")
    if (bend := bend_of(view)) is not None:
        said.append("mirrored and bent" if bend.mirrored else "bent")
    return ", ".join(said)


# The checks that follow from verified views: `shadow`, `shadow_exact`, `outline`, `wrong_outline`.


# share of the frame that a mount may darken if its pegs hide in the tube's shadow
MOST_INTRUSION = 0.001
# of one patch that a bar darkens on the receiver: a few corners that stick out, and never a bar across a gap
MOST_SHOWN_MM2 = 1.0


def skip_shadow_checks(why: str, *, required: bool) -> list[Check]:
    """Skip all shadow checks for one reason."""
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
    pictures: Mapping[str, str] | None = None,
    bars: bool = False,
) -> list[Check]:
    """Make the shadow checks; each takes the worst view, and its detail names it.

    `shadow`: IoU of the rendered shadow and the picture, at least `iou_floor` (None: no floor is
    asked); what a stand darkens beside the tube is left out, for `intrusion` says it, and the
    picture (a file of `pictures`, by the view's name) is changed as its view has it drawn (`changed` says
    how). Where
    nothing was rendered (`no_rendering` says why) it is skipped, though required, unless
    `polygons_decide`. `shadow_exact`: pixels at which rendering and exact polygons disagree away
    from the outline, at most 0. `outline`: distance from the exact tube's shadow. `vertices` (n, 3)
    are the part's, in its own coordinates: places are named there. `intrusion`: the share of the
    frame that a mount, or bars, darken outside picture and knots, at most `MOST_INTRUSION` on a
    wall mount and of a piece without supports, which may have `bars`, none of which may show by more than
    `MOST_SHOWN_MM2`. `wrong_outline`: the longest stretch along which the outlines of shadow and picture are
    farther apart than `WRONG_PX`, for information.
    """
    checks = [
        _check_shadow(
            views, iou_floor, no_rendering, polygons_decide, mount, changed or {}, pictures or {}
        ),
        _check_exact(views, no_rendering),
        _check_outline(views, vertices, max_outline_px),
    ]
    if mount != "none" or bars:
        checks.append(_check_intrusion(views, mount, bars))
    return [*checks, _check_wrong_outline(views)]


def _check_shadow(
    views: Mapping[str, VerifiedView],
    iou_floor: float | None,
    no_rendering: str | None,
    polygons_decide: bool,
    mount: str,
    changed: Mapping[str, str],
    pictures: Mapping[str, str],
) -> Check:
    if no_rendering is not None and not polygons_decide:
        return skip_check("shadow", no_rendering, required=True)
    name = min(views, key=lambda n: views[n].judged.iou)
    by = "rendered" if no_rendering is None else "exact polygons alone"
    how = changed.get(name)
    return at_least(
        "shadow",
        views[name].judged.iou,
        iou_floor,
        "",
        f"IoU of the file's shadow, compared with {pictures.get(name, 'the picture')} as it was read, "
        f"view {name} ({by})"
        + (f", {how}; with the picture as it is {views[name].whole.iou:.4f}" if how else "")
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


def _check_intrusion(views: Mapping[str, VerifiedView], mount: str, bars: bool) -> Check:
    dark = {n: v.intrusion for n, v in views.items() if v.intrusion is not None}
    if not dark:
        return skip_check("intrusion", "not given the knots", required=False)
    name = max(dark, key=lambda n: dark[n])
    hidden = mount == "wall" or (bars and mount == "none")
    bare = max(views, key=lambda n: views[n].bar_mm2)
    if (patch := views[bare].bar_mm2) > MOST_SHOWN_MM2:
        detail = f"a bar shows outside the picture and the knots, view {bare}"
        return Check("intrusion", "fail", True, patch, MOST_SHOWN_MM2, "mm²", detail)
    what = [*(["its mount"] if mount != "none" else []), *(["bars"] if bars else [])]
    return at_most(
        "intrusion",
        dark[name],
        MOST_INTRUSION if hidden else None,
        "of the frame",
        f"what {' and '.join(what)} darken inside the frame, outside the picture and the knots, "
        f"view {name}",
        required=hidden,
    )
