"""A plate in which a piece stands: one sheet that holds every foot, fused with the tubes."""

import re
from dataclasses import replace

import numpy as np
import pytest
import shapely
from tables import some

from knotfab.base.errors import SceneError
from knotfab.geometry.tube import Mesh, sweep
from knotfab.hold.beams import Stiffness
from knotfab.hold.foot_plate import RIM_MM, StandingPiece, plan_foot_plate
from knotfab.hold.wall import WallMount, wall_bodies
from knotfab.knots import Knot, Knots
from knotfab.scene.camera import Camera, camera_of
from knotfab_formats.piece import Mount
from knotfab_formats.scene import ResolvedView

RADIUS, WALL = 1.5, 20.0
STIFF = Stiffness(2300.0, 1.24, 0.2)
VIEW = ResolvedView(frame_width_mm=120.0, frame_height_mm=90.0, wall_distance_mm=WALL)
CAMERA = camera_of(VIEW, 120, 90)


def crown(x: float, feet: int, sink: float = RADIUS / 2, y: float = 0.0) -> Knot:
    """A ring about (x, y) that goes up and down before the wall."""
    t = np.linspace(0, 2 * np.pi, 60 * feet, endpoint=False)
    height = -WALL + RADIUS - sink + 8 * (1 - np.cos(feet * t))
    return Knot(np.column_stack([x + 18 * np.cos(t), y + 18 * np.sin(t), height]), closed=True)


def plan(
    knots: Knots, camera: Camera = CAMERA, **settings: object
) -> tuple[StandingPiece, list[Mesh], Mount]:
    asked = Mount(kind="wall", foot="plate", **{"plate": "outline", **settings})  # type: ignore[arg-type]
    tubes = [sweep(knot.points, RADIUS, 16) for knot in knots.knots]
    return plan_foot_plate(knots, tubes, camera, STIFF, asked), tubes, asked


def lying(x: float, y: float) -> Knot:
    """A ring that lies in the wall's face, such as an eye."""
    knot = crown(x, 3, y=y)
    points = knot.points.copy()
    points[:, 2] = points[:, 2].min()
    return replace(knot, points=points)


TWO = Knots((crown(-30, 3), crown(30, 4, y=10)), RADIUS)
EYES = Knots((*TWO.knots, lying(0, -30), lying(0, 40)), RADIUS)


@pytest.mark.parametrize(
    ("knots", "feet", "kind"),
    some(
        [
            *((EYES, (3, 4, 1, 1), "outline"), (EYES, (3, 4, 1, 1), "full")),
            *((TWO, (3, 4), "full"), (TWO, (3, 4), "outline")),
        ],
        2,
    ),
)
@pytest.mark.slow
def test_the_plate_is_one_sheet_about_all_feet_and_fused_with_them(
    knots: Knots, feet: tuple[int, ...], kind: str
) -> None:
    found, tubes, asked = plan(knots, plate=kind)
    assert found.plate.feet == feet
    sheet = shapely.Polygon(found.plate.outline)
    assert sheet.is_valid and sheet.exterior.is_ccw
    for knot in knots.knots:
        low = knot.points[knot.points[:, 2] < -WALL + RADIUS, :2]
        assert sheet.contains(shapely.MultiPoint(low))
    if kind == "full":
        assert sheet.contains(shapely.box(-60, -45, 60, 45).buffer(-1e-6))
    elif knots is TWO:
        assert sheet.area < 0.5 * 120 * 90
    for hole in found.plate.holes:
        assert sheet.exterior.distance(shapely.Point(hole)) >= 2 + 0.8 * RIM_MM / 2
    assert found.plate.holes[0, 1] == found.plate.holes[1, 1]  # on a level line
    # what the scene tells the validators
    assert Mount(pegs=found.plate.handles).pegs == tuple(n if n > 1 else 0 for n in feet)
    mount = WallMount(pegs=(), settings=asked, **vars(found))
    # raises where the genus is not that of feet and holes
    (body,) = wall_bodies(tubes, mount, CAMERA)
    assert body[0][:, 2].min() == pytest.approx(-WALL - 1.6)
    assert found.sag_mm < 0.2


def test_a_foot_that_lies_in_the_plate_is_held_at_both_ends() -> None:
    knot = crown(0, 1)
    rise = np.maximum(0.0, knot.points[:, 2] - knot.points[:, 2].min() - 4.0)
    lying = knot.points.copy()
    lying[:, 2] = lying[:, 2].min() + 3 * rise
    found, _, _ = plan(Knots((replace(knot, points=lying),), RADIUS))
    moved = np.linalg.norm(found.moves, axis=1)
    assert found.plate.feet == (1,)
    assert moved[np.flatnonzero(np.diff(rise == 0.0))].max() < 0.01 * moved.max()


@pytest.mark.parametrize(
    ("knots", "settings", "why"),
    [
        ((crown(-30, 3), crown(30, 3, sink=-0.3)), {}, "no valley of knot 2 of 2"),
        ((crown(0, 3, sink=1.5),), {}, "1.6 mm thick"),
        ((crown(0, 3),), {"plate_thickness_mm": 0.8}, "0.8 mm thick"),
    ],
)
def test_a_piece_that_does_not_stand_is_refused(
    knots: tuple[Knot, ...], settings: dict[str, float], why: str
) -> None:
    with pytest.raises(SceneError, match=why) as refused:
        plan(Knots(knots, RADIUS), **settings)
    if thicker := re.search(r"plate_thickness_mm = ([\d.]+)", refused.value.remedy):
        plan(Knots(knots, RADIUS), plate_thickness_mm=float(thicker[1]))
    assert thicker or "valley" in why
