"""Hangers: an eyelet straight above the centre of mass holds every knot and touches nothing else."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh
from rings import EMPTY, PLA, RADIUS, camera, knots, ring

from knotfab.base.errors import SceneError
from knotfab.geometry.tube import sweep
from knotfab.hold.hang import MOST_POSTS, HangMount, _let_swing, hang_bodies, plan_hang
from knotfab.hold.struts import GROUND
from knotfab_fixtures.holders import eyelet
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.standing import check_level

pytestmark = pytest.mark.slow

UP = np.array([0.0, 1.0, 0.0])
ONE = knots(ring(50.0, n=240, wave=15.0))
# a lopsided second knot moves the centre of mass aside
TWO = knots(*(k.points for k in ONE.knots), ring(12.0, 5.0, 80, 4.0) + [20.0, 0.0, 0.0])


@cache
def plan(two: bool) -> HangMount:
    return plan_hang(TWO if two else ONE, [camera()], [EMPTY], 0.4, PLA, 0.8)


@cache
def part(two: bool) -> Mesh:
    tubes = [sweep(k.points, RADIUS, 24) for k in (TWO if two else ONE).knots]
    (body,) = hang_bodies(tubes, plan(two))  # it checks the genus
    return Mesh(*body)


@pytest.mark.parametrize("two", [False, True])
def test_the_part_hangs_level_as_another_library_weighs_it(two: bool) -> None:
    mount, mesh = plan(two), part(two)
    assert set(mount.holds) == set(range(2 if two else 1)) and len(mount.holds) == len(
        mount.members
    )
    assert 1 <= (mount.members.second == GROUND).sum() <= MOST_POSTS
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    off = mount.eyelet.thread - other.center_mass
    assert off[1] > 5.0 and np.degrees(np.arctan2(np.hypot(off[0], off[2]), off[1])) < 1.0
    found = check_level(mesh, mount.eyelet.thread, UP)
    assert found.status == "pass" and found.measured < 1.0


def test_a_thread_elsewhere_is_rejected() -> None:
    mount, mesh = plan(True), part(True)
    for aside in (5.0 * UP, -3.0 * UP, np.array([8.0, 0.0, 0.0])):
        found = check_level(mesh, mount.eyelet.thread + aside, UP)
        assert (found.status, found.required) == ("fail", True)


def test_a_weight_at_one_side_hangs_askew() -> None:
    vertices, faces = sweep(ring(30.0, wave=0.0), RADIUS, 24)  # upright, in the plane of x and y
    top = (30.0 - RADIUS) * UP
    assert check_level(Mesh(vertices, faces), top, UP).measured == pytest.approx(0.0, abs=0.01)
    turn = np.radians(4.0)
    askew = (30.0 - RADIUS) * np.array([np.sin(turn), np.cos(turn), 0.0])
    found = check_level(Mesh(vertices, faces), askew, UP)
    assert found.status == "fail" and found.measured == pytest.approx(4.0, abs=0.05)


def test_a_rigid_turn_about_the_thread_is_no_sag() -> None:
    points, thread = ONE.points, np.array([0.0, 60.0, 0.0])
    turned = np.cross([1e-3, 0.0, -2e-3], points - thread)
    assert np.abs(_let_swing(points, turned, thread)).max() < 1e-12
    down = np.tile([0.0, -0.1, 0.0], (len(points), 1))
    assert _let_swing(points, down, thread) == pytest.approx(down)


def test_a_strand_above_the_centre_leaves_no_way_for_a_thread() -> None:
    arc = np.linspace(-90.0, 90.0, 160)
    roof = np.column_stack([arc, np.full(160, 75.0), np.zeros(160)])
    back = np.column_stack([arc[::-1], np.full(160, 68.0), np.full(160, 1.0)])
    mount = plan_hang(
        knots(ONE.knots[0].points, np.vstack([roof, back])), [camera()], [EMPTY], 0.4, PLA, 0.8
    )
    assert mount.eyelet.thread[1] > 75.0
    with pytest.raises(SceneError, match="hanger"):  # nothing is ever so far from all strands
        plan_hang(ONE, [camera()], [EMPTY], 90.0, PLA, 0.8)


@pytest.mark.parametrize("sizes", [(2.0, 0.8), (3.5, 1.2)])
def test_an_eyelet_is_a_torus(sizes: tuple[float, float]) -> None:
    vertices, faces = eyelet(*sizes, tolerance_mm=0.005)
    ring_mm, wire_mm = sizes
    solid = trimesh.Trimesh(vertices, faces, process=False)
    assert solid.is_watertight and solid.euler_number == 0
    assert solid.volume == pytest.approx(2 * np.pi**2 * ring_mm * wire_mm**2, rel=0.02)


@pytest.mark.parametrize("sizes", [(0.8, 0.8), (1.0, 2.0), (0.0, 0.5), (np.nan, 0.5)])
def test_a_ring_without_a_hole_is_refused(sizes: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="eyelet"):
        eyelet(*sizes)
