"""Members: how they meet their tubes, and what is in their way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rings import RADIUS, knots, one, ring

from knotfab.hold.struts import ROOT_SHARE, Obstacles, join, nothing, sites_of, struts


def test_clear_by_exactly_the_clearance() -> None:
    straight = np.column_stack([np.linspace(-60, 60, 121), np.zeros(121), np.zeros(121)])
    back = straight[::-1] + [0.0, 60.0, 0.0]
    own = knots(np.concatenate([straight, back]), ring(8.0, 400.0))
    obstacles = Obstacles(own, sites_of(own), 0.4)
    far = replace(one([-5, 0, 0], [5, 0, 0], 1.0), first=np.array([len(obstacles.sites.knot) - 1]))
    far = replace(far, second=far.first)
    gap = RADIUS + 1.0 + 0.4 + obstacles.slack
    for off, free in ((gap * 1.001, True), (gap * 0.999, False)):
        shift = np.array([[0.0, 0.0, off]])
        moved = replace(far, start=far.start + shift, end=far.end + shift)
        assert obstacles.clear(moved)[0] == free
    # a post's foot is wider
    root = RADIUS + ROOT_SHARE * 1.0 + 0.4 + obstacles.slack
    for off, free in ((root * 1.001, True), (root * 0.999, False)):
        post = one([0.2, -30, off], [0.2, -off, 0], 1.0, ground=True)  # a sample's x
        post = replace(post, first=far.first)
        assert obstacles.clear(post)[0] == free
    # and members keep clear of each other, but for one that is named
    obstacles.add(replace(far, start=far.start + [0, 0, 50], end=far.end + [0, 0, 50]))
    for off, free in ((2.4 * 1.001, True), (2.4 * 0.999, False)):
        shift = np.array([[0.0, 0.0, 50 + off]])
        beside = replace(far, start=far.start + shift, end=far.end + shift)
        assert obstacles.clear(beside)[0] == free
        assert obstacles.clear(beside, but=0)[0]


def test_a_strand_that_runs_along_its_own_strut_is_in_the_way() -> None:
    """A strand with 0.2 mm of air where 0.4 are wanted once passed as a part of the joint."""

    def arc(x: float, y: float, start: float, end: float) -> np.ndarray:
        t = np.linspace(start, end, 20)[1:]
        return np.column_stack([x + 2.2 * np.cos(t), y + 2.2 * np.sin(t)])

    right = np.pi / 2
    beside = np.concatenate([arc(1.0, 2.2, -right, 0.0), arc(5.4, 2.7, 2 * right, right)])
    for way, free in ((beside, False), (np.array([[20.0, 0.0], [60.0, 0.0]]), True)):
        corners = np.concatenate([[[-60.0, 0.0], [0.0, 0.0]], way, [[80.0, 4.9], [80.0, -60.0]]])
        corners = np.concatenate([corners, [[-60.0, -60.0]]])
        steps = np.linalg.norm(np.diff(corners, axis=0, append=corners[:1]), axis=1)
        at = np.concatenate([[0.0], np.cumsum(steps)])
        closed = np.concatenate([corners, corners[:1]])
        even = np.arange(0.0, at[-1], 0.25)
        line = np.column_stack([np.interp(even, at, closed[:, k]) for k in (0, 1)])
        own = knots(np.column_stack([line, np.zeros(len(line))]), ring(8.0, 400.0))
        sites = sites_of(own, also={0: np.array([240])})
        joint = int(np.flatnonzero((sites.knot == 0) & (sites.vertex == 240))[0])
        far = len(sites.knot) - 1
        assert sites.point[joint] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
        strut = replace(
            one([0, 0, 0], [0, 40, 0], 1.0), first=np.array([joint]), second=np.array([far])
        )
        assert Obstacles(own, sites, 0.4).clear(strut)[0] == free


def test_struts_meet_their_tubes_squarely() -> None:
    own = knots(ring(50.0, wave=0.0), ring(30.0, wave=0.0))
    sites = sites_of(own)
    n = len(sites.knot)
    pairs = np.column_stack([np.repeat(np.arange(n), n), np.tile(np.arange(n), n)])
    found = struts(sites, pairs, RADIUS, 1.5)
    along = (found.end - found.start) / found.length_mm[:, None]
    for end in (found.first, found.second):
        cosine = np.abs((along * sites.tangent[end]).sum(axis=1))
        assert len(cosine) and cosine.max() <= np.sqrt(1 - 0.65**2) + 1e-12
    assert found.length_mm.min() >= 2.5 * RADIUS and (found.radius == 1.5).all()


def test_members_can_be_thickened_and_joined() -> None:
    two = join([nothing(), one([0, 0, 0], [3, 4, 0], 1.0), one([0, 0, 0], [0, 0, 2], 1.9)])
    assert two.length_mm == pytest.approx([5.0, 2.0])
    assert two.thicken(1.2, 1.95).radius == pytest.approx([1.2, 1.95])
    assert two.thicken(1.2, 1.5).radius == pytest.approx([1.2, 1.9])  # never thinner
    assert two.with_radius(0, 1.7).radius == pytest.approx([1.7, 1.9])
