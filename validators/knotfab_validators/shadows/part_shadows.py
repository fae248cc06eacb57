"""The shadows of a written part, view by view: checks, reports and pictures."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from knotfab_formats.verdict import Colours
from knotfab_formats.verdict import View as ViewFound
from knotfab_validators.check import Check, skip_check
from knotfab_validators.clock import time_stage
from knotfab_validators.files.bent import bend_of
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.colours import (
    LampShadow,
    check_colours,
    measure_colours,
    write_colours,
)
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.part_view import PosedPart, SeenView, pose_part, see_view, tell_view
from knotfab_validators.shadows.penumbra import check_half_light
from knotfab_validators.shadows.pictures import write_compare, write_shadow
from knotfab_validators.shadows.recognition import check_recognisable, worst_verdict
from knotfab_validators.shadows.render import CannotRender, SilhouetteRenderer
from knotfab_validators.shadows.shadow_checks import shadow_checks
from knotfab_validators.shadows.tone import check_tone

if TYPE_CHECKING:
    from knotfab_formats.scene import View
    from knotfab_validators.files.scene import Scene

__all__ = ["SKIP_RENDER", "verify_shadows"]

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
    """Return the checks of a part's shadows, what was found in each view, and in the colours that lamps mix.

    Args:
        folder: where the scene's pictures lie. skip: with `SKIP_RENDER` the exact polygons decide
            alone. pictures_dir: where to write each view's pictures; None: nowhere.

    Raises:
        ValueError: a picture cannot be read, or the part reaches the light.
    """
    part = pose_part(mesh, curves, scene, folder, seconds)
    renderer, no_rendering = _open_renderer(part, skip)
    into = None if pictures_dir is None else Path(pictures_dir)
    seen: list[SeenView] = []
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
    """Open a renderer of the part in the scene, or say why there is none."""
    if SKIP_RENDER in skip:
        return None, "left out on request"
    with time_stage(part.seconds, "renderer"):
        try:
            return SilhouetteRenderer(part.vertices, part.mesh.faces), None
        except CannotRender as error:
            return None, str(error)


def _write_pictures(seen: SeenView, into: Path) -> None:
    """Write a view's shadow, also the soft one, and how it differs from the picture."""
    found, name = seen.found, seen.view.name
    write_shadow(into / f"shadow-{name}.png", found.shadow, found.frame)
    if seen.soft is not None:
        write_shadow(into / f"soft-{name}.png", seen.soft.soft, found.frame)
    write_compare(into / f"compare-{name}.png", seen.wanted, found.shadow, found.frame)


def _mix_colours(part: PosedPart, seen: Sequence[SeenView], into: Path | None) -> Colours:
    """Mix the light of the lamps on one screen, and write its pictures."""
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
    seen: Sequence[SeenView],
    views: Sequence[ViewFound],
    colours: Colours | None,
    no_rendering: str | None,
    skip: Collection[str],
) -> list[Check]:
    """Check shapes, soft shadows, greys and mixed colours, and that a person would know the pictures."""
    scene = part.scene
    in_greys = any(view.tone == "lines" for view in scene.views)  # no IoU is asked of such views
    floor = None if in_greys else scene.iou_floor
    checks = shadow_checks(
        {one.view.name: one.found for one in seen},
        part.mesh.vertices,
        iou_floor=floor,
        max_outline_px=scene.outline_px,
        no_rendering=no_rendering,
        polygons_decide=SKIP_RENDER in skip,
        mount=scene.mount.kind,
        changed={view.name: _say_changed(view) for view in scene.views if not in_greys},
    )
    half_lit: dict[str, float] = {}  # IoU of the picture with where half of the lamp is hidden
    for one in seen:
        if one.soft is not None:
            beside = one.found.shadow & ~one.found.of_tube  # the stand's part of the shadow
            half_lit[one.view.name] = overlap(one.soft.dark & ~beside, one.found.drawn).iou
    if half_lit:
        checks.append(check_half_light(half_lit, floor))
    accepted = "unrecognisable" in scene.accuracy.accept
    known = check_recognisable(worst_verdict(views), accepted=accepted)
    if in_greys:
        checks.append(check_tone({one.view.name: one.tone for one in seen if one.tone is not None}))
        known = skip_check(known.name, "drawn in greys: tone_error says how well")
    coloured = [] if colours is None else check_colours(colours, scene.iou_floor)
    return [*checks, *coloured, known]


def _say_changed(view: View) -> str:
    """Say in words how the picture was changed before it was drawn."""
    said = []
    if view.thicken_mm:
        said.append(f"its strokes widened to {view.thicken_mm:g} mm as they are drawn")
    if (bend := bend_of(view)) is not None:
        said.append("mirrored and bent" if bend.mirrored else "bent")
    return ", ".join(said)
