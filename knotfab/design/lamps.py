"""Place several lamps before one screen, so that each draws its own mask and casts no stray shadow on it.

Two lamps d apart, at distance H from the wall, cast shadows of a point at distance h that are k·d apart, with
k = h / (H - h). If the screen ends at the picture's frame, a piece whose other shadows miss the screen draws
one mask alone. The lamps stand just far enough apart for that: in a row, a column, or several rows. The least
k is taken for which they keep their bounds and the pieces fit the printer, since a lamp misplaced by 1 mm
moves its picture by k mm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from knotfab.base.arrays import Array, Mask
from knotfab.design.candidates import DEPTH_RATIO
from knotfab.design.frames import frame_view
from knotfab.design.hull import hull_bounds
from knotfab.picture.read import Target
from knotfab.picture.silhouette import fit_size, sample_mask
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedScene, ResolvedView

# default length of the picture's longer side: pieces for three lamps fit most printers side by side
LAMPS_FRAME_MM = 120.0
_WHOLE_MM = 800.0  # default distance from the wall to the lamps
_STEPS = tuple(np.round(np.arange(0.30, 1.51, 0.02), 2).tolist())  # values of k to try
_SPARE_MM = 3.0  # gap on the wall between a stray shadow and the screen
_NEAR = (
    "no places within the bounds keep each lamp's other shadows off the screen: what stands in the middle "
    "draws several masks, and is lost where they contradict each other"
)
_OPEN = "the wall goes on beside the picture, so each shadow of what is drawn must fall on a mask"
_COARSE = 20  # the search by the hull tries every 20th distance
_SHARES = (1.0, 0.6, 0.3)  # shares of the bounds that it spreads the lamps over
_MASK_PX, _RAYS_PX, _RAY_STEPS = 120, 48, 96  # its resolution
_BETTER = 0.002  # gain of a bound (IoU) for which it prefers other places
_MOST_DEPTH = 0.2  # half the deepest piece, over its distance from wall or lamp


@dataclass(frozen=True)
class _Places:
    """Offsets of the lamps from the axis, right and up, (n, 2) mm, and the size of all pieces, mm."""

    beside: Array
    across: tuple[float, float]


def place_lamps(
    scene: ResolvedScene, targets: Sequence[Target]
) -> tuple[ResolvedScene, tuple[str, ...]]:
    """Place lamps and piece before the screen; return the scene and the messages about it.

    Given distances are kept. If no places within the bounds keep stray shadows off the screen, the lamps go
    where the visual hull draws the worst mask best, and a message says so.
    """
    if not scene.share_wall or scene.lamps.places == "fixed":
        return scene, ()
    found = _find_apart(scene, targets) if scene.lamps.screen == "ends" else None
    lines: tuple[str, ...] = ()
    if found is None:
        found = _find_by_hull(scene, targets)
        lines = (_OPEN if scene.lamps.screen == "open" else _NEAR,)
    wall, light, beside = found
    placed = tuple(
        v.but(**_lengths(wall, light), light_right_mm=float(x), light_up_mm=float(y))
        for v, (x, y) in zip(scene.views, beside, strict=True)
    )
    where = ", ".join(
        f"{v.name} {_offset_words(v.light_right_mm, 'right', 'left')}"
        f"{_offset_words(v.light_up_mm, 'up', 'down')}".strip()
        for v in placed
    )
    told = f"lamps {wall + light:g} mm before the screen: {where}; the piece {wall:g} mm before it"
    table = scene.lamps.but(places="fixed")
    return scene.but(views=placed, lamps=table), (told, *lines)


def _find_apart(
    scene: ResolvedScene, targets: Sequence[Target]
) -> tuple[float, float, Array] | None:
    """Find distances of wall and lamps, and offsets (n, 2) of the lamps, mm, that keep all pieces apart.

    Return the first that fit the printer, or else the first within the bounds, or None.
    """
    views = [frame_view(v, t) for v, t in zip(scene.views, targets, strict=True)]
    boxes = np.array([_box(t.mask, v) for t, v in zip(targets, views, strict=True)])
    frame, first = np.array(views[0].frame_mm), views[0]
    # leave 12 mm of the printer's bed free
    narrow, wide = (s - 12.0 for s in sorted(scene.printer.build_volume_mm)[1:])
    bounds = 2.0 * np.array([scene.lamps.max_right_mm, scene.lamps.max_up_mm])
    # a stand's posts below an upper piece would shade a lower one
    most_rows = 1 if scene.mount.kind == "stand" else len(views)
    large: tuple[float, float, Array] | None = None
    for wall, light in _distances(scene):
        depth = depth_of_lamps(boxes, first.but(**_lengths(wall, light)))
        found = [
            p
            for p in _arrangements(boxes, frame, depth, (wall, light), most_rows)
            if (np.ptp(p.beside, axis=0) <= bounds).all()
        ]
        found.sort(key=lambda p: float(np.hypot(*p.beside.T).max()))
        if found and large is None:
            large = wall, light, found[0].beside
        for places in found:
            if max(places.across) <= wide and min(places.across) <= narrow:
                return wall, light, places.beside
    return large


def _find_by_hull(scene: ResolvedScene, targets: Sequence[Target]) -> tuple[float, float, Array]:
    """Find the places, returned as by `_find_apart`, whose visual hull draws the worst mask best.

    It tries a row, a column and a regular polygon in several sizes, with every order of the lamps.
    """
    framed = [frame_view(v, t) for v, t in zip(scene.views, targets, strict=True)]
    few = [fit_size(t.width, t.height, _MASK_PX) for t in targets]
    masks = [sample_mask(t.mask, *size) for t, size in zip(targets, few, strict=True)]
    bounds = np.array([scene.lamps.max_right_mm, scene.lamps.max_up_mm])
    count, ends = len(targets), scene.lamps.screen == "ends"
    best: tuple[float, float, float, Array] | None = None
    for (wall, light), share, order in product(
        list(_distances(scene))[::_COARSE], _SHARES, permutations(range(count))
    ):
        for layout in _layouts(count):
            beside = np.round(share * bounds * layout[list(order)], 1)
            cameras = [
                camera_of(view.but(**_lengths(wall, light), light_right_mm=x, light_up_mm=y), *size)
                for view, size, (x, y) in zip(framed, few, beside.tolist(), strict=True)
            ]
            reach = min(0.9 * wall, 0.5 * light)
            found = hull_bounds(cameras, masks, reach, _RAYS_PX, _RAY_STEPS, ends=ends)
            worst = min(b.iou for b in found)
            if best is None or worst > best[0] + _BETTER:
                best = worst, wall, light, beside
    assert best is not None
    return best[1:]


def _layouts(count: int) -> Iterator[Array]:
    """Yield offsets (n, 2) from -1 to 1 of lamps in a row, a column, and on a circle."""
    along = np.linspace(-1.0, 1.0, count)
    yield np.column_stack([along, np.zeros(count)])
    yield np.column_stack([np.zeros(count), along])
    angle = np.pi / 2 + 2 * np.pi * np.arange(count) / count
    if count > 2:
        yield np.column_stack([np.cos(angle), np.sin(angle)])


def depth_apart(views: Sequence[ResolvedView], masks: Sequence[Mask]) -> float | None:
    """Return the depth, mm, of pieces that draw one mask each and cast no other shadow on the screen.

    The screen ends at the frame. None means that the lamps stand too near to each other for that.
    """
    boxes = np.array([_box(m, v) for m, v in zip(masks, views, strict=True)])
    depth = depth_of_lamps(boxes, views[0])
    half = 0.5 * np.array(views[0].frame_mm)
    for i, one in enumerate(views):
        for j, other in enumerate(views):
            if i == j:
                continue
            away = np.array(
                [one.light_right_mm - other.light_right_mm, one.light_up_mm - other.light_up_mm]
            )
            if one.light_distance_mm != other.light_distance_mm:
                return None
            k = (one.wall_distance_mm - 0.5 * depth) / (one.light_distance_mm + 0.5 * depth)
            low, high = boxes[i, 0] + k * away, boxes[i, 1] + k * away
            if not ((low > half) | (high < -half)).any():
                return None
    return depth


def depth_of_lamps(boxes: Array, view: ResolvedView) -> float:
    """Return the depth, mm, of pieces that draw masks with these bounding boxes, (n, 2, 2) mm on the wall."""
    across = float((boxes[:, 1] - boxes[:, 0]).max()) / view.magnification
    most = 2.0 * _MOST_DEPTH * min(view.wall_distance_mm, view.light_distance_mm)
    return math.floor(10 * min(DEPTH_RATIO * across, most)) / 10


def _lengths(wall: float, light: float) -> dict[str, float]:
    return {"wall_distance_mm": wall, "light_distance_mm": light}


def _offset_words(far: float, one: str, other: str) -> str:
    return f"{abs(far):g} mm {one if far > 0 else other} " if far else ""


def _distances(scene: ResolvedScene) -> Iterator[tuple[float, float]]:
    """Yield distances from the piece to wall and lamps, mm, nearest to the wall first; given ones stay."""
    view = scene.views[0]
    given = {"wall_distance_mm", "light_distance_mm"} & view.model_fields_set
    for k in _STEPS:
        if len(given) == 2:
            yield view.wall_distance_mm, view.light_distance_mm
            return
        if "wall_distance_mm" in given:
            yield view.wall_distance_mm, float(round(view.wall_distance_mm / k))
        elif "light_distance_mm" in given:
            yield float(round(view.light_distance_mm * k)), view.light_distance_mm
        else:
            wall = float(round(_WHOLE_MM * k / (1 + k)))
            yield wall, _WHOLE_MM - wall


def _box(mask: Mask, view: ResolvedView) -> Array:
    """Return a mask's lower left and upper right corner, (2, 2) mm on the wall from the frame's centre."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    height, width = mask.shape
    w, h = view.frame_mm
    x = np.array([columns[0], columns[-1] + 1]) / width - 0.5
    y = 0.5 - np.array([rows[-1] + 1, rows[0]]) / height
    return np.array([[w * x[0], h * y[0]], [w * x[1], h * y[1]]])


def _arrangements(
    boxes: Array, frame: Array, depth: float, distances: tuple[float, float], most_rows: int
) -> Iterator[_Places]:
    """Yield, for each number of rows and each order, the closest places that cast no stray shadow."""
    count = len(boxes)
    for rows in range(1, most_rows + 1):
        for order in permutations(range(count)):
            yield _in_rows(boxes, frame, depth, distances, order, rows)


def _in_rows(
    boxes: Array,
    frame: Array,
    depth: float,
    distances: tuple[float, float],
    order: Sequence[int],
    rows: int,
) -> _Places:
    """Place lamps in rows, from the bottom left, each as near to the others as stray shadows allow.

    Args:
        distances: of wall and lamps from the middle of the piece, mm.
    """
    wall, light = distances
    k = (wall - 0.5 * depth) / (light + 0.5 * depth)
    groups = [list(g) for g in np.array_split(order, rows)]
    beside = np.zeros((len(boxes), 2))
    top, below = 0.0, list[int]()
    for group in groups:
        if below:
            top += max(_apart(boxes, frame, i, j, 1) for i in below for j in group) / k
        right = 0.0
        for n, lamp in enumerate(group):
            if n:
                right = max(beside[i, 0] + _apart(boxes, frame, i, lamp, 0) / k for i in group[:n])
            beside[lamp] = math.ceil(right), math.ceil(top)
        beside[group, 0] -= math.floor(0.5 * beside[group[-1], 0])
        below = group
    beside[:, 1] -= math.floor(0.5 * beside[:, 1].max())
    ats = [(wall + way * depth) / (wall + light) for way in (-0.5, 0.5)]
    low = np.min([boxes[:, 0] * (1 - at) + beside * at for at in ats], axis=(0, 1))
    high = np.max([boxes[:, 1] * (1 - at) + beside * at for at in ats], axis=(0, 1))
    across, up = (high - low).tolist()
    return _Places(beside, (across, up))


def _apart(boxes: Array, frame: Array, one: int, other: int, axis: int) -> float:
    """Return how far apart the shadows of two lamps must fall on the wall, mm; `one` is left or below."""
    half = 0.5 * frame[axis]
    return float(max(half + boxes[one, 1, axis], half - boxes[other, 0, axis])) + _SPARE_MM
