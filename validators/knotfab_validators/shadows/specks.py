"""Specks and slits of light in a shadow, counted as they look with the lamp that the scene has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Mask
from knotfab_validators.shadows.distance import depth_in
from knotfab_validators.shadows.topology import close_slits, crop_to_ink

__all__ = ["Specks", "find_specks"]

SEEN = 0.15  # a person sees a speck whose brightest place has this share of the wall's full light
LEAST_MM2 = 0.25  # the least area of a speck: half a millimetre square


@dataclass(frozen=True)
class Specks:
    """The number of specks, their area together and the largest, mm² on the wall, and its place (u, v)."""

    count: int = 0
    area_mm2: float = 0.0
    largest_mm2: float = 0.0
    at: tuple[float, float] = (0.0, 0.0)


def find_specks(
    shadow: Mask, target: Mask, slit_px: float, reach_px: float, blur_px: float, pixel_mm: float
) -> Specks:
    """Find the specks of light that a person sees where the picture is dark.

    A speck is light that the shadow closed by `slit_px` covers, farther than `reach_px` within the picture:
    pinholes and slits, but no tip that is cut off and no outline that is off. The lamp's penumbra blurs it;
    what is left of its light at its brightest says whether it is seen.

    Args:
        shadow, target: (H, W), on one grid. blur_px: the width of the lamp's penumbra. pixel_mm: on the wall.
    """
    from scipy.ndimage import center_of_mass, gaussian_filter, label, maximum

    cropped = crop_to_ink(shadow, target, 2 * slit_px)
    if cropped is None:
        return Specks()
    seen, wanted, (left, top) = cropped
    light = close_slits(seen, slit_px) & ~seen & (depth_in(wanted) > reach_px)
    labels, count = label(light, np.ones((3, 3)))
    if not count:
        return Specks()
    # a disc that blurs over `blur_px` spreads by a quarter of it
    soft = gaussian_filter(light.astype(np.float32), blur_px / 4, truncate=3.0)
    number = np.arange(1, count + 1)
    areas = np.bincount(labels.ravel())[1:] * pixel_mm**2
    bright = np.asarray(maximum(soft, labels, number))
    kept = number[(areas >= LEAST_MM2) & (bright >= SEEN)]
    if not len(kept):
        return Specks()
    largest = int(kept[areas[kept - 1].argmax()])
    v, u = center_of_mass(labels == largest)
    own = areas[kept - 1]
    return Specks(len(kept), float(own.sum()), float(own.max()), (float(u) + left, float(v) + top))
