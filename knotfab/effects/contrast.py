"""Contrast: stray light in the shadow, and uneven light of the lamp. Outlines stay where they are."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.compiled import compiled
from knotfab.effects.base import Effect, EffectContext, OnWall, Shadows, World
from knotfab.scene.camera import CurvedWall, camera_of, view_axes
from knotfab_formats.scene import ResolvedView
from knotfab_formats.verdict import Contrast

_PLACES = (9, 513)  # sample places across and up the frame
_VARIES = 5.0  # times the square of a step between places over the light's distance: at most, of its light
_FEET = 200  # points of the wall behind strands, where their own light is
_LOOKED_AT = 8  # places that are looked at, where most is thrown back
_PIECE_RADII = 2.0  # length of the pieces that strands are taken in
_CELLS = 64  # across the sky that is seen from there
_SURE = 1.05  # factor to the sum found so: over hundreds of scenes the rest was less
_CHORDS = 200  # across a strand


def magnitude(context: EffectContext) -> float:
    """Return the loss of contrast against a black shadow on an evenly lit wall, 0 to 1."""
    found = [contrast_of(seen, context.radius, context.world) for seen in context.shadows]
    lit = [c for c in found if c is not None]
    return max((1.0 - min(c.contrast_least, c.falloff) for c in lit), default=0.0)


def contrast_of(seen: Shadows, radius: float, world: World) -> Contrast | None:
    """Compute a view's light with strands at places; None for an eye, which needs no lamp.

    A bulb of intensity I gives a wall at distance d, whose normal is an angle off, I cos / d²; of a flat lamp
    that is times the cosine of the angle at which it is seen. On a wall that faces it: cos³ and cos⁴.
    A bulb sends out 4 pi I, a flat lamp pi I; what falls into a room of area A and reflectance q lights
    all of it by flux q / (A (1 - q)), as in an integrating sphere: over the lamp's own light at distance D
    4 pi D² q / (A (1 - q)), or a quarter.

    Filament of which each mm lets a share t through lets t^c through along a chord c, 2 sqrt(r² - x²) of a
    round strand. The wall throws at most q of its light onto backs of strands, and these their own share of
    that (by colour) onto the wall behind. There a piece of length l at height h and distance d, at an angle a
    to the ray, fills 2 r l sin a h / (pi d³) of what lights it, and all together what is left of the sum
    where they hide each other.
    """
    view = seen.view
    if view.kind == "eye":
        return None
    room, flat = world.room, view.light_is_flat
    falloff, middle = _lamp_light(view, flat)
    spread = (np.pi if flat else 4 * np.pi) * room.reflectance / (1 - room.reflectance)
    transmittance = world.material.transmittance_per_mm
    second_mm = room.second_lamp_mm
    back = spread / (1e6 * room.area_m2 * middle) if room.area_m2 > 0 else 0.0
    second = 0.0 if second_mm is None else room.second_lamp_share
    transmitted = _transmitted_share(transmittance, radius) if transmittance > 0 else 0.0
    bounced = _bounced(seen, radius, world) if room.reflectance > 0 else 0.0
    other = room.ambient + back + second

    def contrast(share: float) -> float:
        """Return (lit - dark) / lit where the lamp gives `share` of its light in the middle."""
        own = (
            share * (1 - transmitted) - bounced
        )  # the bounced light comes from the brightest of the wall
        return max(own, 0.0) / (share + other)

    return Contrast(
        contrast=contrast(1.0),
        contrast_least=contrast(falloff),
        falloff=falloff,
        ambient=room.ambient,
        room=back,
        second=second,
        transmitted=transmitted,
        bounced=bounced,
        ghost_shift_mm=None if second_mm is None else _ghost_shift(view, np.array(second_mm)),
        ghost_contrast=second / (1 + other),
    )


@lru_cache(maxsize=8)  # the same views are asked for many times
def _lamp_light(view: ResolvedView, flat: bool) -> tuple[float, float]:
    """Return the frame's least light over its most, and the light of a unit lamp at its middle, per mm²."""
    camera = camera_of(view, *_PLACES)
    ends = (np.linspace(-0.5, n - 0.5, n) for n in _PLACES)
    u, v = (grid.reshape(-1, 1) for grid in np.meshgrid(*ends))
    at, normal = camera.corner + u * camera.du + v * camera.dv, camera.receiver[:3]
    wall = CurvedWall.from_view(view)
    if wall is not None:
        at, normal = wall.stand((at - wall.foot) @ wall.axes[:2].T)
    ray = at - camera.eye
    far = np.linalg.norm(ray, axis=1)
    light = -(ray * normal).sum(axis=1) / far**3
    if flat:
        light = light * -(ray @ view_axes(view)[2]) / far
    # it is largest on the middle line, between two places
    step = 0.5 * view.frame_height_mm / (_PLACES[1] - 1)
    largest = light.max() * (1 + _VARIES * (step / far.min()) ** 2)
    return float(light.min() / largest), float(light[len(light) // 2])


def _ghost_shift(view: ResolvedView, second: Array) -> float:
    """Return the distance on the wall between two lamps' shadows of the scene's origin, mm."""
    wall = OnWall.from_view(view)
    origin, lamp = wall.place(np.zeros((1, 3))), wall.place(second[None])[0]
    return float(np.linalg.norm(wall.cast(origin, lamp) - wall.cast(origin)))


def _transmitted_share(transmittance: float, radius: float) -> float:
    """Return the share of light that passes a strand, averaged across it."""
    x = (np.arange(_CHORDS) + 0.5) / _CHORDS
    return float((transmittance ** (2 * radius * np.sqrt(1 - x**2))).mean())


def _bounced(seen: Shadows, radius: float, world: World) -> float:
    """Bound the share of the wall's light that strands reflect onto their own shadow, where it is most."""
    own = np.array([int(world.material.color[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(own <= 0.04045, own / 12.92, ((own + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1
    light = world.room.reflectance * float(linear @ [0.2126, 0.7152, 0.0722])
    if light == 0 or len(seen.places) < 2:
        return 0.0
    every = max(1, len(seen.places) // _FEET)
    starts, alongs = _pieces(seen.places, radius)
    feet, axes = seen.feet[::every], seen.axes[:: every if len(seen.axes) > 1 else 1]
    # first of some pieces, as if none hid another
    some = max(1, len(starts) // _FEET)
    most = _filled(feet, axes, starts[::some], alongs[::some], radius)
    hidden = 0.0
    for n in np.argsort(-most)[:_LOOKED_AT]:
        own = axes[min(n, len(axes) - 1)]
        hidden = _hidden(feet[n], own, starts, alongs, radius, _CELLS, hidden)
    return light * min(_SURE * hidden, 1.0)


def _pieces(places: Array, radius: float) -> tuple[Array, Array]:
    """Cut strands through places (N, 3) into pieces: their starts (n, 3), and the vectors to their ends."""
    steps = np.diff(places, axis=0)
    step = float(np.sqrt(np.median(np.einsum("ni,ni->n", steps, steps))))
    some = places[:: max(1, int(_PIECE_RADII * radius / max(step, 1e-9)))]
    along = np.roll(some, -1, axis=0) - some
    long = np.linalg.norm(along, axis=1)
    kept = long <= 4 * max(np.median(long), radius)  # longer ones join two knots
    return some[kept], along[kept]


@compiled
def _filled(feet: Array, axes: Array, starts: Array, alongs: Array, radius: float) -> Array:
    """Return the sum of the sky that pieces (n, 3) hide from feet (m, 3), up to a factor, (m,)."""
    found = np.zeros(len(feet))
    for m in range(len(feet)):
        normal = axes[min(m, len(axes) - 1), 2]
        for n in range(len(starts)):
            square = long = to = high = 0.0
            for i in range(3):
                along = alongs[n, i]
                way = starts[n, i] + 0.5 * along - feet[m, i]
                square += way * way
                long += along * along
                to += way * along
                high += way * normal[i]
            square = max(square, radius * radius)
            aside = max(long - to * to / square, 0.0)
            found[m] += high * np.sqrt(aside / square) / square
    return found


@compiled
def _hidden(
    foot: Array, axes: Array, starts: Array, alongs: Array, radius: float, cells: int, least: float
) -> float:
    """Return the cosine-weighted share of a uniform sky that strands along pieces (n, 3) hide.

    If that is less than `least`, `least` is returned. The sky is seen from `foot`, a place of a
    wall whose right, up and normal are rows of `axes`. The shares that the pieces hide are summed;
    the sum is lowered by how much they hide each other, sampled on the disc under the sky
    (Nusselt's analogue), `cells` across.
    """
    covered = np.zeros((cells, cells), dtype=np.bool_)
    wide, summed, found, every = 2.0 / cells, 0.0, 0, 0
    at, way, of = np.empty_like(starts), np.empty_like(alongs), np.empty((len(starts), 4))
    for k in range(len(starts)):
        aa = ao = oo = 0.0
        for i in range(3):
            x = y = 0.0
            for j in range(3):
                x += axes[i, j] * (starts[k, j] - foot[j])
                y += axes[i, j] * alongs[k, j]
            aa, ao, oo = aa + y * y, ao + y * x, oo + x * x
            at[k, i], way[k, i] = x, y
        # square is that of the distance of the middle of the strand
        square = max(oo + ao + 0.25 * aa, radius * radius)
        far, to = np.sqrt(square), ao + 0.5 * aa
        aside = np.sqrt(max(aa - to * to / square, 0.0))
        summed += 2 * radius / np.pi * aside * max(at[k, 2] + 0.5 * way[k, 2], 0.0) / (square * far)
        of[k, 0], of[k, 1], of[k, 2], of[k, 3] = aa, ao, oo, far
    if summed <= least:
        return least
    for k in range(len(starts)):
        s, a = at[k], way[k]
        aa, ao, oo, far = of[k, 0], of[k, 1], of[k, 2], of[k, 3]
        # the directions in which it may lie: a chord of the unit sphere
        share = (radius + 0.5 * np.sqrt(aa)) / far
        away = np.sqrt(2 - 2 * np.sqrt(1 - share * share)) if share < 1 else 2.0
        outside = far * far * (1 - share * share)
        u, v = (s[0] + 0.5 * a[0]) / far + 1, (s[1] + 0.5 * a[1]) / far + 1
        left, right = max(0, int((u - away) / wide)), min(cells, int((u + away) / wide) + 1)
        low, top = max(0, int((v - away) / wide)), min(cells, int((v + away) / wide) + 1)
        for i in range(left, right):
            x = (i + 0.5) * wide - 1
            for j in range(low, top):
                y = (j + 0.5) * wide - 1
                if x * x + y * y >= 1:
                    continue
                z = np.sqrt(1 - x * x - y * y)
                wa, wo = x * a[0] + y * a[1] + z * a[2], x * s[0] + y * s[1] + z * s[2]
                if (wo + 0.5 * wa) ** 2 < outside:
                    continue  # it passes the ball about the piece
                # the place where the piece comes nearest to the ray
                share = (wa * wo - ao) / max(aa - wa * wa, 1e-12)
                kept = min(max(share, 0.0), 1.0)
                on = wo + kept * wa
                if on > 0 and oo + 2 * kept * ao + kept * kept * aa - on * on < radius * radius:
                    every += kept == share
                    found += not covered[i, j]
                    covered[i, j] = True
    return max(summed * min(found / every, 1.0) if every > 0 else summed, least)


CONTRAST = Effect(
    "contrast",
    "of 1",
    magnitude,
    0.4,  # a tenth of the contrast, at standard accuracy
    "light reaches the shadow, or the lamp spreads it unevenly",
)
