"""What members darken, and what hides them."""

import numpy as np
import pytest
from pieces import EMPTY, RADIUS, camera, knots, one, ring

from knotfab.hold.shade import MountShadow, free_rays


def test_shade_measures_what_shows() -> None:
    """A strip across the empty frame; nothing below it; nothing where the picture is dark."""
    view = camera()
    shade = MountShadow(knots(ring(5.0, wave=0.0) + [0.0, 60.0, 0.0]), view, EMPTY)
    post = one([10, 30, 0], [10, -70, 0], 2.0)
    pixel = 180 / 1024
    exact = (2 * 2.0 * 1.2 / pixel) * (100 * 1.2 / pixel)
    assert shade.cost(post)[0] == pytest.approx(exact, rel=0.02)
    round_ends = np.pi * (2.0 * 1.2 / pixel) ** 2
    assert shade.darken(post) * 1024**2 == pytest.approx(exact + round_ends, rel=0.015)
    assert shade.cost(one([10, -80, 0], [10, -120, 0], 2.0))[0] == 0.0
    assert not shade.hidden(post)[0]
    shade.add(post)
    assert shade.cost(post)[0] < 0.01 * exact
    full = MountShadow(knots(ring(5.0, wave=0.0)), view, ~EMPTY)
    assert full.hidden(post)[0] and full.cost(post)[0] == 0 and full.darken(post) == 0
    # a strip that is hidden to a pixel
    half = np.zeros((90, 90), dtype=bool)
    half[:, :45] = True  # the left of the frame
    shade = MountShadow(knots(ring(5.0, wave=0.0) + [0.0, 60.0, 0.0]), view, half)
    for x, hidden in ((-2.0 - 2 * pixel, True), (-2.0 + pixel, False)):
        assert shade.hidden(one([x, 30, 0], [x, -40, 0], 2.0))[0] == hidden


def test_beside_a_screen_that_ends_a_member_shows_nothing() -> None:
    aside = one([110, 30, 0], [110, 60, 0], 2.0)
    for ends in (False, True):
        shade = MountShadow(knots(ring(5.0, wave=0.0)), camera(), EMPTY, ends)
        assert (shade.cost(aside)[0] == 0.0) == ends
        assert shade.cost(one([10, 30, 0], [10, 60, 0], 2.0))[0] > 0


def test_what_is_behind_the_knots_draws_nothing() -> None:
    """A thin bar along the rays behind a strand, and moved out of its shadow into a dark picture."""
    strand = np.column_stack([np.full(121, 10.0), np.linspace(30, -30, 121), np.zeros(121)])
    shade = MountShadow(
        knots(np.concatenate([strand, strand[::-1] + [60.0, 0.0, 0.0]])), camera(), ~EMPTY
    )
    seen = 520.0 / 500.0  # from z = 0 to z = -20, from the light
    for aside, behind in ((0.0, True), (0.5, True), (1.5, False), (-1.5, False)):
        x = (10.0 + aside) * seen
        bar = one([x, 25 * seen, -20], [x, -25 * seen, -20], 1.0)
        assert shade.hidden(bar)[0]
        assert shade.behind_knots(bar)[0] == behind


# Light rays for pegs: they end on the wall, and are free where nothing else is near.


ONE = knots(ring(50.0))


TWO = knots(ring(50.0), ring(25.0, 10.0))


def to_segments(points: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """(n,) distance of points from a closed polyline, by brute force."""
    start, edge = curve, np.roll(curve, -1, axis=0) - curve
    offset = points[:, None] - start[None]
    t = np.clip((offset * edge).sum(2) / (edge * edge).sum(1), 0, 1)
    return np.linalg.norm(offset - t[..., None] * edge, axis=2).min(axis=1)


@pytest.mark.parametrize("tilt", [0.0, 20.0])
def test_rays_end_on_the_wall_and_come_from_the_light(tilt: float) -> None:
    view = camera(wall_tilt_deg=tilt)
    rays = free_rays(TWO, view, 0.9, 0.4)
    assert rays.free.any()
    height = rays.foot @ view.receiver[:3] + view.receiver[3]
    assert np.abs(height).max() < 1e-9
    one, other = rays.top - view.eye, rays.foot - view.eye
    assert np.linalg.norm(np.cross(one, other), axis=1).max() < 1e-6 * 500 * 600
    assert (rays.length_mm > 0).all()


def test_free_means_that_no_other_strand_is_near_the_peg() -> None:
    """Points all along each free peg keep their distance from the other knot, by brute force."""
    view, share, gap = camera(), 0.9, 0.4
    near, far = ring(50.0, 30.0, wave=0.0), ring(50.5, -20.0, wave=12.0)
    far = far[:, [1, 0, 2]]
    piece = knots(near, far)
    rays = free_rays(piece, view, share, gap)
    assert rays.free[rays.knot == 0].any() and not rays.free[rays.knot == 0].all()
    along = np.linspace(0, 1, 120)[:, None]
    for ray in np.flatnonzero(rays.knot == 0)[::5]:
        line = rays.top[ray] + along * (rays.foot[ray] - rays.top[ray])
        spread = np.linalg.norm(line - view.eye, axis=1) / np.linalg.norm(rays.top[ray] - view.eye)
        clear = to_segments(line, far) - RADIUS - share * RADIUS * spread
        if rays.free[ray]:
            assert clear.min() >= gap - 1e-6
        elif clear.min() > gap + 0.3:  # sampling may cost a little, no more
            sine = np.linalg.norm(
                np.cross(rays.tangent[ray], rays.foot[ray] - rays.top[ray]) / rays.length_mm[ray]
            )
            own = to_segments(line[30:], near) - RADIUS - share * RADIUS * spread[30:]
            assert sine < 0.6 or own.min() < gap + 0.3


@pytest.mark.parametrize(("opening", "free"), [(0.8, True), (0.4, False)])
def test_a_strand_must_leave_its_own_peg_at_once(opening: float, free: bool) -> None:
    """A wheel's strand crept away from its peg within the joint: a gap that the printer would close."""
    view = camera()
    fall = np.array([opening, 0.0, -np.sqrt(1 - opening**2)])
    bend = np.array([1.9 * RADIUS, 0.0, 0.0])  # from here on it runs along with the peg
    corners = [-20 * RADIUS * np.array([1.0, 0, 0]), bend, bend + 6 * RADIUS * fall]
    corners += [
        np.array([40.0, 0.0, 0.0]),
        np.array([40.0, 0.0, 60.0]),
        np.array([-40.0, 0.0, 60.0]),
    ]
    closed = np.array([*corners, corners[0]])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.union1d(np.arange(0.0, arc[-1], 0.5), arc[:-1])
    curve = np.column_stack([np.interp(at, arc, closed[:, k]) for k in range(3)])
    rays = free_rays(knots(curve), view, 0.9, 0.4)
    middle = int(np.linalg.norm(rays.top, axis=1).argmin())
    assert np.linalg.norm(rays.top[middle]) < 0.3 and rays.free[middle] == free


def test_a_peg_thicker_than_the_shadow_is_refused() -> None:
    view = camera()
    for share in (0.0, 1.01, float("nan")):
        with pytest.raises(ValueError, match="does not hide"):
            free_rays(ONE, view, share, 0.4)
