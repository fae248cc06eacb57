"""What members darken, and what hides them."""

import numpy as np
import pytest
from rings import EMPTY, camera, knots, one, ring

from knotfab.mount.shade import MountShadow


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
