"""A picture in colours taken apart into one mask a lamp: where each lamp must be hidden.

Lamps that light one white screen mix there: n lamps make 2^n colours, one for each set hidden. Each pixel
gets the mixture nearest to it in OKLab (Ottosson 2020), hue before lightness and chroma: a dark green is
drawn green, not black. What lies between two flat colours as their mixture (antialiasing, JPEG's blur)
belongs to the nearer one of them, so that no seam of a third colour runs between the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import (
    distance_transform_edt,
    gaussian_filter,
    label,
    maximum_filter,
    minimum_filter,
)

from knotfab.base.arrays import Array, Mask
from knotfab.picture.raster import crop_image, encode_image, flatten
from knotfab.picture.read import Given, Target, read_image
from knotfab.picture.silhouette import resample_mask
from knotfab.picture.source import name_picture
from knotfab_formats.errors import InputError, shown
from knotfab_formats.libraries import took_part
from knotfab_formats.scene import ResolvedScene

_LIGHTNESS, _CHROMA = 0.5, 0.35  # weights relative to hue, for a strong colour
_GREY = 0.04  # chroma below which a pixel is grey (a pure red has 0.26)
_COLOURED = 0.002  # least share of coloured pixels
_SAME = 0.06  # two mixtures nearer to each other than this in OKLab look alike
_FLAT = 0.05  # sRGB difference between neighbours below which a pixel lies in a flat colour
_SPECK = 0.008  # share of the longer side: spots below a square so wide join their surroundings
# a picture is a photograph where this share of its pixels differs by the grain (sRGB) from its neighbours
_GRAIN, _PHOTOGRAPH = 0.02, 0.35
_FLATTENED = 0.1  # weight of total variation: grain of sigma 6 of 255 goes, and edges stay
# a share of the longer side: areas of twice this width are slivers beside thicker ones
_SLIVER = 0.0045
# a loss is told where a colour is so far off in OKLab, on this share of the picture
_TOLD = (0.15, 0.01)
_LARGEST_PX = 1024  # longer side of the masks; larger pictures are shrunk

_TO_LMS = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)

Labels = NDArray[np.int64]


@dataclass(frozen=True)
class Separation:
    """Masks (n, H, W), True where a lamp is hidden, and `seen` (H, W, 3), sRGB from 0 to 1, what that shows.

    `shares` are the parts of the picture that mixtures take, by the lamps that are hidden there; `error` is
    the mean distance from the picture in OKLab, and `lines` say what is lost.
    """

    masks: Mask
    seen: Array
    shares: dict[tuple[int, ...], float]
    error: float
    lines: tuple[str, ...]
    png: bytes  # the picture in the masks' size

    def seen_png(self) -> bytes:
        """Return the colours that are seen, as a PNG."""
        return encode_image(Image.fromarray(np.rint(255 * self.seen).astype(np.uint8)))


def to_linear(srgb: Array) -> Array:
    """Convert sRGB from 0 to 1 to linear light (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: Array) -> Array:
    """Convert linear light to sRGB; the inverse of `to_linear`."""
    return np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )


def to_oklab(srgb: Array) -> Array:
    """Convert sRGB to OKLab (..., 3)."""
    return np.asarray(np.cbrt(to_linear(srgb) @ _TO_LMS.T) @ _TO_LAB.T)


def mixtures_of(colours: Array, ambient: float = 0.0) -> Array:
    """Return the sRGB colours that n lamps (n, 3, linear) mix, (2^n, 3); bit k of a row: lamp k is hidden.

    The screen is white where all are lit; `ambient` is white light beside theirs, as a share of it.
    """
    lit = ~((np.arange(2 ** len(colours))[:, None] >> np.arange(len(colours))) & 1).astype(bool)
    white = colours.sum(axis=0)
    shown = (lit @ colours + ambient * white) / ((1 + ambient) * np.maximum(white, 1e-9))
    return np.asarray(to_srgb(np.clip(shown, 0.0, 1.0)))


def separate(
    image: Image.Image,
    names: Sequence[str],
    colours: Array,
    what: str,
    ambient: float = 0.0,
    most: int = 0,
    smooth_px: float = 0.0,
    speck_px: int = 0,
) -> Separation:
    """Separate a picture, which errors call `what`, into masks of lamps of linear colours (n, 3).

    A photograph's grain is smoothed first, lest each of its pixels become a separate area.

    Args:
        most: how many mixtures to use, those that take most of the picture; 0: all.
        smooth_px: detail finer than this joins its surroundings, px of the picture; 0: as strands need.
        speck_px: spots of fewer px join theirs, too; 0: those that no strand draws.

    Raises:
        InputError: the picture is grey, or a lamp is hidden nowhere.
    """
    longer = max(image.size)
    image = flatten(image, _LARGEST_PX)
    shrunk = longer / max(image.size)
    srgb = np.asarray(image, dtype=np.float64) / 255
    lab = to_oklab(srgb)
    photograph = bool((_local_range(srgb) > _GRAIN).mean() > _PHOTOGRAPH)
    plain = _without_grain(srgb) if photograph else srgb
    near = to_oklab(plain) if photograph else lab
    if (np.hypot(lab[..., 1], lab[..., 2]) > _GREY).mean() < _COLOURED:
        raise InputError(
            what,
            "it is grey: lamps of several colours have nothing to mix for it",
            "Leave out --lamps, or give a picture in colours.",
        )
    shown = mixtures_of(colours, ambient)
    palette = to_oklab(shown)
    labels: Labels = _nearest_colour(near, palette, np.arange(len(palette), dtype=np.int64))
    labels = _without_seams(plain, labels)
    if most:
        counts = np.bincount(labels.ravel(), minlength=len(palette))
        kept = np.sort(np.argsort(-counts, kind="stable")[: max(most, 2)]).astype(np.int64)
        labels = _without_seams(plain, _nearest_colour(near, palette, kept))
    # a share of the longer side: about half as wide as the shadow of a thin strand
    reach = smooth_px / shrunk or (0.006 * max(labels.shape) if photograph else 0.0)
    if reach:
        labels = _vote_around(labels, reach)
    least = speck_px / shrunk**2 or (_SPECK * max(labels.shape)) ** 2
    labels = _without_specks(labels, least)
    labels = _without_slivers(labels, _SLIVER * max(labels.shape))
    masks = np.stack([(labels >> k & 1).astype(bool) for k in range(len(colours))])
    for name, mask in zip(names, masks, strict=True):
        if not mask.any():
            raise InputError(
                what,
                f"none of its colours hides the lamp {name!r}",
                f"Leave {name} out, or give a picture in which a colour without {name} stands.",
            )
    seen = shown[labels]
    off = np.linalg.norm(lab - palette[labels], axis=-1)
    taken = np.bincount(labels.ravel(), minlength=len(palette)) / labels.size
    lamps = range(len(colours))  # those that a label hides
    shares = {tuple(k for k in lamps if n >> k & 1): float(c) for n, c in enumerate(taken) if c > 0}
    return Separation(
        masks, seen, shares, float(off.mean()), _tell_lost(srgb, off, seen), encode_image(image)
    )


def read_masks(
    source: str, scene: ResolvedScene, base: Path | None = None
) -> tuple[tuple[Target, ...], Separation]:
    """Read the picture in colours at `source`, and return the masks of the scene's lamps in order.

    Args:
        base: as `read_target` takes it.

    Raises:
        InputError: the picture cannot be read, or lamps cannot show it.
    """
    names = [view.name for view in scene.views]
    colours = np.array([view.lamp_colour for view in scene.views])
    reading, what = scene.views[0], shown(source)
    image, _ = crop_image(read_image(source, base=base), what, reading)
    shown_by = scene.room.ambient, scene.lamps.colours, reading.smooth_px, reading.speck_px
    found = separate(image, names, colours, what, *shown_by)
    plain = name_picture(source)
    rule = "where the lamp {} must be hidden for the nearest mixture of colours"
    first, *others = (
        Target(f"{plain}-{name}", mask, rule.format(name))
        for name, mask in zip(names, found.masks, strict=True)
    )
    return (replace(first, given=Given(found.png, ".png")), *others), found


def on_one_canvas(targets: tuple[Target, ...]) -> tuple[Target, ...]:
    """Centre pictures that lamps show in turn on one common canvas."""
    if len({target.mask.shape for target in targets}) == 1:
        return targets
    # all are scaled to the first one's height, and padded to the largest width
    height = targets[0].height
    widths = [round(t.width * height / t.height) for t in targets]
    found = []
    for target, width in zip(targets, widths, strict=True):
        aside = 0.5 * (max(widths) - width) * target.height / height
        box = (-aside, 0.0, target.width + aside, float(target.height))
        mask = resample_mask(target.mask, max(widths), height, box) >= 0.5
        rule = f"{target.rule}; on a canvas of {mask.shape[1]} x {height} px that all share"
        found.append(replace(target, mask=mask, rule=rule, letters=None, change=None))
    return tuple(found)


def _nearest_colour(lab: Array, palette: Array, kept: Labels) -> Labels:
    """Return each pixel's nearest row of the palette among `kept`, (H, W); look-alikes count as one."""
    apart = [
        k
        for n, k in enumerate(kept.tolist())
        if all(np.linalg.norm(palette[k] - palette[j]) > _SAME for j in kept[:n])
    ]
    best = np.full(lab.shape[:2], np.inf)
    found = np.zeros(lab.shape[:2], dtype=np.int64)
    for k in apart:
        away = _distance(lab, palette[k])
        nearer = away < best
        best[nearer], found[nearer] = away[nearer], k
    return found


def _distance(lab: Array, mixture: Array) -> Array:
    """Return the squared dissimilarity of colours (H, W, 3) to a mixture (3,), both OKLab, (H, W).

    Hue counts in full, lightness and chroma less, since lamps mix only strong colours. But a colour of
    little chroma must get none: a grey must not turn blue because it is as dark.
    """
    chroma, strong = np.hypot(lab[..., 1], lab[..., 2]), float(np.hypot(*mixture[1:]))
    light = _LIGHTNESS * (lab[..., 0] - mixture[0])
    weight = 1.0 - (1.0 - _CHROMA) * np.minimum(chroma / 0.1, 1.0)  # strong from 0.1 on
    fuller = weight * (chroma - strong)
    along = lab[..., 1] * mixture[1] + lab[..., 2] * mixture[2]
    hue = 2.0 * np.maximum(chroma * strong - along, 0.0)
    return np.asarray(light**2 + fuller**2 + hue)


def _without_seams(srgb: Array, labels: Labels) -> Labels:
    """Relabel pixels whose colour lies between two flat neighbours as the nearer of them."""
    rows, columns = np.nonzero(_local_range(srgb) > _FLAT)
    found = labels.copy()
    height, width = labels.shape
    for reach in (2, 3, 4):  # px, to either side of a pixel
        best, name = np.full(len(rows), np.inf), np.zeros(len(rows), dtype=np.int64)
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            (a, b), (c, d) = (
                (
                    np.clip(rows + sign * reach * down, 0, height - 1),
                    np.clip(columns + sign * reach * right, 0, width - 1),
                )
                for sign in (1, -1)
            )
            one, here = srgb[a, b], srgb[rows, columns]
            way = srgb[c, d] - one
            along = ((here - one) * way).sum(-1) / np.maximum((way * way).sum(-1), 1e-9)
            beside = np.linalg.norm(here - one - along[:, None] * way, axis=-1)
            between = (labels[a, b] != labels[c, d]) & (along > 0) & (along < 1)
            # sRGB distance of antialiased pixels from the line between two colours
            between &= (beside < 0.10) & (beside < best)
            best[between] = beside[between]
            nearer = np.where(along < 0.5, labels[a, b], labels[c, d])
            name[between] = nearer[between]
        settled = np.isfinite(best)
        found[rows[settled], columns[settled]] = name[settled]
        rows, columns = rows[~settled], columns[~settled]
    return found


def _without_grain(srgb: Array) -> Array:
    """Smooth the picture and keep its edges, by total variation (Chambolle 2004)."""
    from skimage.restoration import denoise_tv_chambolle

    smoothed = denoise_tv_chambolle(srgb, weight=_FLATTENED, channel_axis=-1)
    took_part("scikit-image", "smoothed the photograph's grain")
    return np.asarray(np.clip(smoothed, 0.0, 1.0))


def _local_range(srgb: Array) -> Array:
    """Return the range of values around each pixel, in the channel where it is largest, (H, W)."""
    return np.asarray(
        (maximum_filter(srgb, (3, 3, 1)) - minimum_filter(srgb, (3, 3, 1))).max(axis=-1)
    )


def _vote_around(labels: Labels, reach_px: float) -> Labels:
    """Replace each label by the majority around it, which drops detail finer than the tube."""
    names = np.unique(labels)
    votes = [gaussian_filter((labels == k).astype(np.float32), reach_px) for k in names]
    return np.asarray(names[np.argmax(votes, axis=0)])


def _without_specks(labels: Labels, least_px: float) -> Labels:
    """Merge spots of fewer pixels into their surroundings."""
    small = np.zeros(labels.shape, dtype=bool)
    for k in np.unique(labels):
        parts, count = label(labels == k)
        sizes = np.bincount(parts.ravel(), minlength=count + 1)
        sizes[0] = labels.size
        small |= (sizes < least_px)[parts]
    if not small.any() or small.all():
        return labels
    rows, columns = distance_transform_edt(small, return_distances=False, return_indices=True)
    return np.asarray(labels[rows, columns])


def _without_slivers(labels: Labels, reach_px: float) -> Labels:
    """Merge tapering ends thinner than twice the reach into their neighbours.

    No strand is as thin as a crescent's horn. An area that is thin all over, such as a line, stays.
    """
    thin = np.zeros(labels.shape, dtype=bool)
    for k in np.unique(labels):
        area = labels == k
        core = distance_transform_edt(np.pad(area, 1, constant_values=True))[1:-1, 1:-1] > reach_px
        if not core.any():
            continue
        horns = area & (distance_transform_edt(~core) > reach_px + 1.0)
        parts, count = label(area)
        cored = np.zeros(count + 1, dtype=bool)
        cored[np.unique(parts[core])] = True
        thin |= horns & cored[parts]
    if not thin.any():
        return labels
    rows, columns = distance_transform_edt(thin, return_distances=False, return_indices=True)
    return np.asarray(labels[rows, columns])


def _tell_lost(srgb: Array, off: Array, seen: Array) -> tuple[str, ...]:
    """Name the colours that cannot be mixed and how they will look, the largest areas first."""
    far = off > _TOLD[0]
    if far.mean() < _TOLD[1]:
        return ()
    steps = np.rint(srgb * 7).astype(np.int64)  # similar colours count as one
    keys = (steps[..., 0] * 8 + steps[..., 1]) * 8 + steps[..., 2]
    names, counts = np.unique(keys[far], return_counts=True)
    told = []
    for key in names[np.argsort(-counts, kind="stable")][:4]:
        at = far & (keys == key)
        if (part := at.mean()) < 0.5 * _TOLD[1]:
            break
        told.append(f"{_name_median(srgb[at])} as {_name_median(seen[at])} ({100 * part:.0f} %)")
    if not told:  # only blurred outlines
        return ()
    share = f"{100 * far.mean():.0f} % of the picture has colours that these lamps cannot mix"
    return (f"{share}: {', '.join(told)}",)


def _name_median(pixels: Array) -> str:
    """Write the median of colours (n, 3) as #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*np.rint(255 * np.median(pixels, axis=0)).astype(int))
