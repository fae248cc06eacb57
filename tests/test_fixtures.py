"""The wall plate: closed, outwards, of the volume of its formula, and what it refuses."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import trimesh

from knotfab_fixtures.plate import wall_plate


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
