"""How far shadows part when lamp and piece are moved for real, against the magnitude of misplacement."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from knotfab.effects.misplacement import parting_mm
from knotfab.scene.camera import Camera, camera_of
from knotfab.scene.model import Placing, ResolvedView

__all__ = ["bounds_and_truths"]

Array = NDArray[np.float64]


def bounds_and_truths(rng: np.random.Generator, ways: int = 150) -> tuple[Array, Array]:
    """(2,) bounds and (2,) truths, mm: of lamp and piece, before a wall tilted by up to 30 degrees.

    Moved by the whole amount in `ways` directions; all round the tube about random points.
    """
    while True:
        view = ResolvedView(
            frame_width_mm=180.0,
            frame_height_mm=180.0,
            light_distance_mm=rng.uniform(200, 2000),
            wall_distance_mm=rng.uniform(50, 400),
            wall_tilt_deg=rng.uniform(-30, 30),
        )
        radius = rng.uniform(0.5, 4)
        room = min(0.4 * view.light_distance_mm, 0.8 * view.wall_distance_mm)
        points = rng.uniform(-1, 1, (60, 3)) * [70, 70, room / 2]
        camera = camera_of(view, 1, 1)
        if (points @ camera.receiver[:3] + camera.receiver[3]).min() > radius:
            break
    placing = Placing(lamp_mm=rng.uniform(1, 10), turn_deg=rng.uniform(0.2, 3))
    all_round = directions(ways)
    surface = (points[:, None] + radius * directions(15)).reshape(-1, 3)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    was = cast(surface, camera.eye, camera)
    lamp = max(
        parted(was, cast(surface, camera.eye + placing.lamp_mm * way, camera)) for way in all_round
    )
    angle = np.radians(placing.turn_deg)
    turn = max(
        parted(
            was, cast(middle + (surface - middle) @ turn_about(way, angle).T, camera.eye, camera)
        )
        for way in all_round
    )
    return np.array(parting_mm(view, points, radius, placing)), np.array([lamp, turn])


def directions(count: int) -> Array:
    """(count, 3) unit vectors all round, on a spiral."""
    k = np.arange(count) + 0.5
    high, around = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    across = np.sqrt(1 - high**2)
    return np.column_stack([across * np.cos(around), across * np.sin(around), high])


def turn_about(axis: Array, angle: float) -> Array:
    """(3, 3), by Rodrigues."""
    k = np.cross(np.eye(3), -axis)
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k))


def cast(points: Array, lamp: Array, camera: Camera) -> Array:
    """(n, 2) shadows of points (n, 3) on the wall, mm in its own axes."""
    normal, offset = camera.receiver[:3], camera.receiver[3]
    height, reach = points @ normal + offset, lamp @ normal + offset
    spots = lamp + (points - lamp) * (reach / (reach - height))[:, None]
    axes = np.stack([camera.du, -camera.dv])
    return np.asarray(spots @ (axes / np.linalg.norm(axes, axis=1)[:, None]).T)


def parted(was: Array, now: Array) -> float:
    """The largest distance left between shadows (n, 2) by their best shift, scale and turn (Umeyama 1991)."""
    x, y = was - was.mean(axis=0), now - now.mean(axis=0)
    one, other = x @ [1, 1j], y @ [1, 1j]
    return float(np.abs(other - np.vdot(one, other) / np.vdot(one, one) * one).max())
