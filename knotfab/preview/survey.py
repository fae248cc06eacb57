"""What can be said of a picture before anything is searched: pieces, holes, what tubes lose, size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from shapely import MultiPolygon, Polygon

from knotfab.arrays import Mask
from knotfab.design.candidates import drawing_radius, line_radius, too_fine, usual_radii
from knotfab.design.frames import frame_view, framed_alike
from knotfab.errors import SceneError
from knotfab.preview.guess import Guess, guess_print
from knotfab.preview.likeness import (
    Likeness,
    compare_lines,
    estimate_likeness,
    opened_share,
    recognisable_radius,
)
from knotfab.scene.catalogue import resolve
from knotfab.scene.model import ResolvedView, Scene
from knotfab.target.masks import holes_of, pieces_of
from knotfab.target.opening import (
    Loss,
    closed_iou,
    find_losses,
    open_by,
    opening_iou,
    thickest_radius,
    whole_radius,
)
from knotfab.target.read import Target
from knotfab.target.silhouette import trace_polygon
from knotfab.target.thicken import run_together

__all__ = ["DRAWN_WELL", "Survey", "ViewSurvey", "require_drawable", "survey", "survey_views"]

DRAWN_WELL = 0.97  # IoU of the opening with which a picture is drawn well
_HOPELESS = 0.45  # IoU that strokes drawn too thick reach, below which no search helps
_USUAL_SHARE = 0.014  # tube radius over the frame's longer side, where the picture has room
_CANDIDATES = 4  # radii that are shown
_ALL = 0.95  # of the silhouette
_BLOBS = 0.3  # of strokes as wide as the tube that run together, above which they are no drawing
_FEW = 200  # pieces and holes of a picture whose polygons are opened
_SADDLE = 1.4  # bend radii: half the least ring of a lone piece, which is to be deep, a saddle
_SPECK = 0.5  # radii of the thinnest tube: the side of a square as large as what nobody misses
_SPARE = 0.3  # px that an outline may move by
_MOST_FRAMES = 24  # of a sequence that are looked at


@dataclass(frozen=True)
class ViewSurvey:
    """One picture: its silhouette in px, and what it takes to draw it. Radii in mm of the piece.

    `feasible_mm`: the thickest tube that fills it well, None where none does that can be printed, or where it
    is drawn along its lines. `whole_mm`: the thickest of these that loses no part of it, None where none is
    that thin.
    `losses`: for each candidate radius what it loses, in px of the picture. `together`: the share of its
    strokes, as wide as the tube along them, that run together; 0 where areas are filled. `likeness`: what
    the thinnest of these tubes could draw at best, None where that need not be asked; where nobody would know
    it, no losses are looked for.
    """

    view: ResolvedView
    target: Target
    polygon: MultiPolygon
    pieces: int
    holes: int
    feasible_mm: float | None
    whole_mm: float | None
    losses: dict[float, list[Loss]]
    together: float = 0.0
    likeness: Likeness | None = None

    @property
    def recognisable(self) -> bool:
        """Whether any of these tubes may draw it so that it is known."""
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
        """Of the silhouette at the middle of the piece."""
        return float(self.polygon.area) / self.px_per_mm**2

    @property
    def piece_mm(self) -> tuple[float, float]:
        """Width and height of the drawing at the middle of the piece."""
        left, top, right, bottom = self.polygon.bounds
        return (right - left) / self.px_per_mm, (bottom - top) / self.px_per_mm


@dataclass(frozen=True)
class Survey:
    """All pictures of a piece, the radius that it will have about, and a guess of the print."""

    views: tuple[ViewSurvey, ...]
    radius_mm: float
    thinnest_mm: float
    guess: Guess
    frames: int = 0  # of a sequence, of which `views` holds the one that is hardest to draw


def survey(scene: Scene, targets: Sequence[Target], sequence: bool = False) -> Survey:
    """Look at pictures as a tube would have to draw them.

    Args:
        targets: those of the scene's views in their order; of a sequence, its frames.
    """
    scene = resolve(scene)
    thinnest, asked = scene.printer.min_tube_radius_mm, scene.piece.tube_radius_mm
    frames = len(targets) if sequence else 0
    views = survey_views(scene, [_hardest(targets)] if sequence else targets)
    if views[0].view.lines == "on":
        radius = line_radius(views[0].view)
    elif isinstance(asked, str):
        feasible = [v.feasible_mm for v in views]
        known = [f for f in feasible if f is not None]
        usual = _USUAL_SHARE * max(v.view.longer_mm for v in views)
        radius = thinnest if len(known) < len(feasible) else max(thinnest, min(usual, *known))
    else:
        radius = asked
    first = views[0]
    return Survey(
        views,
        radius,
        thinnest,
        guess_print(scene, first.view, first.area_mm2, first.piece_mm, radius, first.pieces),
        frames,
    )


def survey_views(scene: Scene, targets: Sequence[Target]) -> tuple[ViewSurvey, ...]:
    """Each picture by itself, as `survey` says; the scene's printer is resolved."""
    if len(targets) > 1:
        scene = framed_alike(scene, targets)
    views = [frame_view(v, t) for v, t in zip(scene.views, targets, strict=True)]
    thinnest, asked = scene.printer.min_tube_radius_mm, scene.piece.tube_radius_mm
    if views[0].lines == "on":  # one tube for all strokes
        tried = [line_radius(views[0])]
    elif isinstance(asked, str):
        usual, thin = usual_radii(views, thinnest, _CANDIDATES)
        tried = sorted({round(r, 2) for r in (*thin[:1], *usual)})[: _CANDIDATES + 1]
    else:
        tried = [asked]
    found = []
    for view, target in zip(views, targets, strict=True):
        px = view.px_per_mm(target.width)
        polygon = _trace(target.mask)
        lines, feasible, whole = view.lines == "on", None, None
        likeness = (
            compare_lines(target.asked, target.judged, min(tried) * px)
            if lines
            else estimate_likeness(target.mask, min(tried) * px)
        )
        hopeless = likeness is not None and not likeness.recognisable
        plain = _without_specks(polygon, (_SPECK * min(tried) * px) ** 2)
        losses = {} if hopeless else _losses(plain, tried, px)
        if not (hopeless or lines):
            # of one picture each piece is a knot of its own
            measure = partial(_closed_iou, scene=scene, px=px) if len(targets) == 1 else opening_iou
            most = 0.5 * max(target.mask.shape)
            feasible = thickest_radius(plain, DRAWN_WELL, thinnest * px, most, measure)
        if feasible is not None:
            whole = _whole_radius(plain, losses, thinnest, feasible, px)
        found.append(
            ViewSurvey(
                view,
                target,
                polygon,
                len(pieces_of(target.mask)[1]),
                len(holes_of(target.mask)[1]),
                None if feasible is None else feasible / px,
                whole,
                losses,
                run_together(target.asked, target.judged, 2.0 * line_radius(view) * px)
                if lines
                else 0.0,
                likeness,
            )
        )
    return tuple(found)


def _without_specks(polygon: MultiPolygon, least: float) -> MultiPolygon:
    """The pieces and holes of at least this area, px²; all, where no piece is as large."""
    kept = [
        Polygon(piece.exterior, [hole for hole in piece.interiors if Polygon(hole).area >= least])
        for piece in polygon.geoms
        if Polygon(piece.exterior).area >= least
    ]
    return MultiPolygon(kept) if kept else polygon


def _losses(polygon: MultiPolygon, radii: Sequence[float], px: float) -> dict[float, list[Loss]]:
    """What tubes of these radii lose, up to the first that loses nearly all."""
    found: dict[float, list[Loss]] = {}
    opened: Polygon | MultiPolygon = polygon
    for radius in sorted(radii):  # of the opening before, which is simpler than the silhouette
        opened = open_by(opened, radius * px)
        found[radius] = find_losses(polygon, opened, radius * px)
        if sum(loss.shape.area for loss in found[radius]) > _ALL * polygon.area:
            break
    return found


def _closed_iou(polygon: MultiPolygon, radius: float, scene: Scene, px: float) -> float:
    """What closed tubes of a radius draw of the one picture, all in px; a mm has `px`."""
    bend, clear = scene.material.min_bend_radius_mm, scene.piece.clearance_mm
    least = radius + 0.5 * clear * px
    if not isinstance(bend, str):
        least = max(least, bend * px)
    flat = scene.piece.depth == "flat"
    if len(polygon.geoms) == 1 and not flat:
        least *= _SADDLE
    return closed_iou(polygon, radius, least, flat)


def _whole_radius(
    polygon: MultiPolygon,
    losses: dict[float, list[Loss]],
    thinnest: float,
    feasible: float,
    px: float,
) -> float | None:
    """The thickest radius, mm, up to which a tube loses nothing; None: the thinnest (mm) does.

    Of a part that lies beside what is drawn a far thicker tube no longer tells that it is lost. So what the
    thinner of the radii that are shown lose stands.

    Args:
        losses: of the radii that are shown. feasible: the thickest that may be taken, px.
    """
    low, high, clear = thinnest, feasible / px, False
    for radius in sorted(losses):
        if losses[radius]:
            high = min(high, radius)
            break
        low, clear = max(low, min(radius, high)), True
    if high <= low:
        return high if clear else None
    found = whole_radius(polygon, low * px, high * px)
    return None if found is None else found / px


def _trace(mask: Mask) -> MultiPolygon:
    """The silhouette in px, without vertices that a preview can spare."""
    shape = trace_polygon(mask).simplify(_SPARE)
    return shape if isinstance(shape, MultiPolygon) else MultiPolygon([shape])


def _hardest(targets: Sequence[Target]) -> Target:
    """The frame whose opening by a usual tube is worst."""
    few = targets[:: -(-len(targets) // _MOST_FRAMES)]
    return min(few, key=lambda t: opened_share(t.mask, _USUAL_SHARE * max(t.mask.shape)))


def require_drawable(found: Survey, scene: Scene) -> None:
    """Refuse at once what a search would refuse after minutes.

    That is a picture that nobody would know in the shadow of any tube, unless that is accepted. And one of
    thin lines: a stroke thinner than the tube is drawn too thick, at an IoU of their ratio. What the
    thinnest tube leaves out is taken to be drawn so.

    Raises:
        SceneError: a picture's lines are far too thin for any tube that can be printed; with what would do.
    """
    if "unrecognisable" not in scene.accuracy.accept:
        for one in found.views:
            if not one.recognisable:
                raise _unlike(one, found, resolve(scene))
    if len(found.views) > 1 or found.frames or scene.piece.tube_radius_mm != "auto":
        return
    printer, (seen,), thinnest = resolve(scene).printer, found.views, found.thinnest_mm
    target, pixels = seen.target, (seen.target.width, seen.target.height)
    if seen.view.lines == "on":
        radius = line_radius(seen.view)
        if seen.together > _BLOBS:
            raise too_fine(
                recognisable_radius(target.asked, thinnest * seen.px_per_mm),
                seen.view,
                pixels,
                printer,
                "its lines are too close together for any printable tube: as wide as one of "
                f"{2 * radius:g} mm, {seen.together:.0%} of them run together",
                otherwise="",
            )
        return
    radius = thinnest * seen.px_per_mm
    if opening_iou(seen.polygon, radius) >= _HOPELESS:
        return
    drawn = drawing_radius(seen.polygon, radius)
    spilled = 0.0 if drawn is None else drawn / radius
    if spilled < _HOPELESS:
        raise too_fine(
            drawn,
            seen.view,
            pixels,
            printer,
            f"it is too fine for any printable tube: {printer.name} prints none under {2 * thinnest:g} mm",
        )


def _unlike(seen: ViewSurvey, found: Survey, scene: Scene) -> SceneError:
    """The error for a picture that nobody would know in the shadow of a tube."""
    likeness, px, printer = seen.likeness, seen.px_per_mm, scene.printer
    assert likeness is not None
    asked = scene.piece.tube_radius_mm
    radius, tube = found.thinnest_mm, "any printable tube"
    if not isinstance(asked, str):
        radius, tube = asked, "such a tube"
    lost = f"which reaches an IoU of about {likeness.iou:.2f}"
    if likeness.changes:
        which = f"{likeness.changes} of its {likeness.features} pieces and holes"
        lost = f"where {which} are lost or run together"
    if likeness.features > _FEW:  # of these an opening takes seconds, and there are many to try
        drawn = recognisable_radius(seen.target.asked, radius * px)
    else:
        drawn = drawing_radius(_trace(seen.target.asked), radius * px)
    otherwise = "--accept unrecognisable to build it nevertheless"
    if drawn is not None and drawn >= printer.min_tube_radius_mm * px:
        least = max(drawn / px, printer.min_tube_radius_mm)
        otherwise = f"a thinner tube (--tube-radius {least:.2f}), or {otherwise}"
    return too_fine(
        drawn,
        seen.view,
        (seen.target.width, seen.target.height),
        printer,
        f"it is too fine for {tube}: nobody would know {seen.target.name} in the shadow of one of "
        f"{radius:g} mm radius, {lost}",
        otherwise,
        "parts",
    )
