"""Distances of segments, against dense samples."""

import numpy as np
import pytest

from knotfab.geometry.neighbours import segment_distance


def test_segments_as_near_as_dense_samples_say() -> None:
    random = np.random.default_rng(3)
    a, b, c, d = random.normal(size=(4, 300, 3))
    d[:20] = c[:20] + (b - a)[:20] * 1.3  # parallel ones
    found = segment_distance(a, b, c, d)
    t = np.linspace(0, 1, 160)[:, None, None]
    p, q = a + t * (b - a), c + t * (d - c)
    dense = np.array(
        [np.linalg.norm(p[:, None, i] - q[None, :, i], axis=2).min() for i in range(300)]
    )
    assert (found <= dense + 1e-12).all() and (dense - found < 0.03).all()
    cross = segment_distance(
        *(np.array([x], dtype=float) for x in ([-1, 0, 0], [1, 0, 0], [0, -1, 2], [0, 1, 2]))
    )
    assert cross == pytest.approx([2.0])
