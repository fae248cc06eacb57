"""Pieces made by hand for the viewer and the report: a wavy ring and a post, in views of every kind."""

from typing import Any

import numpy as np
from rings import RADIUS, ring

from knotfab.base.arrays import Array, Mask
from knotfab.geometry.tube import Mesh, sweep
from knotfab.knots import Knot, Knots
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView, Scene
from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.frame import working_frame
from knotfab_validators.shadows.view import ViewGeometry, view_geometry

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
