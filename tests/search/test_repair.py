"""Repairs of single stretches: what violates a limit is mended, and the rest of the curve stays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from knotfab.search.feasibility import standing
from numpy.typing import NDArray
from torch import Tensor

from knotfab.effects.base import Limits
from knotfab.geometry.neighbours import Neighbours
from knotfab.geometry.polylines import Rings, rings_of_sizes
from knotfab.problem import Account
from knotfab.scene.model import Region
from knotfab.search.repair import about, mended

Array = NDArray[np.float64]

COUNT = 240
RINGS = rings_of_sizes((COUNT,))
EDGE = 2 * np.pi * 30 / COUNT


def limits(side: float = 100.0) -> Limits:
    return Limits(3.0, 0.4, 3.2, 1e4, Region(size_mm=(side, side, side)))


def ring(kink_mm: float) -> Array:
    """A circle of 30 mm radius with one vertex pushed outwards."""
    t = 2 * np.pi * np.arange(COUNT) / COUNT
    points = np.column_stack([30 * np.cos(t), 30 * np.sin(t), np.zeros(COUNT)])
    points[0, 0] += kink_mm
    return points


def stiffness(points: Tensor, near: Neighbours, progress: float) -> Tensor:
    """Smooths a kink, and shrinks a circle if it is let."""
    bent = points.roll(-1, 0) - 2 * points + points.roll(1, 0)
    return (bent**2).sum()


def stiffly(_: Rings) -> Callable[[Tensor, Neighbours, float], Tensor]:
    return stiffness


def account() -> Account:
    return Account(template="a circle", types=("unknot",))


def test_a_kink_is_mended_and_the_far_side_stays() -> None:
    start, entered = ring(0.6), account()
    assert standing(start, RINGS, limits()).broken == ["bend"]
    end, rings, rounds = mended(start, RINGS, stiffly, limits(), EDGE, entered, "cpu", 8)
    assert standing(end, rings, limits()).violations == []
    assert 1 <= rounds <= 8
    assert entered.accepted > 0 and entered.certified
    moved = np.linalg.norm(end - start, axis=1)
    assert moved[[-1, 0, 1]].max() > 0.1
    assert moved[60:180].max() < 0.005  # more than 30 mm from the kink


def test_what_holds_every_limit_is_left_alone() -> None:
    start, entered = ring(0.0), account()
    end, _, rounds = mended(start, RINGS, stiffly, limits(), EDGE, entered, "cpu", 8)
    assert rounds == 0 and entered.accepted == 0
    assert np.array_equal(end, start)


def test_a_stretched_edge_is_cut_before_its_bends_are_judged() -> None:
    """Long edges may turn far by the bend radius, and their mitres stood out of the outline by 0.6 px."""
    start = ring(0.0)[np.r_[0:COUNT:2][:4].tolist() + list(range(7, COUNT))]
    rings = rings_of_sizes((len(start),))
    assert standing(start, rings, limits()).violations == []
    end, rings, _ = mended(start, rings, stiffly, limits(), EDGE, account(), "cpu", 4)
    assert len(end) > len(start) and rings.sizes == (len(end),)
    edges = np.linalg.norm(end[rings.next] - end, axis=1)
    assert edges.max() < 1.31 * EDGE
    assert standing(end, rings, limits()).violations == []


def test_what_the_rounds_do_not_mend_is_returned_as_it_stands() -> None:
    def nothing(points: Tensor, near: Neighbours, progress: float) -> Tensor:
        return torch.zeros((), dtype=torch.float64) * points.sum()

    end, rings, rounds = mended(
        ring(0.6), RINGS, lambda _: nothing, limits(), EDGE, account(), "cpu", 2
    )
    assert rounds == 2
    assert standing(end, rings, limits()).violations


def test_the_stretches_are_those_about_the_violations() -> None:
    kinked = ring(0.6)
    loose = about(kinked, RINGS, standing(kinked, RINGS, limits()))
    apart = np.linalg.norm(kinked - kinked[0], axis=1)
    assert loose[apart < 11.0].all() and not loose[apart > 14.0].any()
    # a region that the ring pokes out of at four places: the furthest alone is let go, for now
    outside = standing(ring(0.0), RINGS, limits(side=65.9))
    assert outside.broken == ["region"]
    loose = about(ring(0.0), RINGS, outside)
    assert 0 < loose.sum() < COUNT / 4
    long = Limits(3.0, 0.4, 3.2, 10.0, Region(size_mm=(100.0, 100.0, 100.0)))
    assert standing(ring(0.0), RINGS, long).broken == ["length"]
    assert not about(ring(0.0), RINGS, standing(ring(0.0), RINGS, long)).any()
