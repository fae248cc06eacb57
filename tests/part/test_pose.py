"""The print pose: rigid, on the bed's corner, of least height among those that fit."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.geometry.overhang import Rules
from knotfab.geometry.tube import mesh_volume, sweep
from knotfab.knots import Knot, Knots
from knotfab.part.pose import PrintPose, choose_pose


def oval(size: tuple[float, float, float], n: int = 120) -> Array:
    """A closed curve whose extents are `size`."""
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.stack([np.cos(t), np.sin(t), np.sin(2 * t)], axis=1) * (np.array(size) / 2)


FRAME = (100.0, 100.0)


def make_pose(
    curves: list[Array],
    build: tuple[float, float, float],
    radius: float = 2.0,
    frame: tuple[float, float] = FRAME,
) -> PrintPose:
    knots = Knots(tuple(Knot(c) for c in curves), radius)
    return choose_pose(knots, [sweep(c, radius, 16) for c in curves], build, frame)


@pytest.mark.parametrize("size", [(180, 170, 90), (180, 60, 170), (40, 160, 170), (100, 100, 100)])
def test_least_height_and_exact_corner(size: tuple[float, float, float]) -> None:
    there = np.array([3.0, -100.0, 40.0])
    curves = [oval(size) + there, oval((20, 30, 25)) + there]
    pose = make_pose(curves, (250.0, 210.0, 220.0))
    corner = np.min([v.min(axis=0) for v, _ in pose.tubes], axis=0)
    assert (corner == 0.0).all()
    assert pose.size_mm[2] == pytest.approx(min(size) + 4, abs=0.8)
    assert (pose.size_mm <= [250, 210, 220]).all()


def test_matrix_takes_the_print_back_to_the_scene() -> None:
    curve = oval((150, 50, 120)) + np.array([1.0, 2.0, 3.0])
    pose = make_pose([curve], (250.0, 210.0, 220.0))
    turn, shift = pose.matrix[:3, :3], pose.matrix[:3, 3]
    assert turn @ turn.T == pytest.approx(np.eye(3)) and np.linalg.det(turn) == pytest.approx(1)
    assert pose.matrix[3] == pytest.approx([0, 0, 0, 1])
    assert pose.knots.points @ turn.T + shift == pytest.approx(curve, abs=1e-9)
    assert pose.knots.moved(pose.matrix).points == pytest.approx(curve, abs=1e-9)
    vertices, faces = pose.tubes[0]
    assert vertices @ turn.T + shift == pytest.approx(sweep(curve, 2.0, 16)[0], abs=1e-9)
    assert mesh_volume(vertices, faces) > 0


def test_a_tie_lies_on_its_back() -> None:
    """Equal heights: the scene's z, towards the light, points up."""
    pose = make_pose([oval((80, 80, 80))], (250.0, 210.0, 220.0), radius=1.0)
    assert pose.matrix[:3, :3] == pytest.approx(np.eye(3))


def test_least_height_gives_way_to_what_fits() -> None:
    pose = make_pose([oval((180, 100, 90))], (110.0, 200.0, 200.0))
    assert (pose.size_mm <= [110.0, 200.0, 200.0]).all()
    assert pose.size_mm[2] == pytest.approx(94, abs=1)


def test_a_long_piece_is_laid_across_the_corners() -> None:
    bar = oval((210, 12, 30))
    pose = make_pose([bar], (180.0, 180.0, 60.0))
    assert (pose.size_mm <= [180.0 + 1e-6, 180.0 + 1e-6, 60.0]).all()
    turn = pose.matrix[:3, :3]
    assert np.linalg.det(turn) == pytest.approx(1) and abs(turn).max(axis=0).min() < 0.9
    assert min(v.min() for v, _ in pose.tubes) == 0.0


def test_too_large_a_piece_names_the_size_that_would_fit() -> None:
    with pytest.raises(SceneError, match=r"the printer holds 120\.0 x 120\.0 x 120\.0") as caught:
        make_pose([oval((180, 180, 108))], (120.0, 120.0, 120.0), frame=(200.0, 190.0))
    found = re.search(r"--size ([\d.]+), another printer, or cut it in", str(caught.value))
    assert found is not None
    scale = float(found[1]) / 200
    make_pose([scale * oval((180, 180, 108))], (120.0, 120.0, 120.0))
    with pytest.raises(SceneError):
        make_pose([1.05 * scale * oval((180, 180, 108))], (120.0, 120.0, 120.0))


def test_a_printer_too_small_for_the_tube() -> None:
    with pytest.raises(SceneError, match="thickness"):
        make_pose([oval((180, 180, 108))], (120.0, 120.0, 3.0))
    with pytest.raises(SceneError, match=r"Use --size 6\d, another"):
        make_pose([oval((180, 180, 108))], (120.0, 120.0, 120.0))


def block(*size: float) -> tuple[Array, np.ndarray]:
    """Corners alone: all that a pose looks at."""
    return np.array([[x, y, z] for x in (0, size[0]) for y in (0, size[1]) for z in (0, size[2])],
                    dtype=float), np.empty((0, 3), dtype=np.int32)  # fmt: skip


def test_the_frame_that_would_fit_allows_for_a_mount() -> None:
    """A plate keeps its margin, and its distance from the wall, when the frame shrinks."""
    fixed = (16.0, 16.0, 103.0)
    knots = Knots((Knot(oval((100, 100, 50))),), 2.0)

    def try_room(frame: float, room: tuple[float, float, float]) -> PrintPose:
        part = block(frame + 16.0, frame + 16.0, 0.3 * frame + 103.0)
        return choose_pose(knots, [part], room, (frame, frame), np.eye(3), fixed_mm=fixed)

    for room in ((210.0, 210.0, 220.0), (300.0, 300.0, 150.0)):
        with pytest.raises(SceneError) as caught:
            try_room(300.0, room)
        found = re.search(
            r"--size ([\d.]+), another printer, or cut it in the slicer", str(caught.value)
        )
        assert found is not None
        try_room(float(found[1]), room)
        with pytest.raises(SceneError):
            try_room(1.02 * float(found[1]) + 1.0, room)


def test_a_wall_too_far_for_the_printer_is_what_must_change() -> None:
    knots = Knots((Knot(oval((100, 100, 50))),), 2.0)
    fixed = (16.0, 16.0, 203.0)

    def try_room(room: tuple[float, float, float]) -> PrintPose:
        part = block(196.0, 196.0, 250.0)
        return choose_pose(knots, [part], room, (180.0, 180.0), np.eye(3), fixed_mm=fixed)

    with pytest.raises(SceneError, match=r"wall_distance_mm smaller by more than 3\.0"):
        try_room((210.0, 210.0, 200.0))
    make_pose([oval((100, 100, 50))], (210.0, 210.0, 200.0))  # --mount none, as it suggests
    with pytest.raises(SceneError, match=r"does not even hold the mount"):
        try_room((10.0, 210.0, 200.0))
    with pytest.raises(SceneError, match=r"Use --size \d+, another"):
        try_room((210.0, 210.0, 210.0))


def test_in_powder_the_smallest_box_is_taken() -> None:
    """A piece turned askew comes back square, whatever hangs over; a bed that is longer one way is used."""
    t = 2 * np.pi * np.arange(200) / 200
    curve = np.column_stack([60 * np.cos(t), 40 * np.sin(t), 12 * np.cos(5 * t)])
    askew = curve @ Rotation.from_euler("xyz", [25, 40, 10], degrees=True).as_matrix().T
    tube = [sweep(askew, 2.0, 12)]
    rules = Rules(supports=False, powder=True)
    for room in ((250.0, 210.0, 220.0), (90.0, 130.0, 40.0), (40.0, 90.0, 130.0)):
        pose = choose_pose(Knots((Knot(askew),), 2.0), tube, room, FRAME, rules=rules)
        assert pose.weighed is None
        assert (pose.size_mm <= np.array(room) + 1e-6).all()
        assert pose.size_mm.prod() < 1.03 * (124.0 * 84.0 * 28.0)
    with pytest.raises(SceneError, match="holds 60"):
        choose_pose(Knots((Knot(askew),), 2.0), tube, (60.0, 60.0, 60.0), FRAME, rules=rules)
