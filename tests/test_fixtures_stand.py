"""The plinth: closed, outwards, of the sizes and the volume of its formula, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from knotfab_fixtures.stand import plinth


@pytest.mark.parametrize(("front", "back"), [(20.0, 5.0), (8.0, 8.0), (5.0, 20.0)])
def test_a_sharp_plinth_is_a_prism(front: float, back: float) -> None:
    vertices, faces = plinth(
        100.0, 80.0, front, back, corner_radius_mm=0, rounding_mm=0, chamfer_mm=0
    )
    part = trimesh.Trimesh(vertices, faces, process=False)
    assert part.is_watertight and part.is_winding_consistent and part.euler_number == 2
    assert part.volume == pytest.approx(100 * 80 * (front + back) / 2)
    top = vertices[vertices[:, 2] > 0.1]
    slope = front + (back - front) * (top[:, 1] + 40) / 80
    assert top[:, 2] == pytest.approx(slope)


def test_its_edges_are_taken_off_and_its_underside_is_flat() -> None:
    vertices, faces = plinth(60.0, 50.0, 12.0, 6.0, corner_radius_mm=6.0, chamfer_mm=0.8)
    part = trimesh.Trimesh(vertices, faces, process=False)
    assert part.is_watertight and part.is_winding_consistent and part.euler_number == 2
    assert part.volume < 60 * 50 * 9
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    assert low == pytest.approx([-30, -25, 0], abs=1e-6) and high[:2] == pytest.approx([30, 25])
    under = vertices[vertices[:, 2] < 1e-6]
    assert np.abs(under[:, 0]).max() == pytest.approx(29.2)
    assert np.abs(under[:, 1]).max() == pytest.approx(24.2)
    # nothing sticks out of the slope
    assert (vertices[:, 2] <= 12 - 6 * (vertices[:, 1] + 25) / 50 + 1e-6).all()


@pytest.mark.parametrize(
    "sizes",
    [
        {"width_mm": 0.0},
        {"depth_mm": float("nan")},
        {"back_mm": -1.0},
        {"corner_radius_mm": 25.0},  # half the depth
        {"rounding_mm": 3.4, "chamfer_mm": 1.6},  # as high as the back
        {"chamfer_mm": -0.1},
        {"corner_radius_mm": 1.0, "rounding_mm": 1.0},
    ],
)
def test_no_plinth(sizes: dict[str, float]) -> None:
    good = {"width_mm": 60.0, "depth_mm": 50.0, "front_mm": 12.0, "back_mm": 5.0}
    with pytest.raises(ValueError, match=r"plinth|corners"):
        plinth(**(good | sizes))
