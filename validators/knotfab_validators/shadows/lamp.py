"""The shadow of an extended lamp, averaged over points of it, and the light of coloured lamps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from knotfab_formats.verdict import Check, Penumbra
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.check import at_least
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.frame import WorkingFrame
from knotfab_validators.shadows.render import Renderer
from knotfab_validators.shadows.view import ViewGeometry

if TYPE_CHECKING:
    from knotfab_formats.views import Room, Switches

BLUR_TOLERANCES = 4.0  # in tolerances: a lamp that blurs the outline less counts as a point


@dataclass(frozen=True)
class SoftShadow:
    """The effect of the lamp's size; `soft` (H, W) is the share of the lamp hidden at each pixel."""

    found: Penumbra
    soft: NDArray[np.float32]

    @property
    def dark(self) -> Mask:
        """(H, W) where at least half of the lamp is hidden."""
        return np.asarray(self.soft >= 0.5)


def blur_px(vertices: Array, geometry: ViewGeometry, size_mm: float) -> float:
    """Return the widest blur on the receiver, px, by a ball of `size_mm` at any of vertices (n, 3).

    For an edge at height h above the receiver, at distance D from a lamp of height H, the rays
    through it that touch the ball form a cone. It cuts the receiver in an ellipse d h D / ((H - h)²
    - d²/4) long.
    """
    height = (vertices - geometry.origin) @ geometry.normal
    below = np.maximum(geometry.light_height - height, 0.501 * size_mm + 1e-9)
    away = np.linalg.norm(vertices - geometry.light, axis=1)
    blur = size_mm * height * away / (below**2 - size_mm**2 / 4)
    return max(float(blur.max()), 0.0) / geometry.pixel_mm


def averages_lamp(
    effects: Switches,
    vertices: Array,
    geometry: ViewGeometry,
    lamp: SceneLamp,
    tolerance_px: float = 0.25,
) -> bool:
    """Return whether to average over the lamp: the scene demands it, or the blur exceeds the threshold."""
    size = lamp_size(lamp)
    if effects.penumbra is not None or size == 0:
        return bool(effects.penumbra) and size > 0
    return blur_px(vertices, geometry, size) > BLUR_TOLERANCES * tolerance_px


def measure_penumbra(
    renderer: Renderer,
    vertices: Array,
    geometry: ViewGeometry,
    target: Mask,
    sharp: Mask,
    frame: WorkingFrame,
    lamp: SceneLamp,
    tolerance_px: float,
    within: Mask | None = None,
) -> SoftShadow:
    """Average the shadows of points of the lamp, which faces the piece.

    Args:
        renderer: renderer of the mesh whose `vertices` (n, 3) these are, scene coordinates (mm).
        geometry: the view on the pixels of `target` (H, W), the padded `frame`.
        sharp: (H, W) the shadow that the lamp's middle throws.
        within: (H, W) where shadow counts, if the wall ends; None: everywhere.
    """
    widest = blur_px(vertices, geometry, lamp_size(lamp))
    points = lamp_points(lamp, widest, tolerance_px)
    hidden = np.zeros(target.shape, dtype=np.int32)
    for right, up in points:
        light = geometry.light + right * geometry.right + up * geometry.up
        hidden += renderer.render(replace(geometry, light=light))
    if within is not None:
        hidden *= within
    soft = (hidden / len(points)).astype(np.float32)
    size = frame.width * frame.height
    error = float(np.abs(soft - target).sum(dtype=np.float64)) / size
    hard = float(np.count_nonzero(sharp != target)) / size
    dark = 2 * hidden >= len(points)
    found = Penumbra(
        widest_px=widest,
        iou=overlap(dark, target).iou,
        brightness_error=error,
        hard_error=hard,
        samples=len(points),
    )
    return SoftShadow(found, soft)


def check_half_light(ious: Mapping[str, float], iou_floor: float | None) -> Check:
    """Check `half_light`: half-light must keep the IoU that the sharp shadow needs.

    Args:
        ious: by the view's name, IoU of the picture with the places where half of the lamp is
            hidden.
        iou_floor: the least IoU; None: nothing is required.
    """
    name = min(ious, key=lambda view: ious[view])
    detail = f"IoU of the picture with where at least half of the lamp is hidden, view {name}"
    return at_least("half_light", ious[name], iou_floor, "", detail, required=iou_floor is not None)


# Points of a lamp over which its shadow is averaged.


# Points of a disc: its centre, and equally many per ring of equal area. Every set is point-symmetric and
# odd in number, so that the half-light line of a straight edge is exact.
RINGS = {7: (6,), 25: (8, 16), 101: (6, 14, 20, 26, 34)}
GRIDS = {7: 3, 25: 5, 101: 11}  # rows and columns of a rectangle's points
MOST_DISCS = 100  # LEDs up to which each is sampled as a disc; larger arrays are sampled as a whole
# steps of a low-discrepancy sequence in the square (M. Roberts' R2: 1 / g and 1 / g² with g³ = g + 1)
STEPS = (0.7548776662466927, 0.5698402909980532)


class SceneLamp(Protocol):
    """What a scene's view says about its lamp; lengths in mm."""

    @property
    def kind(self) -> str: ...
    @property
    def light_shape(self) -> str: ...
    @property
    def light_diameter_mm(self) -> float: ...
    @property
    def light_width_mm(self) -> float: ...
    @property
    def light_height_mm(self) -> float: ...
    @property
    def light_leds(self) -> tuple[int, int]: ...


def lamp_size(lamp: SceneLamp) -> float:
    """Return the length of the longest line within the lamp, mm; 0 for an eye."""
    if lamp.kind == "eye":
        return 0.0
    across = float(np.hypot(lamp.light_width_mm, lamp.light_height_mm))
    if lamp.light_shape == "rectangle":
        return across
    return lamp.light_diameter_mm + (across if lamp.light_shape == "leds" else 0.0)


def is_flat(lamp: SceneLamp) -> bool:
    """Return whether the lamp's light falls off by the cosine to its side, with none behind it."""
    return lamp.light_shape != "ball"


def lamp_points(lamp: SceneLamp, blur_px: float, tolerance_px: float) -> Array:
    """Return offsets from the lamp's centre, right and up, mm, for equal shares of light (n, 2).

    A disc, and a ball (which looks like one), are sampled on rings, a rectangle on a grid. Each LED
    of an array casts its own shadow and is sampled; in a large array by one point each, varied so
    that all points together fill one LED's disc. Their number is odd, except for arrays.

    Args:
        blur_px: the widest blur: below 10 px fewer points suffice, and fewest if `tolerance_px` is
        coarse.
    """
    few = 7 if tolerance_px >= 0.5 else 25
    count = 101 if blur_px >= 10.0 else few  # px of blur from which all points are used
    half = np.array([lamp.light_width_mm, lamp.light_height_mm]) / 2
    if lamp.light_shape == "rectangle":
        side = GRIDS[count]
        middles = (2 * np.arange(side) + 1) / side - 1
        return np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2) * half
    if lamp.light_shape != "leds":
        return 0.5 * lamp.light_diameter_mm * _disc(RINGS[count])
    rows = [np.linspace(-1, 1, n) if n > 1 else np.zeros(1) for n in lamp.light_leds]
    leds = np.stack(np.meshgrid(*rows), axis=-1).reshape(-1, 2) * half
    if len(leds) > MOST_DISCS:
        share, turn = (np.arange(1, len(leds) // 2 + 1)[:, None] * STEPS % 1).T
        angle = 2 * np.pi * turn
        spots = np.sqrt(share)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        middle = np.zeros((len(leds) % 2, 2))
        spots = np.concatenate([spots, middle, -spots[::-1]])  # point-symmetric
        return leds + 0.5 * lamp.light_diameter_mm * spots
    each = 0.5 * lamp.light_diameter_mm * _disc(RINGS[7 if len(leds) > 4 else few])
    return (leds[:, None] + each).reshape(-1, 2)


def _disc(rings: tuple[int, ...]) -> Array:
    """Place points on the unit disc for equal areas: one at the centre, the others on rings."""
    counts = np.array([1, *rings])
    ends = np.cumsum(counts) / counts.sum()
    found = [np.zeros((1, 2))]
    for number, count in enumerate(rings, start=1):
        radius = np.sqrt((ends[number - 1] + ends[number]) / 2)
        angle = 2 * np.pi * (np.arange(count) + 0.5 * (number % 2)) / count
        found.append(radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    return np.concatenate(found)


# The light of several coloured lamps on one screen, and the colours that an eye sees in it.

Bytes = NDArray[np.uint8]
FROM_DISC, FROM_BALL = np.pi, 4 * np.pi  # flux of a lamp of intensity 1


@dataclass(frozen=True)
class Light:
    """The light on a screen of H x W pixels, in linear red, green and blue.

    `colours` (n, 3) are the lamps' own light in the middle of the frame; `falloff` (n, H, W) is the
    share of it that reaches a pixel in sight of the lamp; `other` (3,) is light that reaches all
    pixels. `white` (3,) is all light in the middle, which an adapted eye calls white.
    """

    colours: Array
    falloff: Array
    other: Array

    @property
    def white(self) -> Array:
        return np.asarray(self.colours.sum(axis=0) + self.other)

    def mix(self, lit: Array) -> Array:
        """Return the colours (H, W, 3), white being 1, where shares `lit` (n, H, W) are visible."""
        shape = self.falloff.shape[1:]
        return self._mix(lit.reshape(len(lit), -1), slice(None)).reshape(*shape, 3)

    def mix_at(self, lit: Array, where: Mask) -> Array:
        """Return `mix` at the k pixels of a mask only, for shares (n, k): (k, 3)."""
        return self._mix(lit, where.ravel())

    def flat(self, codes: Ints) -> Array:
        """Return the colour in the middle (..., 3) if the lamps of a code's bits are hidden."""
        bits = np.arange(len(self.colours))
        lit = 1 - (codes[..., None] >> bits & 1)
        return self._white(lit @ self.colours + self.other)

    def _mix(self, lit: Array, where: Mask | slice) -> Array:
        falloff = self.falloff.reshape(len(self.falloff), -1)[:, where]
        return self._white((lit * falloff).T @ self.colours + self.other)

    def _white(self, light: Array) -> Array:
        """Divide by white, channel by channel; a channel without light stays dark."""
        white = self.white
        return np.asarray(np.where(white > 0, light / np.where(white > 0, white, 1.0), 0.0))


def light_of(
    lamps: list[tuple[SceneLamp, Array, ViewGeometry]], room: Room, size: tuple[int, int]
) -> Light:
    """Compute coloured lamps' light, of colour (3,) and view each, on their frame's pixels (H, W).

    Grey walls of a room reflect each lamp's light as an integrating sphere does: q / (A (1 - q)).
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
    """Return the light (H W,), per mm², of a lamp of intensity 1: the screen's cosine over d².

    A flat lamp, which faces along the view's axis, dims with the cosine of its own angle.
    """
    v, u = np.mgrid[: geometry.height, : geometry.width]
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
    ray = geometry.light - geometry.on_receiver(pixels)
    far = np.linalg.norm(ray, axis=1)
    light = np.maximum(ray @ geometry.normal, 0.0) / far**3
    if is_flat(lamp):
        light = light * np.maximum(ray @ geometry.axis, 0.0) / far
    return np.asarray(light)


def _middle_pixel(geometry: ViewGeometry) -> ViewGeometry:
    """Restrict the view to the middle of the frame."""
    return replace(geometry, origin=geometry.middle, width=1, height=1)


def to_srgb(light: Array) -> Bytes:
    """Convert linear light (..., 3), white at 1, to 8-bit sRGB (IEC 61966-2-1), clipping brighter light."""
    kept = np.clip(light, 0.0, 1.0)
    coded = np.where(kept <= 0.0031308, 12.92 * kept, 1.055 * kept ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * coded).astype(np.uint8)


def to_lab(srgb: Bytes) -> Array:
    """Convert 8-bit sRGB (..., 3) to CIELAB under D65."""
    from skimage.color import rgb2lab

    return np.asarray(rgb2lab(srgb))


def colour_error(seen: Bytes, wanted: Bytes) -> Array:
    """Return differences ΔE (n,) (CIEDE2000) of 8-bit sRGB colours (n, 3), computed once for equal pairs."""
    from skimage.color import deltaE_ciede2000

    weights = 256 ** np.arange(6, dtype=np.int64)
    packed = np.concatenate([seen, wanted], axis=1).astype(np.int64) @ weights
    pairs, back = np.unique(packed, return_inverse=True)
    both = (pairs[:, None] // weights % 256).astype(np.uint8)
    found: Array = deltaE_ciede2000(to_lab(both[:, :3]), to_lab(both[:, 3:]))
    return np.asarray(found)[back]
