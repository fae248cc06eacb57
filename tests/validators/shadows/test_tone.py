"""Greys of a shadow against those of its picture."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from knotfab.picture.greys import read_darkness
from knotfab.picture.read import read_target
from knotfab_formats.scene import Reading
from knotfab_validators.files.picture import read_greys
from knotfab_validators.shadows.frame import padded_mask, working_frame
from knotfab_validators.shadows.tone import check_tone, measure_tone

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
