"""A lamp as the points that its shadow is averaged over."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from knotfab_validators.arrays import Array

__all__ = ["SceneLamp", "is_flat", "lamp_points", "lamp_size"]

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
