"""Tell break-away bars from tubes, and check that they are as listed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import dist

import numpy as np

from knotfab_formats.upright import MOST_BAR_MM2
from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array
from knotfab_validators.check import at_most, spot
from knotfab_validators.geometry.curves import Bar
from knotfab_validators.geometry.mesh import Mesh, number_bodies
from knotfab_validators.geometry.surface import survey
from knotfab_validators.printing.slices import Slices, find_pieces, layer_of, slice_layers
from knotfab_validators.tube.solid_matter import Solid, find_hollow

SIZE_MM = 0.05  # tolerance of a bar's width and height
SAME_MM = 0.5  # largest distance between the centres of a bar and of its listing
MOST_LAYERS = 3  # height of a strip that is peeled off the bed
STEP_MM = 0.05
# an end may stick so far out of its strand: the grid of rows and layers sees no more
SUNK_MM = 0.15


def check_bars(
    mesh: Mesh, layer_mm: float, bars: Mesh | None, listed: Sequence[Bar], reach: float
) -> Check:
    """Check `bars`: the bars in the file are exactly those listed, and each joins two strands.

    A bar is a full box. Its axis begins in one strand, leaves it, and ends in another; it meets nothing
    between. On the bed, where it is a strip of a few layers to peel off, it may have any width; elsewhere
    it must break away.

    Args:
        mesh: the part without its bars, which prints in layers of `layer_mm`.
        reach: how far an end may be from where it is listed: within the same strand.

    Raises:
        TooMuchWork: it has too many layers.
    """
    found = [] if bars is None else _read_bars(bars, listed)
    strands = slice_layers(mesh, layer_mm, heights=[float(bar.start[2]) for bar in found])
    bad = [] if bars is None or survey(bars).manifold else [(bars.vertices[0], "is no closed body")]
    open_list = list(range(len(listed)))
    for bar in found:
        middle = (bar.start + bar.end) / 2
        near = [k for k in open_list if _is_listed(bar, listed[k], reach)]
        if near:
            open_list.remove(near[0])
        why = _misses(strands, bar) or ("" if near else "is not listed, or of another size")
        on_bed = middle[2] - bar.height / 2 <= strands.bottom + SIZE_MM
        flat = on_bed and bar.height <= MOST_LAYERS * strands.layer + SIZE_MM
        if bar.width * bar.height > MOST_BAR_MM2 and not flat:
            why = (
                "is too high to be peeled off the bed"
                if on_bed
                else "is too thick to be broken away"
            )
        if why:
            bad.append((middle, why))
    bad += [(at, "has a neck, slit or hollow") for at in _find_necks(bars)]
    bad += [((listed[k].start + listed[k].end) / 2, "is listed and not there") for k in open_list]
    first = f"; the one at {spot(bad[0][0])} {bad[0][1]}" if bad else ""
    detail = f"wrong of {len(found)} in the file and {len(listed)} in knots.json{first}"
    return at_most("bars", len(bad), 0, "bars", detail, at=[place for place, _ in bad])


def _find_necks(bars: Mesh | None) -> list[Array]:
    """Find a place (3,) in each bar that matter does not fill between its outermost corners."""
    if bars is None:
        return []
    label, count = number_bodies(bars)
    found = []
    for number in range(count):
        own = Mesh(bars.vertices, bars.faces[label[bars.faces[:, 0]] == number])
        try:
            hollow = find_hollow(own, Solid("bar", bars.vertices[label == number]))
        except ValueError:  # it is flat, which `_is_listed` tells
            continue
        if hollow is not None:
            found.append(hollow[1])
    return found


def _read_bars(bars: Mesh, listed: Sequence[Bar]) -> list[Bar]:
    """Read each body as a level box: the ends of its axis, its width and its height.

    The axis is that of the listed bar with the nearest centre, since a bar may be wider than long.
    A body far from all listed bars takes its longest extent.
    """
    label, count = number_bodies(bars)
    middles = np.array([(b.start + b.end) / 2 for b in listed]).reshape(-1, 3)
    found = []
    for number in range(count):
        points = bars.vertices[label == number]
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        flat = points[:, :2] - points[:, :2].mean(axis=0)
        along = np.linalg.svd(flat, full_matrices=False)[2][0]
        away = np.linalg.norm(middles - middle, axis=1)
        if len(away) and away.min() <= SAME_MM:
            way = (listed[int(away.argmin())].end - listed[int(away.argmin())].start)[:2]
            along = way / np.linalg.norm(way) if way.any() else along
        t, across = flat @ along, flat @ np.array([-along[1], along[0]])
        start, end = (
            np.append(points[:, :2].mean(axis=0) + s * along, middle[2]) for s in (t.min(), t.max())
        )
        found.append(Bar(start, end, float(np.ptp(across)), float(np.ptp(points[:, 2]))))
    return found


def _is_listed(bar: Bar, said: Bar, reach: float) -> bool:
    ways = ((said.start, said.end), (said.end, said.start))
    if all(max(dist(bar.start, a), dist(bar.end, b)) > reach for a, b in ways):
        return False
    if abs(bar.width - said.width) > SIZE_MM or abs(bar.height - said.height) > SIZE_MM:
        return False
    along = (bar.end - bar.start) / np.linalg.norm(bar.end - bar.start)
    aside = np.cross(np.array([said.start, said.end]) - bar.start, along)
    return bool((np.linalg.norm(aside, axis=1) <= SAME_MM).all())


def _misses(strands: Slices, bar: Bar) -> str:
    """Say what is wrong with what a bar joins; empty if it joins two strands and nothing else."""
    way = bar.end - bar.start
    steps = max(int(np.ceil(np.linalg.norm(way) / STEP_MM)), 2)
    points = bar.start + np.linspace(0.0, 1.0, steps + 1)[:, None] * way
    layer = layer_of(float(points[0, 2]), strands.bottom, strands.layer)
    if not 0 <= layer < strands.layers:
        return "is above or below every strand"
    rows = (points[:, 1] - strands.south) / strands.row
    rows = rows.clip(1, strands.rows - 2) + layer * strands.rows
    lines = strands.first, strands.left, strands.right, strands.piece
    # the next rows would fill a narrow gap between two strands
    piece = find_pieces(*lines, 1e-9, np.ascontiguousarray(points[:, 0]), rows, 0)
    # along a surface aslant to the rows it leaves a strand and comes back, by up to a row
    for last, at in pairwise(np.flatnonzero(piece >= 0).tolist()):
        if (at - last) * STEP_MM <= strands.row + STEP_MM and piece[at] == piece[last]:
            piece[last:at] = piece[at]
    inside = np.flatnonzero(piece >= 0)
    outside = np.flatnonzero(piece < 0)
    if not len(inside) or not len(outside):
        return "joins nothing" if not len(inside) else "lies in a strand"
    if inside[0] * STEP_MM > SUNK_MM or (steps - inside[-1]) * STEP_MM > SUNK_MM:
        return "does not reach a strand with both ends"
    if np.ptp(outside) != len(outside) - 1:
        return "meets more than two strands"
    if piece[inside[0]] == piece[inside[-1]]:
        return "joins a strand with itself"
    return ""
