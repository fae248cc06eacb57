"""Pieces made by hand: wavy rings in views of every kind, on each mount, with members and posts."""

from typing import Any, Literal

import numpy as np

from knotfab.base.arrays import Array, Mask
from knotfab.geometry.tube import Mesh, sweep
from knotfab.hold.beams import Stiffness
from knotfab.hold.mount import Mounted
from knotfab.hold.plinth import Base, slope_below
from knotfab.hold.stand import StandMount
from knotfab.hold.struts import GROUND, Candidates, no_members
from knotfab.hold.wall import Peg, WallMount
from knotfab.knots import Knot, Knots
from knotfab.scene.camera import Camera, camera_of
from knotfab_formats.piece import Mount
from knotfab_formats.scene import ResolvedView, Scene
from knotfab_formats.verdict import Misplacement
from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.frame import working_frame
from knotfab_validators.shadows.view import ViewGeometry, view_geometry

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


SAG: dict[str, Any] = {"sag_mm": 0.1, "sag_at": np.zeros(3)}
Kind = Literal["none", "plate", "dowel", "stand"]
OFF = Misplacement(
    parting_px=2.0, lamp_mm=5.0, turn_deg=1.0, iou=0.99, lamp_iou={}, worst=None, samples=7
)


def setup(kind: Kind, margin_mm: float = 8.0, **view: float) -> tuple[Mounted, Scene, Camera]:
    """A ring of 100 mm on a mount of its kind, its frame 160 x 120 mm."""
    keys = {"frame_width_mm": 160.0, "frame_height_mm": 120.0, **view}
    seen = ResolvedView(**keys)  # type: ignore[arg-type]
    camera = camera_of(seen, 80, 60)
    t = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = np.stack([50 * np.cos(t), 50 * np.sin(t), 5 * np.sin(2 * t)], axis=1)
    bodies = [sweep(ring, 2.0, 12)]
    mount = Mount(kind="wall" if kind in ("plate", "dowel") else kind)
    scene = Scene(views=(seen,), mount=mount)
    if kind == "none":
        return Mounted(bodies, ["knot 1"], scene, None), scene, camera
    if kind == "stand":
        base = Base(slope_below([camera]), -30.0, 32.0, -20.0, 25.0, -75.0, 9.0, 20.0, 15.0)
        none = np.empty(0, dtype=np.int64)
        stand = StandMount(
            members=no_members(), holds=none, base=base, predicted_intrusion=np.zeros(1), **SAG
        )
        return Mounted(bodies, ["piece"], scene, None, stand), scene, camera
    normal = camera.receiver[:3]
    pegs = []
    for number, angle in enumerate((0.3, 2.0, 4.5)):
        top = np.array([50 * np.cos(angle), 50 * np.sin(angle), 0.0])
        ray = top - camera.eye
        reach = -float(camera.receiver @ np.append(top, 1.0)) / float(normal @ ray)
        pegs.append(Peg(0, top, top + reach * ray, 1.0, 1.2 + 0.1 * number, 1.6))
    settings = Mount(foot=kind, plate_margin_mm=margin_mm)
    wall = WallMount(pegs=tuple(pegs), settings=settings, **SAG)
    return Mounted(bodies, ["piece"], scene, np.eye(3), wall), scene, camera


SIZE = {"frame_width_mm": 150.0, "frame_height_mm": 120.0}
VIEWS: dict[str, dict[str, Any]] = {
    "front": {},
    "tilted, near, from above": {
        "wall_tilt_deg": 25.0, "light_distance_mm": 210.0, "elevation_deg": 20.0, "azimuth_deg": 40.0,
        "frame_up_mm": 12.0, "wall_distance_mm": 70.0,
    },
    "eye": {"kind": "eye", "azimuth_deg": 90.0, "light_distance_mm": 900.0},
}  # fmt: skip


def view_of(**keys: Any) -> ResolvedView:
    return ResolvedView(**{**SIZE, **keys})


def wavy_knots() -> Knots:
    """Two rings, one inside the other."""
    return Knots((Knot(ring(42.0, wave=14.0)), Knot(ring(25.0, z=9.0, n=160))), RADIUS)


def post(view: ResolvedView) -> Mesh:
    """A square post from the outer ring through the view's wall: what is behind that casts no shadow."""
    camera = camera_of(view, 10, 10)
    axis = camera.receiver[:3]
    low, high = np.array([38.0, -3.0]), np.array([44.0, 3.0])
    right, up = camera.du / np.linalg.norm(camera.du), -camera.dv / np.linalg.norm(camera.dv)
    corners = [
        x * right + y * up + z * axis
        for z in (-view.wall_distance_mm - 10.0, -5.0)
        for x, y in ((low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1]))
    ]
    faces = [
        [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
        [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7],
    ]  # fmt: skip
    return np.array(corners), np.array(faces, dtype=np.int32)


def bodies_of(knots: Knots, *others: Mesh) -> list[Mesh]:
    return [*(sweep(knot.points, knots.radius_mm, 24) for knot in knots.knots), *others]


def geometry_at(view: ResolvedView, longer: int) -> ViewGeometry:
    """The validators' grid of a view, the frame padded by a quarter on each side."""
    width, height = 150, 120
    return view_geometry(view, width, height).resample(working_frame(width, height, longer))


def validated_shadow(bodies: list[Mesh], geometry: ViewGeometry) -> Mask:
    """The shadow of all bodies by the validators' exact polygons."""
    found = np.zeros((geometry.height, geometry.width), dtype=bool)
    for vertices, faces in bodies:
        found |= shadow_mask(shadow_lines(vertices, faces, geometry), geometry)
    return found


def scene_of(views: list[ResolvedView], mount: str = "wall", matrix: Array | None = None) -> Any:
    """A scene with a pose, printed: what is shown of a piece needs no more of it resolved."""
    return Scene.model_validate(
        {
            "views": [view.model_dump() for view in views],
            "piece": {"tube_radius_mm": RADIUS, "printed": True},
            "mount": {"kind": mount},
            "pose": {"matrix": (np.eye(4) if matrix is None else matrix).tolist()},
        }
    )


LAMPS = {"red": ((1.0, 0.0, 0.0), -70.0, 0.0), "green": ((0.0, 1.0, 0.0), 10.0, 60.0)}
LAMPS |= {"blue": ((0.0, 0.0, 1.0), 70.0, -10.0)}
"""Name of a lamp: its colour, and how far beside and above the axis it stands, mm."""


def lit_scene(mode: str = "mix") -> Any:
    """A scene of three lamps on one screen."""
    views = [
        view_of(name=name, lamp_colour=colour, light_right_mm=right, light_up_mm=up)
        for name, (colour, right, up) in LAMPS.items()
    ]
    views = [views[0], *(view.model_copy(update={"wall": views[0].name}) for view in views[1:])]
    scene = scene_of(views, "none")
    return scene.model_copy(update={"lamps": scene.lamps.model_copy(update={"mode": mode})})
