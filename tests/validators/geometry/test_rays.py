"""Winding numbers by rays are those of the exact sum of solid angles, on every kind of surface."""

from __future__ import annotations

import igl
import numpy as np
import pytest
from solids import box, inward, move, together
from validator_parts import trefoil, tube

from knotfab_validators.arrays import Array
from knotfab_validators.geometry.mesh import Mesh, winding_numbers
from knotfab_validators.geometry.rays import count_above

BOX = box((0.0, 0, 0), (4, 4, 4))
TUBE = Mesh(*tube(trefoil(60, 4.0), 1.5, 12))
OVERLAPPING = Mesh(*tube(trefoil(60, 4.0), 4.0, 12))  # the tube meets itself: 2 and more inside
SURFACES = {
    "box": BOX,
    "hollow": together(box((0, 0, 0), (10, 10, 10)), inward(box((3, 3, 3), (7, 7, 7)))),
    "tube": TUBE,
    "overlapping": OVERLAPPING,
    "inside out": inward(TUBE),
    "doubled": together(BOX, BOX),
    "touching in a face": together(BOX, box((4, 0, 0), (8, 4, 4))),
    "touching in an edge": together(BOX, box((4, 4, 0), (8, 8, 4))),
    "a hair apart": together(BOX, box((4 + 1e-9, 0, 0), (8, 4, 4))),
    "far from the origin": move(TUBE, shift=(5e4, -3e4, 7e4)),
    "open": Mesh(TUBE.vertices, TUBE.faces[3:]),
    "one face turned": Mesh(TUBE.vertices, np.concatenate([TUBE.faces[1:], TUBE.faces[:1, ::-1]])),
    "one face twice": Mesh(TUBE.vertices, np.concatenate([TUBE.faces, TUBE.faces[:1]])),
    "flat faces": Mesh(BOX.vertices, np.concatenate([BOX.faces, [[0, 1, 0], [1, 0, 1]]])),
    "slivers": together(BOX, box((1, 1, 1), (3, 3, 1 + 1e-7))),
}


def _exact(points: Array, mesh: Mesh) -> Array:
    arrays = (mesh.vertices, mesh.faces, points)
    return np.asarray(igl.winding_number(*map(np.ascontiguousarray, arrays))).ravel()


def _points(mesh: Mesh, seed: int, count: int) -> Array:
    """Points all about, above and below corners, middles of edges and faces, and on all of these."""
    rng = np.random.default_rng(seed)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    about = rng.uniform(low - 0.2 * (high - low), high + 0.2 * (high - low), (count, 3))
    corner = mesh.vertices[mesh.faces]
    special = np.concatenate([corner[:, 0], corner[:, :2].mean(axis=1), corner.mean(axis=1)])
    special = special[rng.choice(len(special), min(len(special), count // 10), replace=False)]
    moved = [special + step * (high - low) for step in (0, [0, 0, 0.3], [0, 0, -0.3], [0.2, 0, 0])]
    return np.concatenate([about, *moved])


@pytest.mark.parametrize("name", SURFACES)
def test_they_agree_with_the_exact_sum(name: str) -> None:
    mesh = SURFACES[name]
    points = _points(mesh, 7, 10_000 if len(mesh.faces) < 2000 else 3000)
    found, summed = winding_numbers(points, mesh), _exact(points, mesh)
    # on a face the sum is what it is: rays leave such points to it
    assert np.abs(found - summed).max() < 1e-9
    assert ((found > 0.5) == (summed > 0.5)).all()


def test_rays_decide_what_is_not_near_a_face() -> None:
    points = np.random.default_rng(3).uniform(-12, 12, (5000, 3))
    _, unsure = count_above(points, TUBE.vertices, TUBE.faces)
    assert unsure.mean() < 1e-3
    for on in (TUBE.vertices[:50], TUBE.vertices[TUBE.faces[:50]].mean(axis=1)):
        assert count_above(on, TUBE.vertices, TUBE.faces)[1].all()


@pytest.mark.parametrize(
    ("name", "closed"),
    {n: n not in ("open", "one face turned", "one face twice") for n in SURFACES}.items(),
)
def test_a_rim_is_found(name: str, closed: bool) -> None:
    assert SURFACES[name].balanced == closed
