"""Say where the lamp stands, measured from marks that a person finds on wall, plate or desk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab.base.arrays import Array
from knotfab.hold.mount import Mounted
from knotfab.hold.plinth import Base
from knotfab.hold.wall import hole_inset_mm
from knotfab.scene.camera import Camera

EDGES = ("front", "right", "back", "left")  # a base's edges, as the first light goes round it
QUARTER_DEG = 90.0


@dataclass(frozen=True)
class Mark:
    """A place to measure from: its name, where it is (3,), and the lamp's distance from it."""

    name: str
    at: Array
    lamp_mm: float


@dataclass(frozen=True)
class Footing:
    """A stand's base as seen in one view: its bounds in the view's level axes, mm.

    `bottom` is the desk. `turned_deg` is how far the view is turned from the first, anticlockwise seen
    from above; `wall_side` and `lamp_side` name the sides of the base next to the wall and to the lamp.
    """

    left: float
    right: float
    back: float
    front: float
    bottom: float
    turned_deg: float
    wall_side: str
    lamp_side: str


@dataclass(frozen=True)
class Placement:
    """Measures that put the lamp where the scene says (mm, scene coordinates).

    `wall` (3, 3) has rows: right, up the wall, and out of it; `level` (3, 3): right, straight up,
    and level towards the lamp. `middle` (3,) is the frame's, on the wall, `frame_mm` its width and
    height, `plate_mm` those of a wall plate.

    The point of the wall square opposite the lamp is `right_mm` and `up_mm` from that middle, and
    the lamp `off_wall_mm` out of it. `holes` (k, 2) are those in plate or wall, right and up from
    the middle. `base` is a stand's, as this view meets it. `outline` (n, 2) is that of a plate in
    which the piece stands, which has no edges to measure from.

    A `round` wall touches the flat one, by which lengths are given, at its middle line.
    """

    lamp: Array
    wall: Array
    level: Array
    middle: Array
    frame_mm: tuple[float, float]
    plate_mm: tuple[float, float] | None
    off_wall_mm: float
    right_mm: float
    up_mm: float
    marks: tuple[Mark, ...]
    holes: Array
    base: Footing | None
    outline: Array | None = None

    def on_wall(self, points: Array) -> Array:
        """Project points (..., 3) square to the wall: right and up from its middle, (..., 2)."""
        return np.asarray((points - self.middle) @ self.wall[:2].T)

    def throw(self, points: Array) -> Array:
        """Throw points (n, 3) along the light into the wall's axes about `middle`."""
        lamp = self.wall @ (self.lamp - self.middle)
        reach = lamp[2] / (lamp[2] - points[:, 2:])
        moved = lamp[:2] + (points[:, :2] - lamp[:2]) * reach
        return np.column_stack([moved, points[:, 2] * reach[:, 0]])

    def cast(self, points: Array) -> Array:
        """Cast points (n, 3) on the wall: right and up from its middle, mm, (n, 2)."""
        return self.throw((points - self.middle) @ self.wall.T)[:, :2]


def placement_of(mounted: Mounted, camera: Camera) -> Placement:
    """Derive from the scene where a piece's lamp stands."""
    wall, level, middle = camera.wall_axes, camera.level_axes, camera.middle
    width, height = camera.frame_mm
    plate: tuple[float, float] | None = None
    holes, outline = np.empty((0, 2)), None
    if mounted.wall is not None:
        s = mounted.wall.settings
        if mounted.wall.plate is not None:
            holes, outline = mounted.wall.plate.holes, mounted.wall.plate.outline
        elif s.foot == "plate":
            plate = (width + 2 * s.plate_margin_mm, height + 2 * s.plate_margin_mm)
            x = plate[0] / 2 - hole_inset_mm(s)
            holes = np.array([[-x, 0.0], [x, 0.0]])
        else:
            holes = (np.stack([p.foot for p in mounted.wall.pegs]) - middle) @ wall[:2].T
    base = None if mounted.stand is None else mounted.stand.base
    places = _mark_places(wall, middle, (width, height), plate, base)
    to_lamp = wall @ (camera.eye - middle)
    return Placement(
        camera.eye,
        wall,
        level,
        middle,
        (width, height),
        plate,
        float(to_lamp[2]),
        float(to_lamp[0]),
        float(to_lamp[1]),
        tuple(
            Mark(name, at, float(np.linalg.norm(camera.eye - at))) for name, at in places.items()
        ),
        holes,
        None if base is None else _bound_base(base, level),
        outline,
    )


def _bound_base(base: Base, level: Array) -> Footing:
    """Bound a base in a view's level axes (3, 3)."""
    low, high = (f(base.corners @ level.T, axis=0) for f in (np.min, np.max))
    way = base.slope.axes @ level[2]
    turned = float(np.degrees(np.arctan2(way[0], way[2])))
    quarter = round(turned / QUARTER_DEG)
    # a base turned by so little more than quarters is square to its wall
    if abs(turned - QUARTER_DEG * quarter) <= 0.5:
        sides = [f"{EDGES[(quarter + n) % 4]} edge" for n in (2, 0)]
    else:
        sides = ["nearest corner", "nearest corner"]
    (left, _, back), (right, _, front) = low.tolist(), high.tolist()
    return Footing(left, right, back, front, base.bottom, turned, sides[0], sides[1])


def _mark_places(
    wall: Array,
    middle: Array,
    frame: tuple[float, float],
    plate: tuple[float, float] | None,
    base: Base | None,
) -> dict[str, Array]:
    """Return four places to measure from: edges of base or plate, or the frame's corners."""
    if base is not None:
        x, z = (base.left + base.right) / 2, (base.back + base.front) / 2
        sides = {
            "front": (x, base.front),
            "back": (x, base.back),
            "left": (base.left, z),
            "right": (base.right, z),
        }
        return {
            f"{name} edge of the base": np.array([u, base.bottom, v]) @ base.slope.axes
            for name, (u, v) in sides.items()
        }
    if plate is not None:
        x, y = plate[0] / 2, plate[1] / 2
        edges = {"upper": (0.0, y), "lower": (0.0, -y), "left": (-x, 0.0), "right": (x, 0.0)}
        return {
            f"{name} edge of the plate": middle + np.array(at) @ wall[:2]
            for name, at in edges.items()
        }
    x, y = frame[0] / 2, frame[1] / 2
    return {
        f"{high} {side} corner of the frame": middle + np.array([u, v]) @ wall[:2]
        for high, v in (("upper", y), ("lower", -y))
        for side, u in (("left", -x), ("right", x))
    }
