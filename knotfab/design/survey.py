"""Survey pictures before a search: the tube that a build takes, what it loses, and whether to refuse."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.design.candidates import (
    FILLET_MM,
    LENGTH_ARCHED,
    PICTURE,
    Guess,
    Laid,
    drawing_radius,
    guess_print,
    line_radius,
    too_fine,
)
from knotfab.design.frames import frame_view, framed_alike
from knotfab.design.hull import HullBound
from knotfab.design.likeness import Likeness, compare_lines, estimate_likeness, recognisable_radius
from knotfab.design.motion import find_leap
from knotfab.design.question import Question, ask
from knotfab.design.radius import RadiusChoice, choose_radius, take_radius
from knotfab.design.settings import suit_settings
from knotfab.design.small import SmallParts, require_strokes
from knotfab.knots import read_start
from knotfab.picture.frames import count_knots
from knotfab.picture.lamps import Separation
from knotfab.picture.opening import Loss, find_losses, open_by, run_together
from knotfab.picture.read import Target
from knotfab.picture.silhouette import holes_of, opened_share, pieces_of, trace_polygon
from knotfab.problem import Start
from knotfab.scene.camera import camera_of
from knotfab.start.filling import Template
from knotfab.start.lift import refuse_doubled
from knotfab_formats.errors import in_digits
from knotfab_formats.piece import Piece
from knotfab_formats.scene import ResolvedScene, ResolvedView

SPILL = 0.05  # what is drawn beside a picture counts from this share of its area on
GUESSED = 1.12  # over a limit, by as much as guesses are off
TOLD_NEAR = 0.15  # by as much as a guess of what is told is off
# tube radii: shorter pieces are no larger than the loops that a tube closes in, and are drawn as blobs
_CLOSES = 8.0
_SPECK = 0.5  # side of the largest square that nobody misses, in radii of the thinnest tube
# area of roots over the square of the picture's longer side, by how much arches lengthen
_ROOTS = 0.075
_BESIDE_MM = 6.5  # beside the picture, of a rounded plate: about feet at its edge
_SPARE = 0.3  # tolerance of a simplified outline, px
_BLOBS = 0.3  # share of strokes that run together, above which they are no drawing
# tube radii that outlines may go from frame to frame: farther none is tried, and as far as this most succeed
_LEAP, _STEP = 20.0, 8.0
_MOST = 250  # pieces and holes of a picture that is tried: a large QR code has half of them
_FEW = 200  # pieces and holes up to which polygons are opened, and not pixels


@dataclass(frozen=True)
class ViewSurvey:
    """One picture's silhouette, in px, and what tubes lose of it. Radii are in mm of the piece.

    `pieces` and `holes` are counted without specks that nobody misses. `losses`: what the tube loses,
    None where that is not known; `spill`: what it draws beside the picture, as a share of it.
    `together`: the share of strokes that run together when drawn by a tube; 0 if areas are filled.
    `likeness`: the best that the thinnest tube could draw, None if most of the picture is wider than two
    tubes.
    """

    view: ResolvedView
    target: Target
    pieces: int
    holes: int
    losses: Sequence[Loss] | None = None
    spill: float = 0.0
    together: float = 0.0
    likeness: Likeness | None = None

    @cached_property
    def polygon(self) -> MultiPolygon:
        """The silhouette, simplified as a preview can afford."""
        shape = trace_polygon(self.target.mask).simplify(_SPARE)
        return shape if isinstance(shape, MultiPolygon) else MultiPolygon([shape])

    @property
    def px_per_mm(self) -> float:
        """The picture's pixels per mm at the middle of the piece."""
        return self.view.px_per_mm(self.target.width)

    @property
    def wall_mm_per_px(self) -> float:
        """The size of the picture's pixels on the wall, mm."""
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

    `refusal` is the error with which a build would end at once, None if it would not.
    """

    scene: ResolvedScene
    views: tuple[ViewSurvey, ...]
    radius_mm: float
    guess: Guess
    frames: int = 0  # length of a sequence, whose hardest frame is in `views`
    refusal: SceneError | None = None
    small: SmallParts | None = None  # None where the usual tube loses no small part
    chosen: bool = True  # whether the radius is known; a search by the clock chooses its own
    bounds: tuple[HullBound, ...] = ()  # the visual hull's, for several pictures
    told: tuple[str, ...] = ()  # what else is done to the pictures or the piece, a sentence each
    parted: Separation | None = None  # the masks of a coloured picture, which lamps mix again
    start: Start | None = None  # where the search begins, if it was asked for


def survey(
    scene: ResolvedScene,
    targets: Sequence[Target],
    sequence: bool = False,
    choose: bool = True,
    placed: bool = False,
    lay: Callable[[ResolvedScene, Start, float], Laid] | None = None,
) -> Survey:
    """Survey pictures with the tube radius that a build would choose.

    Args:
        targets: one a view, in the views' order, or the frames of a sequence.
        choose: whether to choose the radius; otherwise the thinnest is taken, and no losses are found.
        placed: whether to place strands in depth, as a build begins, where the radius does not ask for it.
        lay: tells how the strands of a start, of a radius in mm, print best; asked of those along strokes.

    Raises:
        InputError: the pictures do not fit the scene.
    """
    frames, every = (len(targets) if sequence else 0), targets
    if sequence:  # the frame of a few whose opening by a usual tube is worst
        few = targets[:: -(-len(targets) // 24)]
        targets = [min(few, key=lambda t: opened_share(t.mask))]
    views = _survey_views(scene, targets)
    refusal = find_refusal(views, scene, sequence)
    radius = scene.thinnest_mm
    template: Template | None = None
    small: SmallParts | None = None
    start: Start | None = None
    if choose and refusal is None:
        try:
            question, choice = _choose_tube(scene, targets, placed)
            radius, template, small = choice.radius_mm, choice.template, choice.small
            start = choice.start
            if template is not None and template.passes and scene.piece.supports == "none":
                refusal = refuse_doubled()
            # a plate for feet moves the wall to the piece, and so frames it larger
            views = tuple(
                _add_losses(
                    replace(seen, view=view), radius, scene.printer.min_tube_radius_mm, template
                )
                for seen, view in zip(views, question.views, strict=True)
            )
        except SceneError as error:
            refusal = None if sequence else error  # another frame may come first
    first = views[0]
    if sequence and choose and refusal is None:
        refusal = _refuse_leap(scene, every, first, radius)
    guess = guess_print(
        scene,
        first.view,
        [seen.area_mm2 for seen in views],
        first.piece_mm,
        radius,
        first.pieces,
        template,
        _outline_mm2(first, scene),
        lay(scene, start, radius) if lay and start and first.view.lines else None,
    )
    if refusal is None and scene.piece.printed:
        refusal = refuse_price(guess, scene.piece, first.view.longer_mm)
    known = choose or scene.piece.tube_radius_mm is not None
    return Survey(scene, views, radius, guess, frames, refusal, small, known, start=start)


def _refuse_leap(
    scene: ResolvedScene, frames: Sequence[Target], seen: ViewSurvey, radius: float
) -> SceneError | None:
    """Return the error of a sequence whose outline leaps farther than a tube follows, else None."""
    px = seen.px_per_mm
    outlines = [replace(seen, target=target).polygon for target in frames]
    number, far = find_leap(outlines, count_knots(frames, scene.piece.knots))
    radii = far / px / radius
    if radii <= _LEAP or "unrecognisable" in scene.accuracy.accept:
        return None
    lacking = math.ceil(radii / _STEP) - 1
    return SceneError(
        "the sequence",
        f"from frame {number} to frame {number + 1} the outline goes {far / px:.0f} mm, "
        f"{radii:.0f} tube radii, and strands follow some {_STEP:.0f}",
        f"Draw {lacking} frames between these two; --accept unrecognisable tries it nevertheless",
    )


def _survey_views(scene: ResolvedScene, targets: Sequence[Target]) -> tuple[ViewSurvey, ...]:
    """Survey each picture by itself, without a choice of the radius."""
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
        least = (_SPECK * scene.printer.min_tube_radius_mm * px) ** 2
        pieces, holes = (areas(target.mask)[1] for areas in (pieces_of, holes_of))
        found.append(
            ViewSurvey(
                framed,
                target,
                int((pieces >= min(least, pieces.max())).sum()),
                int((holes >= least).sum()),
                together=run_together(target.asked, target.judged, wide) if lines else 0.0,
                likeness=likeness,
            )
        )
    return tuple(found)


def _choose_tube(
    scene: ResolvedScene, targets: Sequence[Target], placed: bool
) -> tuple[Question, RadiusChoice]:
    """Return a build's question and its tube, with the search's start if `placed`.

    Raises:
        SceneError: no tube draws the pictures.
    """
    question = ask(scene, targets)
    settings = suit_settings(scene.settings, question, scene.search)
    radius, knots = question.scene.piece.tube_radius_mm, question.scene.piece.knots
    if radius is None and settings.start:
        radius = read_start(Path(settings.start)).radius_mm
    if radius is None:
        placed = placed or len(targets) > 1  # their starts tell the radius
        choice = choose_radius(question, settings, knots, placed=placed)
    else:
        choice = take_radius(question, settings, knots, radius, placed and not settings.start)
    if choice.start is not None:
        require_strokes(question, choice.start)
    return question, choice


def _add_losses(
    seen: ViewSurvey, radius: float, thinnest: float, template: Template | None
) -> ViewSurvey:
    """Add what a tube loses of a view, found by its template, or else by an opening."""
    if seen.view.lines:
        return seen
    px = seen.px_per_mm
    plain = _without_specks(seen.polygon, (_SPECK * thinnest * px) ** 2)
    drawn = open_by(plain, radius * px) if template is None else _drawn_by(template, seen)
    try:
        losses = find_losses(plain, drawn, radius * px)
        spill = float(drawn.difference(plain).area / plain.area)
    except shapely.GEOSException:
        return seen  # skip an estimate that fails
    return replace(seen, losses=losses, spill=spill)


def _drawn_by(template: Template, seen: ViewSurvey) -> Polygon | MultiPolygon:
    """Return the outline of a template's tube in px of the picture."""
    own = seen.view.but(azimuth_deg=0.0, elevation_deg=0.0)
    camera = camera_of(own, seen.target.width, seen.target.height)

    def to_pixels(points: Array) -> Array:
        return camera.project(np.pad(points, ((0, 0), (0, 1))))

    tube: Polygon | MultiPolygon = shapely.transform(template.tube, to_pixels)
    return tube if tube.is_valid else tube.buffer(0)


def _without_specks(polygon: MultiPolygon, least: float) -> MultiPolygon:
    """Drop pieces and holes below this area, px²; drop none if no piece is as large."""
    kept = [
        Polygon(piece.exterior, [hole for hole in piece.interiors if Polygon(hole).area >= least])
        for piece in polygon.geoms
        if Polygon(piece.exterior).area >= least
    ]
    plain = (MultiPolygon(kept) if kept else polygon).buffer(0)
    return plain if isinstance(plain, MultiPolygon) else MultiPolygon([plain])


def _outline_mm2(seen: ViewSurvey, scene: ResolvedScene) -> float:
    """Guess the area of roots, or return that of a plate about the picture; infinite for another one."""
    mount = scene.mount
    x0, y0, x1, y1 = np.array(seen.polygon.bounds) * seen.wall_mm_per_px
    if mount.plate == "roots":
        area = float(seen.polygon.area) * seen.wall_mm_per_px**2
        roots = _ROOTS * LENGTH_ARCHED[scene.accuracy.name]
        return min(area, roots * float(max(x1 - x0, y1 - y0)) ** 2)
    if mount.plate == "rounded":
        return float((x1 - x0 + 2 * _BESIDE_MM) * (y1 - y0 + 2 * _BESIDE_MM))
    if mount.plate != "outline":
        return np.inf
    px = 1.0 / seen.wall_mm_per_px
    sheet = seen.polygon.simplify(px).buffer((mount.plate_margin_mm + FILLET_MM) * px)
    islands = shapely.get_parts(sheet.buffer(-FILLET_MM * px))
    filled = shapely.union_all([Polygon(island.exterior) for island in islands])
    return float(filled.area) / px**2


def require_drawable(found: Survey) -> None:
    """Raise the survey's refusal, a SceneError, if it has one."""
    if found.refusal is not None:
        raise found.refusal


def refuse_price(guess: Guess, asked: Piece, size_mm: float) -> SceneError | None:
    """Return the error of a piece whose guess exceeds the hours or grams that are allowed, else None.

    A guess that is off by no more than usual passes; then the slicer's figures decide.
    """
    cubic = 3.0 if asked.tube_radius_mm is None else 2.0  # a larger picture has a thicker tube
    for most, found, option, unit, power in (
        (asked.max_hours, guess.hours, "--max-hours", "h", 2.0),
        (asked.max_grams, guess.mass_g, "--max-grams", "g", cubic),
    ):
        if most is not None and found is not None and found > GUESSED * most:
            size = smaller_size(size_mm, most / found, power)
            why = f"this piece would take about {in_digits(found, 3)} {unit}"
            return SceneError(f"{option} {most:g}", why, f"Use --size {size}")
    return None


def smaller_size(size_mm: float, share: float, power: float) -> int:
    """Return a size, in whole 5 mm, at which a piece takes this share of what goes with that power of it."""
    return int(max(5 * math.floor(0.96 * size_mm * share ** (1 / power) / 5), 5))


def find_refusal(
    views: Sequence[ViewSurvey], scene: ResolvedScene, sequence: bool = False
) -> SceneError | None:
    """Return the error with which a build refuses pictures at once, None if a search may succeed.

    It refuses a picture that no tube shows recognisably, unless the scene accepts that, and one of lines
    that run together.
    """
    if "unrecognisable" in scene.accuracy.accept:
        return None
    for one in views:
        if one.likeness is not None and not one.likeness.recognisable:
            return _refuse_unlike(one, one.likeness, scene)
        if one.pieces + one.holes > _MOST:
            few = ", or its largest pieces alone (--keep-largest 20)"
            return SceneError(
                PICTURE,
                f"it has {one.pieces} pieces and {one.holes} holes, and more than {_MOST} are not tried",
                "Use a simpler picture" + (few if _refuse_small(one, scene) is None else ""),
            )
    seen, given = views[0], scene.piece.tube_radius_mm is not None
    if len(views) > 1 or sequence:
        return None
    if (small := _refuse_small(seen, scene)) is not None or given or seen.together <= _BLOBS:
        return small
    radius = scene.printer.min_tube_radius_mm * seen.px_per_mm
    return too_fine(
        recognisable_radius(seen.target.asked, radius),
        seen.view,
        (seen.target.width, seen.target.height),
        scene.printer,
        "its lines are too close together for any printable tube: as wide as one of "
        f"{2 * line_radius(seen.view):g} mm, {seen.together:.0%} of them run together",
        "",
    )


def _refuse_small(seen: ViewSurvey, scene: ResolvedScene) -> SceneError | None:
    """Return the error of a picture of pieces too short for a tube to close in any of them, else None."""
    radius = line_radius(seen.view) if seen.view.lines else scene.thinnest_mm
    boxes = np.array([piece.bounds for piece in seen.polygon.geoms]) / seen.px_per_mm
    longest, least = float((boxes[:, 2:] - boxes[:, :2]).max()), _CLOSES * radius
    bridged = (scene.piece.knots or seen.pieces) < seen.pieces
    if longest >= least or bridged or scene.piece.knot != "unknot":
        return None
    return SceneError(
        PICTURE,
        f"none of its pieces would be longer than {longest:.1f} mm, and a closed tube {2 * radius:g} mm "
        f"thick draws none below {least:.1f} mm",
        f"Use --size {math.ceil(seen.view.longer_mm * least / longest)}",
    )


def _refuse_unlike(seen: ViewSurvey, likeness: Likeness, scene: ResolvedScene) -> SceneError:
    """Build the error for a picture that no tube shows recognisably."""
    px, printer = seen.px_per_mm, scene.printer
    given, radius = scene.piece.tube_radius_mm is not None, scene.thinnest_mm
    lost = f"which reaches an IoU of about {likeness.iou:.2f}"
    if likeness.changes:
        which = f"{likeness.changes} of its {likeness.features} pieces and holes"
        lost = f"where {which} are lost or run together"
    if likeness.features > _FEW:  # openings of their polygons would take long
        drawn = recognisable_radius(seen.target.asked, radius * px)
    else:
        drawn = drawing_radius(trace_polygon(seen.target.asked), radius * px)
    otherwise = "--accept unrecognisable to build it nevertheless"
    if given and drawn is not None and drawn >= printer.min_tube_radius_mm * px:
        otherwise = (
            f"a thinner tube (--tube-radius {math.floor(100 * drawn / px) / 100:g}), or {otherwise}"
        )
    why = (
        f"it is too fine for {'such a' if given else 'any printable'} tube: nobody would know "
        f"{seen.target.name} in the shadow of one {2 * radius:g} mm thick, {lost}"
    )
    pixels = (seen.target.width, seen.target.height)
    return too_fine(
        drawn, seen.view, pixels, printer, why, otherwise, "parts", radius if given else None
    )
