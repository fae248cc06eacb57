"""Each reading of a picture that may be meant in several ways is another silhouette, as its options say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from knotfab.design.readings import MOST, draw_readings, is_unclear, try_readings
from knotfab.picture.read import read_target
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.prepare import list_readings, survey_pictures
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene


@pytest.mark.slow
def test_each_reading_is_another_and_is_what_its_options_say(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    image = Image.fromarray(rng.integers(90, 200, (150, 200, 3)).astype(np.uint8))
    ImageDraw.Draw(image).ellipse((50, 30, 150, 120), fill=(20, 20, 40))
    path = tmp_path / "photo.png"
    image.save(path)
    found = try_readings(path, resolve(Scene()))
    assert 1 <= len(found) <= MOST and found[0].refusal is None
    assert len({one.options for one in found}) == len(found)
    for one in found:
        view = Scene().views[0].model_copy(update=one.keys)
        assert (read_target(path, view, glance=True).mask == one.target.mask).all()
    assert draw_readings(found).startswith(b"\x89PNG") and found[0].thumbnail()[:4] == b"\x89PNG"
    best = found[0].keys
    asked = BuildOptions(
        ink=best.get("ink"),
        specks=best.get("speck_px"),
        smooth=best.get("smooth_px"),
        keep_largest=best.get("keep_largest"),
    )
    assert survey_pictures([str(path)], asked).refusal is None
    assert list_readings([str(path), str(path)], BuildOptions()) == ()


@pytest.mark.slow
def test_a_drawing_of_lines_is_offered_without_its_dust(tmp_path: Path) -> None:
    """No usual tube draws thin lines: those of which most can be drawn along them are no worse for that."""
    image = Image.new("L", (800, 600), 255)
    pen = ImageDraw.Draw(image)
    pen.arc((200, 100, 600, 500), 0, 360, fill=100, width=4)
    pen.arc((300, 250, 500, 430), 20, 160, fill=100, width=4)
    for x, y in np.random.default_rng(1).integers(0, 590, (40, 2)):
        pen.rectangle((x, y, x + 1, y + 1), fill=110)
    image.save(tmp_path / "scan.png")
    found = try_readings(tmp_path / "scan.png", resolve(Scene()))
    # the shape that stands out, without dust
    assert any(set(one.keys) == {"speck_px"} for one in found)
    assert not any(one.keys == {} for one in found)


def test_a_guess_from_a_border_of_two_colours_may_be_meant_otherwise(tmp_path: Path) -> None:
    image = Image.new("RGB", (300, 200), (200, 200, 200))
    pen = ImageDraw.Draw(image)
    pen.rectangle((0, 0, 149, 199), fill=(90, 140, 200))
    pen.ellipse((90, 40, 210, 160), fill=(20, 20, 20))
    image.save(tmp_path / "flag.png")
    assert is_unclear(survey_pictures([str(tmp_path / "flag.png")], BuildOptions()))
    asked = BuildOptions(ink="flood")
    assert not is_unclear(survey_pictures([str(tmp_path / "flag.png")], asked))
