"""Light rays for pegs: they end on the wall, and are free where nothing else is near."""

import numpy as np
import pytest
from rings import RADIUS, camera, knots, ring

from knotfab.mount.rays import free_rays

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
