"""The wall plate: closed, outwards, of the volume of its formula, and what it refuses."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import trimesh

from knotfab_fixtures.plate import ARROW_DEPTH_MM, ARROW_MARKS, wall_plate


@pytest.mark.parametrize("corner", [0.0, 8.0])
@pytest.mark.parametrize("tolerance", [0.05, 0.005])
def test_volume_is_that_of_the_formula(corner: float, tolerance: float) -> None:
    width, height, thickness, hole = 90.0, 40.0, 4.0, 5.0
    vertices, faces = wall_plate(
        width, height, thickness, hole, corner_radius_mm=corner, tolerance_mm=tolerance
    )
    part = trimesh.Trimesh(vertices, faces, process=False)
    assert part.is_watertight and part.is_winding_consistent
    assert part.euler_number == 2 - 2 * 2  # two holes
    area = width * height - (4 - np.pi) * corner**2 - 2 * np.pi * (hole / 2) ** 2
    # Facets lie within the tolerance of the round edges: that much area along their length.
    slack = tolerance * (2 * np.pi * corner + 2 * np.pi * hole) * thickness
    assert abs(part.volume - area * thickness) < slack + 1e-9
    assert vertices.min(axis=0) == pytest.approx([-width / 2, -height / 2, 0.0])
    assert vertices.max(axis=0) == pytest.approx([width / 2, height / 2, thickness])


def test_holes_go_through_where_they_are_asked_for() -> None:
    vertices, _ = wall_plate(60.0, 30.0, 3.0, 4.0, hole_inset_mm=8.0)
    for x in (-22.0, 22.0):
        from_axis = np.hypot(vertices[:, 0] - x, vertices[:, 1])
        rim = from_axis < 5.0
        assert from_axis[rim] == pytest.approx(2.0)
        assert set(vertices[rim, 2]) == {0.0, 3.0}


def marked(mark: float, **options: float) -> tuple[np.ndarray, np.ndarray]:
    return wall_plate(90.0, 60.0, 3.0, 4.0, corner_radius_mm=0.0, mark_mm=mark, **options)


def test_marks_take_away_four_wedges_and_an_arrow() -> None:
    mark = 1.5
    part = trimesh.Trimesh(*marked(mark), process=False)
    plain = trimesh.Trimesh(*marked(0.0), process=False)
    assert part.is_watertight and part.euler_number == plain.euler_number == 2 - 2 * 2
    gone = 4 * mark**2 * 3.0 + (2 * mark) ** 2 * ARROW_DEPTH_MM
    assert plain.volume - part.volume == pytest.approx(gone, rel=1e-6)
    thin = wall_plate(90.0, 60.0, 1.0, 4.0, corner_radius_mm=0.0, mark_mm=mark)
    bare = wall_plate(90.0, 60.0, 1.0, 4.0, corner_radius_mm=0.0)
    gone = 4 * mark**2 + (2 * mark) ** 2 * 0.25  # the arrow leaves three quarters of the plate
    volumes = [trimesh.Trimesh(*mesh, process=False).volume for mesh in (bare, thin)]
    assert volumes[0] - volumes[1] == pytest.approx(gone, rel=1e-6)


def test_marks_lie_in_the_middle_of_the_edges_and_the_arrow_points_up() -> None:
    mark = 1.5
    vertices, _ = marked(mark)
    flat = {tuple(np.round(v[:2], 9)) for v in vertices}
    x, y = 45.0, 30.0
    assert flat >= {(0, y - mark), (0, mark - y), (mark - x, 0), (x - mark, 0)}
    assert flat >= {(mark, y), (-mark, y), (mark, -y), (-x, mark), (x, -mark)}
    # the frame inside the marks is untouched: no corner of them there
    outer = np.maximum(np.abs(vertices[:, 0]) - x, np.abs(vertices[:, 1]) - y)
    rim = np.hypot(np.abs(vertices[:, 0]) - 30.0, vertices[:, 1]) < 3  # of the screw holes
    assert outer[~rim].min() == pytest.approx(-ARROW_MARKS * mark)
    sunk = vertices[(vertices[:, 2] > 1) & (vertices[:, 2] < 2.9)]
    assert sunk[:, 2] == pytest.approx(3.0 - ARROW_DEPTH_MM)
    # pointing up: one corner above, two below, all above the middle
    assert sorted(set(np.round(sunk[:, 1], 9))) == [y - 4 * mark, y - 2 * mark]
    assert set(np.round(sunk[sunk[:, 1] > y - 3 * mark, 0], 9)) == {0.0}


@pytest.mark.parametrize(
    ("mark", "options"),
    [
        (7.0, {}),  # (60 / 2 - 2) / 4: the arrow meets the line of the holes
        (1.0, {"hole_inset_mm": 3.0}),  # the notch meets the hole
        (-0.1, {}),
        (float("nan"), {}),
    ],
)
def test_marks_without_room_are_refused(mark: float, options: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="marks"):
        marked(mark, **options)
    if mark > 0:
        trimesh.Trimesh(*marked(0.98 * mark, **options), process=False)


def test_marks_stay_between_round_corners() -> None:
    for width, height, mark in ((52.0, 90.0, 1.5), (90.0, 43.0, 1.5)):
        sizes = (width, height, 3.0, 4.0)
        wall_plate(*sizes, corner_radius_mm=19.9, hole_inset_mm=8.0, mark_mm=mark)
        with pytest.raises(ValueError, match="corners"):
            wall_plate(*sizes, corner_radius_mm=20.0, hole_inset_mm=8.0, mark_mm=mark)


@pytest.mark.parametrize(
    ("sizes", "options"),
    [
        ((60.0, 30.0, 0.0, 4.0), {}),
        ((60.0, 30.0, -1.0, 4.0), {}),
        ((60.0, 30.0, float("nan"), 4.0), {}),
        ((60.0, 30.0, 3.0, 30.0), {}),
        ((60.0, 30.0, 3.0, 4.0), {"hole_inset_mm": 1.0}),
        ((60.0, 30.0, 3.0, 4.0), {"hole_inset_mm": 29.0}),
        ((60.0, 30.0, 3.0, 4.0), {"corner_radius_mm": 15.0}),
    ],
)
def test_what_is_no_plate_is_refused(
    sizes: tuple[float, float, float, float], options: dict[str, float]
) -> None:
    with pytest.raises(ValueError):
        wall_plate(*sizes, **options)


def test_fixtures_load_neither_torch_nor_the_optimizer() -> None:
    code = (
        "import sys; from knotfab_fixtures.plate import wall_plate; wall_plate(60, 30, 3, 4);"
        "print([m for m in ('torch', 'knotfab', 'knotfab_validators') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
