"""Overlap of masks, depth ratio and legibility, on shapes whose numbers are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from validator_parts import PlainView, circle, tangle, tube

from knotfab.picture.read import read_target
from knotfab.start.tone import read_darkness
from knotfab_formats.views import Reading
from knotfab_validators.files.picture import read_greys
from knotfab_validators.shadows.compare import (
    check_tone,
    depth_ratio,
    legibility,
    measure_tone,
    overlap,
    see_aside,
)
from knotfab_validators.shadows.frame import padded_mask, working_frame
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


# Greys of a shadow against those of its picture.


RADIUS, CLEARANCE = 4.0, 0.5  # px; radii
PITCH = round(RADIUS * (2 + CLEARANCE))  # strands as near as they may be


def strands(darkness: float) -> np.ndarray:
    """(400, 400) parallel strands whose distance gives an even grey."""
    place = np.arange(400) % (PITCH / darkness)
    return np.tile(place < 2 * RADIUS, (400, 1))


@pytest.mark.parametrize("grey", [0.3, 0.6, 1.0])
def test_strands_at_the_right_distance_have_no_error(grey: float) -> None:
    frame = working_frame(400, 400, 400)
    asked = np.full((400, 400), grey)
    found = measure_tone(padded_mask(strands(grey), frame), asked, frame, RADIUS, CLEARANCE)
    assert found.densest == pytest.approx(0.8)
    assert found.error < 0.05
    other = padded_mask(strands(min(1.0, grey + 0.3)), frame)
    wrong = measure_tone(other, asked, frame, RADIUS, CLEARANCE).error
    assert wrong > 0.2 or grey == 1.0


def test_two_halves_are_told_apart_and_an_even_grey_fails() -> None:
    frame = working_frame(400, 400, 400)
    asked = np.full((400, 400), 0.2)
    asked[:200] = 0.9
    right = np.where(np.arange(400)[:, None] < 200, strands(0.9), strands(0.2))
    good = measure_tone(padded_mask(right, frame), asked, frame, RADIUS, CLEARANCE)
    even = measure_tone(padded_mask(strands(0.55), frame), asked, frame, RADIUS, CLEARANCE)
    turned = measure_tone(padded_mask(right[::-1], frame), asked, frame, RADIUS, CLEARANCE)
    assert good.error < 0.3 * good.flat < 0.5 * even.error < turned.error
    assert even.error == pytest.approx(even.flat, rel=0.1)
    assert check_tone({"front": good}).status == "pass"
    for bad in (even, turned):
        found = check_tone({"front": good, "side": bad})
        assert found.status == "fail" and found.required and "view side" in found.detail


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "I;16"])
@pytest.mark.parametrize("invert", [False, True])
def test_both_readers_see_the_same_greys(mode: str, invert: bool, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    y, x = np.mgrid[0:40, 0:60] / 60
    levels = np.clip(255 * np.stack([x, y, x * y, 0.4 + x], axis=-1) + rng.normal(0, 9, 4), 0, 255)
    if mode == "I;16":
        image = Image.fromarray((levels[..., 0] * 257).astype(np.uint16))
    else:
        image = Image.fromarray(levels.astype(np.uint8), "RGBA").convert(mode)
    path = tmp_path / "greys.png"
    image.save(path)
    mine = read_darkness(read_target(path), invert)
    theirs = read_greys(path, Reading(invert=invert))
    assert np.abs(mine - theirs).max() < 0.012
    assert mine.min() == 0.0 and mine.max() == 1.0
