"""Overlap of masks, depth ratio and legibility, on shapes whose numbers are known."""

from __future__ import annotations

from fractions import Fraction
from math import ceil, floor
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tables import some
from validator_parts import PlainView, circle, tangle, tube

from knotfab_validators.shadows.compare import depth_ratio, legibility, overlap, see_aside
from knotfab_validators.shadows.frame import (
    MISSING,
    SPILL,
    padded_mask,
    working_frame,
    write_compare,
    write_shadow,
)
from knotfab_validators.shadows.naming import (
    GAINS,
    MARGIN,
    SIDE,
    fit_picture,
    name_piece,
    read_foreign,
    shrink_to_box,
)
from knotfab_validators.shadows.render import SilhouetteRenderer, why_no_rendering
from knotfab_validators.shadows.view import view_geometry


def test_overlap_by_hand() -> None:
    a, b = np.zeros((2, 10, 10), dtype=bool)
    a[:, :4] = True  # 40
    b[:, 2:5] = True  # 30, of which 20 are shared
    both = overlap(a, b)
    assert (both.iou, both.precision, both.recall) == (20 / 50, 20 / 40, 20 / 30)
    nothing = np.zeros_like(a)
    assert overlap(nothing, b).iou == 0.0 and overlap(nothing, b).recall == 0.0
    assert overlap(a, nothing).precision == 0.0
    assert overlap(nothing, nothing).iou == 1.0


def test_depth_ratio_is_along_the_views_own_axis() -> None:
    points = np.array([[0.0, 0, 0], [10.0, 20.0, 40.0]])
    assert depth_ratio(points, view_geometry(PlainView(), 8, 8)) == pytest.approx(2.0)
    side = view_geometry(PlainView(azimuth_deg=90.0), 8, 8)
    assert depth_ratio(points, side) == pytest.approx(0.25)


@pytest.mark.skipif(why_no_rendering() is not None, reason="no rendering here")
def test_a_ball_is_read_from_everywhere_and_a_tangle_is_not() -> None:
    g = view_geometry(PlainView(), 400, 400)
    v, u = np.mgrid[:200, :200]
    disc = (u - 99.5) ** 2 + (v - 80.5) ** 2 < 60**2
    t, p = np.mgrid[0:61, 0:60]
    t, p = np.pi * t / 60, 2 * np.pi * p / 60
    ball = 20.0 * np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=-1)
    i, j = (a.ravel() for a in np.mgrid[0:60, 0:60])
    a, b = i * 60 + j, i * 60 + (j + 1) % 60
    faces = np.concatenate([np.stack([a, a + 60, b], -1), np.stack([b, a + 60, b + 60], -1)])
    vertices = ball.reshape(-1, 3) + np.array([5.0, 0.0, 0.0])
    with SilhouetteRenderer(vertices, faces) as renderer:
        seen = legibility(see_aside(renderer, vertices, g), disc)
    assert list(seen) == ["15", "30", "45", "60"]
    assert min(seen.values()) > 0.98
    vertices, faces = tube(tangle(300, 2), 3.0, 16)
    with SilhouetteRenderer(vertices, faces) as renderer:
        target = renderer.render(g)
        tangled = legibility(see_aside(renderer, vertices, g), target)
    assert tangled["15"] < 0.9 and tangled["60"] < tangled["15"]


@pytest.mark.skipif(why_no_rendering() is not None, reason="no rendering here")
def test_a_flat_ring_turned_is_the_ring_squashed() -> None:
    g = view_geometry(PlainView(light_distance_mm=1e5), 1600, 1600)
    vertices, faces = tube(circle(300, 40.0), 2.0, 24)
    with SilhouetteRenderer(vertices, faces) as renderer:
        target = renderer.render(g)
        seen = legibility(see_aside(renderer, vertices, g, angles_deg=(45,)), target)
        c, s = np.cos(np.pi / 4), np.sin(np.pi / 4)
    turned = vertices @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    with SilhouetteRenderer(turned, faces) as renderer:
        squashed = renderer.render(g)

    def crop(mask: np.ndarray) -> np.ndarray:
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        i = rows[0] + ((np.arange(400) + 0.5) / 400 * (np.ptp(rows) + 1)).astype(int)
        j = columns[0] + ((np.arange(400) + 0.5) / 400 * (np.ptp(columns) + 1)).astype(int)
        return mask[np.ix_(i, j)]

    by_hand = overlap(crop(squashed), crop(target)).iou
    assert seen["45"] == pytest.approx(by_hand, abs=0.02)


# The frame on which shadows and pictures are compared.


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(16, 16), (1000, 300), (3000, 4096), (1, 1)])
def test_the_working_frame_keeps_pixel_squares(shape: tuple[int, int]) -> None:
    mask = np.random.default_rng(1).random(shape) < 0.5
    frame = working_frame(shape[1], shape[0])
    assert max(frame.width, frame.height) == 1024
    assert frame.pad_x == round(frame.width / 4) and frame.pad_y == round(frame.height / 4)
    padded = padded_mask(mask, frame)
    assert padded.shape == (frame.padded_height, frame.padded_width)
    inner = padded[
        frame.pad_y : frame.pad_y + frame.height, frame.pad_x : frame.pad_x + frame.width
    ]
    assert padded.sum() == inner.sum()
    for i, j in np.random.default_rng(2).integers(0, inner.shape, (50, 2)):
        down = share(int(i), frame.height, shape[0])
        across = share(int(j), frame.width, shape[1])
        covered = sum(a * b for y, a in down.items() for x, b in across.items() if mask[y, x])
        assert inner[i, j] == (2 * covered >= sum(down.values()) * sum(across.values()))


def share(at: int, wanted: int, pixels: int) -> dict[int, Fraction]:
    """Measure how much of each of so many pixels the one of `wanted` covers, by number."""
    low, high = Fraction(at * pixels, wanted), Fraction((at + 1) * pixels, wanted)
    return {k: min(high, k + 1) - max(low, k) for k in range(floor(low), ceil(high))}


def test_a_picture_of_twice_as_many_pixels_is_not_moved() -> None:
    """A disc in the middle of a picture of 2048 px lay a quarter of a pixel aside on the frame of 1024."""
    v, u = np.mgrid[:2048, :2048] - 1023.5
    inner = padded_mask(np.hypot(u, v) < 700.3, working_frame(2048, 2048))
    for turned in (inner[::-1], inner[:, ::-1], inner.T):
        np.testing.assert_array_equal(turned, inner)


def test_half_a_pixel_counts() -> None:
    """The same on either side: an edge between two working pixels' centres takes neither side's part."""
    mask = np.zeros((2048, 2048), dtype=bool)
    mask[101:801, 501:1801] = True
    inner = padded_mask(mask, working_frame(2048, 2048))[256:-256, 256:-256]
    rows, columns = np.flatnonzero(inner.any(axis=1)), np.flatnonzero(inner.any(axis=0))
    assert (rows[0], rows[-1], columns[0], columns[-1]) == (50, 400, 250, 900)


# The pictures of a verified shadow say what the masks say.


def test_the_shadows_picture_reads_back_as_the_shadow(tmp_path: Path) -> None:
    frame = working_frame(100, 60)
    shape = np.zeros((60, 100), dtype=bool)
    shape[10:40, 20:70] = True
    shadow = padded_mask(shape, frame)
    write_shadow(tmp_path / "shadow.png", shadow, frame)
    back = np.asarray(Image.open(tmp_path / "shadow.png")) < 128
    assert back.shape == (frame.height, frame.width)
    np.testing.assert_array_equal(padded_mask(back, frame), shadow)


@pytest.mark.slow
def test_the_difference_has_its_colours_only_where_there_is_one(tmp_path: Path) -> None:
    frame = working_frame(64, 64)
    target = np.zeros((frame.padded_height, frame.padded_width), dtype=bool)
    target[400:900, 500:1000] = True
    for name, shadow, colours in [
        ("same", target, []),
        ("spill", target | np.roll(target, 60, axis=0), [SPILL]),
        ("missing", target & np.roll(target, 60, axis=0), [MISSING]),
        ("moved", np.roll(target, 60, axis=1), [SPILL, MISSING]),
    ]:
        path = tmp_path / f"{name}.png"
        write_compare(path, target, shadow, frame)
        image = np.asarray(Image.open(path))
        assert image.shape[1] > 2.5 * image.shape[0]
        for colour in (SPILL, MISSING):
            assert (image == colour).all(axis=-1).any() == (colour in colours), (name, colour)


# A piece from aside is named by its picture where that stands out, and by nothing where it is a
# tangle.


V, U = np.mgrid[:200, :160]
CROSS = (np.abs(U - 80) < 14) | (np.abs(V - 70) < 14)
HOUSE = (V > 90) & (np.abs(U - 80) < 60) | (np.abs(U - 80) < V - 10) & (V < 91)


def lattice(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    mask = np.zeros((200, 160), dtype=bool)
    for a, b, c in rng.uniform(-1, 1, (14, 3)):
        mask |= np.abs(a * (U - 80) + b * (V - 100) + 90 * c) < 7 * np.hypot(a, b)
    return mask


@pytest.mark.parametrize("picture", [CROSS, HOUSE])
@pytest.mark.study
def test_the_picture_itself_is_named_first_sheared_too_and_a_lattice_is_not(
    picture: np.ndarray,
) -> None:
    sheared = np.array([np.roll(row, i // 8 - 12) for i, row in enumerate(picture)])
    for seen in (picture, sheared[::2]):
        found = name_piece([seen], picture)
        assert found is not None and found.first and found.z > 3
        assert name_piece([seen], picture) == found  # no luck in it
    tangled = name_piece([lattice(k) for k in range(4)], picture)
    assert tangled is not None and tangled.z < 2.5
    best = name_piece([lattice(0), picture], picture)
    assert best == name_piece([picture], picture)


def test_nothing_to_see_is_not_named() -> None:
    nothing = np.zeros((9, 9), dtype=bool)
    assert name_piece([], CROSS) is name_piece([nothing], CROSS) is None
    assert name_piece([CROSS], nothing) is None


@pytest.mark.parametrize("number", some(range(24), 6))
@pytest.mark.study
def test_signs_are_two_dozen_pictures_none_of_which_is_another(number: int) -> None:
    signs = read_foreign()
    assert signs.shape == (24, SIDE, SIDE)
    fits = np.array([fit_picture(signs[number], sign) for sign in signs])
    assert fits[number] == pytest.approx(1.0)
    others = np.delete(fits, number)
    assert others.max() < 0.9
    assert others.mean() == pytest.approx(GAINS[number], abs=1e-5)


def test_a_box_is_stretched_with_all_that_it_covers() -> None:
    mask = np.zeros((50, 70), dtype=bool)
    mask[11:31, 7:52] = True
    whole = shrink_to_box(mask)
    assert whole is not None
    assert whole.sum() == pytest.approx((SIDE - 2 * MARGIN) ** 2)
    mask[11:21, 7:29] = False
    part = shrink_to_box(mask)
    assert part is not None
    assert part.sum() / whole.sum() == pytest.approx(1 - 10 * 22 / (20 * 45))
