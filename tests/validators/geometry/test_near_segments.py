"""Near segments: none that is near is left out."""

import numpy as np

from knotfab_validators.geometry.near_segments import near_segments, segment_blocks


def test_near_segments_leaves_out_no_near_one() -> None:
    rng = np.random.default_rng(0)
    start = rng.normal(size=(60, 3))
    end = start + rng.normal(size=(60, 3)) * rng.choice([0.0, 0.1, 1.0, 5.0], (60, 1))
    end[:20] = start[:20] + [4.0, 0, 0]  # parallel
    blocks = segment_blocks(start, end, np.arange(0, 60, 8))
    i, j = np.triu_indices(8)
    t = np.linspace(0, 1, 40)[:, None]
    points = [a + t * (b - a) for a, b in zip(start, end, strict=True)]
    for limit in (0.05, 0.3):
        one, other = near_segments(blocks, i, j, limit)
        assert (one < other).all() and len(one) < 60 * 59 / 2
        found = set(zip(one.tolist(), other.tolist(), strict=True))
        assert len(found) == len(one)
        for a in range(60):
            for b in range(a + 1, 60):
                apart = np.linalg.norm(points[a][:, None] - points[b], axis=2).min()
                assert apart > limit or (a, b) in found
