"""One view of a part: what its picture requires, what is seen there, and what the report says of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.piece import Piece
from knotfab_formats.verdict import Layers, Misplacement, Named, Recognition, Told
from knotfab_formats.verdict import View as ViewFound
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.check import time_stage
from knotfab_validators.files.picture import (
    Bent,
    bend_of,
    bend_silhouette,
    read_mask,
    widen_strokes,
)
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh, move_points, part_bars
from knotfab_validators.shadows.compare import depth_ratio, overlap
from knotfab_validators.shadows.exact_shadow import ShadowCaster
from knotfab_validators.shadows.frame import padded_mask, working_frame
from knotfab_validators.shadows.lamp import SoftShadow, averages_lamp, lamp_size, measure_penumbra
from knotfab_validators.shadows.misplacement import (
    layer_shift_px,
    measure_layers,
    measure_misplacement,
    parting_px,
    shows_layers,
    simulates_misplacement,
)
from knotfab_validators.shadows.recognition import recognise
from knotfab_validators.shadows.render import SilhouetteRenderer
from knotfab_validators.shadows.told import tell
from knotfab_validators.shadows.topology import label_regions
from knotfab_validators.shadows.verdict_rules import judge_bending
from knotfab_validators.shadows.verify_view import VerifiedView, verify_view
from knotfab_validators.shadows.view import ViewGeometry, view_geometry
from knotfab_validators.tube.solid_matter import inside_plate, tube_vertices

if TYPE_CHECKING:
    from knotfab_formats.views import View
    from knotfab_validators.files.scene import Scene

MISPLACED_PX = 512  # px of the frame's longer side: enough to distinguish losses of a few per cent
SPECK_PX = 4.0  # half the length of a piece too small to need a knot


@dataclass(frozen=True)
class PosedPart:
    """A part in its scene.

    `mesh` and `curves` are in the file's coordinates, mm; `pose` (4, 4) takes them to the scene, in which
    `vertices` (n, 3), `polygons` (the centre lines, where they are known) and `caster` are. `folder` holds
    the scene's pictures. `seconds` collects the cost of each stage.
    """

    mesh: Mesh
    curves: Curves | None
    scene: Scene
    folder: Path
    seconds: dict[str, float]
    pose: Array
    vertices: Array
    polygons: list[Array] | None
    caster: ShadowCaster

    @property
    def points(self) -> Array:
        """Points of the centre lines (k, 3), mm, or of the mesh if the lines are unknown."""
        return self.vertices if self.polygons is None else np.concatenate(self.polygons)


@dataclass(frozen=True)
class ViewShadow:
    """What one view asks for, and the shadow that the part casts in it.

    `target` (H, W) is the silhouette in the picture's pixels, as is `geometry`. `drawn` (H, W) is what the
    part draws of it, widened and `bent`; None if that is the same. `verdict` is None if the
    centre lines are unknown. `soft` is the shadow of a lamp whose width shows.
    """

    view: View
    geometry: ViewGeometry
    target: Mask
    drawn: Mask | None
    bent: Bent | None
    found: VerifiedView
    verdict: Recognition | None = None
    soft: SoftShadow | None = None

    @property
    def fine(self) -> ViewGeometry:
        """The view on the pixels of the padded frame, on which shadow and picture are compared."""
        return self.geometry.resample(self.found.frame)

    @property
    def wanted(self) -> Mask:
        """The picture on the padded frame, bent as the part draws it."""
        return self.found.target if self.bent is None else self.found.drawn

    @property
    def iou_drawn(self) -> float | None:
        """IoU with the picture as drawn; None if that is the picture itself."""
        if self.drawn is None or (self.bent is None and self.found.tube_px is None):
            return None
        return overlap(self.found.seen, self.found.drawn).iou


def pose_part(
    mesh: Mesh, curves: Curves | None, scene: Scene, folder: Path, seconds: dict[str, float]
) -> PosedPart:
    """Move a part and its centre lines into the scene."""
    pose = np.eye(4) if scene.pose is None else np.asarray(scene.pose.matrix, dtype=np.float64)
    vertices = move_points(mesh.vertices, pose)
    polygons = None if curves is None else [move_points(p, pose) for p in curves.polygons]
    caster = ShadowCaster(vertices, mesh.faces)
    return PosedPart(mesh, curves, scene, folder, seconds, pose, vertices, polygons, caster)


def see_view(
    part: PosedPart, view: View, renderer: SilhouetteRenderer | None, before: Sequence[ViewShadow]
) -> ViewShadow:
    """Compare the part's shadow with a view's picture, judge it, and soften it.

    Without a renderer of the part in the scene, its exact polygons stand in for the rendering. Pictures of
    lamps on one wall have the size of those that were seen `before`.

    Raises:
        ValueError: a picture cannot be read, or the part reaches the light.
    """
    scene, folder = part.scene, part.folder
    with time_stage(part.seconds, f"view {view.name}"):
        target = read_mask(folder / view.picture)
        if before and scene.share_wall and target.shape != before[0].target.shape:
            raise ValueError(f"{view.picture}: pictures of lamps on one wall have one size")
        geometry = view_geometry(view, target.shape[1], target.shape[0])
        drawn, bent, bend = None, None, bend_of(view)
        if view.thicken_mm:
            drawn = widen_strokes(target, view.thicken_mm / geometry.pixel_mm)
        if bend is not None:
            bent = bend_silhouette(target if drawn is None else drawn, bend)
            drawn = bent.mask
        bars = part_bars(part.mesh).bars if scene.piece.supports == "none" else None
        if bars is not None:
            bars = Mesh(move_points(bars.vertices, part.pose), bars.faces)
        found = verify_view(
            part.vertices,
            part.mesh.faces,
            target,
            geometry,
            polygons=part.polygons,
            radius=None if part.curves is None else part.curves.radius_mm,
            closed=None if part.curves is None else part.curves.closed,
            mounted=scene.mount.kind != "none" or scene.piece.supports == "none",
            stand=scene.mount.kind in ("stand", "hang"),
            renderer=renderer,
            caster=part.caster,
            drawn=drawn,
            ends=scene.screen_ends,
            bars=scene.piece.supports == "none",
            bar_bodies=bars,
        )
    seen = ViewShadow(view, geometry, target, drawn, bent, found)
    seen = replace(seen, verdict=_recognise(part, seen))
    return replace(seen, soft=_soften(part, seen))


def _recognise(part: PosedPart, seen: ViewShadow) -> Recognition | None:
    """Judge whether a person would know the picture in the shadow; None where no centre lines are known."""
    found = seen.found
    if found.tube_px is None:
        return None
    with time_stage(part.seconds, "verdict"):
        drawn = seen.iou_drawn
        judged = recognise(
            found.seen,
            found.drawn,
            found.framed.iou if drawn is None else drawn,
            found.tube_px,
            found.frame,
            seen.geometry,
            outlined=found.of_tube,
            blur_px=_blur_px(part, seen),
            bridged=count_bridged(part.scene.piece, found.target),
        )
    return judged if seen.bent is None else judge_bending(judged, seen.bent)


def _blur_px(part: PosedPart, seen: ViewShadow) -> float:
    """Return the width of the penumbra at the middle of the part, px of the padded frame."""
    tube_px, fine_mm, curves = seen.found.tube_px, seen.fine.pixel_mm, part.curves
    if tube_px is None or curves is None or not curves.radius_mm:
        return 0.0
    return lamp_size(seen.view) * max(tube_px * fine_mm / curves.radius_mm - 1.0, 0.0) / fine_mm


def count_bridged(piece: Piece, target: Mask) -> int:
    """Count the gaps between pieces that must be bridged to draw the requested number of knots."""
    if piece.knots is None or not piece.asks_for_bridges:
        return 0
    return max(len(label_regions("piece", target, SPECK_PX)[1]) - piece.knots, 0)


def _soften(part: PosedPart, seen: ViewShadow) -> SoftShadow | None:
    """Average the shadow over the lamp; None if its width does not show."""
    scene, found, view, fine = part.scene, seen.found, seen.view, seen.fine
    tolerance = scene.settings.tolerance_px
    if not averages_lamp(scene.effects, part.vertices, fine, view, tolerance):
        return None
    screen = found.frame.mask if scene.screen_ends else None
    masks = seen.wanted, found.shadow, found.frame
    with time_stage(part.seconds, "penumbra"):
        return measure_penumbra(part.caster, part.vertices, fine, *masks, view, tolerance, screen)


def tell_view(part: PosedPart, seen: ViewShadow) -> ViewFound:
    """Report what was found in a view, and measure what misplacement and printed layers cost there.

    `projection` and `receiver` are in the part file's coordinates; the pose is that of the shrunk part.
    """
    found, view, geometry = seen.found, seen.view, seen.geometry
    told, recognition = _tell(part, seen)
    own, left = geometry.in_part(part.pose), part.scene.material.shrinks_to
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
        told=told,
        recognition=recognition,
        depth_ratio=depth_ratio(part.points, geometry),
        lamp_colour=view.lamp_colour if part.scene.share_wall else None,
        iou_drawn=seen.iou_drawn,
        bending=None if seen.bent is None else seen.bent.figures,
        verdict=seen.verdict,
        misplacement=_misplace(part, seen),
        penumbra=None if seen.soft is None else seen.soft.found,
        layers=_measure_layers(part, seen),
    )


def _tell(part: PosedPart, seen: ViewShadow) -> tuple[Told, dict[str, Named]] | tuple[None, None]:
    """Measure how much of the picture knots, holder and the whole tell, unlit."""
    faces, curves, geometry = part.mesh.faces, part.curves, seen.geometry
    parts = {"whole": faces}
    if curves is not None and curves.radius_mm and part.scene.mount.kind != "none":
        if curves.plate is not None:
            held = inside_plate(part.mesh.vertices, curves.plate)
        else:
            held = ~tube_vertices(part.mesh.vertices, faces, curves.polygons, curves.radius_mm)
        own = held[faces].all(axis=1)
        parts |= {"knots": faces[~own], "holder": faces[own]}
    with time_stage(part.seconds, "told"):
        axes = np.stack([geometry.right, geometry.up, np.cross(geometry.right, geometry.up)])
        return tell(part.vertices, parts, axes, seen.target) or (None, None)


def _misplace(part: PosedPart, seen: ViewShadow) -> Misplacement | None:
    """Measure the cost of misplacement; None if it hardly changes the shadow's shape."""
    scene, target, points = part.scene, seen.target, part.points
    middle: Array = (points.min(axis=0) + points.max(axis=0)) / 2
    turns = scene.mount.kind != "wall"
    parting = parting_px(points, middle, seen.fine, scene.placing, turns=turns)
    if not simulates_misplacement(scene.effects, parting, scene.settings.tolerance_px):
        return None
    # a stand throws its own shadow below the frame
    inside = scene.mount.kind == "stand" or scene.screen_ends
    with time_stage(part.seconds, "misplacement"):
        coarse = working_frame(target.shape[1], target.shape[0], MISPLACED_PX)
        return measure_misplacement(
            part.caster,
            points,
            middle,
            seen.geometry.resample(coarse),
            padded_mask(target if seen.bent is None else seen.bent.mask, coarse),
            scene.placing,
            parting=parting,
            turns=turns,
            within=padded_mask(np.ones_like(target), coarse) if inside else None,
        )


def _measure_layers(part: PosedPart, seen: ViewShadow) -> Layers | None:
    """Measure what the layers of a printed part do to its shadow; None if they do not show."""
    scene, found = part.scene, seen.found
    if not scene.piece.printed:
        return None
    own = seen.fine.in_part(part.pose)
    layer = scene.printer.layer_height_mm * scene.material.shrinks_to
    shift = layer_shift_px(part.mesh.vertices, own, layer)
    if not shows_layers(scene.effects, shift, scene.settings.tolerance_px):
        return None
    screen = found.frame.mask if scene.screen_ends else None
    with time_stage(part.seconds, "layers"):
        return measure_layers(part.mesh, own, layer, seen.wanted, found.exact, shift, screen)
