"""Estimate from pixels, in a second, whether a person could know a picture in any tube's shadow.

A search takes minutes to find that it cannot draw noise, and so did openings of thousands of polygons. What
a tube of one radius could draw is a union of discs. A few of those that come nearest to the picture are
drawn, and what each of them loses is counted by labelling. It is an estimate: only where all of them
are far from the verdict's demands (docs/verdict.md) is it a refusal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Mask
from knotfab.picture.opening import draw_discs, thicken
from knotfab.picture.silhouette import (
    holes_of,
    mask_iou,
    outline_px,
    pieces_of,
    sample_mask,
)

if TYPE_CHECKING:
    pass


_PIXELS = 4.0  # pixels to a radius, where the picture is compared
_LEAST_PX, _MOST_PX = 256, 1024  # px of its longer side there
_SOLID = 0.5  # radii of outline to the area, below which most of it is wider than two tubes
_COVERED = 1.0 / 3.0  # a piece or hole of which a smaller share is covered is lost
_SHARED = 0.25  # a piece of which a smaller share is covered merely touches the drawing
_SPECK = 0.5  # radii: the side of a square as large as what nobody misses
_DRAWN = 0.9  # IoU of an opening that is a remedy
_CHANGED = 0.65  # a share of all pieces and holes; the verdict allows one in two
_DENSITIES = (0.3, 0.4, 0.5, 0.6, 0.7)  # shares of ink in a disc, from which on it is drawn
_FINER = (0.8, 0.65, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.1, 0.07, 0.05, 0.03)  # radii that are tried


@dataclass(frozen=True)
class Likeness:
    """The likeness of the picture and the best of the unions of discs.

    `changes` are pieces and holes lost, and pieces run together, of `features` pieces and holes.
    """

    iou: float
    changes: int
    features: int

    @property
    def recognisable(self) -> bool:
        """True if a search may be worth it."""
        # changes that are never too many; the verdict allows 3
        most = max(_CHANGED * self.features, 6)
        # the verdict asks for 0.5, but its topology for more
        return self.iou >= 0.55 and self.changes <= most


def estimate_likeness(mask: Mask, radius_px: float, unions: int = 7) -> Likeness | None:
    """Estimate how like the picture tubes of this radius could draw; None where most of it is wider.

    Args:
        mask: (H, W), not empty. radius_px: radius of the tube's shadow. unions: how many are drawn.
    """
    if outline_px(mask) * radius_px < _SOLID * mask.sum():
        return None
    seen, scale = _resample(mask, radius_px)
    radius = radius_px * scale
    counted = _Features(seen, radius)
    best: Likeness | None = None
    for drawn in islice(_unions_of_discs(seen, radius), unions):
        found = counted.compare(drawn)
        if found.recognisable:
            return found
        best = found if best is None else max(best, found, key=lambda one: one.iou)
    return best


def opened_share(mask: Mask, radius_px: float) -> float:
    """Return the share of a silhouette that its opening by a disc keeps."""
    seen, scale = _resample(mask, radius_px)
    return float((next(_unions_of_discs(seen, radius_px * scale)) & seen).sum() / seen.sum())


def compare_lines(asked: Mask, widened: Mask, radius_px: float) -> Likeness:
    """Compare a drawing's pieces and holes before and after its strokes are widened to the tube's shadow.

    Such a drawing is judged by its widened strokes, so by its topology alone. It is compared as fine as it
    is: sampled, a stroke of a px or two falls to dashes. A screen of the finest meshes is no drawing, and
    its meshes no specks.
    """
    _, holes = holes_of(asked)
    # specks of holes that together are more than this share of the ink are a screen
    screen = holes[holes < (_SPECK * radius_px) ** 2].sum() > 0.5 * asked.sum()
    found = _Features(asked, 0.0 if screen else radius_px).compare(widened)
    return replace(found, iou=1.0)


def recognisable_radius(mask: Mask, radius_px: float) -> float | None:
    """Return the largest of a few smaller radii whose opening draws the picture; None where none does.

    A picture s times as large is to the same tube what this one is to a tube of a radius 1 / s.
    """
    low, high = 0, len(_FINER)  # halve: a thinner tube draws all that a thicker one draws
    while low < high:
        middle = (low + high) // 2
        found = estimate_likeness(mask, radius_px * _FINER[middle], unions=1)
        if found is None or (found.recognisable and found.iou >= _DRAWN):
            high = middle
        else:
            low = middle + 1
    return radius_px * _FINER[low] if low < len(_FINER) else None


def _resample(mask: Mask, radius_px: float) -> tuple[Mask, float]:
    """Give the mask by nearest sampling, as fine as the radius needs it, and its px to one of the picture."""
    longer = max(mask.shape)
    side = float(np.clip(longer * _PIXELS / radius_px, _LEAST_PX, _MOST_PX))
    height, width = (max(1, round(n * side / longer)) for n in mask.shape)
    return sample_mask(mask, width, height), side / longer


def _unions_of_discs(mask: Mask, radius: float) -> Iterator[Mask]:
    """Yield unions of discs that tubes may draw of a mask: without its thin parts, and with them widened.

    Then discs wherever there is ink enough in them, which may run over what is finer than they are.
    """
    from scipy import fft, ndimage

    inside = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
    yield draw_discs(inside >= radius, radius)
    yield thicken(mask, 2.0 * radius)
    size = [fft.next_fast_len(n + 2 * int(np.ceil(radius)), real=True) for n in mask.shape]
    v, u = (fft.fftfreq(n, 1.0 / n) for n in size)  # whole pixels, either way around
    disc = np.hypot(v[:, None], u) <= radius
    spectrum = fft.rfft2(mask, size) * fft.rfft2(disc / disc.sum())
    density: Array = fft.irfft2(spectrum, size)[: mask.shape[0], : mask.shape[1]]
    for least in _DENSITIES:
        yield draw_discs(density >= least, radius)


class _Features:
    """A picture's pieces and holes, against which what is drawn is held."""

    def __init__(self, mask: Mask, radius: float) -> None:
        self._mask = mask
        speck = (_SPECK * radius) ** 2
        self._pieces, self._holes = (
            _drop_specks(*found, speck) for found in (pieces_of(mask), holes_of(mask))
        )

    def compare(self, drawn: Mask) -> Likeness:
        """Return the IoU, and what is lost or run together."""
        pieces, areas = self._pieces
        kept = _share(pieces, areas, drawn) >= _COVERED
        lost = int((~kept).sum())
        lost += int((_share(*self._holes, ~drawn) < _COVERED).sum())
        labels, _ = pieces_of(drawn)
        both = (pieces > 0) & drawn
        count = int(labels.max()) + 1
        pairs, pixels = np.unique(
            pieces[both].astype(np.int64) * count + labels[both], return_counts=True
        )
        piece = pairs // count - 1
        shared = kept[piece] & (pixels >= _SHARED * areas[piece])
        joined = int(shared.sum()) - len(np.unique(pairs[shared] % count))
        return Likeness(
            mask_iou(drawn, self._mask), lost + max(joined, 0), len(areas) + len(self._holes[1])
        )


def _drop_specks(
    labels: NDArray[np.int32], areas: NDArray[np.int64], least: float
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return labels and areas of the regions of at least so many pixels, numbered anew."""
    kept = np.concatenate([[False], areas >= least])
    number = np.where(kept, np.cumsum(kept), 0).astype(np.int32)
    return number[labels], areas[kept[1:]]


def _share(labels: NDArray[np.int32], areas: NDArray[np.int64], covered: Mask) -> Array:
    """Return (n,) what share of each region is covered."""
    counts = np.bincount(labels[covered], minlength=len(areas) + 1)[1:]
    return np.asarray(counts / np.maximum(areas, 1))
