"""Faces drawn by a depth buffer."""

import numpy as np

from knotfab.drawing.shading import draw_faces

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
