"""The picture of a part: its plates are flat to the rims of their holes, and its tubes are round."""

from __future__ import annotations

import numpy as np
from solids import blocks
from validator_parts import circle, tube

from knotfab.geometry.tube import face_normals
from knotfab.render.part_picture import _normals, draw_faces


def test_a_plate_is_flat_to_the_rim_of_its_hole_and_a_tube_is_smooth() -> None:
    filled = np.ones((3, 3, 1))
    filled[1, 1, 0] = 0
    plate = blocks([0, 10, 12, 30], [0, 4, 6, 60], [0, 3], filled)
    own = face_normals(plate.vertices[plate.faces])
    own /= np.linalg.norm(own, axis=1)[:, None]
    assert np.allclose(_normals(plate.vertices, plate.faces), np.repeat(own, 3, axis=0))
    vertices, faces = tube(circle(60), 3.0)
    found = _normals(vertices, faces)
    for vertex in range(0, len(vertices), 97):
        around = found[faces.ravel() == vertex]
        assert np.allclose(around, around[0]) and np.linalg.norm(around[0]) > 0.999


# Faces drawn by a depth buffer.


UP = np.array([[0.0, 0.0, 1.0]])


def test_faces_that_share_an_edge_leave_no_gap() -> None:
    corners = np.array([[0.0, 0.0, 1.0], [20.0, 0.0, 1.0], [0.0, 20.0, 1.0], [20.0, 20.0, 1.0]])
    half, _ = draw_faces(corners, np.repeat(UP, 4, axis=0), np.array([[0, 1, 2]]), 20)
    assert abs(half.sum() - 200) <= 10
    both, _ = draw_faces(corners, np.repeat(UP, 4, axis=0), np.array([[0, 1, 2], [1, 2, 3]]), 20)
    assert both.all()
    beyond, _ = draw_faces(
        corners - [30, 0, 0], np.repeat(UP, 4, axis=0), np.array([[0, 1, 2]]), 20
    )
    assert not beyond.any()


def test_the_nearer_face_hides_the_other_in_any_order() -> None:
    """Where two faces cut each other, the nearer one is seen; normals lie between the corners'."""
    side = np.array([[0.0, 0.0], [30.0, 0.0], [0.0, 30.0]])
    near = np.column_stack([side, [1.0, 3.0, 1.0]])  # comes nearer to the right
    level = np.column_stack([side, [2.0, 2.0, 2.0]])
    x, y = np.eye(3)[0], np.eye(3)[1]
    normals = np.stack([x, x, x, y, y, y])
    points = np.concatenate([near, level])
    for order in ([0, 1], [1, 0]):
        faces = np.array([[0, 1, 2], [3, 4, 5]])[order]
        found, normal = draw_faces(points, normals, faces, 30)
        assert (normal[0, :14] == y).all() and (normal[0, 16:29] == x).all() and found[0, :29].all()
    ramp = np.stack([x, y, x])
    _, normal = draw_faces(level, ramp, np.array([[0, 1, 2]]), 30)
    np.testing.assert_allclose(normal[0, 10], (1 - 10.5 / 30) * x + 10.5 / 30 * y)
