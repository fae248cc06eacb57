"""Weigh what a thinner tube keeps of a picture's small parts, such as eyes and letters, against its price."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from shapely import MultiPolygon

from knotfab.base.errors import SceneError
from knotfab.design.question import Question
from knotfab.picture.opening import Small, find_missed, open_by, thickest_radius
from knotfab.problem import Start
from knotfab.start.filling import enlarge_loops, fill

_SURE = 1.15  # room that strands need which serve several pictures, over that of one
_FINER = 0.86  # ratio of neighbouring radii that are tried
_HELPS = 0.5  # share of the lost parts that a thinner tube must keep, or it helps little
# a search takes as long as radius to minus this, for one view and for several, measured from 2.2 to 0.8 mm
_SLOWER = (1.4, 2.0)
_CHEAP = 5.0  # a search may take so many times as long unasked
_SMALLEST = 0.1  # least radius over the thinnest for which a larger picture is looked for
# width of the strokes of several line drawings, in tube diameters, by how many there are: below the first
# strands have no room beside those of the other views (two at 1.8 lost whole arcs, three at 3.8 ended at .85,
# four at 5 at .81); from the second on they were drawn as well as other pictures are
_STROKES = {2: (2.0, 2.5), 3: (4.2, 5.0), 4: (6.5, 10.0)}
_MOSTLY = 0.5  # share of a picture in such strokes
_DRAWN = 0.8  # IoU of a start that the search can mend

Found = Sequence[tuple[int, Small]]  # small parts, each with the number of its picture


@dataclass(frozen=True)
class SmallParts:
    """What the usual tube loses of the pictures' small parts, and what keeps them.

    `keeping_mm` is the thickest radius that loses no more than the thinnest one; None where that keeps few.
    `beyond` are lost by the thinnest too; `larger` is how many times as large the pictures would have to be
    for it to keep these, None if nothing is known to help.
    """

    usual_mm: float
    lost: Found
    keeping_mm: float | None = None
    beyond: Found = ()
    larger: float | None = None
    several: bool = False  # whether there are several pictures

    @property
    def slower(self) -> float:
        """How many times as long a search takes with the radius that keeps them."""
        kept = self.keeping_mm or self.usual_mm
        return float((self.usual_mm / kept) ** _SLOWER[self.several])

    @property
    def taken(self) -> bool:
        """Whether a build takes the thinner tube unasked, because it costs little."""
        return self.keeping_mm is not None and self.slower <= _CHEAP


def weigh_small(
    missed: Callable[[float], Found],
    usual: float,
    thinnest: float,
    bend: float,
    polygons: Sequence[MultiPolygon],
) -> SmallParts | None:
    """Find the thickest tube that keeps what a person would miss; None where the usual one loses nothing.

    Args:
        missed: returns the small parts that a tube of a radius, mm, loses.
        usual: the radius that would be taken otherwise, mm. thinnest: the printer's, mm.
        bend: the least bend radius of the thinnest tube, mm. polygons: the pictures, mm.
    """
    lost = missed(usual)
    if not lost:
        return None
    # from thick to thin, as templates of thin tubes take long
    steps = int(np.ceil(np.log(thinnest / usual) / np.log(_FINER)))
    keeping, beyond = usual, lost
    for radius in np.geomspace(usual, thinnest, steps + 1)[1:].round(4).tolist():
        found = missed(radius)
        if len(found) < len(beyond):
            keeping, beyond = radius, found
        if not beyond:
            break
    if len(beyond) > (1.0 - _HELPS) * len(lost):
        return SmallParts(usual, lost, None, lost, _enlargement(lost, polygons, thinnest, bend))
    larger = _enlargement(beyond, polygons, thinnest, bend)
    return SmallParts(usual, lost, keeping, beyond, larger, len(polygons) > 1)


def _enlargement(
    lost: Found, polygons: Sequence[MultiPolygon], thinnest: float, bend: float
) -> float | None:
    """Return how many times as large the pictures must be for the thinnest tube to keep these parts."""
    for share in np.geomspace(1.0, _SMALLEST, 24).tolist() if lost else ():
        if not any(missed_alone([s], polygons[n], share * thinnest, share * bend) for n, s in lost):
            return 1.0 / share if share < 1.0 else None
    return None


def missed_alone(
    small: Sequence[Small], polygon: MultiPolygon, radius: float, bend: float
) -> list[Small]:
    """Return the small parts of a picture that a tube may lose where it passes through several pictures.

    A piece must hold a closed tube by itself, since no strand comes to it from elsewhere. A hole must be
    wider than the tube.

    Args:
        radius: of the tube, mm. bend: its least bend radius, mm.
    """
    pieces = [s for s in small if s.kind == "piece"]
    holes = [s for s in small if s.kind == "hole"]
    lost = [s for s in holes if open_by(s.shape, radius).is_empty]
    if pieces:
        alone = fill(MultiPolygon([s.shape for s in pieces]), _SURE * radius)
        lost += find_missed(pieces, polygon, enlarge_loops(alone, _SURE * bend).tube, radius)
    return lost


def require_strokes(question: Question, start: Start) -> None:
    """Refuse several drawings of thin lines of which the start draws too little to be mended.

    Raises:
        SceneError: names the width of the strokes, and the height at which they are wide enough.
    """
    views, scene = question.problem.views, question.scene
    alone = question.problem.apart_mm is None and "unrecognisable" not in scene.accuracy.accept
    if len(views) < 2 or not alone or min(start.ious, default=1.0) >= _DRAWN:
        return
    thinnest = scene.printer.min_tube_radius_mm
    bare, bold = _STROKES[min(len(views), max(_STROKES))]
    widths = [
        thickest_radius(view.polygon, _MOSTLY, thinnest / 64, bare * thinnest) for view in views
    ]
    thin = [(w, view) for w, view in zip(widths, views, strict=True) if w and w < bare * thinnest]
    if not thin:
        return
    half, target = min(thin, key=lambda found: found[0])
    on_wall = 2.0 * target.view.magnification
    height = views[0].view.frame_mm[1] * bold * thinnest / half
    fewer = ", or show fewer of them" if len(views) > 2 else ""
    raise SceneError(
        f"picture {target.view.title or target.view.name}",
        f"most of its strokes are {on_wall * half:.1f} mm wide on the wall, and lines are drawn from "
        f"{len(views)} sides where they are {on_wall * bold * thinnest:.1f} mm, {bold:g} times what a tube "
        "draws",
        f"Make the pictures {np.ceil(height / 10) * 10:.0f} mm high (--height), or their strokes bolder"
        f"{fewer}; --accept unrecognisable builds them nevertheless.",
    )
