"""Which pixels of a picture are its silhouette, by the rules of docs/silhouette.md."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from colorsys import rgb_to_hsv
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor

from knotfab.base.arrays import Array, Mask
from knotfab.picture.colours import cluster_colours, enclosed_parts
from knotfab.picture.silhouette import holes_of
from knotfab_formats.errors import InputError
from knotfab_formats.views import Reading

Levels = NDArray[Any]  # (H, W) or (H, W, 3) of 8 bits, or grey of 16

_ROWS = 512  # rows compared at once, to bound the memory
_LUMA = (299, 587, 114)  # ITU-R BT.601, in thousandths
# levels (of 255) by which blank paper varies after JPEG compression
_NOISE = 8.0
_WHITE_TOO = ", and the white is drawn as dark as the rest"  # what lies on white paper unseen
# upper bounds of hues, degrees, and their names
_HUES: tuple[tuple[int, str], ...] = (
    *((15, "red"), (40, "orange"), (68, "yellow"), (165, "green"), (195, "turquoise")),
    *((255, "blue"), (290, "purple"), (345, "pink"), (361, "red")),
)


class Ink(NamedTuple):
    """The pixels of a picture that are ink, and the rule in words, its figures in brackets."""

    mask: Mask
    rule: str


def find_ink(image: Image.Image, reading: Reading, what: str) -> Ink:
    """Find the pixels of a decoded picture that are ink.

    Args:
        image: upright, and cropped already. what: how an error names
            the picture.

    Raises:
        InputError: the picture is transparent everywhere, or all one colour.
    """
    colours, alpha = split_channels(image)
    least = reading.threshold if reading.ink in ("auto", "alpha") else 0.5
    clear = None if alpha is None or alpha.min() == 255 else alpha < 255 * least
    if alpha is not None and clear is not None and clear.all():
        raise _explain_faint(alpha, what)
    share = f"{reading.threshold:g} of the largest difference"
    if clear is not None and (reading.ink == "alpha" or takes_alpha(colours, alpha, reading)):
        return _take_opaque(colours, ~clear, reading)
    if reading.ink == "alpha":
        raise InputError(
            what, "--ink alpha needs transparency, and it has none", "Leave --ink out."
        )
    if reading.ink == "auto":
        middle = np.median(take_border(colours), axis=0)
        mask = _mark_different(colours, middle, reading.threshold, what, clear)
        rule = f"{_tell_shape(middle, colours, mask)} [what differs from the border's colour, "
        rule += f"{_name(middle, colours)}, by more than {share}]"
        return Ink(mask, rule + _tell_colours(colours, mask))
    opaque = np.ones(colours.shape[:2], dtype=bool) if clear is None else ~clear
    if reading.ink == "flood":
        inside = opaque & ~_flood_border(colours, reading.threshold, what)
        return Ink(inside, f"what the colours of the border do not reach [each taking in {share}]")
    if reading.ink in ("dark", "light"):
        return Ink(*_split_brightness(colours, opaque, reading, what))
    wanted = np.array(ImageColor.getrgb(reading.ink), dtype=np.float64)
    if colours.ndim == 2:  # greys are colours too: black is not green for want of red
        most = 255.0 if colours.dtype == np.uint8 else np.iinfo(np.uint16).max
        colours = np.stack([colours * (255.0 / most)] * 3, axis=-1)
    away = square_distances(colours, wanted)
    near = away < reading.threshold**2 * away[opaque].max()
    if clear is not None and away[opaque].max() == 0:
        near = opaque
    if not (near & opaque).any():
        raise InputError(
            what,
            f"nothing in it is near {reading.ink}",
            "Name a colour that it has; `knotfab preview` without --ink tells its colours.",
        )
    # may differ from the one asked for
    called = _word_of(np.median(colours[near & opaque], axis=0))
    exact = f"[what differs from {reading.ink} by less than {share}]"
    return Ink(near & opaque, f"what is {called} {exact}")


def split_channels(image: Image.Image) -> tuple[Levels, NDArray[np.uint8] | None]:
    """Return colours (H, W) or (H, W, 3), and alpha (H, W), None without any."""
    key = image.info.get("transparency")
    if image.mode.startswith("I"):  # 16-bit grey, kept at full precision
        grey = np.asarray(image)
        alpha = np.where(grey == key, 0, 255) if isinstance(key, int) else None
        return grey, None if alpha is None else alpha.astype(np.uint8)
    if image.mode in ("L", "1") and key is None:
        return np.asarray(image.convert("L")), None
    if key is not None or image.mode in ("LA", "La", "PA", "RGBA", "RGBa"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            rgba = np.asarray(image.convert("RGBA"))
        return rgba[..., :3], rgba[..., 3]
    return np.asarray(image if image.mode == "RGB" else image.convert("RGB")), None


def takes_alpha(colours: Levels, alpha: NDArray[np.uint8] | None, reading: Reading) -> bool:
    """Return whether transparency decides what is ink: if enough is clear, and `reading` says nothing else.

    Up to a hundredth of clear pixels is a fault of export, unless nothing else shows a shape.
    """
    if alpha is None or reading.ink != "auto":
        return False
    clear = alpha < 255 * reading.threshold
    share = clear.mean()
    if share > 0.01 or not share:  # the largest share of pixels that are clear by accident
        return bool(share)
    seen = colours[~clear]
    return bool((seen.max(axis=0).astype(np.int64) - seen.min(axis=0)).max() <= _NOISE)


def _explain_faint(alpha: NDArray[np.uint8], what: str) -> InputError:
    """Make the error for a picture without opaque pixels, with a remedy."""
    from scipy import ndimage

    peak = int(alpha.max()) / 255
    if not peak:
        why = "it is transparent everywhere, so there is no shape in it"
        return InputError(what, why, "Use a picture with opaque pixels where the shape is.")
    drawn = alpha > 0
    # the largest share of hairlines' pixels that lie where hairlines meet
    if ndimage.binary_erosion(drawn, np.ones((3, 3))).sum() < 0.05 * drawn.sum():
        why = f"its lines are thinner than a pixel: its most opaque pixel has alpha {peak:.2g}"
        return InputError(what, why, "Draw wider lines (of a wider stroke in an SVG).")
    why = f"it is faint: its most opaque pixel has alpha {peak:.2g}"
    return InputError(what, why, f"Add --threshold {peak / 2:.2g}, or make the drawing opaque.")


def _take_opaque(colours: Levels, opaque: Mask, reading: Reading) -> Ink:
    """Mark the opaque pixels, without enclosed parts in another colour than the main one."""
    rule = f"what is opaque [alpha at least {reading.threshold:g}]"
    if reading.ink == "alpha" or colours.ndim == 2:
        return Ink(opaque, rule)
    holes, clusters = enclosed_parts(colours.astype(np.uint8, copy=False), opaque)
    if clusters is not None and holes.any():
        rule += ", without the parts of other colours inside it "
        rule += f"[that {name_colour(clusters.colours[0])}, the largest colour, encloses]"
    mask = opaque & ~holes
    return Ink(mask, rule + _tell_colours(colours, mask, clear=True))


def _tell_colours(colours: Levels, mask: Mask, clear: bool = False) -> str:
    """Name the colours where ink has several, since a person may want only one of them.

    Colours of soft edges, nowhere 3 px thick, do not count. White beside a larger colour is told on a `clear`
    ground, since it may be meant as paper.
    """
    from scipy import ndimage

    if colours.ndim == 2 or colours.dtype != np.uint8 or not mask.any():
        return ""
    found = cluster_colours(colours[mask].astype(np.uint8, copy=False))
    # share of the ink of a colour that is told
    told = [k for k, share in enumerate(found.shares) if share >= 0.02]
    if len(told) < 2:
        return ""
    kinds = found.label(colours)
    told = [k for k in told if ndimage.binary_erosion(mask & (kinds == k), np.ones((3, 3))).any()]
    if len(told) < 2:
        return ""
    names = [(_word_of(found.colours[k]), name_colour(found.colours[k])) for k in told[:4]]
    words = [
        f"{word} ({name}, {found.shares[k]:.0%})"
        for k, (word, name) in zip(told, names, strict=False)
    ]
    (most, name), white = names[0], clear and "white" in [word for word, _ in names[1:]]
    taken = f'--ink "{name}" draws the {most} alone'
    too = _WHITE_TOO if white else ""
    return f"; its colours are {', '.join(words[:-1])} and {words[-1]}{too}: {taken}"


def take_border(colours: Levels) -> Levels:
    """Return the outermost pixels, each once, (n, channels)."""
    rows = [colours[0], colours[-1], colours[1:-1, 0], colours[1:-1, -1]]
    channels = 1 if colours.ndim == 2 else colours.shape[2]
    return np.concatenate([r.reshape(-1, channels) for r in rows])


def _by_rows(colours: Levels, measure: Callable[[NDArray[Any]], NDArray[Any]]) -> NDArray[Any]:
    """Apply `measure` to colours (h, ..., channels), some rows at a time.

    In single precision where the colours have 8 bits: doubled differences, squared and summed, stay
    below 2^24, so that they are exact, and levels on either side of the half fall where they belong.
    """
    kind = np.float32 if colours.dtype == np.uint8 else np.float64
    tops = range(0, len(colours), _ROWS)
    return np.concatenate([measure(colours[top : top + _ROWS].astype(kind)) for top in tops])


def square_distances(colours: Levels, *grounds: Array | NDArray[np.uint8]) -> NDArray[Any]:
    """Return the squared Euclidean differences (...) of colours (..., channels) from the nearest of some."""

    def measure(part: NDArray[Any]) -> NDArray[Any]:
        apart = [part - np.asarray(ground, part.dtype) for ground in grounds]
        return np.asarray(np.minimum.reduce([np.einsum("...k,...k->...", a, a) for a in apart]))

    return _by_rows(colours, measure)


def _mark_different(
    colours: Levels, middle: Array, threshold: float, what: str, clear: Mask | None
) -> Mask:
    """Mark opaque pixels that differ from a colour by a share of the largest difference."""
    squared = square_distances(colours if colours.ndim == 3 else colours[..., None], middle)
    if clear is not None:
        squared[clear] = 0
    largest = float(squared.max())
    if largest == 0.0:
        raise _one_colour(what)
    channels = colours.shape[2] if colours.ndim == 3 else 1
    if colours.dtype == np.uint8 and largest <= channels * _NOISE**2:
        raise InputError(
            what,
            "it is nearly all one colour: nothing in it differs from its border by more than noise does",
            "Use a picture of more contrast, or say what is drawn: --ink dark, --ink light or a colour.",
        )
    return np.asarray(squared > threshold**2 * largest)


def _flood_border(colours: Levels, threshold: float, what: str) -> Mask:
    """Mark the background: pixels near a colour of the border and connected to it."""
    if colours.dtype != np.uint8:
        colours = (colours >> 8).astype(np.uint8)
    rgb = np.stack([colours] * 3, axis=-1) if colours.ndim == 2 else colours
    away = square_distances(rgb, *cluster_colours(take_border(rgb)).colours)
    if away.max() == 0:
        raise _one_colour(what)
    near = away <= threshold**2 * away.max()
    return np.asarray(near & (holes_of(~near)[0] == 0))


def _split_brightness(
    colours: Levels, opaque: Mask, reading: Reading, what: str
) -> tuple[Mask, str]:
    """Mark opaque pixels darker, or lighter, than a share of the way between the extremes."""
    if colours.ndim == 2:
        bright = colours.astype(np.int64)
    else:
        bright = _by_rows(colours, lambda part: part.astype(np.int64) @ _LUMA).astype(np.int64)
    most = 255 * sum(_LUMA) if colours.ndim == 3 else 255 if colours.dtype == np.uint8 else 65535
    dark = reading.ink == "dark"
    # clear pixels are as bright as paper where ink is dark, as dark as night where it is light
    bright = np.where(opaque, bright, most if dark else 0)
    low, high = int(bright.min()), int(bright.max())
    if low == high:
        raise _one_colour(what)
    at = reading.threshold
    edge = low + at * (high - low) if dark else high - at * (high - low)
    mask = bright < edge if dark else bright > edge
    way = "from the darkest to the lightest" if dark else "from the lightest to the darkest"
    return np.asarray(mask), f"what is {reading.ink} [up to {at:g} of the way {way} pixel]"


def _one_colour(what: str) -> InputError:
    return InputError(
        what,
        "it is all one colour, so there is no shape in it",
        "Use a picture whose shape differs from its background, or one with transparency.",
    )


def name_colour(colour: Array | NDArray[np.uint8]) -> str:
    """Write a colour as #rrggbb."""
    return "#" + "".join(f"{int(c):02x}" for c in colour)


def _tell_shape(middle: Array, colours: Levels, mask: Mask) -> str:
    """Name the shape as a person sees it, such as "the dark shape on white"."""
    most = np.iinfo(colours.dtype).max
    ground = np.broadcast_to(255 * middle / most, 3)
    ink = np.broadcast_to(255 * colours[mask].mean(axis=0) / most, 3)
    brighter = float((ink - ground) @ _LUMA) / sum(_LUMA)
    # levels (of 255) by which ink is plainly darker or lighter than its background
    which = "" if abs(brighter) < 64.0 else "light " if brighter > 0 else "dark "
    return f"the {which}shape on {_word_of(ground)}"


def _word_of(colour: Array) -> str:
    """Return a word for a colour (0 .. 255)."""
    hue, saturation, value = rgb_to_hsv(*(colour / 255))
    if value < 0.15 or saturation < 0.15:
        return "black" if value < 0.2 else "white" if value > 0.85 else "grey"
    tone = "pale " if saturation < 0.45 else "dark " if value < 0.5 else ""
    name = next(name for below, name in _HUES if 360 * hue < below)
    return "brown" if name == "orange" and value < 0.65 and saturation >= 0.45 else tone + name


def _name(middle: Array, colours: Levels) -> str:
    """Return a border's colour as a person would write it."""
    if colours.dtype != np.uint8:
        return f"grey {middle[0]:g}"
    return name_colour(np.repeat(middle, 3) if len(middle) == 1 else middle)
