"""Measure how well a shadow gives the greys of a picture by the spacing of its strands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.check import Check, at_most, skip_check
from knotfab_validators.shadows.frame import WorkingFrame

__all__ = ["SIGMA_RADII", "Tone", "check_tone", "measure_tone"]

# standard deviation of the Gaussian through which shadow and picture are seen, in radii of the tube's shadow
SIGMA_RADII = 3.0
MOST = 0.5  # a share of the error of one even grey


@dataclass(frozen=True)
class Tone:
    """Greys of one view: `error` is the rms difference of the greys, and `flat`, that of an even grey.

    Both are shares of the way from white to the densest shadow, `densest`, which parallel strands with
    their clearance can throw.
    """

    error: float
    flat: float
    densest: float


def measure_tone(
    shadow: Mask, darkness: Array, frame: WorkingFrame, radius_px: float, clearance: float
) -> Tone:
    """Measure the low-passed shadow against the picture's low-passed greys, over the picture's frame.

    Where the picture is white no shadow is wanted, where it is black the densest: strands of radius r and
    clearance c side by side darken 2r / (2r + c). Nothing is fitted to the shadow.

    Args:
        shadow: (H, W) on the padded frame. darkness: the picture's, 0 .. 1, in its own pixels.
        radius_px: radius of the tube's shadow. clearance: clearance of strands, in radii.
    """
    from PIL import Image
    from scipy import ndimage

    inside = frame.window
    size = (frame.width, frame.height)
    filtered = Image.fromarray(darkness.astype(np.float32)).resize(size, Image.Resampling.BOX)
    wanted = np.zeros(shadow.shape)
    densest = 2.0 / (2.0 + clearance)
    wanted[inside] = densest * np.asarray(filtered, dtype=np.float64)
    sigma = SIGMA_RADII * radius_px
    seen = ndimage.gaussian_filter(shadow.astype(np.float64), sigma, mode="constant")[inside]
    asked = ndimage.gaussian_filter(wanted, sigma, mode="constant")[inside]
    error = float(np.sqrt(((seen - asked) ** 2).mean()))
    return Tone(error / densest, float(asked.std()) / densest, densest)


def check_tone(tones: dict[str, Tone]) -> Check:
    """Check `tone`: the greys are nearer to those asked for than an even grey would be, by half."""
    name = "tone"
    if not tones:
        return skip_check(name, "no view asks for greys")
    worst = max(tones, key=lambda view: tones[view].error / max(tones[view].flat, 1e-9))
    found = tones[worst]
    detail = (
        f"rms difference of the greys of shadow and picture, both seen through a Gaussian of {SIGMA_RADII:g} "
        f"tube radii, from white to the densest shadow ({found.densest:.0%} dark), view {worst}; "
        f"an even grey has {found.flat:.3f}"
    )
    return at_most(name, found.error, MOST * found.flat, "", detail)
