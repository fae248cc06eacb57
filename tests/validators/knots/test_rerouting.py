"""Runs laid elsewhere: fewer crossings, and the same knot."""

from __future__ import annotations

import pytest
from knot_curves import random_markov

from knotfab_validators.knots.invariants import invariants
from knotfab_validators.knots.names import Factor, braid_of, braid_word, known_knot, prime_names
from knotfab_validators.knots.planar_diagram import closed_braid
from knotfab_validators.knots.rerouting import reroute, summands


@pytest.mark.parametrize("name", [*prime_names()[5:80:9], *prime_names()[90::12]])
def test_braids_come_down_to_the_crossings_of_the_table(name: str) -> None:
    diagram = closed_braid(random_markov(list(braid_word(name)), 12, seed=1))
    least = int(name.split("_")[0])
    found = reroute(diagram, enough=least)
    assert len(found.crossings) == least
    assert invariants(found) == invariants(closed_braid(braid_word(name)))


def test_unknots_come_down_to_nothing() -> None:
    for seed in range(4):
        assert not reroute(closed_braid(random_markov([1, -2, 3], 60, seed))).crossings


@pytest.mark.slow
def test_no_diagram_has_fewer_crossings_than_its_knot() -> None:
    assert len(reroute(closed_braid([1] * 11)).crossings) == 11
    assert len(reroute(closed_braid([1, 2] * 7)).crossings) == 14  # T(3,7)


@pytest.mark.slow
def test_sums_fall_into_their_summands_and_prime_diagrams_do_not() -> None:
    knot = known_knot((Factor(3, 1, 1), Factor(4, 1, 0), Factor(5, 2, -1)))
    parts = summands(reroute(closed_braid(braid_of(knot)), enough=12))
    assert sorted(len(part.crossings) for part in parts) == [3, 4, 5]
    product = invariants(parts[0]) * invariants(parts[1]) * invariants(parts[2])
    assert product == knot.invariants
    (alone,) = summands(reroute(closed_braid(braid_word("10_123"))))
    assert len(alone.crossings) == 10
