"""The light that lamps of several colours throw on one screen, and what colours an eye sees in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.shadows.lamp import SceneLamp, is_flat
from knotfab_validators.shadows.view import ViewGeometry

if TYPE_CHECKING:
    from knotfab_formats.scene import Room

__all__ = ["Bytes", "Light", "colour_error", "light_of", "share_of_light", "to_lab", "to_srgb"]

Bytes = NDArray[np.uint8]
FROM_DISC, FROM_BALL = np.pi, 4 * np.pi  # the flux of a lamp of intensity 1


@dataclass(frozen=True)
class Light:
    """The light on a screen of H x W pixels, in linear red, green and blue.

    `colours` (n, 3) are the lamps' own light in the middle of the frame, `falloff` (n, H, W) what share of
    it reaches a pixel that sees the lamp, and `other` (3,) what reaches all pixels besides. `white` (3,) is
    all of it in the middle, which an eye that is used to it calls white.
    """

    colours: Array
    falloff: Array
    other: Array

    @property
    def white(self) -> Array:
        return np.asarray(self.colours.sum(axis=0) + self.other)

    def mix(self, lit: Array) -> Array:
        """Return (H, W, 3) what is seen where shares `lit` (n, H, W) of the lamps are seen; white is 1."""
        shape = self.falloff.shape[1:]
        return self._mix(lit.reshape(len(lit), -1), slice(None)).reshape(*shape, 3)

    def mix_at(self, lit: Array, where: Mask) -> Array:
        """Return `mix` for the k pixels of a mask alone, of shares (n, k): (k, 3)."""
        return self._mix(lit, where.ravel())

    def flat(self, codes: Ints) -> Array:
        """Return (..., 3) the colour in the middle where the lamps of a code's bits are hidden."""
        bits = np.arange(len(self.colours))
        lit = 1 - (codes[..., None] >> bits & 1)
        return self._white(lit @ self.colours + self.other)

    def _mix(self, lit: Array, where: Mask | slice) -> Array:
        falloff = self.falloff.reshape(len(self.falloff), -1)[:, where]
        return self._white((lit * falloff).T @ self.colours + self.other)

    def _white(self, light: Array) -> Array:
        """Scale by white, channel by channel; a channel in which nothing shines stays dark."""
        white = self.white
        return np.asarray(np.where(white > 0, light / np.where(white > 0, white, 1.0), 0.0))


def light_of(
    lamps: list[tuple[SceneLamp, Array, ViewGeometry]], room: Room, size: tuple[int, int]
) -> Light:
    """Give the light of lamps, each with its colour (3,) and view, on the pixels (H, W) of a common frame.

    Grey walls of a room throw back of each lamp's light what an integrating sphere does: q / (A (1 - q)).
    """
    colours = np.array([colour for _, colour, _ in lamps], dtype=np.float64)
    falloff, thrown = [], []
    for lamp, _, geometry in lamps:
        light = share_of_light(lamp, geometry)
        middle = share_of_light(lamp, _middle_pixel(geometry)).item()
        falloff.append(light.reshape(size) / middle)
        flux = FROM_DISC if is_flat(lamp) else FROM_BALL
        back = room.reflectance / (1 - room.reflectance)
        thrown.append(flux * back / (1e6 * room.area_m2 * middle) if room.area_m2 > 0 else 0.0)
    other = room.ambient * colours.sum(axis=0) + np.array(thrown) @ colours
    return Light(colours, np.array(falloff), other)


def share_of_light(lamp: SceneLamp, geometry: ViewGeometry) -> Array:
    """Return (H W,) what a lamp of intensity 1 gives each pixel, per mm²: the cosine on the screen over d².

    A flat lamp, which faces along the view's axis, is dimmer at an angle, by its cosine.
    """
    v, u = np.mgrid[: geometry.height, : geometry.width]
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
    at, normal = geometry.touching(pixels)
    ray = geometry.light - at
    far = np.linalg.norm(ray, axis=1)
    light = np.maximum((ray * normal).sum(axis=1), 0.0) / far**3
    if is_flat(lamp):
        light = light * np.maximum(ray @ geometry.axis, 0.0) / far
    return np.asarray(light)


def _middle_pixel(geometry: ViewGeometry) -> ViewGeometry:
    """Return the view of the frame's middle alone."""
    return replace(geometry, origin=geometry.middle, width=1, height=1)


def to_srgb(light: Array) -> Bytes:
    """Turn linear light (..., 3), white at 1, into sRGB of 8 bits (IEC 61966-2-1); brighter is white."""
    kept = np.clip(light, 0.0, 1.0)
    coded = np.where(kept <= 0.0031308, 12.92 * kept, 1.055 * kept ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * coded).astype(np.uint8)


def to_lab(srgb: Bytes) -> Array:
    """Return sRGB of 8 bits (..., 3) in CIELAB of D65."""
    from skimage.color import rgb2lab

    return np.asarray(rgb2lab(srgb))


def colour_error(seen: Bytes, wanted: Bytes) -> Array:
    """Give (n,) differences ΔE (CIEDE2000) of colours (n, 3) in sRGB of 8 bits, each pair worked out once."""
    from skimage.color import deltaE_ciede2000

    weights = 256 ** np.arange(6, dtype=np.int64)
    packed = np.concatenate([seen, wanted], axis=1).astype(np.int64) @ weights
    pairs, back = np.unique(packed, return_inverse=True)
    both = (pairs[:, None] // weights % 256).astype(np.uint8)
    found: Array = deltaE_ciede2000(  # type: ignore[no-untyped-call]
        to_lab(both[:, :3]), to_lab(both[:, 3:])
    )
    return np.asarray(found)[back]
