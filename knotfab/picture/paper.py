"""A photographed drawing on paper: its ink, without light, ruled lines, and what the paper lies on."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from PIL import Image

from knotfab.base.arrays import Array, Mask
from knotfab.picture.ground import has_four_corners
from knotfab.picture.ink import take_border

_SIDE = 600  # px of the longer side at which the light on the paper is estimated
_LEVELS = 12  # fewest levels of brightness along a photograph's border; painted pictures have fewer
_WIDE = 16.0  # px at that size from which on a blur is made of boxes
_RULE = 7  # px at that size; ruled lines and thin strokes are narrower
# the change of log brightness from px to px that parts shadows, which are softer, from outlines of ink; in
# pictures that are not shrunk shadows are steeper
_STEP, _STEP_UNSHRUNK = 0.045, 0.065
_SHEET = 0.15  # the least share of the picture that blank paper covers
_CHROMA = 0.4  # the highest chroma of paper
_PALE = 0.12  # up to this log darkness it is paper
_ENCLOSED = 0.35  # what ink encloses is paper up to this share of the ink's log darkness
_USUAL = 0.6  # the quantile of its darkness that ink usually has: strokes are paler at their edges
_FIRM = 0.9  # the one that outlines are measured by: a photograph's blotches fade from their middle
_FAINT = 0.16  # the least share of the light that ink takes
_MARGIN = 0.012  # the share of the longer side that is cut off a sheet: its soft or shaded edge
# shares of the longer side: the sides of the smallest part and hole, and half the width of the thinnest part
_PART, _HOLE, _THIN = 0.006, 0.008, 0.0022
_PUNCHED = 0.13  # the share of the longer side within which holes are punched
_LEAST, _MOST = 0.002, 0.5  # shares of the picture that ink covers
# an outline is sharp where brightness changes by so many thresholds within a few px; how much of a drawing's
# outlines must be, and how much of a hole's
_SHARP, _EDGES, _HOLED = 1.2, 0.9, 0.5
_BETWEEN = 0.3  # the most that is neither ink nor paper, as a share of the ink


def is_photograph(image: Image.Image) -> bool:
    if image.mode.startswith(("I", "F")) or image.has_transparency_data:
        return False
    border = take_border(np.asarray(image.convert("RGB")))
    return len(np.unique(border.mean(axis=1).round())) >= _LEVELS


def read_paper(image: Image.Image) -> tuple[Image.Image, str] | None:
    """Return the ink of a drawing, black on white, with a note; None for other photographs.

    Paper is what can be reached from its largest blank part without a step: light and shadows fall off
    softly, and an outline of ink does not. Ink is what is darker than the paper about it by more than half of
    what ink is in the middle.
    """
    image = image.convert("RGB")
    rgb = np.asarray(image)
    found = _find_paper(image)
    if found is None:
        return None
    light, sheet, whole = found
    ink = _find_ink(rgb, light, sheet)
    if ink is None:
        return None
    mask, punched = ink
    gone = [
        "the uneven light on the paper",
        *["what it lies on"] * (not whole),
        *["punched holes"] * punched,
    ]
    note = f"{' and '.join(gone)} {'is' if len(gone) == 1 else 'are'} left out"
    return Image.fromarray(~mask), f"{note} (--ink dark reads the picture as it is)"


def _find_paper(image: Image.Image) -> tuple[Array, Mask, bool] | None:
    """Return the light on the paper (h, w, 3), also under ink, and the sheet (h, w), both shrunk.

    None without paper. The sheet is whole where it goes on beyond the picture's edges.
    """
    from scipy import ndimage

    shrunk = max(1.0, max(image.size) / _SIDE)
    step = _STEP if shrunk > 1.5 else _STEP_UNSHRUNK
    size = round(image.width / shrunk) or 1, round(image.height / shrunk) or 1
    small = np.asarray(image.resize(size, Image.Resampling.BOX), dtype=np.float64)
    logs = np.log(np.maximum(small, 6.0))
    blank = ndimage.grey_closing(logs.mean(axis=2), (_RULE, _RULE))
    labels, count = ndimage.label(ndimage.gaussian_gradient_magnitude(blank, 1.0) < step)
    if not count:
        return None
    number = np.arange(1, count + 1)
    area = np.bincount(labels.ravel())[1:]
    bright = ndimage.median(small.mean(axis=2), labels, number)
    chroma = ndimage.median(
        np.ptp(small, axis=2) / np.maximum(small.max(axis=2), 1), labels, number
    )
    main = labels == number[np.where(np.asarray(chroma) < _CHROMA, area * bright, 0.0).argmax()]
    if main.mean() < _SHEET:
        return None
    thick = blank - logs.mean(axis=2) < _PALE  # no thin stroke
    light = _spread(logs, ndimage.binary_erosion(main & thick, border_value=1))
    filled = ndimage.binary_fill_holes(main)
    # what ink encloses may lie in more light, or in less, but is not nearly as dark as ink
    darker = (light - logs).mean(axis=2)
    usual = np.asarray(ndimage.median(darker, labels, number))
    enclosed = np.concatenate(
        [[False], usual < _ENCLOSED * usual[area > _RULE**2].max(initial=0.0)]
    )
    pale = (darker < _PALE) | (enclosed[labels] & ~main & thick)
    paper = pale & ndimage.binary_dilation(filled, iterations=3)
    light = np.exp(_spread(logs, ndimage.binary_erosion(paper, border_value=1) | (main & paper)))
    sides = np.mean([side.mean() for side in (filled[0], filled[-1], filled[:, 0], filled[:, -1])])
    if sides > 0.8:
        return light, np.ones_like(filled), True
    if not has_four_corners(filled):
        return None
    steps = max(2, round(_MARGIN * max(filled.shape)))
    return light, ndimage.binary_erosion(filled, iterations=steps), False


def _spread(values: Array, known: Mask) -> Array:
    """Return smoothed values (h, w, n); where none is known, means of those about, wider if far."""
    from scipy import ndimage

    found, told = np.empty_like(values), np.zeros_like(known)
    found[:] = values[known].mean(axis=0)

    def blur(image: Array, width: float) -> Array:
        if width < _WIDE:
            return np.asarray(ndimage.gaussian_filter(image, width))
        for _ in range(3):  # as wide together as the Gaussian, at a cost that does not grow with it
            image = ndimage.uniform_filter(image, round(2 * width) + 1)
        return image

    for width in 2.0 ** np.arange(9):
        weight = blur(known.astype(np.float64), width)
        here = ~told & (weight > 0.05)
        for k in range(values.shape[2]):
            mean = blur(values[..., k] * known, width)
            found[here, k] = mean[here] / weight[here]
        told |= here
        if told.all():
            break
    return np.asarray(ndimage.gaussian_filter(found, (1.0, 1.0, 0.0)))


def _find_ink(rgb: Array, light: Array, sheet: Mask) -> tuple[Mask, bool] | None:
    """Return what is ink on a sheet, (H, W), and whether punched holes are left out; None if no drawing."""
    from scipy import ndimage

    size, side = (rgb.shape[1], rgb.shape[0]), max(rgb.shape)
    dark = np.ones(rgb.shape[:2])
    for k in range(3):
        full = Image.fromarray(light[..., k].astype(np.float32)).resize(
            size, Image.Resampling.BICUBIC
        )
        dark -= np.minimum(rgb[..., k] / np.maximum(np.asarray(full), 1.0), 1.5) / 3
    dark = ndimage.gaussian_filter(dark, max(0.7, 0.0003 * side))
    dark[~np.asarray(Image.fromarray(sheet).resize(size))] = 0.0
    labels, _ = ndimage.label(dark > _FAINT)
    punched = _find_punched(labels, side)
    if punched:
        dark[np.isin(labels, punched)] = 0.0
    half = dark[::2, ::2]
    few = ndimage.grey_opening(half, (3, 3))
    thick = half[few > _FAINT]
    if len(thick) < _LEAST * few.size:
        return None
    least, firm = (max(0.75 * _FAINT, 0.5 * float(np.quantile(thick, q))) for q in (_USUAL, _FIRM))
    mask = dark > least
    labels, count = ndimage.label(mask)
    kept = np.zeros(count + 1, dtype=bool)
    kept[labels[ndimage.distance_transform_edt(mask) >= _THIN * side]] = True
    kept &= np.bincount(labels.ravel()) >= (_PART * side) ** 2
    mask = kept[labels]
    labels, _ = ndimage.label(~mask)
    mask |= (np.bincount(labels.ravel()) < (_HOLE * side) ** 2)[labels]
    about = ndimage.binary_dilation(mask[::2, ::2], iterations=2)
    between = (few > _FAINT) & (few < least) & ~about  # lines of the paper are too thin to count
    if not _LEAST <= mask.mean() <= _MOST or between.mean() > _BETWEEN * mask.mean():
        return None
    (drawn,) = ndimage.find_objects(mask.astype(np.int8))
    box = tuple(slice(max(one.start - _RULE, 0), one.stop + _RULE) for one in drawn)
    ink, near = mask[box], dark[box]
    across = ndimage.maximum_filter(near, _RULE) - ndimage.minimum_filter(near, _RULE)
    sharp = across > _SHARP * firm
    holes, count = ndimage.label(~ink)
    rims = np.where(ndimage.binary_dilation(ink), holes, 0)
    if not count or sharp[rims > 0].mean() < _EDGES:
        return None
    share = ndimage.mean(sharp, rims, np.arange(1, count + 1))
    ink |= np.append(False, share < _HOLED)[holes]  # a pale spot of a wash, within the mask
    return mask, bool(punched)


def _find_punched(labels: Array, side: int) -> list[int]:
    """List the parts that are two discs alike, far apart along one edge: the holes of a punched sheet."""
    from scipy import ndimage

    discs: list[tuple[int, float, float, int]] = []
    for number, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
        high, wide = rows.stop - rows.start, columns.stop - columns.start
        edge = min(
            rows.stop, columns.stop, labels.shape[0] - rows.start, labels.shape[1] - columns.start
        )
        if edge < _PUNCHED * side and high > 2 * _PART * side and 0.8 < high / wide < 1.25:
            filled = (labels[rows, columns] == number).sum() / (high * wide)
            if 0.7 < filled < 0.88:
                discs.append((number, rows.start + high / 2, columns.start + wide / 2, high))
    pairs = []
    for one, other in combinations(discs, 2):
        near, far = sorted((abs(one[1] - other[1]), abs(one[2] - other[2])))
        if abs(one[3] - other[3]) <= 0.25 * one[3] and near < one[3] < 0.2 * far:
            pairs += [one[0], other[0]]
    return pairs
