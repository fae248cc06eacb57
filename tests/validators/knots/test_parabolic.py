"""Representations in PSL(2, p): known values, and what they tell apart."""

from __future__ import annotations

from itertools import combinations

import pytest
from knot_curves import random_markov

from knotfab_validators.knots.names import Factor, braid_of, braid_word, candidates, known_knot
from knotfab_validators.knots.planar_diagram import PlanarDiagram, closed_braid
from knotfab_validators.knots.projection import PRIMES, cusp_counts
from knotfab_validators.knots.rerouting import reroute


def diagram_of(name: str) -> PlanarDiagram:
    return reroute(closed_braid(braid_word(name)), enough=10)


def test_the_trefoils_longitude_is_its_meridian_to_minus_six() -> None:
    """This holds beside the one representation that commutes, where it is central but for its meridians."""
    for prime in PRIMES:
        found = cusp_counts(diagram_of("3_1"), prime)
        assert found is not None and found[0] == 1
        assert {k for k, n in enumerate(found) if n and k} == {6}


@pytest.mark.parametrize("name", ["4_1", "8_16", "9_35", "10_103"])
def test_counts_depend_on_the_knot_and_turn_in_a_mirror(name: str) -> None:
    tangled = reroute(closed_braid(random_markov(list(braid_word(name)), 30, seed=2)), enough=11)
    for prime in PRIMES:
        one = cusp_counts(diagram_of(name), prime)
        assert one is not None and one == cusp_counts(tangled, prime)
        assert cusp_counts(diagram_of(name).mirror(), prime) == (one[0], *one[:0:-1])


@pytest.mark.parametrize(
    "name", ["8_8", "8_16", "10_25", "10_40", "4_1#5_2", "10_48", "10_71", "10_91", "10_104"]
)
def test_what_all_other_invariants_take_for_one_is_told_apart(name: str) -> None:
    numbers = [tuple(map(int, factor.split("_"))) for factor in name.split("#")]
    factors = tuple(Factor(n, k, 0 if (n, k) == (4, 1) else 1) for n, k in numbers)
    knots = [k for k in candidates(known_knot(factors).invariants) if k.crossings <= 10]
    assert len(knots) == 2
    counts = [
        [cusp_counts(reroute(closed_braid(braid_of(knot)), enough=10), p) for p in PRIMES]
        for knot in knots
    ]
    assert all(one != other for one, other in combinations(counts, 2))
