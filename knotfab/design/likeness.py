"""Estimate from pixels, within a second, whether any tube's shadow could show a picture recognisably.

A tube of one radius draws a union of discs. A few unions that come near to the picture are drawn, and the
pieces and holes that each loses are counted. Only if all are far from what the verdict demands
(docs/verdict.md) is the picture refused; a search would take minutes to find that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Mask
from knotfab.picture.opening import draw_discs, thicken
from knotfab.picture.silhouette import holes_of, mask_iou, outline_px, pieces_of, sample_mask

_PIXELS = 4.0  # resolution of the comparison, px per radius
_LEAST_PX, _MOST_PX = 256, 1024  # limits on its longer side
# outline times radius over area, below which most of a picture is wider than two tubes
_SOLID = 0.5
_COVERED = 1.0 / 3.0  # share of a piece or hole that must be covered, or it is lost
_SHARED = 0.25  # share of a piece that must be covered for it to join another
_SPECK = 0.5  # side of the largest square that nobody misses, in radii
_DRAWN = 0.9  # IoU of an opening that `recognisable_radius` accepts
_CHANGED = 0.65  # share of pieces and holes that may change; the verdict allows one in two
_DENSITIES = (0.3, 0.4, 0.5, 0.6, 0.7)  # least share of ink in a disc that is drawn
_FINER = (0.8, 0.65, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.1, 0.07, 0.05, 0.03)  # thinner radii to try


@dataclass(frozen=True)
class Likeness:
    """The likeness of a picture and a drawing of it.

    `changes` counts lost pieces and holes, and merged pieces, of `features` pieces and holes in all.
    """

    iou: float
    changes: int
    features: int

    @property
    def recognisable(self) -> bool:
        """Whether a search may reach the verdict's demands."""
        most = max(_CHANGED * self.features, 6)  # the verdict always allows 3
        # the verdict asks for an IoU of 0.5, but its topology needs more
        return self.iou >= 0.55 and self.changes <= most


def estimate_likeness(mask: Mask, radius_px: float, unions: int = 7) -> Likeness | None:
    """Estimate how well a tube of this radius could draw a picture.

    Return None if most of the picture is wider than two tubes, which any filling draws.

    Args:
        mask: (H, W), not empty. radius_px: radius of the tube's shadow. unions: number of drawings to try.
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


def compare_lines(asked: Mask, widened: Mask, radius_px: float) -> Likeness:
    """Compare a line drawing's pieces and holes before and after its strokes are widened.

    The widened strokes are what the part is judged by, so only topology counts here. The full resolution is
    used, since sampling would break strokes of a pixel or two. If most holes are tiny, like those of a screen
    are, they count as well.
    """
    _, holes = holes_of(asked)
    # holes the size of specks that add up to half the ink make a screen
    screen = holes[holes < (_SPECK * radius_px) ** 2].sum() > 0.5 * asked.sum()
    found = _Features(asked, 0.0 if screen else radius_px).compare(widened)
    return replace(found, iou=1.0)


def recognisable_radius(mask: Mask, radius_px: float) -> float | None:
    """Return the largest of a few thinner radii whose opening draws the picture, px; None if none does.

    By its ratio to `radius_px` a caller can as well enlarge the picture.
    """
    low, high = 0, len(_FINER)  # bisection: a thinner tube draws all that a thicker one draws
    while low < high:
        middle = (low + high) // 2
        found = estimate_likeness(mask, radius_px * _FINER[middle], unions=1)
        if found is None or (found.recognisable and found.iou >= _DRAWN):
            high = middle
        else:
            low = middle + 1
    return radius_px * _FINER[low] if low < len(_FINER) else None


def _resample(mask: Mask, radius_px: float) -> tuple[Mask, float]:
    """Sample the mask as finely as the radius needs; return it and its scale, px per px of the picture."""
    longer = max(mask.shape)
    side = float(np.clip(longer * _PIXELS / radius_px, _LEAST_PX, _MOST_PX))
    height, width = (max(1, round(n * side / longer)) for n in mask.shape)
    return sample_mask(mask, width, height), side / longer


def _unions_of_discs(mask: Mask, radius: float) -> Iterator[Mask]:
    """Yield unions of discs that resemble a mask: its opening, then the mask with thin parts widened.

    Then come unions of all discs with enough ink in them, which may cover finer gaps.
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
    """A picture's pieces and holes, with which drawings are compared."""

    def __init__(self, mask: Mask, radius: float) -> None:
        self._mask = mask
        speck = (_SPECK * radius) ** 2
        self._pieces, self._holes = (
            _drop_specks(*found, speck) for found in (pieces_of(mask), holes_of(mask))
        )

    def compare(self, drawn: Mask) -> Likeness:
        """Return the IoU, and the number of features that are lost or merged."""
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
    """Return labels and areas of the regions of at least `least` pixels, renumbered."""
    kept = np.concatenate([[False], areas >= least])
    number = np.where(kept, np.cumsum(kept), 0).astype(np.int32)
    return number[labels], areas[kept[1:]]


def _share(labels: NDArray[np.int32], areas: NDArray[np.int64], covered: Mask) -> Array:
    """Return the covered share of each region, (n,)."""
    counts = np.bincount(labels[covered], minlength=len(areas) + 1)[1:]
    return np.asarray(counts / np.maximum(areas, 1))
