"""The checks tell whether parts reach the bed, and how far they are from toppling."""

from __future__ import annotations

import numpy as np
import pytest
from printed_solids import BARE, PRINTER, leaning, run
from scipy.spatial.transform import Rotation
from solids import blocks, box, cone, inward, move, prism, table, together
from validator_parts import trefoil, tube

from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.printability import printability_checks
from knotfab_validators.printing.standing import above, bodies


def test_a_body_one_layer_up_still_lies_on_the_bed() -> None:
    ground = box((0, 0, 0), (10, 10, 5))
    for height, count in ((0.2, 0), (0.203, 1)):
        found = run(together(ground, box((20, 0, height), (30, 10, 5))), BARE)
        assert (found["floating"].measured, found["islands"].measured) == (count, count)
        assert found["floating"].status == ("fail" if count else "pass")
    assert run(box((0, 0, 3), (5, 5, 5)))["floating"].status == "pass"  # with supports


def test_a_box_stands_by_half_its_width() -> None:
    found = run(box((5, 5, 0), (15, 45, 20)), stands=True)["standing"]
    assert found.measured == pytest.approx(5.0) and found.status == "pass"
    assert "26.6°" in found.detail and found.at[0] == pytest.approx((10, 25, 10))


@pytest.mark.parametrize(("more", "status"), [(0.0, "pass"), (0.001, "fail")])
def test_a_top_that_reaches_out_too_far_topples(more: float, status: str) -> None:
    reach = 2 + np.sqrt(8) + more  # the centre is above the foot's edge
    mesh = blocks([0, 2, reach], [0, 6], [0, 1, 2], [[[1, 1]], [[0, 1]]])
    found = run(mesh, stands=True)["standing"]
    assert (found.status, found.required) == (status, True)
    assert found.measured == pytest.approx(0.0, abs=1e-3)
    assert run(mesh)["standing"].status == "pass"


def test_a_hollow_moves_the_centre() -> None:
    solid, hole = box((0, 0, 0), (20, 20, 20)), box((12, 5, 5), (18, 15, 15))
    found = run(together(solid, inward(hole)), stands=True)
    x = (8000 * 10 - 600 * 15) / 7400
    assert found["standing"].at[0] == pytest.approx((x, 10, 10))
    assert found["standing"].measured == pytest.approx(x)
    assert found["feature"].measured == pytest.approx(2.0)
    assert "of 1;" in found["floating"].detail


def test_the_centre_of_mass_is_that_of_other_libraries() -> None:
    pymeshlab, trimesh = pytest.importorskip("pymeshlab"), pytest.importorskip("trimesh")
    vertices, faces = tube(trefoil(120, 10.0), 2.0, 24)
    (body,) = bodies(Mesh(vertices + [50.0, 60.0, 70.0], faces))
    other = trimesh.Trimesh(vertices + [50.0, 60.0, 70.0], faces, process=False)
    assert body.volume_mm3 == pytest.approx(other.volume, rel=1e-9)
    assert body.center == pytest.approx(other.center_mass, rel=1e-9)
    third = pymeshlab.MeshSet()
    third.add_mesh(pymeshlab.Mesh(vertices, faces))
    measures = third.get_geometric_measures()
    assert body.volume_mm3 == pytest.approx(measures["mesh_volume"], rel=1e-4)
    assert body.center - [50, 60, 70] == pytest.approx(measures["center_of_mass"], abs=1e-3)


def test_each_body_stands_for_itself() -> None:
    pair = together(box((0, 0, 0), (10, 10, 5)), cone((30, 30, 0), 5.0, 8.0))
    found = run(pair, stands=True)["standing"]
    assert found.measured == pytest.approx(0.201 * 5 / 8 * np.cos(np.pi / 48), rel=1e-6)
    assert "2 bodies" in found.detail
    edge = prism([(5, 0), (10, 5), (5, 10), (0, 5)], 8)  # lies on an edge, within the layer 0.4 mm
    assert run(edge, stands=True)["standing"].measured == pytest.approx(0.201)


def test_what_is_printed_lying_stands_as_it_is_turned() -> None:
    """A wide low block, printed on its edge; places are told as it is printed."""
    mesh = box((0, 0, 0), (4, 40, 40))
    up = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # print x is up
    lying = printability_checks(mesh, None, seconds={}, stands=True)
    stood = printability_checks(mesh, None, seconds={}, stands=True, desk=up)
    one, other = ({c.name: c for c in found}["standing"] for found in (lying, stood))
    assert one.measured == pytest.approx(2.0) and other.measured == pytest.approx(20.0)
    assert other.at[0] == pytest.approx((2, 20, 20))
    assert other.status == "pass" and "not as it is printed" in other.detail


# Overhangs and the support under them, of solids whose numbers are known.


@pytest.mark.parametrize("level", [-1.0, 0.0, 0.3, 0.6, 1.1, 2.0, 3.0])
def test_the_share_of_a_triangle_above_a_level(level: float) -> None:
    samples = np.random.default_rng(0).dirichlet([1, 1, 1], 200_000) @ [0.0, 0.6, 2.0]
    share = above(np.array([[0.6, 2.0, 0.0]]), level)[0]
    assert share == pytest.approx((samples > level).mean(), abs=0.005)


def test_the_share_of_level_edges_is_exact() -> None:
    z = np.array([[0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    assert above(z, 0.5).tolist() == [0.75, 0.25, 1.0]


def test_the_overhang_begins_beyond_the_limit() -> None:
    assert run(leaning(45.0), BARE)["overhang"].measured == 0.0
    assert run(leaning(45.0), BARE)["overhang"].status == "pass"
    found = run(leaning(45.2), BARE)["overhang"]
    # all of the underside but what belongs to the first layer
    area = 20 * (10 - 0.201) / np.cos(np.radians(45.2)) / 100
    assert found.status == "fail" and found.measured == pytest.approx(area, rel=1e-6)
    assert (
        run(leaning(45.2), BARE.model_copy(update={"max_overhang_deg": 45.2}))["overhang"].status
        == "pass"
    )
    assert run(leaning(45.2))["overhang"].required is False


def test_a_table_needs_a_box_of_support() -> None:
    found = run(table())
    assert found["overhang"].measured == pytest.approx(3.84, rel=1e-9)
    assert (found["overhang"].status, found["overhang"].limit) == ("pass", None)
    assert found["support_volume"].measured == pytest.approx(3.84, rel=1e-9)
    fits = PRINTER.model_copy(update={"max_support_cm3": 3.8400001})
    assert run(table(), fits)["support_volume"].status == "pass"
    tight = run(table(), fits.model_copy(update={"max_support_cm3": 3.839}))["support_volume"]
    assert (tight.status, tight.required) == ("fail", True)
    assert (
        run(table(), BARE.model_copy(update={"max_support_cm3": 1.0}))["support_volume"].required
        is False
    )


def test_support_stands_on_the_surface_below() -> None:
    plate = box((-10, -10, 0), (30, 30, 4))
    legless = move(table(), shift=(0, 0, 0))
    found = run(together(plate, move(legless, shift=(0, 0, 5))))["support_volume"]
    # the leg's own underside hangs 1 mm above the plate, the top 11 mm
    assert found.measured == pytest.approx((16 * 1 + 384 * 11) / 1000, rel=0.02)


def test_a_slope_off_the_grid_is_supported_within_its_error() -> None:
    found = run(move(leaning(60.0), Rotation.from_euler("z", 0.3).as_matrix(), (10, 5, 0)))
    shift = 10 * np.tan(np.radians(60))
    assert found["support_volume"].measured == pytest.approx(shift * 10 / 2 * 20 / 1000, rel=0.02)
