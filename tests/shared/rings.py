"""Wavy rings to be mounted, their views, and members made by hand."""

import numpy as np

from knotfab.base.arrays import Array
from knotfab.hold.beams import Stiffness
from knotfab.hold.struts import GROUND, Candidates
from knotfab.knots import Knot, Knots
from knotfab.scene.camera import Camera, camera_of
from knotfab_formats.piece import Mount
from knotfab_formats.scene import ResolvedView

RADIUS = 2.0
VIEW = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0)
EMPTY = np.zeros((90, 90), dtype=bool)
PLA = Stiffness(2300.0, 1.24, 0.2)
PLATE, DOWEL = Mount(foot="plate"), Mount(foot="dowel")


def ring(radius: float, z: float = 0.0, n: int = 200, wave: float = 8.0) -> Array:
    """A closed curve that goes round and up and down: no plane holds it."""
    t = 2 * np.pi * np.arange(n) / n
    return np.column_stack([radius * np.cos(t), radius * np.sin(t), z + wave * np.sin(3 * t)])


def knots(*curves: Array) -> Knots:
    return Knots(tuple(Knot(c) for c in curves), RADIUS)


def camera(**keys: float) -> Camera:
    return camera_of(VIEW.model_copy(update=keys), 90, 90)


def one(start: object, end: object, radius: float, ground: bool = False) -> Candidates:
    """A member that belongs to no site but the ground, if at all: its first is site 0."""
    second = GROUND if ground else 0
    ends = (np.array([p], dtype=float) for p in (start, end))
    return Candidates(np.array([0]), np.array([second]), *ends, np.array([radius]))
