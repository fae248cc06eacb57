"""Estimate from pixels, in a second, whether a person could know a picture in any tube's shadow.

A search takes minutes to find that it cannot draw noise, and so did openings of thousands of polygons. What
a tube of one radius could draw is a union of discs. A few of those that come nearest to the picture are
drawn, and what each of them loses is counted by labelling. It is an estimate: only where all of them
are far from the verdict's demands (docs/verdict.md) is it a refusal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Mask
from knotfab.base.errors import SceneError
from knotfab.design.candidates import drawing_radius, line_radius, too_fine
from knotfab.picture.opening import draw_discs, opening_iou, thicken
from knotfab.picture.silhouette import (
    holes_of,
    mask_iou,
    outline_px,
    pieces_of,
    sample_mask,
    trace_polygon,
)
from knotfab_formats.scene import ResolvedScene

if TYPE_CHECKING:
    from knotfab.design.survey import ViewSurvey


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


# Refuse at once what a search would refuse after minutes, and say what would do.


_HOPELESS = 0.45  # IoU that strokes drawn too thick reach, below which no search helps
# a share of strokes as wide as the tube that run together, above which they are no drawing
_BLOBS = 0.3
_FEW = 200  # pieces and holes of a picture whose polygons are opened


def find_refusal(
    views: Sequence[ViewSurvey], scene: ResolvedScene, sequence: bool = False
) -> SceneError | None:
    """Find the error for pictures that no tube draws so that they are known; None where a search may.

    That is a picture that nobody would know in the shadow of any tube, unless that is accepted. And one of
    thin lines: a stroke thinner than the tube is drawn too thick, at an IoU of their ratio. What the
    thinnest tube leaves out is taken to be drawn so.

    """
    if "unrecognisable" not in scene.accuracy.accept:
        for one in views:
            if not one.recognisable:
                return _unlike(one, scene)
    if len(views) > 1 or sequence or scene.piece.tube_radius_mm is not None:
        return None
    printer, (seen,) = scene.printer, views
    thinnest = printer.min_tube_radius_mm
    target, pixels = seen.target, (seen.target.width, seen.target.height)
    radius = thinnest * seen.px_per_mm
    if seen.view.lines:
        if seen.together <= _BLOBS:
            return None
        return too_fine(
            recognisable_radius(target.asked, radius),
            seen.view,
            pixels,
            printer,
            "its lines are too close together for any printable tube: as wide as one of "
            f"{2 * line_radius(seen.view):g} mm, {seen.together:.0%} of them run together",
            otherwise="",
        )
    if opening_iou(seen.polygon, radius) >= _HOPELESS:
        return None
    drawn = drawing_radius(seen.polygon, radius)
    spilled = 0.0 if drawn is None else drawn / radius
    if spilled >= _HOPELESS:
        return None
    return too_fine(
        drawn,
        seen.view,
        pixels,
        printer,
        f"it is too fine for any printable tube: {printer.name} prints none under {2 * thinnest:g} mm",
    )


def _unlike(seen: ViewSurvey, scene: ResolvedScene) -> SceneError:
    """Return the error for a picture that nobody would know in the shadow of a tube."""
    likeness, px, printer = seen.likeness, seen.px_per_mm, scene.printer
    assert likeness is not None
    given, radius = scene.piece.tube_radius_mm is not None, scene.thinnest_mm
    lost = f"which reaches an IoU of about {likeness.iou:.2f}"
    if likeness.changes:
        which = f"{likeness.changes} of its {likeness.features} pieces and holes"
        lost = f"where {which} are lost or run together"
    if likeness.features > _FEW:  # an opening of so many takes seconds, and there are many to try
        drawn = recognisable_radius(seen.target.asked, radius * px)
    else:
        drawn = drawing_radius(trace_polygon(seen.target.asked), radius * px)
    otherwise = "--accept unrecognisable to build it nevertheless"
    if given and drawn is not None and drawn >= printer.min_tube_radius_mm * px:
        otherwise = f"a thinner tube (--tube-radius {drawn / px:.2f}), or {otherwise}"
    return too_fine(
        drawn,
        seen.view,
        (seen.target.width, seen.target.height),
        printer,
        f"it is too fine for {'such a' if given else 'any printable'} tube: nobody would know "
        f"{seen.target.name} in the shadow of one {2 * radius:g} mm thick, {lost}",
        otherwise,
        "parts",
    )
