"""The lamp's place has exact figures, whichever way the wall leans, and words that carry them."""

from __future__ import annotations

import numpy as np
import pytest
from setups import setup

from knotfab.hold.placement import placement_of
from knotfab.hold.wall import mark_depth_mm
from knotfab.report.setup_words import level_wall, steps_of
from knotfab_fixtures.solids import ARROW_MARKS
from knotfab_formats.piece import Mount


@pytest.mark.parametrize("azimuth", [0.0, 40.0])
@pytest.mark.parametrize("tilt", [0.0, 25.0, -10.0])
def test_the_lamps_foot_on_a_leaning_wall(tilt: float, azimuth: float) -> None:
    mounted, _, camera = setup("none", wall_tilt_deg=tilt, azimuth_deg=azimuth)
    place = placement_of(mounted, camera)
    slope = np.radians(tilt)
    assert place.off_wall_mm == pytest.approx(600 * np.cos(slope))
    assert (place.right_mm, place.up_mm) == pytest.approx((0.0, 600 * np.sin(slope)), abs=1e-9)
    assert place.frame_mm == pytest.approx((160.0, 120.0))
    # the frame's middle lies where the lamp's axis meets the wall
    assert np.linalg.norm(place.lamp - place.middle) == pytest.approx(600.0)
    again = place.middle + place.right_mm * place.wall[0] + place.up_mm * place.wall[1]
    assert again + place.off_wall_mm * place.wall[2] == pytest.approx(place.lamp)
    # the law of cosines: the corners are half a frame away, the upper ones along the slope
    by_name = {mark.name: mark.lamp_mm for mark in place.marks}
    corner = np.sqrt(80**2 + (60 - place.up_mm) ** 2 + place.off_wall_mm**2)
    assert by_name["upper left corner of the frame"] == pytest.approx(corner)
    assert by_name["upper right corner of the frame"] == pytest.approx(corner)


def test_the_distances_place_the_lamp() -> None:
    """Four distances from the marks leave only one place for the lamp, on its side of the wall."""
    for kind in ("plate", "dowel", "stand"):
        mounted, _, camera = setup(kind, wall_tilt_deg=8.0)
        place = placement_of(mounted, camera)
        at = np.stack([mark.at for mark in place.marks])
        square = np.array([mark.lamp_mm for mark in place.marks]) ** 2
        left = 2 * (at[1:] - at[0])
        right = (at[1:] ** 2).sum(1) - (at[0] ** 2).sum() - square[1:] + square[0]
        within, _, rank, _ = np.linalg.lstsq(left, right, rcond=None)
        assert rank == 2
        normal = np.cross(at[1] - at[0], at[2] - at[0])
        normal *= np.sign(normal @ (place.lamp - at[0])) / np.linalg.norm(normal)
        in_plane = within - (within - at[0]) @ normal * normal
        high = np.sqrt(square[0] - ((in_plane - at[0]) ** 2).sum())
        assert in_plane + high * normal == pytest.approx(place.lamp, abs=1e-6)


def test_marks_lie_on_the_plates_edges() -> None:
    mounted, _, camera = setup("plate")
    place = placement_of(mounted, camera)
    assert place.plate_mm == pytest.approx((176.0, 136.0))
    marks = {m.name.split()[0]: place.on_wall(m.at) for m in place.marks}
    assert marks["upper"] == pytest.approx([0, 68]) and marks["left"] == pytest.approx([-88, 0])
    assert all(m.at @ camera.receiver[:3] + camera.receiver[3] < 1e-9 for m in place.marks)
    # the holes are where the plate has them
    assert place.holes == pytest.approx(np.array([[-83.0, 0.0], [83.0, 0.0]]))


def test_dowel_holes_are_the_pegs_feet() -> None:
    mounted, _, camera = setup("dowel", wall_tilt_deg=12.0)
    place = placement_of(mounted, camera)
    assert mounted.wall is not None
    for (right, up), peg in zip(place.holes, mounted.wall.pegs, strict=True):
        assert place.middle + right * place.wall[0] + up * place.wall[1] == pytest.approx(peg.foot)


def test_a_leaning_wall_is_told_in_words() -> None:
    mounted, scene, camera = setup("plate", wall_tilt_deg=20.0)
    place = placement_of(mounted, camera)
    said = " ".join(steps_of(mounted, place, scene.views[0]))
    assert "563.8 mm off" in said and "opposite 205.2 mm above the middle of the frame" in said
    assert level_wall(place, 0.0) == pytest.approx(-100.0)
    # 40 mm higher a wall that leans towards the lamp is nearer to it
    assert level_wall(place, 40.0) == pytest.approx(-100 + 40 * np.tan(np.radians(20)))


@pytest.mark.parametrize(
    ("margin", "hole", "mark"),
    [
        (8.0, 4.0, 1.5),  # as deep as they come
        (6.0, 1.0, 1.2),  # a fifth of the margin
        (6.0, 5.0, 0.875),  # half of what is left beside a screw hole
        (2.5, 1.0, 0.5),  # the least
        (2.49, 1.0, 0.0),
        (2.4, 4.0, 0.0),
    ],
)
def test_notches_stay_in_the_margin_and_off_the_holes(
    margin: float, hole: float, mark: float
) -> None:
    deep = mark_depth_mm(Mount(plate_margin_mm=margin, hole_diameter_mm=hole))
    assert deep == pytest.approx(mark)
    assert ARROW_MARKS * deep < margin
