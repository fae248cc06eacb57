"""Cut one thing out of a photograph by a rectangle about it: GrabCut (Rother, Kolmogorov, Blake 2004)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from knotfab.base.arrays import Array, Mask
from knotfab.base.disk import read_file
from knotfab.base.errors import needs_extra
from knotfab.picture.silhouette import (
    fill_holes,
    fit_size,
    holes_of,
    pieces_of,
    sample_mask,
    smooth,
)
from knotfab_formats.errors import InputError
from knotfab_formats.libraries import took_part
from knotfab_formats.views import Box, Disc, Reading

Levels = NDArray[np.float32]
_Gaussian = tuple[float, NDArray[np.float64], NDArray[np.float64]]  # share, mean, covariance

_CUT_PX, _FINE_PX = 320, 1600  # longer side for the cut, and for refining its outline
_MARGIN = 0.25  # share of the rectangle's longer side; pixels this near model the background
_KINDS, _ROUNDS = 5, 6  # Gaussians for subject and background each, and most cuts
_COARSE_PX = 200  # longer side above which a coarse cut comes first
# the first cuts are so much coarser; the last moves their outline by so much
_COARSER, _BAND_PX = 2, 6
_EDGE = 50.0  # weight of an outline between like pixels, against one pixel's likelihood
_GRAIN = 5.0  # least levels by which pixels of one colour differ
_FEW = 16  # least pixels from which a mixture is learnt
_SURE = 1e6  # weight of known pixels
_ALIKE = (0.05 * 255) ** 2  # variance of brightness below which the outline follows no edge
_ROUND = 0.004  # smoothing radius, as a share of the rectangle's longer side
# shares of the largest piece: smaller pieces are left out, smaller holes filled
_CRUMB, _HOLE = 0.05, 0.03
# features, as shares of the subject's longer side: the blur that they stand out of, their own blur, the
# least distance from the outline, half the least width, and the least area
_AROUND, _FINE, _INSIDE, _THIN, _SMALL = 0.06, 0.004, 0.02, 0.006, 4e-4
_STANDS_OUT = 28.0  # levels
_MOST_FEATURES = 12
_FULL = 0.995  # a cut that fills this share of the rectangle has found nothing apart
_SIDES = ((0, 1), (1, 0), (1, 1), (1, -1))  # steps to half of a pixel's eight neighbours


def middle_boxes(width: int, height: int) -> list[Box]:
    """Return starting rectangles in the middle of a picture: 80 % of it, and an upright one."""
    return [
        (
            round((1 - x) / 2 * width),
            round((1 - y) / 2 * height),
            round(x * width),
            round(y * height),
        )
        for x, y in ((0.8, 0.8), (0.4, 0.8))  # shares of width and height
    ]


def take_subject(
    image: Image.Image, reading: Reading, folder: Path, what: str, shrunk: int = 1
) -> Mask:
    """Return the subject of an upright picture, from its mask's file or by a new cut, (H, W).

    Args:
        folder: where relative paths of the mask's file start. shrunk: how many px of the picture make one of
            `image`, across; `reading` is in px of the picture.

    Raises:
        InputError: the rectangle or a disc lies outside, the cut finds nothing or everything, or the file is
            not a mask.
    """
    if not reading.subject_mask:
        assert reading.subject_px is not None
        left, top, width, height = (c // shrunk for c in reading.subject_px)
        keep, drop = (
            [(u // shrunk, v // shrunk, max(1, r // shrunk)) for u, v, r in discs]
            for discs in (reading.keep_px, reading.drop_px)
        )
        return cut_subject(image, (left, top, width, height), keep, drop, what)
    path, remedy = folder / reading.subject_mask, "Leave subject_mask out, to cut it anew."
    what = f"the mask {reading.subject_mask}"
    read_file(path, what, "mask", 2**28, missing=remedy, too_large=remedy)
    try:
        with Image.open(path) as opened:
            mask = np.asarray(opened.convert("L")) >= 128
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError) as error:
        raise InputError(what, "it cannot be read as a picture", remedy) from error
    if mask.shape != (image.height, image.width):
        size = f"it has {mask.shape[1]} x {mask.shape[0]} px, the picture {image.width} x {image.height}"
        raise InputError(what, size, "Draw it in the picture's size, or leave subject_mask out.")
    return mask


def cut_subject(
    image: Image.Image, box: Box, keep: Sequence[Disc], drop: Sequence[Disc], what: str
) -> Mask:
    """Cut out the subject in a rectangle: smooth, without crumbs, reproducible, (H, W).

    What stands out within it, such as eyes, becomes holes. Mixtures of Gaussians tell the subject's colours
    from those of its surroundings, which are known outside the rectangle. The outline is a minimal cut of the
    grid's graph. Both are repeated until they agree.

    Args:
        box: left, top, width, height, px. keep, drop: discs (x, y, radius), px, that belong to the subject or
            do not; where they overlap, `drop` wins.

    Raises:
        InputError: as for `take_subject`. MachineError: PyMaxflow is not installed.
    """
    left, top, width, height = box
    asked = f"{what}: --subject {','.join(map(str, box))}"
    example = "--subject " + ",".join(map(str, middle_boxes(*image.size)[0]))
    if left + width > image.width or top + height > image.height or min(width, height) < _FEW:
        raise InputError(
            asked,
            f"it is no rectangle of at least {_FEW} px within its {image.width} x {image.height} px",
            f"Give left, top, width and height, such as {example}, its middle.",
        )
    for name, discs in (("keep", keep), ("drop", drop)):
        for u, v, radius in discs:
            if u >= image.width or v >= image.height:
                why = f"its middle is outside of the picture's {image.width} x {image.height} px"
                raise InputError(f"{what}: --{name} {u},{v},{radius}", why, "Give it in px.")
    near = round(_MARGIN * max(width, height))
    first, above = max(0, left - near), max(0, top - near)
    last, below = min(image.width, left + width + near), min(image.height, top + height + near)
    part = image.crop((first, above, last, below))
    if part.mode.startswith("I"):
        part = Image.fromarray((np.asarray(part) >> 8).clip(0, 255).astype(np.uint8))
    part = part.convert("RGB")
    size = fit_size(*part.size, min(_CUT_PX, max(part.size)))
    halves = [(np.arange(n, dtype=np.float64) + 0.5) / n for n in size]
    x: Array = first + halves[0] * part.width
    y: Array = above + halves[1] * part.height
    inside = ((y > top) & (y < top + height))[:, None] & (x > left) & (x < left + width)
    dropped = _discs(x, y, drop)
    kept = _discs(x, y, keep) & ~dropped
    outside = dropped | ~(inside | kept)
    if outside.sum() < _FEW:
        why = "nothing of the picture lies around it to tell what does not belong"
        raise InputError(asked, why, f"Leave a margin ({example}), or mark some with --drop X,Y,R.")
    levels = np.asarray(part.resize(size, Image.Resampling.BOX), dtype=np.float32)
    with needs_extra("--subject", "photo"):
        mask = _grab_coarsely(levels, kept, outside)
    found = _finish(mask, part, kept, dropped, _ROUND * max(width, height))
    share = found.sum() / (width * height)
    if share == 0 or share >= _FULL:
        why = (
            "nothing in it differs from what is around it" if share == 0 else "the subject fills it"
        )
        remedy = (
            "Mark what belongs with --keep X,Y,R."
            if share == 0
            else ("Draw the rectangle larger, or mark what does not belong with --drop X,Y,R.")
        )
        raise InputError(asked, why, remedy)
    whole = np.zeros((image.height, image.width), dtype=bool)
    whole[above:below, first:last] = found
    return whole


def _discs(x: Array, y: Array, discs: Sequence[Disc]) -> Mask:
    """Return which grid points the discs cover, (len(y), len(x))."""
    covered = np.zeros((len(y), len(x)), dtype=bool)
    for u, v, radius in discs:
        covered |= (x - u) ** 2 + (y[:, None] - v) ** 2 <= radius**2
    return covered


def _grab_coarsely(levels: Levels, kept: Mask, outside: Mask) -> Mask:
    """Alternate cuts and learning at a coarse size, then cut once more near that outline."""
    from scipy.ndimage import binary_dilation, binary_erosion

    height, width = kept.shape
    if max(height, width) < _COARSE_PX:
        return _grab(levels, kept, outside)
    size = max(1, width // _COARSER), max(1, height // _COARSER)
    small = [
        np.asarray(Image.fromarray(channel).resize(size, Image.Resampling.BOX))
        for channel in np.moveaxis(levels, 2, 0)
    ]
    kept_coarsely, outside_coarsely = (sample_mask(mask, *size) for mask in (kept, outside))
    edge = _EDGE / _COARSER
    found = _grab(np.stack(small, axis=2), kept_coarsely, outside_coarsely, edge=edge)
    mask = sample_mask(found, width, height)
    near = binary_dilation(mask, iterations=_BAND_PX) & ~binary_erosion(mask, iterations=_BAND_PX)
    kept, outside = kept | (mask & ~near), outside | ~(mask | near | kept)
    return _grab(levels, kept, outside, (mask & ~outside) | kept, rounds=1)


def _grab(
    levels: Levels,
    kept: Mask,
    outside: Mask,
    start: Mask | None = None,
    rounds: int = _ROUNDS,
    edge: float = _EDGE,
) -> Mask:
    """Alternate cuts and learning from `start`, or from all that may belong; known pixels never change."""
    import maxflow

    took_part("PyMaxflow", "cut the subject out")
    mask, pixels = ~outside if start is None else start, levels.reshape(-1, 3)
    weights = _edge_weights(levels, edge)
    mixtures: list[list[_Gaussian]] = [[], []]
    for _ in range(rounds):
        if min(mask.sum(), (~mask).sum()) < _FEW:
            break
        mixtures = [
            _learn(pixels[side.ravel()], old)
            for side, old in zip((mask, ~mask), mixtures, strict=True)
        ]
        own, other = (_costs(pixels, m).min(1).reshape(mask.shape) for m in mixtures)
        graph = maxflow.GraphFloat(mask.size, 4 * mask.size)
        nodes = graph.add_grid_nodes(mask.shape)
        for (down, right), weight in weights.items():
            structure = np.zeros((3, 3))
            structure[1 + down, 1 + right] = 1
            graph.add_grid_edges(nodes, weight, structure=structure, symmetric=True)
        least = np.minimum(own, other)
        belongs = np.where(kept, _SURE, np.where(outside, 0, other - least))
        graph.add_grid_tedges(
            nodes, belongs, np.where(outside, _SURE, np.where(kept, 0, own - least))
        )
        graph.maxflow()
        before, mask = mask, ~graph.get_grid_segments(nodes)
        if (before != mask).mean() < 1e-3:  # share of pixels changed below which it has converged
            break
    return np.asarray(mask)


def _edge_weights(levels: Levels, edge: float) -> dict[tuple[int, int], NDArray[np.float64]]:
    """Return, for each direction, the cost of an outline between a pixel and its neighbour, (H, W)."""
    squares = {}
    for down, right in _SIDES:
        shifted = np.roll(levels, (-down, -right), (0, 1))  # no edge beyond the grid
        squares[down, right] = ((levels - shifted) ** 2).sum(-1)
    sharp = 0.5 / max(float(np.mean([s[:-1, 1:-1].mean() for s in squares.values()])), 1.0)
    return {
        s: edge / np.hypot(*s) * np.exp(-sharp * v.astype(np.float64)) for s, v in squares.items()
    }


def _learn(pixels: Levels, old: list[_Gaussian]) -> list[_Gaussian]:
    """Fit Gaussians to pixels (n, 3) grouped by the old ones; without old ones, split the widest."""
    if old:
        kind = _costs(pixels, old).argmin(1)
    else:
        pixels = pixels[:: 1 + len(pixels) // 20000]
        kind = np.zeros(len(pixels), dtype=np.int64)
        for number in range(1, _KINDS):
            spreads = [
                np.linalg.eigh(len(p) * np.cov(p.T))
                if len(p := pixels[kind == k]) > _FEW
                else (np.zeros(3), np.eye(3))
                for k in range(number)
            ]
            widest = max(range(number), key=lambda k: float(spreads[k][0][-1]))
            along = pixels @ spreads[widest][1][:, -1]
            here = kind == widest
            kind[here & (along > along[here].mean())] = number
    found: list[_Gaussian] = []
    for k in range(_KINDS):
        own = pixels[kind == k]
        if len(own) >= _FEW or (not found and k == _KINDS - 1):
            own = own if len(own) >= _FEW else pixels
            cov = np.cov(own.T) + _GRAIN**2 * np.eye(3)
            found.append((len(own) / len(pixels), own.mean(0, dtype=np.float64), cov))
    return found


def _costs(pixels: Levels, mixture: list[_Gaussian]) -> Levels:
    """Return each pixel's negative log density in each Gaussian, (n, kinds)."""
    columns = []
    for share, middle, cov in mixture:
        root = np.linalg.cholesky(np.linalg.inv(cov))
        away = (pixels - middle.astype(np.float32)) @ root.astype(np.float32)
        constant = 0.5 * np.linalg.slogdet(cov)[1] - np.log(share)
        columns.append(0.5 * np.einsum("ij,ij->i", away, away) + np.float32(constant))
    return np.stack(columns, axis=1)


def _finish(mask: Mask, part: Image.Image, kept: Mask, dropped: Mask, round_px: float) -> Mask:
    """Refine the cut at full size: along edges, smooth, without crumbs, with real holes only."""
    size = fit_size(*part.size, min(_FINE_PX, max(part.size)))
    scale = size[0] / mask.shape[1]
    mask = _follow_edges(mask, part.convert("L").resize(size, Image.Resampling.BOX), scale)
    mask = smooth(mask, max(0.7, round_px * size[0] / part.width))
    kept, dropped = (sample_mask(m, *size) for m in (kept, dropped))
    labels, areas = pieces_of(mask | kept)
    if not len(areas):
        return np.zeros((part.height, part.width), dtype=bool)
    stays = areas >= _CRUMB * areas.max()
    stays[np.unique(labels[kept]) - 1] = True
    mask = np.concatenate([[False], stays])[labels]
    filled = fill_holes(mask, _HOLE * areas.max())
    holes, _ = holes_of(mask)
    asked = np.isin(holes, np.unique(holes[dropped & (holes > 0)])) & (holes > 0)
    whole = filled & ~asked & ~dropped
    grey = np.asarray(part.convert("L").resize(size, Image.Resampling.BOX))
    features = pieces_of(_find_features(whole, grey))[0]
    whole &= (features == 0) | np.isin(features, np.unique(features[kept]))  # --keep fills one
    labels, areas = pieces_of(whole | (kept & ~dropped))
    stays = areas >= _CRUMB * areas.max(initial=0)
    stays[np.unique(labels[kept & ~dropped]) - 1] = True
    return sample_mask(np.concatenate([[False], stays])[labels], *part.size)


def _find_features(mask: Mask, grey: NDArray[np.uint8]) -> Mask:
    """Find the features of a subject that a drawing shows as holes, such as eyes, a nose or stripes.

    Either those darker than their surroundings are taken or the lighter ones, whichever stand out more.
    """
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    if not mask.any():
        return mask
    longer = 1 + max(int(np.ptp(np.flatnonzero(mask.any(axis)))) for axis in (0, 1))
    size = fit_size(
        mask.shape[1], mask.shape[0], min(_CUT_PX * max(mask.shape) // longer, max(mask.shape))
    )
    few = sample_mask(mask, *size)
    scale = size[0] / mask.shape[1]
    levels = np.asarray(Image.fromarray(grey).resize(size, Image.Resampling.BOX), dtype=np.float32)
    weight, side = few.astype(np.float32), longer * scale

    def blur(share: float) -> Levels:
        covered = np.maximum(gaussian_filter(weight, share * side), 1e-3)
        return np.asarray(gaussian_filter(levels * weight, share * side) / covered)

    above = blur(_FINE) - blur(_AROUND)
    inside = distance_transform_edt(np.pad(few, 1))[1:-1, 1:-1] > _INSIDE * side
    best, strength = np.zeros_like(few), 0.0
    for difference in (above, -above):
        found = inside & (difference > _STANDS_OUT)
        core = distance_transform_edt(found) > _THIN * side
        found &= distance_transform_edt(~core) <= _THIN * side
        labels, areas = pieces_of(found)
        largest = np.argsort(-areas, kind="stable")[:_MOST_FEATURES]
        found = np.isin(labels, 1 + largest[areas[largest] >= _SMALL * side**2])
        if (total := float(difference[found].sum())) > strength:
            best, strength = found, total
    found = Image.fromarray(255 * best.astype(np.uint8))
    return np.asarray(found.resize(mask.shape[::-1], Image.Resampling.BICUBIC)) >= 128


def _follow_edges(mask: Mask, grey: Image.Image, scale: float) -> Mask:
    """Upsample the mask along the edges of a grey picture: a guided filter (He, Sun, Tang 2010)."""
    from scipy.ndimage import uniform_filter

    guide = np.asarray(grey, dtype=np.float32)
    cover = np.asarray(
        Image.fromarray(mask).convert("L").resize(grey.size, Image.Resampling.BILINEAR),
        dtype=np.float32,
    )

    def mean(values: Levels) -> Levels:
        return np.asarray(uniform_filter(values, 2 * round(1.5 * scale) + 1, mode="nearest"))

    middle, covered = mean(guide), mean(cover)
    slope = (mean(guide * cover) - middle * covered) / (mean(guide**2) - middle**2 + _ALIKE)
    return np.asarray(mean(slope) * guide + mean(covered - slope * middle) > 127.5)
