"""The ground of a picture: what a drawing lies on is removed, and its border tells how to read it."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image

from knotfab.base.arrays import Array, Mask
from knotfab.picture.colours import Colours, cluster_colours
from knotfab.picture.ink import (
    name_colour,
    split_channels,
    square_distances,
    take_border,
    takes_alpha,
)
from knotfab.picture.silhouette import fill_holes, pieces_of
from knotfab_formats.errors import InputError
from knotfab_formats.views import Reading

_SIDE = 600  # px of the longer side at which a sheet is looked for
_LIGHT = 0.78  # the share of the brightest level that paper has at least
_GREY = 60  # levels by which the channels of paper differ at most
_LEAST = 0.15  # the share of the picture that a sheet covers at least
# the share of the picture's longer side that is cut off a sheet: its soft or shaded edge
_EDGE = 0.012
_INK = 8.0  # levels up to which a ground is as black as a drawing's
_PAGE = 0.5  # the share of such a picture that a page with a black margin covers at least
_NEAR = 20.0  # levels that differ within one flat colour


def plain_ground(image: Image.Image) -> tuple[Image.Image, str] | None:
    """Return the picture on plain paper, with a note, if it lies on a sheet, a board or squares.

    Returns None if it does not, or if nothing is drawn on the sheet.
    """
    if image.mode.startswith(("I", "F")):
        return None
    rgba = np.asarray(image.convert("RGBA"))
    for find in (_checkerboard, _ruled, _sheet):
        found = find(rgba[..., :3], rgba[..., 3] >= 128)
        if found is not None:
            return Image.fromarray(found[0]), found[1]
    return None


def _sheet(rgb: Colours, opaque: Mask) -> tuple[Colours, str] | None:
    """Paint the surroundings of a sheet of light paper in the paper's colour."""
    every = -(-max(opaque.shape) // _SIDE)
    few, seen = rgb[::every, ::every].astype(np.int64), opaque[::every, ::every]
    if not seen.any():
        return None
    bright = few.mean(axis=2)
    most = float(np.percentile(bright[seen], 95))
    light = seen & (bright >= _LIGHT * most) & (np.ptp(few, axis=2) <= _GREY)
    labels, areas = pieces_of(light)
    if most < 140 or not len(areas) or areas.max() < _LEAST * light.size:
        return None
    paper = labels == int(areas.argmax()) + 1
    sheet = fill_holes(paper, light.size)
    around = ~sheet
    sides = np.array([side.mean() for side in (sheet[0], sheet[-1], sheet[:, 0], sheet[:, -1])])
    reached = sides.mean()
    bars = max(sides[:2]) < 0.02 or max(sides[2:]) < 0.02
    # a sheet that reaches the edge is a scan whose edge shows, or lies between two bars
    if around.mean() < 0.002 or reached > 0.8 or frame_px(rgb):
        return None
    if reached > 0.2 and around.mean() > 0.12 and not bars:
        return None
    clear = ~seen[around]
    bright_around = light[around].mean()
    if bright_around > 0.3 or not (clear.mean() > 0.5 or bright[around & seen].mean() < 0.9 * most):
        return None
    if not clear.any() and bright[around].max() < _INK and sheet.mean() < _PAGE:
        return None  # a light shape on flat black is drawn so
    if not has_four_corners(sheet):
        return None
    from scipy import ndimage

    if ndimage.binary_erosion(paper, np.ones((3, 3))).sum() < 0.5 * paper.sum():
        return None  # grain or a pattern is no paper
    steps = max(2, round(_EDGE * max(light.shape)))
    inside = ndimage.binary_erosion(sheet, np.ones((3, 3)), iterations=steps, border_value=1)
    drawn = (inside & ~light).sum() / max(1, inside.sum())
    if not 0.002 <= drawn <= 0.6:
        return None
    colour = np.median(few[paper], axis=0).astype(np.uint8)
    whole = np.asarray(Image.fromarray(inside).resize(opaque.shape[::-1], Image.Resampling.NEAREST))
    painted = np.where((whole & opaque)[..., None], rgb, colour)
    return painted.astype(np.uint8), (
        f"a sheet of paper ({name_colour(colour)}) lies within the picture, and what is drawn on it is read "
        "(--ink light or --ink alpha draws the sheet itself)"
    )


def has_four_corners(sheet: Mask) -> bool:
    rows, columns = sheet.nonzero()
    hull = shapely.convex_hull(shapely.MultiPoint(find_ends(sheet)))
    if not isinstance(hull, shapely.Polygon) or len(rows) < 0.95 * hull.area:
        return False
    longer = float(np.ptp(rows) + np.ptp(columns)) / 2
    return len(hull.simplify(0.03 * longer).exterior.coords) - 1 in (4, 5)


def find_ends(mask: Mask) -> Array:
    """Return the first and the last set px of each row, (n, 2)."""
    rows = np.flatnonzero(mask.any(axis=1))
    first = mask[rows].argmax(axis=1)
    last = mask.shape[1] - 1 - mask[rows][:, ::-1].argmax(axis=1)
    ends = np.concatenate([np.stack([first, rows], 1), np.stack([last, rows], 1)])
    return np.asarray(ends, dtype=np.float64)


def _checkerboard(rgb: Colours, opaque: Mask) -> tuple[Colours, str] | None:
    """Draw, dark on white, what covers a painted checkerboard of two greys, which means transparency."""
    if not opaque.all():
        return None
    runs = []
    for line in (rgb[0], rgb[-1], rgb[:, 0], rgb[:, -1]):
        starts = np.flatnonzero((np.abs(np.diff(line.astype(int), axis=0)) > 6).any(axis=1)) + 1
        if len(starts) < 5:
            return None
        runs += list(np.diff(starts))
    tile = int(np.median(runs))
    if tile < 3 or np.mean(np.abs(np.array(runs) - tile) <= max(1, 0.15 * tile)) < 0.8:
        return None
    border = take_border(rgb).astype(np.float64)
    bright = border.mean(axis=1)
    pale, dark = (
        np.median(border[side], axis=0)
        for side in (bright >= bright.mean(), bright < bright.mean())
    )
    flat = max(np.ptp(pale), np.ptp(dark)) <= 12 and _NEAR / 2 < np.linalg.norm(pale - dark) < 200
    near = [_away(rgb, c) <= _NEAR / 2 for c in (pale, dark)]
    shares = [float(np.mean(np.linalg.norm(border - c, axis=1) <= _NEAR / 2)) for c in (pale, dark)]
    if not flat or min(shares) < 0.3 or sum(shares) < 0.9:
        return None
    from scipy import ndimage

    share = ndimage.uniform_filter(near[1].astype(np.float32), 2 * tile, mode="reflect")
    covered = (share < 0.25) | (share > 0.75)
    whole = np.zeros_like(covered)
    whole[tile:-tile, tile:-tile] = True  # nearer to the edge a window holds one square
    shape = ~(near[0] | near[1]) | (covered & whole)
    shape = ndimage.median_filter(shape, 5)
    if not 0.002 <= shape.mean() <= 0.9:
        return None
    names = f"{name_colour(pale)} and {name_colour(dark)}"
    return np.where(shape[..., None], 0, 255).repeat(3, axis=2).astype(np.uint8), (
        f"its ground is a painted checkerboard ({names}), which stands for transparency: what hides it is "
        "drawn, and edges are as coarse as its squares (--ink COLOUR reads the picture as it is)"
    )


def _ruled(rgb: Colours, opaque: Mask) -> tuple[Colours, str] | None:
    """Paint the lines of squared or lined paper in the paper's colour."""
    if not opaque.all():
        return None
    paper = np.percentile(rgb.reshape(-1, 3)[:: max(1, rgb.size // 300_000)], 90, axis=0)
    away = _away(rgb, paper)
    off = away > _NEAR
    if paper.mean() < 150 or not 0.02 < off.mean() < 0.7:
        return None
    near, ways, most = np.zeros(away.shape, dtype=bool), 0, 0.0
    for axis in (0, 1):
        along = off.mean(axis=1 - axis) > 0.6
        gaps = np.diff(np.flatnonzero(along & ~np.roll(along, 1)))
        even = len(gaps) > 3 and np.ptp(gaps[1:-1]) <= max(2, 0.1 * np.median(gaps))
        ways += bool(even and along.mean() <= 0.4)
        if along.mean() > 0.1 and not even:
            return None
        # how far each line is from paper
        own = np.where(along, np.median(away, axis=1 - axis), 0.0)
        own = np.maximum(own, np.maximum(np.roll(own, 1), np.roll(own, -1)))
        near |= away <= 1.5 * np.expand_dims(own, 1 - axis)
        most = max(most, float(own.max()))
    if not ways or most > 200:  # as dark as ink
        return None
    near &= away > 0.0
    tone = np.median(rgb[near & off], axis=0)
    painted = np.where(near[..., None], paper.astype(np.uint8), rgb)
    name, kind = name_colour(tone), "squared" if ways == 2 else "lined"
    return painted.astype(np.uint8), (
        f"the lines of {kind} paper ({name}) are left out (--ink {name} draws them)"
    )


# Guessing from its border how to read an opaque picture: thin frames, borders of several colours.

_ALIKE, _APART = 24.0, 96.0  # levels, Euclidean in RGB: within one colour, and between two
_THIN = 0.015  # the thickest frame, as a share of the shorter side
_EVEN = 0.75  # the share of each side of a frame's inside that has the colour of the paper
_MOST = 0.98  # the share of a frame that has its colour
# the least share of pixels that differ from the paper where a frame goes about a shape
_SHAPE = 1e-3
_SPOT = 0.02  # the largest share of the picture that is a spot
_MAJORITY = 0.6  # a colour with this share of the border is the background
_FLAT = 0.9  # at most three colours make up this share of a painted border
_SMALL = 320  # px of the longer side at which outlines are looked at
_FIRM = 0.73  # the least share of a drawing's outline across which colours step
_STEP = 0.9  # least step, in thresholds; blurs take some of the contrast of what is thin
LIFT = "Lift its subject out (a phone or rembg does in one tap), and bring a PNG with transparency"


def guess_reading(
    image: Image.Image, reading: Reading, what: str
) -> tuple[Reading, tuple[str, ...]]:
    """Guess how to read an opaque picture where nobody says what is ink; return the notes, too.

    A frame of one colour, thinner than 1.5 % of the shorter side, is cropped off. If the border has two or
    three colours, none of which covers most of it, whatever they do not reach is drawn (`flood`).

    Raises:
        InputError: the picture has only the colours of its border, or the edges of its shapes fade.
    """
    colours, alpha = split_channels(image)
    if reading.ink != "auto" or colours.dtype != np.uint8 or takes_alpha(colours, alpha, reading):
        return reading, ()
    rgb, notes = np.stack([colours] * 3, axis=-1) if colours.ndim == 2 else colours, list[str]()
    if reading.crop_px is True and (thick := frame_px(rgb)):
        inside = thick, thick, image.width - 2 * thick, image.height - 2 * thick
        reading = reading.but(crop_px=inside)
        notes.append(
            f"the frame about it, {thick} px of {name_colour(rgb[0, 0])}, is cropped off "
            f"(--crop 0,0,{image.width},{image.height} keeps it)"
        )
    if isinstance(box := reading.crop_px, tuple):
        rgb = rgb[box[1] : box[1] + box[3], box[0] : box[0] + box[2]]
    border = take_border(rgb)
    found = cluster_colours(border)
    grounds, said = np.median(border, axis=0)[None], reading.threshold != Reading().threshold
    if threshold := _pale_threshold(rgb, border, reading.threshold):
        notes.append(
            "most of what is drawn is paler than its darkest spot, and is drawn with it "
            f"(--threshold {threshold:g} does the same, --ink dark draws the spot alone)"
        )
        reading = reading.but(threshold=threshold)
    elif found.shares[0] < _MAJORITY and found.shares[:3].sum() >= _FLAT:
        shares = zip(found.colours[:3], found.shares[:3], strict=False)
        named = " and ".join(f"{name_colour(c)} ({share:.0%})" for c, share in shares)
        if (_away(rgb, *found.colours) > _APART).mean() >= 5 * _SHAPE:
            drawn = "so what none of these reaches is drawn (--ink flood)"
            notes.append(f"its border is {named}, {drawn}")
            reading, grounds = reading.but(ink="flood"), found.colours
        elif _away(border, *grounds).min() > _ALIKE:
            remedy = 'Say which is drawn: --ink "{}" or --ink "{}".'
            why = f"its border is {named}, so none of these is its background"
            raise InputError(what, why, remedy.format(*map(name_colour, found.colours[:2])))
    if not said and _fades(rgb, grounds, reading.threshold):
        why = "it is a photograph, and no drawing: the edges of what would be drawn fade"
        raise InputError(what, why, f"{LIFT}, or say what is drawn: --ink dark or --ink light.")
    return reading, tuple(notes)


def _fades(rgb: Colours, grounds: Array | Colours, threshold: float) -> bool:
    """Return whether the outline of what differs from these colours is mostly no step in brightness.

    At 320 px a step is within 7 px: a scan or a logo blurred by a hundredth of its side has sharp outlines.
    """
    from scipy import ndimage

    image = Image.fromarray(rgb)
    image.thumbnail((_SMALL, _SMALL), Image.Resampling.BOX)
    away = _away(np.asarray(image), *grounds)
    least, wide = threshold * away.max(), 1 + 2 * max(1, round(max(image.size) / 100))
    drawn = away > least
    rim = ndimage.maximum_filter(drawn, 3) & ~ndimage.minimum_filter(drawn, 3)
    across = ndimage.maximum_filter(away, wide) - ndimage.minimum_filter(away, wide)
    return bool(rim.any() and (across[rim] >= _STEP * least).mean() < _FIRM)


def _pale_threshold(rgb: Colours, border: Colours, usual: float) -> float:
    """Return a lower threshold if only a small spot exceeds the usual one but a pale body does not, else 0.

    Such a body has a single colour and five times the spot's area.
    """
    every = -(-max(rgb.shape[:2]) // 1500)
    few = rgb[::every, ::every]
    away = _away(few, np.median(border, axis=0))
    most = float(away.max())
    spot, pale = away > usual * most, (away > _ALIKE) & (away <= usual * most)
    lone = 0 < spot.mean() <= min(_SPOT, pale.mean() / 5) and pale.mean() >= 0.01
    if not lone or not is_of_one_colour(border, _MAJORITY):
        return 0.0
    typical = float(np.median(away[pale]))
    if (np.abs(away[pale] - typical) <= _ALIKE).mean() < _EVEN:
        return 0.0
    return round(0.5 * typical / most, 3)


def _away(colours: Colours, *grounds: Array | Colours) -> NDArray[np.float32]:
    """Return the distances of colours (..., 3) from the nearest of some, in levels, (...)."""
    return np.asarray(np.sqrt(square_distances(colours, *grounds)))


def is_of_one_colour(colours: Colours, share: float) -> bool:
    """Return whether this share of colours (n, 3) lies about their median."""
    return bool((_away(colours, np.median(colours, axis=0)) <= _ALIKE).mean() >= share)


def frame_px(rgb: Colours) -> int:
    """Return the thickness of a one-coloured frame about a shape on other paper; 0 without one."""
    most = max(1, round(_THIN * min(rgb.shape[:2])))
    outer = np.median(take_border(rgb), axis=0)
    for depth in range(most + 1):
        inside = rgb[depth : len(rgb) - depth, depth : rgb.shape[1] - depth]
        sides = (inside[0], inside[-1], inside[:, 0], inside[:, -1])
        paper = np.median(take_border(inside), axis=0)
        framed: Mask = _away(take_border(inside), outer) <= _ALIKE
        if framed.mean() >= _MOST:
            continue
        if depth == 0:
            return 0
        further = np.median(take_border(inside[1:-1, 1:-1]), axis=0)
        even = all((_away(side, paper) <= _ALIKE).mean() >= _EVEN for side in sides)
        if even and _away(paper[None], outer) >= _APART and _away(paper[None], further) <= _ALIKE:
            return depth if (_away(inside, paper) > _APART).mean() >= _SHAPE else 0
    return 0
