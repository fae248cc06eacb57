"""Cut a tube too large for the printer at straight, hidden places, into as few pieces as fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from knotfab.base.arrays import Array, Indices
from knotfab.base.errors import SceneError
from knotfab.geometry.tube import Mesh, as_manifold, as_mesh
from knotfab.hold.solids import place_along
from knotfab.part.orient import spread_turns
from knotfab_formats.libraries import took_part

if TYPE_CHECKING:
    from manifold3d import Manifold

PIN_RADII = 2.0  # tube radii by which a pin sticks out of the cut
PIN_SHARE = 0.5  # a pin's radius over the tube's, where the bend leaves room for it
LEAST_SHARE = 0.25
CLEARANCE_MM = 0.12  # the pin's play in its hole, all round
WALL_NOZZLES = 1.1  # round the hole
PIN_NOZZLES = 0.6  # the least radius of a pin, in nozzles
STARTS = 24  # places at which the first cut is tried
TURNS = 40  # ways up in which a piece may fit


@dataclass(frozen=True)
class Line:
    """The centre line of a knot, with all that must be known to cut it.

    `points` (n, 3) mm, closed; `hidden` (n,) from 0 (on the picture's outline) to 1 (well inside);
    `barred` (n,) where nothing may be cut because a peg is near. `beside` (k, 3) are points of what
    hangs on it (pegs), and `beside_of` (k,) their vertices.
    """

    points: Array
    radius: float
    hidden: Array
    barred: NDArray[np.bool_]
    beside: Array
    beside_of: Indices


@dataclass(frozen=True)
class Cut:
    """A cut through vertex `vertex`, at `point` (3,), across `along` (3,), a unit vector.

    The pin sticks out along `along` times `side`, which is 1 if it belongs to the piece before the
    cut.
    """

    vertex: int
    point: Array
    along: Array
    side: int
    pin_radius: float
    pin_length: float


def find_cuts(
    line: Line, build_volume_mm: tuple[float, float, float], nozzle_mm: float, name: str
) -> list[Cut]:
    """Find cuts, in order of their vertices, into pieces that each fit the build volume.

    The curve is followed from several first places as far as it still fits, any of `TURNS` ways up,
    and cut at the best place before that; the fewest pieces win, then the best places. A place is
    good if a thick pin finds room (the curve is straight) and far from the picture's outline.

    Raises:
        SceneError: the tube is too thin for a pin, too bent, or a piece would need to be too short.
    """
    places = _rate_places(line, nozzle_mm)
    if len(places) < 2:
        least = max(PIN_NOZZLES * nozzle_mm, LEAST_SHARE * line.radius)
        wall = CLEARANCE_MM + WALL_NOZZLES * nozzle_mm
        raise SceneError(
            "the printer's build volume",
            f"{name} does not fit, and it has {len(places)} places where it could be cut: a pin of "
            f"{2 * least:.2f} mm with {wall:.2f} mm of clearance and wall round it does not go into "
            f"a tube of {2 * line.radius:.2f} mm where that is bent",
            "Use a larger printer, a smaller frame, a finer nozzle or a thicker tube",
        )
    at = np.array(sorted(places), dtype=np.int64)
    worth = np.array([places[int(i)][2] for i in at])
    span = _Spans(line, build_volume_mm)
    best: tuple[int, float, list[int]] | None = None
    for first in at[:: max(1, len(at) // STARTS)]:
        # how far back from the last place that fits the best is sought
        for early in (1.0, 0.85, 0.7):
            found = _cut_greedily(span, at, worth, int(first), early)
            if found is None:
                continue
            quality = -float(worth[np.searchsorted(at, np.sort(found))].min())
            if best is None or (len(found), quality) < best[:2]:
                best = len(found), quality, found
    if best is None:
        room = " x ".join(f"{side:.0f}" for side in build_volume_mm)
        raise SceneError(
            "the printer's build volume",
            f"{name} does not fit {room} mm, and between the {len(at)} places where it could be "
            "cut there are pieces that do not fit either",
            "Use a larger printer or a smaller frame",
        )
    along, pin = _tangents(line.points), PIN_RADII * line.radius
    return [Cut(v, line.points[v], along[v], *places[v][:2], pin) for v in sorted(best[2])]


def _rate_places(line: Line, nozzle: float) -> dict[int, tuple[int, float, float]]:
    """Map each vertex that may be cut to the pin's side, its radius, and how good the place is."""
    p, r = line.points, line.radius
    edge = np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1)
    reach = PIN_RADII * r + 0.5 * r
    steps = int(np.ceil(reach / max(float(np.median(edge)), 1e-9))) + 1
    along = _tangents(p)
    away: dict[int, Array] = {}
    for side in (1, -1):
        worst = np.zeros(len(p))
        walked = np.zeros(len(p))
        here = p
        for step in range(1, min(steps * 2, len(p) // 3)):
            there = np.roll(p, -side * step, axis=0)
            # edges are not quite even: each vertex walks as far as the hole goes
            inside = walked <= reach
            gap = there - p
            off = gap - np.einsum("ij,ij->i", gap, along)[:, None] * along
            worst = np.where(inside, np.maximum(worst, np.linalg.norm(off, axis=1)), worst)
            walked += np.linalg.norm(there - here, axis=1)
            here = there
            if not inside.any():
                break
        away[side] = worst
    found = {}
    least = max(PIN_NOZZLES * nozzle, LEAST_SHARE * r)
    for i in np.flatnonzero(~line.barred):
        side = 1 if away[1][i] <= away[-1][i] else -1
        room = r - CLEARANCE_MM - WALL_NOZZLES * nozzle - float(away[side][i])
        pin = min(PIN_SHARE * r, room)
        # the piece with the pin must be straight too, or the pin's root comes out of it
        if pin >= least and away[-side][i] <= 0.5 * r:
            found[int(i)] = (side, pin, pin / (PIN_SHARE * r) + float(line.hidden[i]))
    return found


def _tangents(points: Array) -> Array:
    """Return the normals of the planes that bisect the angles, (n, 3)."""
    ahead = np.roll(points, -1, axis=0) - points
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    along = ahead + np.roll(ahead, 1, axis=0)
    return np.asarray(along / np.linalg.norm(along, axis=1)[:, None])


class _Spans:
    """How far a curve can be followed from a vertex before it no longer fits the printer."""

    def __init__(self, line: Line, room: tuple[float, float, float]) -> None:
        turns = spread_turns(TURNS)
        self.low = np.einsum("nj,tkj->ntk", line.points, turns) - line.radius
        self.high = self.low + 2 * line.radius
        side = np.einsum("nj,tkj->ntk", line.beside, turns)
        np.minimum.at(self.low, line.beside_of, side)
        np.maximum.at(self.high, line.beside_of, side)
        # square to the bed either way round; a little less than all, as facets stand out
        a, b, c = (0.995 * side for side in room)
        self.rooms = np.array([[a, b, c], [b, a, c]])
        edge = np.linalg.norm(np.roll(line.points, -1, axis=0) - line.points, axis=1)
        self.pin = int(np.ceil(PIN_RADII * line.radius / max(float(np.median(edge)), 1e-9)))
        self.count = len(line.points)
        self.known: dict[int, int] = {}

    def fits(self, first: int) -> int:
        """Count the vertices of the longest piece from `first` that fits, pins included."""
        if first in self.known:
            return self.known[first]
        n = self.count
        index = (first - self.pin + np.arange(n)) % n
        size = np.maximum.accumulate(self.high[index], axis=0)
        size = size - np.minimum.accumulate(self.low[index], axis=0)
        good = (size[:, :, None, :] <= self.rooms).all(axis=-1)
        good = good.reshape(n, -1).any(axis=-1)
        longest = n if good.all() else int(good.argmin())
        self.known[first] = max(0, longest - 2 * self.pin - 1)
        return self.known[first]


def _cut_greedily(
    span: _Spans, at: Indices, worth: Array, first: int, early: float
) -> list[int] | None:
    """Choose cuts from `first` all round; None if a piece does not reach the next place."""
    n, cuts, here, gone = span.count, [first], first, 0
    while True:
        reach = span.fits(here)
        if gone + reach >= n:
            return cuts if len(cuts) > 1 else None
        ahead = (at - here) % n
        near = np.flatnonzero((ahead > early * reach - 1) & (ahead <= reach) & (ahead > 0))
        if not len(near):
            near = np.flatnonzero((ahead > 0) & (ahead <= reach))
            if not len(near):
                return None
            near = near[[int(ahead[near].argmax())]]
        pick = int(near[int(worth[near].argmax())])
        gone += int(ahead[pick])
        if gone >= n:
            return None
        here = int(at[pick])
        cuts.append(here)


# Cut a body where its tube is cut, and give the pieces pins and holes that hold them together.

KERF_MM = 0.01  # the matter that is lost at a cut
DEEPER_MM = 0.3  # a hole is deeper than its pin is long, by this
SIDES = 32


@dataclass(frozen=True)
class CutPiece:
    """A piece of a cut body: its mesh, and the stretch (n, 3) of centre line that it holds."""

    mesh: Mesh
    points: Array


def cut_body(
    body: Mesh, points: Array, radius: float, gap_mm: float, cuts: Sequence[Cut]
) -> list[CutPiece]:
    """Cut a tube, and what hangs on it, at two or more places; pieces in order of the cuts.

    A slice of `KERF_MM` is taken out at each cut. Of the pieces beside it, one gets a pin with a
    chamfered tip, the other a hole that is wider by `CLEARANCE_MM` all round and a little deeper.

    Args:
        body: closed mesh, whose tube has the centre line `points` (n, 3).
        gap_mm: to the nearest other strand, which the slice must not touch.
        cuts: in order of their vertices.

    Raises:
        SceneError: the cuts do not part the body into that many pieces.
    """
    from manifold3d import Manifold, OpType

    solid = as_manifold(body)
    took_part("manifold3d", "cut the plates apart")
    slices = [
        place_along(
            Manifold.cylinder(KERF_MM, radius + 0.45 * gap_mm, -1, SIDES, True),
            cut.along,
            cut.point,
        )
        for cut in cuts
    ]
    parts = Manifold.batch_boolean([solid, *slices], OpType.Subtract).decompose()
    found = _in_order(parts, points, radius, cuts)
    lost = solid.volume() - sum(part.volume() for part in parts)
    section = np.pi * radius**2 * KERF_MM * len(cuts)
    if found is None or any(p.genus() != 0 for p in found) or not 0.8 < lost / section < 1.2:
        raise SceneError(
            "the cut of a knot",
            f"{len(cuts)} cuts came out as {len(parts)} pieces, "
            f"and take {lost:.4g} mm³ away instead of {section:.4g}",
            "Use a larger printer or a smaller frame, or report this scene",
        )
    for number, cut in enumerate(cuts):
        before, after = (number - 1) % len(cuts), number
        pinned, holed = (before, after) if cut.side > 0 else (after, before)
        outward = cut.along * cut.side
        pin, hole = _make_connector(cut, radius)
        found[pinned] = found[pinned] + place_along(pin, outward, cut.point)
        found[holed] = found[holed] - place_along(hole, outward, cut.point)
    pieces = []
    for number, (part, cut) in enumerate(zip(found, cuts, strict=True)):
        last = cuts[(number + 1) % len(cuts)].vertex
        count = (last - cut.vertex) % len(points)
        own = points[(cut.vertex + np.arange(count + 1)) % len(points)]
        if part.genus() != 0 or len(part.decompose()) != 1:
            raise SceneError(
                "the cut of a knot",
                f"piece {number + 1} is not one ball with its pin and hole",
                "Use a larger printer or a smaller frame, or report this scene",
            )
        pieces.append(CutPiece(as_mesh(part), own))
    return pieces


def _make_connector(cut: Cut, radius: float) -> tuple[Manifold, Manifold]:
    """Make the pin and the hole along z, with the cut at z = 0."""
    from manifold3d import CrossSection

    pin, long = cut.pin_radius, cut.pin_length
    chamfer = 0.3 * pin  # a share of the pin's radius, at its tip
    root = 0.5 * radius  # a pin goes so far back into its own piece
    profile = [(0, -root), (pin, -root), (pin, long - chamfer), (pin - chamfer, long), (0, long)]
    wide = pin + CLEARANCE_MM
    # a polygon's flats lie inside its circle: the hole's must not come nearer than the clearance
    wide /= np.cos(np.pi / SIDES)
    deep = long + DEEPER_MM
    hole = [(0.0, -root), (wide, -root), (wide, deep), (0.0, deep)]
    return (
        CrossSection([np.array(profile, dtype=np.float64)]).revolve(SIDES),
        CrossSection([np.array(hole, dtype=np.float64)]).revolve(SIDES),
    )


def _in_order(
    parts: list[Manifold], points: Array, radius: float, cuts: Sequence[Cut]
) -> list[Manifold] | None:
    """Order the parts by the cut that each begins at; None unless there is one for each cut."""
    if len(parts) != len(cuts):
        return None
    tree = cKDTree(points)
    starts = np.array([cut.vertex for cut in cuts])
    order: dict[int, Manifold] = {}
    for part in parts:
        vertices, _ = as_mesh(part)
        away, nearest = tree.query(vertices[:: max(1, len(vertices) // 500)])
        nearest = nearest[away <= 1.1 * radius]
        stretch = (np.searchsorted(starts, nearest, side="right") - 1) % len(cuts)
        order[int(np.bincount(stretch, minlength=len(cuts)).argmax())] = part
    return [order[k] for k in range(len(cuts))] if len(order) == len(cuts) else None
