"""The shadows of a written part, view by view: checks, reports and pictures."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import Colours, Recognition
from knotfab_formats.verdict import View as ViewFound
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.check import Check, skip_check
from knotfab_validators.clock import time_stage
from knotfab_validators.files.bent import Bent, bend_of, bend_silhouette
from knotfab_validators.files.picture import read_greys, read_silhouette
from knotfab_validators.files.strokes import widen_strokes
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh, move_points
from knotfab_validators.shadows.bending_rule import judge_bending
from knotfab_validators.shadows.cast import ShadowCaster
from knotfab_validators.shadows.colours import (
    LampShadow,
    check_colours,
    measure_colours,
    write_colours,
)
from knotfab_validators.shadows.compare import depth_ratio, overlap
from knotfab_validators.shadows.frame import padded_mask, working_frame
from knotfab_validators.shadows.lamp import SceneLamp, lamp_size
from knotfab_validators.shadows.layers import layer_shift_px, measure_layers, shows_layers
from knotfab_validators.shadows.misplacement import (
    measure_misplacement,
    moves_apart,
    parting_px,
)
from knotfab_validators.shadows.penumbra import averages_lamp, check_half_light, measure_penumbra
from knotfab_validators.shadows.pictures import write_compare, write_shadow
from knotfab_validators.shadows.recognition import check_recognisable, recognise, worst_verdict
from knotfab_validators.shadows.render import CannotRender, SilhouetteRenderer
from knotfab_validators.shadows.shadow_checks import shadow_checks
from knotfab_validators.shadows.tone import Tone, check_tone, measure_tone
from knotfab_validators.shadows.topology import label_regions
from knotfab_validators.shadows.verify_view import VerifiedView, verify_view
from knotfab_validators.shadows.view import ViewGeometry, view_geometry
from knotfab_validators.shadows.wall import receive

if TYPE_CHECKING:
    from knotfab_formats.scene import View
    from knotfab_validators.files.scene import Scene

__all__ = ["SKIP_RENDER", "verify_shadows"]


MISPLACED_PX = 512  # losses of a few per cent are told apart as well
SPECK_PX = 4.0  # half the length of a piece that no knot needs to draw
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
    """The checks of a part's shadows, what was found in each view, and in the colours that lamps mix.

    Args:
        folder: where the scene's pictures lie. skip: with `SKIP_RENDER` the exact polygons decide
            alone. pictures_dir: where to write each view's pictures; None: nowhere.

    Raises:
        ValueError: a picture cannot be read, or the part reaches the light.
    """
    views: list[ViewFound] = []
    tolerance = scene.settings.tolerance_px
    pose = np.eye(4) if scene.pose is None else np.asarray(scene.pose.matrix, dtype=np.float64)
    vertices = move_points(mesh.vertices, pose)
    polygons = [move_points(p, pose) for p in curves.polygons] if curves is not None else None
    radius = curves.radius_mm if curves is not None else None
    caster = ShadowCaster(vertices, mesh.faces)
    renderer, why = None, "left out on request"
    if SKIP_RENDER not in skip:
        with time_stage(seconds, "renderer"):
            try:
                renderer = SilhouetteRenderer(vertices, mesh.faces)
            except CannotRender as error:
                why = str(error)
    verified: dict[str, VerifiedView] = {}
    drawn: dict[str, float] = {}  # IoU with the picture as it is drawn: strokes widened, bent
    tones: dict[str, Tone] = {}
    half_lit: dict[str, float] = {}  # likewise, of where half of the lamp is hidden
    ends = scene.screen_ends
    mixed: list[LampShadow] = []
    colours: Colours | None = None
    coloured: list[Check] = []
    try:
        for view in scene.views:
            with time_stage(seconds, f"view {view.name}"):
                toned = view.tone == "lines"
                if toned:  # a picture in greys is drawn as lines, in a picture of their own
                    target = read_silhouette(folder / f"picture-{view.name}-lines.png")
                else:
                    target = read_silhouette(folder / view.picture, view)
                if mixed and target.shape != (mixed[0].geometry.height, mixed[0].geometry.width):
                    raise ValueError(f"{view.picture}: pictures of lamps on one wall have one size")
                size = target.shape[1], target.shape[0]
                geometry, wall = receive(view_geometry(view, *size), scene.effects, tolerance)
                wide = None
                if not isinstance(view.thicken_mm, str) and not toned:
                    wide = widen_strokes(target, view.thicken_mm / geometry.pixel_mm)
                bent: Bent | None = None
                bend = bend_of(view)
                if bend is not None and not toned:
                    bent = bend_silhouette(target if wide is None else wide, bend)
                    wide = bent.mask
                found = verify_view(
                    vertices,
                    mesh.faces,
                    target,
                    geometry,
                    polygons=polygons,
                    radius=radius,
                    closed=curves.closed if curves is not None else None,
                    mounted=scene.mount.kind != "none",
                    stand=scene.mount.kind in ("stand", "hang"),
                    renderer=renderer,
                    caster=caster,
                    drawn=wide,
                    ends=ends,
                )
            verified[view.name] = found
            screen = found.frame.mask if ends else None
            judged: Recognition | None = None
            if toned and found.tube_px is not None and radius is not None:
                with time_stage(seconds, "tone"):
                    darkness = read_greys(folder / view.picture, view)
                    clearance = scene.piece.clearance_mm / radius
                    tones[view.name] = measure_tone(
                        found.seen, darkness, found.frame, found.tube_px, clearance
                    )
                drawn[view.name] = found.judged.iou
            elif found.tube_px is not None:
                with time_stage(seconds, "verdict"):
                    iou = found.framed.iou
                    if wide is not None:
                        iou = drawn[view.name] = overlap(found.seen, found.drawn).iou
                    judged = recognise(
                        found.seen,
                        found.drawn,
                        iou,
                        found.tube_px,
                        found.frame,
                        geometry,
                        outlined=found.of_tube,
                        blur_px=_blur_px(view, found, radius, geometry),
                        bridged=_count_bridged(scene.piece.knots, found.target),
                    )
                if bent is not None:
                    judged = judge_bending(judged, bent)
            soft, wanted = None, found.target if bent is None else found.drawn
            fine = geometry.resample(found.frame)
            if averages_lamp(scene.effects, vertices, fine, view, tolerance):
                with time_stage(seconds, "penumbra"):
                    soft = measure_penumbra(
                        caster,
                        vertices,
                        fine,
                        wanted,
                        found.shadow,
                        found.frame,
                        view,
                        tolerance,
                        screen,
                    )
            points = np.concatenate(polygons) if polygons is not None else vertices
            ratio, left = depth_ratio(points, geometry), scene.material.shrinks_to
            if bent is not None and view.name not in drawn:
                drawn[view.name] = overlap(found.seen, found.drawn).iou
            toned_error = tones[view.name].error if view.name in tones else None
            told = replace(
                _tell_view(view, found, geometry, pose, ratio, left),
                wall=wall,
                lamp_colour=view.lamp_colour if scene.share_wall else None,
                iou_drawn=drawn.get(view.name),
                bending=None if bent is None else bent.figures,
                verdict=judged,
                tone_error=toned_error,
                penumbra=None if soft is None else soft.found,
            )
            if scene.share_wall:
                hidden = found.shadow if soft is None else soft.soft
                tube_mm = None if found.tube_px is None else found.tube_px * fine.pixel_mm
                mixed.append(LampShadow(view, geometry, hidden, found.target, tube_mm))
            turns = scene.mount.kind != "wall"
            middle = _middle(points)
            parting = parting_px(points, middle, fine, scene.placing, turns=turns)
            if moves_apart(scene.effects, parting, tolerance):
                with time_stage(seconds, "misplacement"):
                    coarse = working_frame(target.shape[1], target.shape[0], MISPLACED_PX)
                    within = None
                    # it throws its own shadow below the frame
                    if scene.mount.kind == "stand" or ends:
                        within = padded_mask(np.ones_like(target), coarse)
                    moved = measure_misplacement(
                        caster,
                        points,
                        middle,
                        geometry.resample(coarse),
                        padded_mask(target if bent is None else bent.mask, coarse),
                        scene.placing,
                        parting=parting,
                        turns=turns,
                        within=within,
                    )
                told = replace(told, misplacement=moved)
            if soft is not None:
                beside = found.shadow & ~found.of_tube  # the stand's part of the shadow
                half_lit[view.name] = overlap(soft.dark & ~beside, found.drawn).iou
            if scene.piece.printed:
                own = fine.in_part(pose)
                layer = scene.printer.layer_height_mm * scene.material.shrinks_to
                shift = layer_shift_px(mesh.vertices, own, layer)
                if shows_layers(scene.effects, shift, tolerance):
                    with time_stage(seconds, "layers"):
                        stack = measure_layers(mesh, own, layer, wanted, found.exact, shift, screen)
                    told = replace(told, layers=stack)
            views.append(told)
            if pictures_dir is not None:
                with time_stage(seconds, "pictures"):
                    into = Path(pictures_dir)
                    write_shadow(into / f"shadow-{view.name}.png", found.shadow, found.frame)
                    if soft is not None:
                        write_shadow(into / f"soft-{view.name}.png", soft.soft, found.frame)
                    write_compare(
                        into / f"compare-{view.name}.png", wanted, found.shadow, found.frame
                    )
        if scene.share_wall and scene.lamps.mode == "mix":
            with time_stage(seconds, "colours"):
                mixture = measure_colours(mixed, scene, folder, found.frame, caster, points)
                colours = mixture.found
                coloured = check_colours(colours, scene.iou_floor)
                if pictures_dir is not None:
                    write_colours(Path(pictures_dir), mixture)
    finally:
        if renderer is not None:
            renderer.close()
    in_greys = any(view.tone == "lines" for view in scene.views)  # no IoU is asked of such views
    floor = scene.iou_floor if not in_greys else None
    checks = shadow_checks(
        verified,
        mesh.vertices,
        iou_floor=floor,
        max_outline_px=scene.outline_px,
        no_rendering=None if renderer is not None else why,
        polygons_decide=SKIP_RENDER in skip,
        mount=scene.mount.kind,
        changed={v.name: _say_changed(v) for v in scene.views if not in_greys},
    )
    if half_lit:
        checks.append(check_half_light(half_lit, floor))
    accepted = "unrecognisable" in scene.accuracy.accept
    known = check_recognisable(worst_verdict(views), accepted=accepted)
    if in_greys:
        known = skip_check(known.name, "drawn in greys: tone_error says how well")
        checks.append(check_tone(tones))
    return [*checks, *coloured, known], views, colours


def _blur_px(
    view: SceneLamp, found: VerifiedView, radius: float | None, geometry: ViewGeometry
) -> float:
    """The width of the penumbra that the lamp gives the middle of the piece, px of the compared grid."""
    if found.tube_px is None or not radius:
        return 0.0
    fine_mm = geometry.resample(found.frame).pixel_mm
    return lamp_size(view) * max(found.tube_px * fine_mm / radius - 1.0, 0.0) / fine_mm


def _count_bridged(knots: int | str, target: Mask) -> int:
    """Count how many gaps between pieces must be bridged for so few knots to draw them."""
    if isinstance(knots, str):
        return 0
    pieces = label_regions("piece", target, SPECK_PX)[1]
    return max(len(pieces) - knots, 0)


def _tell_view(
    view: View,
    found: VerifiedView,
    geometry: ViewGeometry,
    pose: Array,
    depth: float,
    left: float = 1.0,
) -> ViewFound:
    """What every view has; `projection` and `receiver` in the coordinates of the part's file.

    Args:
        pose: pose of the part that has shrunk. left: the share that is left then of every length in the file.
    """
    own = geometry.in_part(pose)
    fine_mm = geometry.resample(found.frame).pixel_mm
    a, b, c, d = (own.receiver / [1.0, 1.0, 1.0, left]).tolist()
    rows = (own.projection * [left, left, left, 1.0]).tolist()
    return ViewFound(
        name=view.name,
        kind=view.kind,
        picture=view.picture,
        width=geometry.width,
        height=geometry.height,
        projection=tuple((w, x, y, z) for w, x, y, z in rows),
        receiver=(a, b, c, d),
        iou=found.whole.iou,
        iou_frame=found.framed.iou,
        iou_tube=found.tube.iou if found.tube is not None else None,
        precision=found.whole.precision,
        recall=found.whole.recall,
        outline_error_px=found.outline_px,
        outline_error_mm=found.outline.largest_mm if found.outline is not None else None,
        intrusion=found.intrusion,
        outline_stretch_px=found.wrong.length_px,
        outline_stretch_mm=found.wrong.length_px * fine_mm,
        outline_stretch_off_px=found.wrong.off_px,
        legibility=found.legibility,
        depth_ratio=depth,
    )


def _say_changed(view: View) -> str:
    """Say in words how the picture was changed before it was drawn."""
    said = []
    if not isinstance(view.thicken_mm, str):
        said.append(f"its strokes widened to {view.thicken_mm:g} mm as they are drawn")
    if (bend := bend_of(view)) is not None:
        said.append("mirrored and bent" if bend.mirrored else "bent")
    return ", ".join(said)


def _middle(points: Array) -> Array:
    middle: Array = (points.min(axis=0) + points.max(axis=0)) / 2
    return middle
