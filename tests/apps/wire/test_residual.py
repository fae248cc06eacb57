"""The residuals of a wire's shadow beside a picture: an area, with the slopes of finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from knotfab.apps.wire.arcs import round_corners
from knotfab.apps.wire.fit import fit_wires
from knotfab.apps.wire.residual import FitLimits, GridLikeness
from knotfab.base.arrays import Array
from knotfab_formats.scene import ResolvedView
from knotfab_validators.shadows.tube_field import tube_field
from knotfab_validators.shadows.view import ViewGeometry, view_geometry

SQUARE = np.array([[-20.0, -20, 0], [20, -20, 4], [20, 20, 0], [-20, 20, -4]])


def look(azimuth_deg: float = 0.0) -> ViewGeometry:
    view = ResolvedView(frame_width_mm=60.0, frame_height_mm=60.0, light_distance_mm=400.0,
                        wall_distance_mm=40.0, azimuth_deg=azimuth_deg)  # fmt: skip
    return view_geometry(view, 300, 300)


def picture_of(curve: Array, geometry: ViewGeometry) -> GridLikeness:
    return GridLikeness.of(geometry, tube_field([curve], 1.0, geometry).mask, 1.0)


def bent(corners: Array) -> Array:
    """The wire's centre line, finely."""
    wire = round_corners(corners, 2.0)
    arcs = np.linspace(0.0, 1.0, 9)[:, None] * wire.turn
    inner = wire.entry + wire.radius * (
        np.sin(arcs)[..., None] * wire.before + (1 - np.cos(arcs))[..., None] * wire.inward
    )
    return np.asarray(inner.transpose(1, 0, 2).reshape(-1, 3))


def test_the_sum_of_squares_is_what_differs_in_squared_radii() -> None:
    geometry = look()
    picture = picture_of(bent(SQUARE), geometry)
    own, moved = (
        (picture.residual([round_corners(SQUARE + [shift, 0, 0], 2.0)], False)[0] ** 2).sum()
        for shift in (0.0, 1.0)
    )
    # two sides of 38 radii leave a strip of one radius and draw another; edges that fade make it less
    area = 2 * 2 * 38
    assert own < 20 and 0.6 * area < moved < area


@pytest.mark.parametrize("azimuth", [0.0, 50.0])
def test_slopes_are_those_of_finite_differences(azimuth: float) -> None:
    picture = picture_of(bent(SQUARE + [0.4, -0.3, 0]), look(azimuth))
    second = SQUARE[::-1] * 0.5
    residual, blocks = picture.residual([round_corners(c, 2.0) for c in (SQUARE, second)], True)
    slope = 2 * sparse.hstack(blocks).T @ residual
    both = np.concatenate([SQUARE, second])
    for number in (0, 5, 10, 14, 21):
        values = []
        for sign in (1, -1):
            moved = both.ravel() + sign * 1e-3 * (np.arange(24) == number)
            one, two = moved.reshape(2, 4, 3)
            wires = [round_corners(one, 2.0), round_corners(two, 2.0)]
            values.append((picture.residual(wires, False)[0] ** 2).sum())
        found = (values[0] - values[1]) / 2e-3
        assert slope[number] == pytest.approx(found, rel=0.05, abs=0.02 * np.abs(slope).max())


@pytest.mark.slow
def test_a_wire_moves_to_where_it_draws_its_picture() -> None:
    t = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    ring = np.column_stack([12 * np.cos(t), 12 * np.sin(t), 3 * np.sin(2 * t)])
    geometry = look()
    # the picture's ring is 0.4 mm larger than the one that is followed
    picture = picture_of(1.033 * ring, geometry)
    limits = FitLimits(2.0, 2.0, 160.0, 2.0, 0.9)
    plain, shown = (fit_wires([ring], geometry.light, limits, pictures=p) for p in ((), (picture,)))
    before, after = ((picture.residual(w, False)[0] ** 2).sum() for w in (plain, shown))
    assert after < 0.95 * before
    assert len(shown[0].corners) <= len(plain[0].corners)
