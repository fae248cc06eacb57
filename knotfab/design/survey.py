"""Survey a picture before anything is searched: the tube that a build takes, and its losses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import SceneError
from knotfab.design.candidates import DEPTH_RATIO, line_radius
from knotfab.design.frames import frame_view, framed_alike
from knotfab.design.hull import HullBound
from knotfab.design.likeness import (
    Likeness,
    compare_lines,
    estimate_likeness,
    find_refusal,
    opened_share,
)
from knotfab.design.question import Question, ask
from knotfab.design.radius import choose_radius
from knotfab.design.settings import suit
from knotfab.geometry.polylines import arc_lengths
from knotfab.knots import read_start
from knotfab.picture.lamps import Separation
from knotfab.picture.opening import Loss, find_losses, open_by, run_together
from knotfab.picture.read import Target
from knotfab.picture.silhouette import holes_of, pieces_of, trace_polygon
from knotfab.scene.camera import camera_of
from knotfab.start.filling import Template
from knotfab.start.start import make_template
from knotfab_formats.scene import ResolvedScene, ResolvedView

# A guess of grams and hours before anything is searched.


# Fitted on builds of the project's own pictures (docs/silhouette.md has guesses beside the slicer's figures).
# the tube's length over that of its flat start, or over area / width
_LENGTH, _LENGTH_FLAT = 1.45, 1.12
# hours to a cm3 of a tube of this radius; thin ones take longer
_HOURS, _OF_RADIUS_MM = 0.158, 1.77
_HOURS_PLATE = 0.06
_HOURS_AROUND = 0.007  # hours to a cm3 of the room between the strands, part of which supports fill


@dataclass(frozen=True)
class Guess:
    """Grams of the part, and hours on the printer with its supports; None where nothing is known.

    `without` names what it does not know: a stand, or what an eyelet hangs from, is planned with the knots.
    """

    mass_g: float
    hours: float | None
    without: str = ""


def guess_print(
    scene: ResolvedScene,
    view: ResolvedView,
    areas_mm2: Sequence[float],
    size_mm: tuple[float, float],
    radius_mm: float,
    pieces: int = 1,
    template: Template | None = None,
) -> Guess:
    """Guess by the results of builds.

    A tube that fills an area A with strands side by side is A / 2r long; through the depth it is longer.
    What fills one of several pictures is hidden in the others, so that their areas add up.

    Args:
        areas_mm2: areas of the silhouettes. size_mm: width and height of the first one,
            in the middle of the piece. radius_mm: radius of the tube. pieces: pieces of the picture, each a
            knot if that is open.
        template: the flat curves that the search starts from, where they are known.
    """
    flat = scene.piece.depth == 0
    length = sum(areas_mm2) / (2 * radius_mm)
    if template is not None:
        length = sum(float(arc_lengths(curve)[-1]) for curve in template.curves)
    length *= _LENGTH_FLAT if flat else _LENGTH
    tube, plate = np.pi * radius_mm**2 * length, 0.0
    loose = scene.hangs(scene.count_knots(pieces))  # a wall mount holds them if they are printed
    hangs = (scene.piece.printed and loose) or scene.mount.kind == "wall"
    if hangs and scene.mount.foot != "dowel":
        margin = 2 * scene.mount.plate_margin_mm
        plate = (view.frame_width_mm + margin) * (view.frame_height_mm + margin)
        plate *= scene.mount.plate_thickness_mm
    without = {"stand": "its stand", "hang": "its eyelet"}.get(scene.mount.kind, "")
    if loose and not hangs:
        without = "the wall mount that --print adds"
    mass = (tube + plate) * 1e-3 * scene.material.density_g_cm3
    if scene.material.process != "filament":
        return Guess(float(mass), None, without)
    room = 2.0 * view.reach_mm
    depth = 0.0 if flat else scene.piece.depth or min(room, DEPTH_RATIO * max(size_mm))
    hours = _HOURS * _OF_RADIUS_MM / radius_mm * tube
    hours += _HOURS_PLATE * plate + _HOURS_AROUND * sum(areas_mm2) / len(areas_mm2) * depth
    return Guess(float(mass), float(hours * 1e-3), without)


_USUAL_SHARE = 0.014  # tube radius over the frame's longer side, where the picture has room
_SHOWN = 3  # thicker tubes that are shown beside the one that is taken
_SPECK = 0.5  # radii of the thinnest tube: the side of a square as large as what nobody misses
_SPARE = 0.3  # px that an outline may move by


@dataclass(frozen=True)
class ViewSurvey:
    """One picture: its silhouette in px, and what it takes to draw it. Radii in mm of the piece.

    `losses`: for the radius that a build takes, and for thicker ones, what they lose, in px of the picture.
    `whole_mm`: the thickest of the radii tried that loses nothing, None where none does that is known.
    `together`: the share of its strokes, as wide as the tube along them, that run together; 0 where areas are
    filled. `likeness`: what the thinnest tube could draw at best, None where that need not be asked.
    """

    view: ResolvedView
    target: Target
    polygon: MultiPolygon
    pieces: int
    holes: int
    losses: Mapping[float, list[Loss]] = field(default_factory=dict)
    whole_mm: float | None = None
    together: float = 0.0
    likeness: Likeness | None = None

    @property
    def recognisable(self) -> bool:
        """True if any of these tubes may draw it so that it is known."""
        return self.likeness is None or self.likeness.recognisable

    @property
    def px_per_mm(self) -> float:
        """px of the picture to a mm of a piece in the middle of the scene."""
        return self.view.px_per_mm(self.target.width)

    @property
    def wall_mm_per_px(self) -> float:
        """mm on the wall to a px of the picture."""
        return self.view.frame_width_mm / self.target.width

    @property
    def area_mm2(self) -> float:
        """The area of the silhouette at the middle of the piece."""
        return float(self.polygon.area) / self.px_per_mm**2

    @property
    def piece_mm(self) -> tuple[float, float]:
        """Width and height of the drawing at the middle of the piece."""
        left, top, right, bottom = self.polygon.bounds
        return (right - left) / self.px_per_mm, (bottom - top) / self.px_per_mm


@dataclass(frozen=True)
class Survey:
    """All pictures of a piece, the radius that a build takes, and a guess of the print.

    `refusal`: why a build ends at once, None where it does not.
    """

    views: tuple[ViewSurvey, ...]
    radius_mm: float
    guess: Guess
    frames: int = 0  # frames of a sequence, of which `views` holds the one that is hardest to draw
    refusal: SceneError | None = None
    chosen: bool = True  # whether the radius is known: a search by the clock chooses its own
    bounds: tuple[HullBound, ...] = ()  # the bounds that several pictures leave of each other
    agreed: tuple[str, ...] = ()  # the changes that made them agree, a sentence each
    parted: Separation | None = None  # the masks of a picture in colours, which lamps are to mix


def survey(
    scene: ResolvedScene, targets: Sequence[Target], sequence: bool = False, choose: bool = True
) -> Survey:
    """Look at pictures as a build will: its own choice of the radius, and what that tube draws.

    Args:
        targets: those of the scene's views in their order; of a sequence, its frames.
        choose: whether the radius is chosen; otherwise the thinnest is taken, and no losses are found.

    Raises:
        InputError: the pictures do not go with the scene.
    """
    frames = len(targets) if sequence else 0
    targets = [_hardest(targets)] if sequence else targets
    views = survey_views(scene, targets)
    refusal = find_refusal(views, scene, sequence)
    radius = scene.thinnest_mm
    templates: dict[float, Template] = {}
    if choose and refusal is None:
        try:
            question, radius, templates = _choose_tube(scene, targets)
            views = _add_losses(views, question, radius, templates)
        except SceneError as error:
            refusal = None if sequence else error  # another frame of a sequence may be taken
    first = views[0]
    printed = guess_print(
        scene,
        first.view,
        [seen.area_mm2 for seen in views],
        first.piece_mm,
        radius,
        first.pieces,
        templates.get(radius),
    )
    known = choose or scene.piece.tube_radius_mm is not None
    return Survey(views, radius, printed, frames, refusal, known)


def survey_views(scene: ResolvedScene, targets: Sequence[Target]) -> tuple[ViewSurvey, ...]:
    """Return each picture by itself, and whether any tube draws it."""
    if len(targets) > 1:
        scene = framed_alike(scene, targets)
    found = []
    for view, target in zip(scene.views, targets, strict=True):
        framed = frame_view(view, target)
        px, lines, radius = framed.px_per_mm(target.width), framed.lines, scene.thinnest_mm
        if lines:  # one tube for all strokes
            radius = line_radius(framed)
            likeness: Likeness | None = compare_lines(target.asked, target.judged, radius * px)
        else:
            likeness = estimate_likeness(target.mask, radius * px)
        wide = 2.0 * radius * px
        found.append(
            ViewSurvey(
                framed,
                target,
                _trace(target.mask),
                len(pieces_of(target.mask)[1]),
                len(holes_of(target.mask)[1]),
                together=run_together(target.asked, target.judged, wide) if lines else 0.0,
                likeness=likeness,
            )
        )
    return tuple(found)


def _choose_tube(
    scene: ResolvedScene, targets: Sequence[Target]
) -> tuple[Question, float, dict[float, Template]]:
    """Give a build's own question, its choice of the radius, mm, and of one view the templates that it tried.

    Raises:
        SceneError: no tube draws the pictures.
    """
    question = ask(scene, targets)
    settings = suit(scene.settings, question, scene.search)
    radius, knots = question.scene.piece.tube_radius_mm, question.scene.piece.knots
    one = len(targets) == 1
    if radius is None and settings.start:
        radius = read_start(Path(settings.start)).radius_mm
    if radius is None:
        choice = choose_radius(question, settings, knots, placed=not one)
        return question, choice.radius_mm, dict(choice.templates)
    if not one:
        return question, radius, {}
    return question, radius, {radius: make_template(question.problem.views[0], radius, knots)}


def _add_losses(
    views: Sequence[ViewSurvey],
    question: Question,
    radius: float,
    templates: Mapping[float, Template],
) -> tuple[ViewSurvey, ...]:
    """Add to the views what tubes lose of them: of one view by the templates, which a search starts from."""
    thinnest = question.scene.printer.min_tube_radius_mm
    found = []
    for seen in views:
        px = seen.px_per_mm
        plain = _without_specks(seen.polygon, (_SPECK * thinnest * px) ** 2)
        thicker = [r for r in sorted(templates) if r > radius]
        tried = [radius, *thicker[:: -(-len(thicker) // _SHOWN) or 1]]
        if seen.view.lines:
            tried = []
        losses = {}
        for r in [*tried, min(templates, default=radius)]:
            drawn = _drawn_by(templates[r], seen) if templates else open_by(plain, r * px)
            try:
                losses[r] = find_losses(plain, drawn, r * px)
            except shapely.GEOSException:
                continue  # an estimate that fails is not shown
        whole = max((r for r, lost in losses.items() if not lost), default=None)
        shown = {r: losses[r] for r in tried if r in losses}
        found.append(replace(seen, losses=shown, whole_mm=whole))
    return tuple(found)


def _drawn_by(template: Template, seen: ViewSurvey) -> Polygon | MultiPolygon:
    """Draw a template's tube, in px of the picture."""
    own = seen.view.but(azimuth_deg=0.0, elevation_deg=0.0)
    camera = camera_of(own, seen.target.width, seen.target.height)

    def to_pixels(points: Array) -> Array:
        return camera.project(np.pad(points, ((0, 0), (0, 1))))

    tube: Polygon | MultiPolygon = shapely.transform(template.tube, to_pixels)
    return tube if tube.is_valid else tube.buffer(0)


def _without_specks(polygon: MultiPolygon, least: float) -> MultiPolygon:
    """Return the pieces and holes of at least this area, px²; all, where no piece is as large."""
    kept = [
        Polygon(piece.exterior, [hole for hole in piece.interiors if Polygon(hole).area >= least])
        for piece in polygon.geoms
        if Polygon(piece.exterior).area >= least
    ]
    plain = (MultiPolygon(kept) if kept else polygon).buffer(0)
    return plain if isinstance(plain, MultiPolygon) else MultiPolygon([plain])


def _trace(mask: Mask) -> MultiPolygon:
    """Return the silhouette in px, without vertices that a preview can spare."""
    shape = trace_polygon(mask).simplify(_SPARE)
    return shape if isinstance(shape, MultiPolygon) else MultiPolygon([shape])


def _hardest(targets: Sequence[Target]) -> Target:
    """Return the frame whose opening by a usual tube is worst."""
    few = targets[:: -(-len(targets) // 24)]  # frames of a sequence that are looked at
    return min(few, key=lambda t: opened_share(t.mask, _USUAL_SHARE * max(t.mask.shape)))


def require_drawable(found: Survey) -> None:
    """Refuse at once what a search would refuse after minutes.

    Raises:
        SceneError: as `Survey.refusal` says.
    """
    if found.refusal is not None:
        raise found.refusal
