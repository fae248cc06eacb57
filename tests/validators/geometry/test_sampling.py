"""Runs are numbered, and edges cut, as their definitions say."""

import numpy as np
import pytest

from knotfab_validators.geometry.sampling import cut_edges, number_runs, quarter_triangles


def test_entries_are_numbered_run_by_run() -> None:
    which, number = number_runs(np.array([2, 0, 3]))
    assert which.tolist() == [0, 0, 2, 2, 2] and number.tolist() == [0, 1, 0, 1, 2]


@pytest.mark.parametrize("step", [0.3, 1.0, 100.0])
def test_pieces_cover_each_edge_and_none_is_longer_than_the_step(step: float) -> None:
    start, end = np.random.default_rng(0).normal(size=(2, 20, 3))
    end[7] = start[7]  # an edge of no length is one piece
    which, begin, share = cut_edges(start, end, step)
    length = np.linalg.norm(end - start, axis=1)
    assert (share * length[which] <= step * (1 + 1e-12)).all()
    assert np.bincount(which, share) == pytest.approx(np.ones(20))
    for edge in range(20):
        own = begin[which == edge]
        assert own == pytest.approx(np.arange(len(own)) / len(own))
        assert len(own) == max(1, np.ceil(length[edge] / step))


def test_quarters_cover_a_triangle() -> None:
    corner = np.random.default_rng(1).normal(size=(5, 3, 3))
    small = quarter_triangles(corner)
    area = np.linalg.norm(
        np.cross(*(np.moveaxis(small, 1, 0)[k] - small[:, 0] for k in (1, 2))), axis=1
    )
    whole = np.linalg.norm(
        np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1
    )
    assert area.reshape(4, 5) == pytest.approx(np.tile(whole / 4, (4, 1)))
