"""The piece as it hangs: with its lamp on and its shadow on the wall, a picture to send; and by day."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter, uniform_filter

from knotfab.base.arrays import Array, Mask, Real
from knotfab.render.part_picture import Eye, Light, PartPainter, encode_light, eye_towards
from knotfab.render.room import find_unhidden, light_part, light_walls
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView

WIDE_PX, HIGH_PX = 1600, 1200  # of the picture of the hung piece
_FILLED = 0.8  # share of it that piece and shadow take
_FIELD_DEG = 26.0  # that its height spans
# a PNG's options where grain leaves nothing to be found again: half of the time, and fewer bytes
GRAINY = {"compress_level": 1, "compress_type": 3}  # zlib's Z_RLE
_LAMP_PX = 1024  # side of what a lamp sees
_TURN = 5  # cells about one, in which an outline may turn
_GRID = 48  # cells across a shadow, to see how much of it a viewpoint shows
_LAMPS = 3  # lamps that are drawn at most: one a channel
_CORNER_DEG = 40.0, 140.0  # between two walls that one picture shows
_BESIDE_DEG = -30.0, -24.0, -18.0, -12.0, 12.0, 18.0, 24.0, 30.0
_ABOVE_DEG = -8.0, 0.0, 8.0, 16.0
_DAY = 7.0  # the room's light by day, for 1 in the evening
_DAY_PX = 800, 600
# linear light: a warm lamp, a cool room, a plastered wall, a desk of wood
_WARM, _COOL = np.array([1.0, 0.79, 0.54]), np.array([0.52, 0.57, 0.72])
_PLASTER, _WOOD = np.array([0.94, 0.88, 0.79]), np.array([0.36, 0.22, 0.13])
_AROUND, _REACH_MM = 10, 9.0  # pairs of neighbours that may shade a pixel, and how far they are


@dataclass(frozen=True)
class _Lamp:
    """A lamp that is on: its place, the wall (4,) that it lights, the frame there, and its colour."""

    place: Array
    wall: Array
    axes: Array  # the picture's right, up the wall, and out of it, as rows
    middle: Array
    frame_mm: tuple[float, float]
    size_mm: float
    colour: Array


def draw_hung(
    painter: PartPainter, views: Sequence[ResolvedView], desk_mm: float | None = None
) -> Image.Image | None:
    """Draw the piece before its wall with the lamp on, from where its shadow is read best.

    Two walls make a corner. None where no view has a shadow.

    Args:
        desk_mm: the height of the desk that it stands on.
    """
    lamps = _choose_lamps(views)
    if not lamps:
        return None
    walls = _lit_walls(lamps)
    return _draw(painter, _place_viewer(painter.points, walls), walls, lamps, desk_mm)


def draw_unlit(
    painter: PartPainter, views: Sequence[ResolvedView], eyes: Array, desk_mm: float | None = None
) -> Image.Image:
    """Draw the piece by day with its lamp off, from the way of each eye (k, 3), as a row of pictures.

    Where no view has a wall, it is drawn on paper.
    """
    walls = _lit_walls(_choose_lamps(views))
    if not walls:
        return painter.draw_panels(eyes)
    middle = np.mean([one.middle for one in walls], axis=0)
    ways = (eyes - middle) / np.linalg.norm(eyes - middle, axis=1)[:, None]
    seen = [_frame(painter.points, way, walls, _DAY_PX) for way in ways]
    return Image.fromarray(
        np.hstack([np.asarray(_draw(painter, eye, walls, (), desk_mm)) for eye in seen])
    )


def _lit_walls(lamps: Sequence[_Lamp]) -> list[_Lamp]:
    """Return the first lamp of each wall."""
    return [one for n, one in enumerate(lamps) if not any(_same(one, o) for o in lamps[:n])]


def _draw(
    painter: PartPainter,
    eye: Eye,
    walls: Sequence[_Lamp],
    lamps: Sequence[_Lamp],
    desk_mm: float | None,
) -> Image.Image:
    """Draw the piece before its walls by the light of lamps and room; by day where no lamp is on."""
    day = 1.0 if lamps else _DAY
    lit = [Light(one.place, np.eye(3)[n], False) for n, one in enumerate(lamps)]
    if len(lamps) < _LAMPS:
        lit.append(Light(np.array([-0.6, 1.0, 0.8]), np.eye(3)[2], True))
    painter.light(*lit)
    light, depth = painter.look(eye)
    cast = [_look_from(painter, one) for one in lamps]

    planes = [(one.wall, _PLASTER, 1.0, one) for one in walls]
    if desk_mm is not None:
        planes.append((np.array([0.0, 1.0, 0.0, -desk_mm]), _WOOD, 0.45, walls[0]))
    soft = np.zeros((len(lamps), _LAMP_PX, _LAMP_PX), np.float32)
    for k, (*_, dark) in enumerate(cast):
        soft[k] = dark
    shown, maps = [], np.zeros((len(planes), len(lamps), 3, 3))
    for n, (plane, _, share, own) in enumerate(planes):
        to, size = eye.plane_map(plane), max(own.frame_mm)
        off = own.axes @ (to[:3] - np.outer(own.middle, to[3])) / size
        height = float(plane[:3] @ eye.place + plane[3])
        shown.append([*off.ravel(), *to[3], height, share * bool(lamps)])
        for k, (lamp_eye, _, _) in enumerate(cast):
            maps[n, k] = lamp_eye.projection @ to
    serves = [[share < 1 or _same(one, own) for one in lamps] for *_, share, own in planes]
    albedos = np.array([albedo for _, albedo, *_ in planes])
    tints = np.array([one.colour for one in lamps]).reshape(-1, 3)
    colour, room, pool = light_walls(
        np.array(shown), albedos, maps, np.array(serves, dtype=bool), soft, tints, day * _COOL,
        _grain(), eye.size, eye.far,
    )  # fmt: skip
    shade = _occlude(np.minimum(depth, room), eye)
    free = np.zeros((len(lamps), *depth.shape), np.float32)
    for k, (lamp_eye, nearest, _) in enumerate(cast):
        free[k] = find_unhidden(light, depth, eye.place, eye.rays, lamp_eye.projection, nearest)
    light_part(colour, light, shade, pool, free, tints, painter.paint, day * _COOL, _WARM)
    return Image.fromarray(encode_light(colour, 1.7))


def _choose_lamps(views: Sequence[ResolvedView]) -> list[_Lamp]:
    """Choose the lamps of the first view's wall, and of one that makes a corner with it."""
    lamps, turned = list[_Lamp](), list[_Lamp]()
    for view in views:
        if view.kind != "shadow" or len(lamps) == _LAMPS:
            continue
        camera = camera_of(view, 1, 1)
        own = np.asarray(view.lamp_colour, dtype=np.float64)
        colour = _WARM if np.ptp(own) < 1e-6 else 1.2 * own / own.max()
        lamp = _Lamp(
            camera.eye, camera.receiver, camera.wall_axes, camera.middle, camera.frame_mm,
            view.light_size_mm, colour,
        )  # fmt: skip
        angle = (
            np.degrees(np.arccos(np.clip(lamp.wall[:3] @ lamps[0].wall[:3], -1, 1))) if lamps else 0
        )
        if not lamps or _same(lamp, lamps[0]):
            lamps.append(lamp)
        elif _CORNER_DEG[0] < angle < _CORNER_DEG[1] and all(_same(lamp, o) for o in turned):
            turned.append(lamp)
            lamps.append(lamp)
    return lamps


def _same(one: _Lamp, other: _Lamp) -> bool:
    """Return whether two lamps light one wall."""
    off = np.abs(one.wall - other.wall)
    return bool(off[:3].max() < 1e-3 and off[3] < 0.5)


def _cast(points: Array, place: Array, plane: Array) -> Array:
    """Return where the rays from a place through points (n, 3) meet a plane (n, 3)."""
    away = points - place
    height = float(plane[:3] @ place + plane[3])
    return np.asarray(place + away * (height / np.maximum(-(away @ plane[:3]), 1e-9))[:, None])


def _place_viewer(points: Array, walls: Sequence[_Lamp]) -> Eye:
    """Place the viewer where most of the shadows is seen and least of the piece lies beside them."""
    some = _thin(points)
    shadows = [_bin(one, _cast(some, one.place, one.wall)) for one in walls]
    weights = [_weigh(shadow) for shadow in shadows]
    size = max(max(one.frame_mm) for one in walls)
    middle = np.mean([one.middle for one in walls], axis=0)
    if len(walls) > 1:  # into the corner
        out = walls[0].axes[2] + walls[1].axes[2]
        axes = np.stack([np.cross((0.0, 1.0, 0.0), out), (0.0, 1.0, 0.0), out])
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        beside: tuple[float, ...] = (-14.0, 0.0, 14.0)
    else:
        axes, beside = walls[0].axes, _BESIDE_DEG
    best, chosen = -1.0, axes[2]
    for right in np.radians(beside):
        for up in np.radians(_ABOVE_DEG):
            way = (
                np.array([np.sin(right) * np.cos(up), np.sin(up), np.cos(right) * np.cos(up)])
                @ axes
            )
            place, score = middle + 4 * size * way, 1.0
            for one, dark, weight in zip(walls, shadows, weights, strict=True):
                hidden = _bin(one, _cast(some, place, one.wall))
                beside_it = (dark | hidden).sum() / dark.sum()
                score *= float(weight[~hidden].sum()) / beside_it**2
            if score > best:
                best, chosen = score, way
    return _frame(points, chosen, walls, (WIDE_PX, HIGH_PX))


def _frame(points: Array, way: Array, walls: Sequence[_Lamp], size_px: tuple[int, int]) -> Eye:
    """Return the eye that looks against `way` and has all of the piece and its shadows in its picture."""
    some = _thin(points)
    shown = np.concatenate([some, *(_cast(some, one.place, one.wall) for one in walls)])
    wide, high = size_px
    size = max(max(one.frame_mm) for one in walls)
    to, away = shown.mean(axis=0), 5 * size
    for _ in range(8):
        reach = away + 10 * size
        eye = eye_towards(to + away * way, to, (0.0, 1.0, 0.0), _FIELD_DEG / 2, size_px, reach)
        seen, _ = eye.project(shown)
        low, far = seen.min(axis=0), seen.max(axis=0)
        off = ((low + far) / 2 - (wide / 2, high / 2)) * away / eye.focal_px
        to = to + off[0] * eye.axes[0] - off[1] * eye.axes[1]
        away *= float(((far - low) / (_FILLED * wide, _FILLED * high)).max())
    near = float(np.linalg.norm(some - eye.place, axis=1).min())
    return Eye(eye.place, eye.axes, eye.focal_px, eye.size, 0.8 * near, eye.far)


def _thin(points: Array) -> Array:
    return points[:: max(1, len(points) // 15_000)]


def _weigh(dark: Mask) -> Array:
    """Weigh the cells of a shadow by what a person knows it by: its corners (Harris), then its area."""
    down, right = np.gradient(dark.astype(np.float64))
    a, b, c = (uniform_filter(g, _TURN) for g in (down * down, right * right, down * right))
    corners = np.sqrt(np.maximum(a * b - c * c, 0.0))
    return np.asarray(corners / max(corners.sum(), 1e-9) + 0.5 * dark / max(dark.sum(), 1))


def _bin(lamp: _Lamp, points: Array) -> Mask:
    """Mark the cells of a wall, over its frame, on which points (n, 3) lie."""
    cells = (points - lamp.middle) @ lamp.axes[:2].T / max(lamp.frame_mm) + 0.5
    found = np.zeros((_GRID, _GRID), dtype=bool)
    index = np.floor(_GRID * cells[((cells >= 0) & (cells < 1)).all(axis=1)]).astype(int)
    found[index[:, 1], index[:, 0]] = True
    return found


def _look_from(painter: PartPainter, lamp: _Lamp) -> tuple[Eye, Real, Real]:
    """Look at the part from its lamp: the eye, the depths, and the soft shadow on the wall's scale."""
    out, up = lamp.axes[2], lamp.axes[1]
    away = painter.points - lamp.place
    depth = -(away @ out)
    aside = np.abs(np.stack([away @ lamp.axes[0], away @ up]) / depth).max()
    to_wall = float(lamp.wall[:3] @ lamp.place + lamp.wall[3])
    half, size = float(np.degrees(np.arctan(1.03 * aside))), (_LAMP_PX, _LAMP_PX)
    eye = eye_towards(lamp.place, lamp.place - out, up, half, size, 1.0)
    eye = Eye(eye.place, eye.axes, eye.focal_px, size, 0.9 * float(depth.min()), 1.2 * to_wall)
    _, seen = painter.look(eye, colours=False)
    # the lamp's width, as the middle of the piece throws it on the wall
    spread = lamp.size_mm * float(np.median(to_wall - depth)) / float(np.median(depth)) / 3
    px = max(spread, 0.3) * eye.focal_px / to_wall
    dark = gaussian_filter((seen < 0.999 * eye.far).astype(np.float32), px)
    return eye, seen, dark


def _occlude(depth: Real, eye: Eye) -> Real:
    """Return how much of the room's light reaches each pixel: less beside what stands close before it."""
    half = np.ascontiguousarray(depth[::2, ::2])
    px_mm, (high, wide) = 0.5 * eye.focal_px / float(np.median(half)), half.shape
    most = int(np.ceil(_REACH_MM * px_mm))
    # a slope goes on beyond the border
    about = np.pad(half, most, mode="reflect", reflect_type="odd")
    found = np.zeros_like(half)
    for number in range(_AROUND):  # pairs of neighbours on a spiral; a slope alone shades nothing
        angle, reach_mm = 2.4 * number, _REACH_MM * (number + 1) / _AROUND
        down, right = (round(reach_mm * px_mm * float(f(angle))) for f in (np.sin, np.cos))
        one, other = (
            about[most + y :, most + x :][:high, :wide] for y, x in ((down, right), (-down, -right))
        )
        off = (half - 0.5 * (one + other)) / np.float32(reach_mm)
        # what is far before it shades little
        found += np.clip(off, 0, 1) * np.clip(2.2 - 0.7 * off, 0, 1)
    found = uniform_filter(uniform_filter(found, 5), 7) * np.float32(2.2 / _AROUND)
    small = Image.fromarray(np.exp(-found))
    return np.asarray(small.resize(depth.shape[::-1], Image.Resampling.BILINEAR))


def _grain() -> Real:
    """Return a tile of the grain of plaster, the same each time, about 0."""
    tile = np.random.default_rng(7).standard_normal((400, 400)).astype(np.float32)
    tile = gaussian_filter(tile, 1.6, mode="wrap")
    return np.asarray(tile * np.float32(0.012 / tile.std()))
