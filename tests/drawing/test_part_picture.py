"""The picture of a part: its plates are flat to the rims of their holes, and its tubes are round."""

import numpy as np
from solids import blocks
from validator_parts import circle, tube

from knotfab.drawing.part_picture import _normals
from knotfab.geometry.meshes import face_normals


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
