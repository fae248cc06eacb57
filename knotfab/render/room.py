"""Compiled loops that light the walls of a room and a part before them, pixel by pixel, in linear light."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Real
from knotfab.base.compiled import compiled

# where a lamp's depths are asked about a place, px
_BESIDE = np.array([[-0.9, -0.4], [0.9, 0.4], [-0.4, 0.9], [0.4, -0.9]])


@compiled
def _interpolate(image: Real, u: float, v: float) -> float:
    """Return an image's value at (u, v), by its four nearest pixels; 0 outside."""
    high, wide = image.shape
    if not (0 <= u < wide and 0 <= v < high):
        return 0.0
    x, y = max(min(u - 0.5, wide - 1.0), 0.0), max(min(v - 0.5, high - 1.0), 0.0)
    i, j = min(int(x), wide - 2), min(int(y), high - 2)
    a, b = x - i, y - j
    above = (1 - a) * image[j, i] + a * image[j, i + 1]
    below = (1 - a) * image[j + 1, i] + a * image[j + 1, i + 1]
    return float((1 - b) * above + b * below)


@compiled
def light_walls(
    walls: Array, albedos: Array, maps: Array, serves: NDArray[np.bool_], soft: Real, tints: Array,
    room: Array, grain: Real, size: tuple[int, int], far: float,
) -> tuple[Real, Real, Real]:  # fmt: skip
    """Light walls by lamps and room: colour (h, w, 3), depth, and what share of lamps' light arrives.

    Args:
        walls: (p, 14), of each: rows (4, 3) from a pixel to its place on the wall, homogeneous, from the
            middle of what is lit and in its size; the eye's height over it; the share of light it gets.
        maps: (p, k, 3, 3), from a pixel to that of a lamp's shadows. serves: (p, k), whether it lights it.
        soft: (k, n, n), the share of each lamp that is hidden. tints: (k, 3). room: (3,), its light.
    """
    high, wide = size[1], size[0]
    colour = np.empty((high, wide, 3), np.float32)
    depth, pool = np.full((high, wide), np.float32(far)), np.zeros((high, wide), np.float32)
    for row in range(high):
        for column in range(wide):
            x, y, own = column + 0.5, row + 0.5, -1
            near = far
            for p in range(len(walls)):
                w = walls[p, 9] * x + walls[p, 10] * y + walls[p, 11]
                behind = -walls[p, 12] / w if w != 0 else -1.0
                if 0 < behind < near:
                    near, own = behind, p
            if own < 0:
                for k in range(3):  # whole rows take two seconds to compile
                    colour[row, column, k] = 0.09 * room[k] * albedos[0, k]
                continue
            to = walls[own]
            w = to[9] * x + to[10] * y + to[11]
            away = 0.0
            for k in range(3):
                off = (to[3 * k] * x + to[3 * k + 1] * y + to[3 * k + 2]) / w
                away += off * off
            falls = to[13] / (1 + (away / 0.72) * math.sqrt(away / 0.72))
            ambient = 0.035 + 0.10 / (1 + away)
            r, g, b = ambient * room[0], ambient * room[1], ambient * room[2]
            for k in range(len(tints)):
                if serves[own, k]:
                    m = maps[own, k]
                    scale = m[2, 0] * x + m[2, 1] * y + m[2, 2]
                    u = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) / scale
                    v = (m[1, 0] * x + m[1, 1] * y + m[1, 2]) / scale
                    arrives = falls * (1 - _interpolate(soft[k], u, v))
                    r, g, b = (
                        r + arrives * tints[k, 0],
                        g + arrives * tints[k, 1],
                        b + arrives * tints[k, 2],
                    )
            rough = 1 + grain[row % len(grain), column % len(grain)]
            colour[row, column, 0] = r * rough * albedos[own, 0]
            colour[row, column, 1] = g * rough * albedos[own, 1]
            colour[row, column, 2] = b * rough * albedos[own, 2]
            depth[row, column], pool[row, column] = near, falls
    return colour, depth, pool


@compiled
def find_unhidden(
    light: Real, depth: Real, eye: Array, rays: Array, projection: Array, nearest: Real
) -> Real:
    """Return how much of a lamp a pixel of the part sees, (h, w), by the depths (n, n) that the lamp sees."""
    high, wide, last = *depth.shape, len(nearest) - 1
    free = np.zeros((high, wide), np.float32)
    for y in range(high):
        for x in range(wide):
            if light[y, x, 3] > 0:
                u, v = x + 0.5, y + 0.5
                place = eye + depth[y, x] * (rays[:, 0] * u + rays[:, 1] * v + rays[:, 2])
                z = projection[2, 3]
                u, v = projection[0, 3], projection[1, 3]
                for k in range(3):
                    u += projection[0, k] * place[k]
                    v += projection[1, k] * place[k]
                    z += projection[2, k] * place[k]
                u, v, bias = u / z, v / z, 0.8 + 0.0015 * z
                for t in range(4):
                    i, j = int(u + _BESIDE[t, 0]), int(v + _BESIDE[t, 1])
                    seen = nearest[min(max(j, 0), last), min(max(i, 0), last)]
                    free[y, x] += 0.25 * (z < seen + bias)
    return free


@compiled
def light_part(
    colour: Real, light: Real, shade: Real, pool: Real, free: Real, tints: Array, paint: Array,
    room: Array, warm: Array,
) -> None:  # fmt: skip
    """Draw the part over the walls' `colour`, by lamps, room and what walls throw back, and dim the corners.

    Args:
        light: (h, w, 4), see `light_samples`: a channel for each lamp, then one for the room.
        shade: (h, w), what share of the room's light reaches a pixel. free: (k, h, w), of each lamp's.
    """
    high, wide, _ = light.shape
    for y in range(high):
        for x in range(wide):
            covered, own = light[y, x, 3], shade[y, x]
            across, down = 2.0 * x / (wide - 1) - 1, 2.0 * y / (high - 1) - 1
            off = 0.5 * (across * across + down * down)
            dim = 1 - 0.22 * off * (0.8 + 0.2 * off)
            for c in range(3):
                colour[y, x, c] *= own * (1 - covered) * dim
            if covered <= 0:
                continue
            if len(free) < 3:
                fill = light[y, x, 2]
            else:
                fill = (light[y, x, 0] + light[y, x, 1] + light[y, x, 2]) / 3
            fill *= own * 0.16 * dim
            back = own * covered * (0.05 + 0.10 * pool[y, x]) * dim
            for c in range(3):
                colour[y, x, c] += (fill * room[c] + back * warm[c]) * paint[c]
            for k in range(len(free)):
                seen = 0.0
                for j in range(max(y - 1, 0), min(y + 2, high)):
                    for i in range(max(x - 1, 0), min(x + 2, wide)):
                        seen += free[k, j, i]
                key = light[y, x, k] * seen / 9
                shine = 0.5 * min(max(key - 0.85, 0.0), 1.0)
                for c in range(3):
                    colour[y, x, c] += (1.35 * key * paint[c] + shine) * tints[k, c] * dim
