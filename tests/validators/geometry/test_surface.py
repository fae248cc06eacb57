"""What a mesh is made of: bodies, genera and volumes of known solids."""

from __future__ import annotations

import numpy as np
import pytest
from damaged_rings import ring, two

from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.geometry.surface import survey


def test_survey_finds_genus_and_volume_of_each_body() -> None:
    axes = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    ball = Mesh(
        np.concatenate([axes, -axes]) + 100,
        np.array(
            [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
        ),
    )
    found = survey(two(ring(), ball))
    assert found.closed and found.manifold
    assert found.genus.tolist() == [1, 0]
    assert found.volumes_mm3[1] == pytest.approx(4 / 3)
    assert np.bincount(found.body).tolist() == [len(ring().faces), 8]
