"""Faces that cross: both libraries are asked, and where they do not agree it is said."""

import numpy as np
import pytest
from damaged_rings import CIRCLE, by_name, curves, ring

from knotfab_validators.geometry.heap import overlapping_boxes
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.mesh import second_opinion
from knotfab_validators.mesh.second_opinion import crossing_faces, opinions
from knotfab_validators.mesh.surface_checks import check_mesh

# Each face is paired with (0, 0, 0), (4, 0, 0), (0, 4, 0), and shares no corner with it.
TOUCHING = {
    "corner on face": [[1, 1, 0], [1, 1, 1], [2, 1, 1]],
    "corner on edge": [[2, 0, 0], [2, 0, 1], [3, 0, 1]],
    "edge along edge": [[1, 0, 0], [3, 0, 0], [2, 0, 1]],
    "in one plane": [[1, 1, 0], [5, 1, 0], [1, 5, 0]],
    "the same": [[0, 0, 0], [4, 0, 0], [0, 4, 0]],
}


FIRST = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]


@pytest.mark.parametrize("case", TOUCHING)
def test_exact_touching_counts_for_libigl_alone(case: str) -> None:
    pair = Mesh(
        np.array(FIRST + TOUCHING[case], dtype=np.float64), np.array([[0, 1, 2], [3, 4, 5]])
    )
    found = opinions(pair)
    assert found.pairs is not None and found.seen is not None
    assert (found.pairs.tolist(), found.seen.tolist()) == ([[0, 1]], [])
    check = by_name(check_mesh(pair))["mesh_self_intersection"]
    assert check.status == "fail" and "do not agree" in check.detail and len(check.at) == 1
    # the least gap is none
    lifted = Mesh(pair.vertices + np.array([[0, 0, 0]] * 3 + [[0, 0, 1e-9]] * 3), pair.faces)
    if case in ("corner on face", "in one plane", "the same"):
        assert by_name(check_mesh(lifted))["mesh_self_intersection"].status == "pass"


def test_both_libraries_see_what_crosses() -> None:
    sunk = [[1, 1, -1e-9], [1, 1, 1], [2, 1, 1]]
    pair = Mesh(np.array(FIRST + sunk, dtype=np.float64), np.array([[0, 1, 2], [3, 4, 5]]))
    found = opinions(pair)
    assert found.pairs is not None and found.seen is not None
    assert (found.pairs.tolist(), found.seen.tolist()) == ([[0, 1]], [0, 1])
    assert "do not agree" not in by_name(check_mesh(pair))["mesh_self_intersection"].detail


# two faces of a stand's base, apart from each other, in its aslant plane
BESIDE = [
    [57.14777374267578, 38.441162109375, 7.15132474899292],
    [197.86212158203125, 62.775794982910156, 4.109495639801025],
    [56.996315002441406, 38.42103958129883, 7.153840065002441],
    [197.20518493652344, 45.61954879760742, 6.254026412963867],
    [168.7625732421875, 27.10506820678711, 8.568336486816406],
    [197.31759643554688, 45.57883834838867, 6.259115219116211],
]


def test_faces_beside_each_other_in_one_plane_do_not_cross() -> None:
    pair = Mesh(np.array(BESIDE), np.array([[0, 1, 2], [3, 4, 5]]))
    assert len(crossing_faces(pair)) == 2  # by the rounding of pymeshlab
    assert by_name(check_mesh(pair))["mesh_self_intersection"].status == "pass"


def test_a_crossing_is_seen_however_it_is_turned(monkeypatch: pytest.MonkeyPatch) -> None:
    sunk = [[1, 1, -0.01], [1, 1, 1], [2, 1, 1]]
    pair = Mesh(np.array(FIRST + sunk, dtype=np.float64), np.array([[0, 1, 2], [3, 4, 5]]))
    monkeypatch.setattr(second_opinion, "self_intersections", lambda *a, **k: np.empty((0, 2), int))
    found = opinions(pair)
    assert found.seen is not None and found.seen.tolist() == [0, 1]


def test_a_crossing_that_one_library_alone_sees_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    some = {True: np.array([3, 4]), False: np.array([0, 1])}  # by the mesh, and by them alone
    monkeypatch.setattr(second_opinion, "crossing_faces", lambda mesh: some[len(mesh.faces) > 2])
    check = by_name(check_mesh(ring(), curves(CIRCLE)))["mesh_self_intersection"]
    assert check.status == "fail" and check.measured == 2 and len(check.at) == 2
    assert (
        "0 by libigl, 2 faces that cross others by pymeshlab (the two do not agree)" in check.detail
    )


def test_a_part_is_not_accepted_without_the_second_opinion(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(mesh: Mesh) -> None:
        raise ImportError("libGL.so.1")

    monkeypatch.setattr(second_opinion, "crossing_faces", missing)
    check = by_name(check_mesh(ring()))["mesh_self_intersection"]
    assert check.status == "skipped" and check.required and "libGL" in check.detail


@pytest.mark.slow
def test_a_heap_of_faces_is_refused_without_counting_all_pairs() -> None:
    rng = np.random.default_rng(0)
    heap = Mesh(rng.normal(size=(18000, 3)), np.arange(18000).reshape(-1, 3))
    check = by_name(check_mesh(heap))["mesh_self_intersection"]
    assert check.status == "fail"
    assert (
        "not tested" in check.detail or "at least 1 by libigl, and pymeshlab agrees" in check.detail
    )
    few = Mesh(heap.vertices[:8400], heap.faces[:2800])
    check = by_name(check_mesh(few))["mesh_self_intersection"]
    assert check.status == "fail" and isinstance(check.measured, float) and check.measured > 1000


def test_a_few_long_faces_aslant_do_not_make_a_heap() -> None:
    """Bars across a fine surface: sixteen faces drawn from all once foresaw many times the work."""
    n = 80
    x, y = np.meshgrid(np.linspace(0, 100, n), np.linspace(0, 100, n))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(n * n)])
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    fine = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + n], 1),
            np.stack([corner + 1, corner + n + 1, corner + n], 1),
        ]
    )
    bars = np.array([[[0, 0, -5], [100, 100, 5], [100, 99, 5 + k]] for k in range(40)], dtype=float)
    long = len(vertices) + np.arange(120).reshape(-1, 3)
    mesh = Mesh(np.concatenate([vertices, bars.reshape(-1, 3)]), np.concatenate([fine, long]))
    low, high = (f(mesh.vertices[mesh.faces], axis=1) for f in (np.min, np.max))
    exact = sum(
        int(((low[k + 1 :] <= high[k]) & (high[k + 1 :] >= low[k])).all(axis=1).sum())
        for k in range(0, len(mesh.faces), 7)
    )
    exact *= 7
    assert overlapping_boxes(mesh) == pytest.approx(exact, rel=0.35)
