"""The shadow of a lamp that has a size: the average over points of the lamp."""

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


BLUR_TOLERANCES = 4.0  # a lamp that blurs the outline by fewer tolerances is taken as a point


@dataclass(frozen=True)
class SoftShadow:
    """What the lamp's size does; `soft` (H, W) is the share of the lamp that is hidden at each pixel."""

    found: Penumbra
    soft: NDArray[np.float32]

    @property
    def dark(self) -> Mask:
        """(H, W) where at least half of the lamp is hidden."""
        return np.asarray(self.soft >= 0.5)


def blur_px(vertices: Array, geometry: ViewGeometry, size_mm: float) -> float:
    """Return widest blur on the receiver by a ball of `size_mm`, pixels, of any edge at vertices (n, 3).

    An edge at height h over the receiver and distance D from a lamp at height H: the rays through it that
    touch the ball, a cone, meet the receiver in an ellipse that is d h D / ((H - h)² - d²/4) long. Of a
    curved receiver that is the plane which touches it where the edge's shadow falls.
    """
    at, normal = geometry.touching(geometry.project(vertices)[0])
    height = ((vertices - at) * normal).sum(axis=1)
    above = ((geometry.light - at) * normal).sum(axis=1)
    below = np.maximum(above - height, 0.501 * size_mm + 1e-9)
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
    """Tell whether the lamp is averaged over: the scene says so, or the blur exceeds the threshold."""
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
        within: (H, W) where shadow counts, of a wall that ends; None: everywhere.
    """
    widest = blur_px(vertices, geometry, lamp_size(lamp))
    points = lamp_points(lamp, widest, tolerance_px)
    hidden = np.zeros(target.shape, dtype=np.int32)
    for right, up in points:
        light = geometry.light + right * geometry.right + up * geometry.up
        # coarser pixels do on a round wall: they lose as much to either side, which averages out
        hidden += renderer.render(replace(geometry, light=light), finer=1)
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
    """Check `half_light`: of what a lamp leaves dark as wide as it is as much is asked as of its middle's.

    Args:
        ious: IoU of the picture with the places where half of the lamp is hidden, by the view's name.
        iou_floor: the least; None: nothing is asked.
    """
    name = min(ious, key=lambda view: ious[view])
    detail = f"IoU of the picture with where at least half of the lamp is hidden, view {name}"
    return at_least("half_light", ious[name], iou_floor, "", detail, required=iou_floor is not None)


# A lamp as the points that its shadow is averaged over.


# Points of a disc: the middle, and so many on rings of equal share about it. Every set looks the same from
# the other side and has an odd number, so the half-light line of a straight edge is exact.
RINGS = {7: (6,), 25: (8, 16), 101: (6, 14, 20, 26, 34)}
GRIDS = {7: 3, 25: 5, 101: 11}  # rows and columns of a rectangle's points
MOST_DISCS = 100  # LEDs of which each is sampled as a disc; of a larger array all together are
# steps of a sequence that fills a square evenly from wherever it begins (M. Roberts' R2: 1 / g and 1 / g²
# with g³ = g + 1)
STEPS = (0.7548776662466927, 0.5698402909980532)


class SceneLamp(Protocol):
    """The keys of a scene's view that say what its lamp is; lengths in mm."""

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
    """Return the longest line within the lamp, mm; 0 of an eye."""
    if lamp.kind == "eye":
        return 0.0
    across = float(np.hypot(lamp.light_width_mm, lamp.light_height_mm))
    if lamp.light_shape == "rectangle":
        return across
    return lamp.light_diameter_mm + (across if lamp.light_shape == "leds" else 0.0)


def is_flat(lamp: SceneLamp) -> bool:
    """Tell whether the lamp shines less aside than ahead, by the cosine, and not behind itself."""
    return lamp.light_shape != "ball"


def lamp_points(lamp: SceneLamp, blur_px: float, tolerance_px: float) -> Array:
    """Return (n, 2) offsets right and up from the lamp's middle, mm, each for the same share of its light.

    A disc and a ball, which looks like one, are sampled on rings; a rectangle on a grid; of an array every
    LED, for each throws a shadow of its own: a large array by a point of each, elsewhere on it than on the
    others, so that all points fill the disc that one LED is. An odd number, but for arrays.

    Args:
        blur_px: the widest blur: below 10 px fewer points serve, the fewest where `tolerance_px` is coarse.
    """
    few = 7 if tolerance_px >= 0.5 else 25
    count = 101 if blur_px >= 10.0 else few  # a blur from which on all points are taken
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
        spots = np.concatenate([spots, middle, -spots[::-1]])  # alike from the other side
        return leds + 0.5 * lamp.light_diameter_mm * spots
    each = 0.5 * lamp.light_diameter_mm * _disc(RINGS[7 if len(leds) > 4 else few])
    return (leds[:, None] + each).reshape(-1, 2)


def _disc(rings: tuple[int, ...]) -> Array:
    """Place points of the unit disc that each stand for the same area: one in the middle, others on rings."""
    counts = np.array([1, *rings])
    ends = np.cumsum(counts) / counts.sum()
    found = [np.zeros((1, 2))]
    for number, count in enumerate(rings, start=1):
        radius = np.sqrt((ends[number - 1] + ends[number]) / 2)
        angle = 2 * np.pi * (np.arange(count) + 0.5 * (number % 2)) / count
        found.append(radius * np.column_stack([np.cos(angle), np.sin(angle)]))
    return np.concatenate(found)


# The light that lamps of several colours throw on one screen, and what colours an eye sees in it.


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
