"""Find how the topology of a shadow differs from its picture's: pieces, holes, gaps and strokes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self, TypeVar

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.shadows.outlines import depth_in

Kind = Literal["piece", "hole", "gap", "stroke", "stray", "leak", "shape", "tip"]
Box = tuple[int, int, int, int]
"""Left, top, right and bottom, in pixels, the last two exclusive."""

COVERED = 1 / 3  # the covered share below which a piece or hole is lost
MOST_STRAY = 4.0  # reaches: the width up to which extra pieces of the shadow go unseen
SLACK_PX = 2.0  # px: how far around a place its width is taken from the narrowest
SHORT = 6.0  # reaches: a longer place where two pieces nearly touch is a slit
SHARED = 1 / 4  # the share of the smaller of two regions below which they merely touch

_EIGHT = np.ones((3, 3), dtype=bool)  # pieces connect at corners, so holes and gaps do not
_FOUR = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], dtype=bool)


def enlarge_box(box: Box, step: int) -> Box:
    left, top, right, bottom = box
    return left * step, top * step, right * step, bottom * step


@dataclass(frozen=True)
class Change:
    """One difference of topology.

    `piece` and `hole`: of the picture, lost in the shadow; `gap`: between pieces, or across a bay, bridged by
    the shadow; `stroke`: of a piece, broken; `stray` and `leak`: a piece and a hole that only the shadow has;
    `shape`: there, but drawn out of shape (see shapes.py).
    `where` (u, v) lies on the compared grid; `width_px` is the width of what was changed, of the widest
    disc that it holds or, of a gap and a stroke, across it in the picture. `box` is what it takes up.
    """

    kind: Kind
    where: tuple[float, float]
    width_px: float
    box: Box

    def enlarged(self, step: int) -> Self:
        """Return the change as it is on a grid `step` times as fine."""
        u, v = self.where
        where, box = (u * step, v * step), enlarge_box(self.box, step)
        return replace(self, where=where, width_px=self.width_px * step, box=box)


SomeChange = TypeVar("SomeChange", bound=Change)


def find_changes(shadow: Mask, target: Mask, reach_px: float) -> list[Change]:
    """Find every change of topology from the picture to its shadow that `reach_px` does not undo.

    Pieces (8-connected) and holes (4-connected) no longer than 2 `reach_px` are specks, which do not count. A
    piece is lost where less than `COVERED` of it lies within `reach_px` of the shadow, and a hole where less
    than that lies within `reach_px` of the light. What only the shadow has is the same with the roles
    exchanged; it counts where it is wider than `MOST_STRAY` times `reach_px`, and is nothing of the picture's
    grown large. Two pieces are bridged where they are apart in the picture closed by `reach_px`, and one in
    the shadow opened by it: by the duality of a planar set and its complement, a bay closed off is the
    same with background for pieces. Strokes are broken where picture opened and shadow closed say so.
    Opening and closing are those by a disc (Serra 1982). Regions
    count as one only across pixels' sides, and as apart only if corners do not touch either, so that two
    squares that touch at a corner are neither.

    Args:
        shadow, target: (H, W), on one grid.
        reach_px: how far an outline may be off without saying anything.

    Raises:
        ValueError: the masks lie on two grids.
    """
    if shadow.shape != target.shape:
        raise ValueError(f"masks of one grid are compared, got {shadow.shape} and {target.shape}")
    cropped = crop_to_ink(shadow, target, 2 * reach_px)
    if cropped is None:
        return []
    seen, wanted, corner = cropped
    dark, light = _grow(seen, reach_px), _grow(~seen, reach_px)
    ink, paper = _grow(wanted, reach_px), _grow(~wanted, reach_px)
    closed, opened = _shrink(dark, reach_px) | seen, ~_shrink(light, reach_px) & seen
    joined, thinned = _shrink(ink, reach_px) | wanted, ~_shrink(paper, reach_px) & wanted
    found = [
        *_find_lost("piece", wanted, dark, reach_px),
        *_find_lost("hole", ~wanted, light, reach_px),
        *_only_seen("stray", opened, wanted, ink, reach_px),
        *_only_seen("leak", ~closed, ~wanted, paper, reach_px),
        *_find_joined("gap", joined, opened, ~wanted, reach_px),
        *_find_joined("gap", ~opened, ~joined, ~wanted, reach_px),
        *_find_joined("stroke", closed, thinned, wanted, reach_px),
        *_find_joined("stroke", ~thinned, ~closed, wanted, reach_px),
    ]
    return [move_change(change, *corner) for change in found]


def crop_to_ink(
    shadow: Mask, target: Mask, edge_px: float
) -> tuple[Mask, Mask, tuple[int, int]] | None:
    """Crop both masks to the ink of both and an edge about it; return the corner too. None without ink.

    The edge, a little wider than `edge_px`, makes the outside one region and cuts no dilation by as
    much.
    """
    rows, columns = np.nonzero(shadow | target)
    if not len(rows):
        return None
    edge = int(np.ceil(edge_px)) + 2
    top, left = int(rows.min()), int(columns.min())
    window = slice(top, int(rows.max()) + 1), slice(left, int(columns.max()) + 1)
    return np.pad(shadow[window], edge), np.pad(target[window], edge), (left - edge, top - edge)


def close_slits(mask: Mask, reach_px: float) -> Mask:
    """Close the mask by a disc, which removes slits and pinholes no wider than 2 `reach_px`."""
    padded = np.pad(mask, int(np.ceil(reach_px)) + 2)
    edge = slice(int(np.ceil(reach_px)) + 2, -int(np.ceil(reach_px)) - 2)
    return (_shrink(_grow(padded, reach_px), reach_px) | padded)[edge, edge]


def without_lost(target: Mask, changes: Sequence[Change]) -> Mask:
    """Remove the lost pieces from the picture, and fill its lost holes."""
    kept = target.copy()
    for kind, ink, neighbours in (("piece", True, _EIGHT), ("hole", False, _FOUR)):
        labels, _ = _label(target == ink, neighbours)
        lost = [labels[int(c.where[1]), int(c.where[0])] for c in changes if c.kind == kind]
        kept[np.isin(labels, lost)] = not ink
    return kept


def without_specks(target: Mask, reach_px: float) -> Mask:
    """Remove pieces no longer than 2 `reach_px` from the picture, such as the dust of a scan."""
    labels, found = label_regions("piece", target, reach_px)
    return np.isin(labels, [number for number, _ in found])


def holes_at(changes: Sequence[Change], target: Mask) -> list[int]:
    """Return the number of the picture's hole that each change (u, v on the mask) is in; 0 for none."""
    labels, _ = _label(np.pad(~target, 1, constant_values=True), _FOUR)
    found = [int(labels[round(c.where[1]) + 1, round(c.where[0]) + 1]) for c in changes]
    return [0 if number == labels[0, 0] else number for number in found]


def count_repeated(gaps: Sequence[Change], target: Mask) -> int:
    """Count the bridged gaps in a hole of the picture that has another one already.

    A hole that strands cross is seen as one fault, however many cross it.
    """
    holes = [number for number in holes_at(gaps, target) if number]
    return len(holes) - len(set(holes))


def count_touching(target: Mask, reach_px: float) -> int:
    """Count where pieces of a picture barely touch or miss, as squares at their corners.

    No tube can draw such a place: it either runs through or leaves it open. Pieces are those of the
    picture opened by `reach_px`. A place lies where two are within that distance of the line midway
    between them, and is short, unlike a slit.
    """
    from scipy.ndimage import distance_transform_edt, find_objects

    cropped = crop_to_ink(target, target, 2 * reach_px)
    if cropped is None:
        return 0
    _, wanted, _ = cropped
    parts, count = _label(~_shrink(_grow(~wanted, reach_px), reach_px) & wanted, _FOUR)
    large = [n for n, _ in _regions(parts, count, reach_px)]
    if len(large) < 2:
        return 0
    away, (i, j) = distance_transform_edt(~np.isin(parts, large), return_indices=True)
    nearest = parts[i, j]
    meets = np.zeros_like(wanted)
    meets[:, 1:] |= nearest[:, 1:] != nearest[:, :-1]
    meets[1:] |= nearest[1:] != nearest[:-1]
    places, _ = _label(meets & (away <= reach_px), _EIGHT)
    sizes = [max(r.stop - r.start, c.stop - c.start) for r, c in find_objects(places)]
    return sum(size <= SHORT * reach_px for size in sizes)


def list_pieces(mask: Mask, reach_px: float) -> list[Box]:
    """List the bounding boxes of a mask's pieces and holes longer than 2 `reach_px`."""
    padded = np.pad(mask, 1)
    boxes = [
        *(box for _, box in label_regions("piece", padded, reach_px)[1]),
        *(box for _, box in label_regions("hole", ~padded, reach_px)[1]),
    ]
    return [(left - 1, top - 1, right - 1, bottom - 1) for left, top, right, bottom in boxes]


def find_widest(region: Mask) -> tuple[tuple[float, float], float]:
    """Return the centre (u, v) and the diameter of the widest disc in a region (H, W), px."""
    depth = depth_in(np.pad(region, 1))[1:-1, 1:-1]
    v, u = np.unravel_index(int(depth.argmax()), depth.shape)
    return (float(u), float(v)), 2 * float(depth.max()) - 1


def _grow(mask: Mask, reach: float) -> Mask:
    grown: Mask = depth_in(~mask) <= reach
    return grown


def _shrink(mask: Mask, reach: float) -> Mask:
    shrunk: Mask = depth_in(mask) > reach
    return shrunk


def _label(mask: Mask, neighbours: Mask) -> tuple[Ints, int]:
    from scipy.ndimage import label

    labels = np.empty(mask.shape, dtype=np.int64)
    return labels, int(label(mask, neighbours, output=labels))


def _regions(labels: Ints, count: int, reach: float) -> list[tuple[int, Box]]:
    """List regions longer than 2 `reach` with their number and bounding box."""
    from scipy.ndimage import find_objects

    found = []
    for number, window in enumerate(find_objects(labels, count), start=1):
        rows, columns = window
        if max(rows.stop - rows.start, columns.stop - columns.start) > 2 * reach:
            found.append((number, (columns.start, rows.start, columns.stop, rows.stop)))
    return found


def label_regions(kind: Kind, regions: Mask, reach: float) -> tuple[Ints, list[tuple[int, Box]]]:
    """Label all regions, and list those longer than 2 `reach` with their boxes.

    Holes and leaks are regions of the background; the one in the frame's corner is not listed.
    """
    light = kind in ("hole", "leak")
    labels, count = _label(regions, _FOUR if light else _EIGHT)
    found = _regions(labels, count, reach)
    return labels, [(n, box) for n, box in found if not (light and n == labels[0, 0])]


def _find_lost(kind: Kind, regions: Mask, kept: Mask, reach: float) -> Iterator[Change]:
    """Yield the pieces (or holes) in `regions` of which less than `COVERED` is in `kept`."""
    labels, found = label_regions(kind, regions, reach)
    for number, (left, top, right, bottom) in found:
        inside = labels[top:bottom, left:right] == number
        if kept[top:bottom, left:right][inside].mean() < COVERED:
            (u, v), width = find_widest(inside)
            yield Change(kind, (u + left, v + top), width, (left, top, right, bottom))


def _only_seen(
    kind: Kind, regions: Mask, wanted: Mask, kept: Mask, reach: float
) -> Iterator[Change]:
    """Yield the parts of `regions` that are not in the picture, nor a piece (or hole) of it grown large."""
    labels, count = _label(wanted, _EIGHT if kind == "stray" else _FOUR)
    areas = np.bincount(labels.ravel(), minlength=count + 1)
    specks = np.ones(count + 1, dtype=bool)
    specks[[n for n, _ in _regions(labels, count, reach)]] = False
    for change in _find_lost(kind, regions, kept, reach):
        left, top, right, bottom = change.box
        here = labels[top:bottom, left:right][regions[top:bottom, left:right]]
        shared = np.bincount(here, minlength=count + 1)
        grew = ~specks & (shared > SHARED * areas)
        if change.width_px > MOST_STRAY * reach and not grew[1:].any():
            yield change


def _find_joined(
    kind: Kind, parts: Mask, wholes: Mask, matter: Mask, reach: float
) -> Iterator[Change]:
    """Yield a change for each join of regions of `parts` within one region of `wholes`.

    Joins are those of a minimum spanning tree: the narrowest places, in `wholes`, between regions of
    `parts`. The width is that of `matter` there, of the picture's light or ink.
    """
    from scipy.sparse import csr_array

    # the first pair of gap and stroke are pieces, the second their complements
    pieces = not bool(parts[0, 0])
    part, count = _label(parts, _EIGHT)
    whole, count_whole = _label(wholes, _FOUR)
    large = np.zeros(count + 1, dtype=bool)
    large[[n for n, _ in _regions(part, count, reach)]] = True
    large[0] = False
    both = (part > 0) & (whole > 0)
    ones = np.ones(int(both.sum()), dtype=np.int64)
    shape = count + 1, count_whole + 1
    overlaps = csr_array((ones, (part[both], whole[both])), shape=shape)
    overlaps.sum_duplicates()
    p, w = overlaps.nonzero()
    shared = overlaps.data
    areas, areas_whole = np.bincount(part.ravel()), np.bincount(whole.ravel())
    real = large[p] & (shared >= SHARED * np.minimum(areas[p], areas_whole[w]))
    members: dict[int, set[int]] = {}
    for a, b in zip(p[real].tolist(), w[real].tolist(), strict=True):
        members.setdefault(b, set()).add(a)
    several = {b: inside for b, inside in members.items() if len(inside) > 1}
    if not several:
        return
    depth = depth_in(matter)
    for number, inside in several.items():
        yield from _find_narrowest(kind, part, inside, whole == number, depth, pieces)


def _find_narrowest(
    kind: Kind, part: Ints, inside: set[int], room: Mask, across: Array, pieces: bool
) -> Iterator[Change]:
    """Yield the narrowest places of the n - 1 joins between the regions `inside`."""
    from scipy.ndimage import distance_transform_edt

    rows, columns = np.nonzero(room)
    window = (
        slice(int(rows.min()), int(rows.max()) + 1),
        slice(int(columns.min()), int(columns.max()) + 1),
    )
    numbers, room = part[window], room[window]
    apart = ~np.isin(numbers, list(inside))
    if not apart.any():
        return
    distance, (i, j) = distance_transform_edt(apart, return_indices=True)
    nearest = numbers[i, j]
    meetings = []
    for a, b in (
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
        ((slice(None, -1), slice(None)), (slice(1, None), slice(None))),
    ):
        meets = (nearest[a] != nearest[b]) & room[a] & room[b]
        v, u = np.nonzero(meets)
        ends = np.sort(np.stack([nearest[a][meets], nearest[b][meets]]), axis=0)
        meetings.append(np.stack([distance[a][meets] + distance[b][meets], u, v, *ends], axis=1))
    lines = np.concatenate(meetings)
    lines = lines[np.argsort(lines[:, 0], kind="stable")]
    root = {n: n for n in inside}

    def find(n: int) -> int:
        while root[n] != n:
            n = root[n]
        return n

    pairs, which = np.unique(lines[:, 3:], axis=0, return_inverse=True)
    for k in np.argsort(np.unique(which, return_index=True)[1]):
        one, other = find(int(pairs[k, 0])), find(int(pairs[k, 1]))
        if one == other:
            continue
        root[one] = other
        # pieces meet across their join at its narrowest; what parts their complements lies along it
        here = lines[which == k]
        here = here[here[:, 0] <= here[0, 0] + SLACK_PX] if pieces else here
        u, v = (here[:, 1:3].astype(int) + (window[1].start, window[0].start)).T
        middle = int(across[v, u].argmax())
        wide = max(2 * float(across[v[middle], u[middle]]) - 1, 0.0)
        x, y, half = int(u[middle]), int(v[middle]), round(wide / 2) + 1
        yield Change(kind, (float(x), float(y)), wide, (x - half, y - half, x + half, y + half))


def move_change(change: SomeChange, du: int, dv: int) -> SomeChange:
    """Move a change by (du, dv) px, as from a cropped picture to the whole one."""
    (u, v), (left, top, right, bottom) = change.where, change.box
    box = (left + du, top + dv, right + du, bottom + dv)
    return replace(change, where=(u + du, v + dv), box=box)
