"""Places that face each other are told from neighbours; endless descents are given up, in a sentence."""

import numpy as np
import pytest
from validator_parts import circle, hairpin, tube

from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.tube import strand_pairs as strand_pairs_module
from knotfab_validators.tube.clearance import check_clearance
from knotfab_validators.tube.strand_pairs import sample_curves, strand_pairs


def test_a_spike_of_a_centre_line_leaves_a_check_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    points = circle(24, 20.0)
    mesh = Mesh(*tube(points, 3.0, 8))
    points[3, 2] = 100.0
    curves = Curves((points,), ("unknot",), (True,), 3.0)
    assert check_clearance(mesh, curves, 0.4).status != "skipped"
    monkeypatch.setattr(strand_pairs_module, "MOST_MOVES", 10_000)
    check = check_clearance(mesh, curves, 0.4)
    assert check.status == "skipped" and check.required and "side by side" in check.detail


def test_neighbours_along_a_strand_meet_and_others_do_not() -> None:
    samples = sample_curves([circle(100, 10.0)], 0.5)
    assert not strand_pairs(samples, 15.0, np.inf).facing.any()
    pairs = strand_pairs(samples, 15.0, 8.0)
    along = np.abs(samples.arc[pairs.i] - samples.arc[pairs.j])
    assert len(along) and np.minimum(along, samples.lengths[0] - along).min() >= 8.0
    two = sample_curves([hairpin(2.0)], 0.5)
    legs = strand_pairs(two, 4.5, np.inf)
    x = two.point[legs.i[legs.facing], 0]
    assert x.min() < 2 and 18 < x.max() < 22
