"""Each reading of a picture that may be meant in several ways is another silhouette, as its options say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from knotfab.options import BuildOptions
from knotfab.picture.read import read_target
from knotfab.prepare import list_readings, survey_pictures
from knotfab.preview.readings import MOST, draw_readings, try_readings
from knotfab_formats.scene import Scene


@pytest.mark.slow
def test_each_reading_is_another_and_is_what_its_options_say(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    image = Image.fromarray(rng.integers(90, 200, (150, 200, 3)).astype(np.uint8))
    ImageDraw.Draw(image).ellipse((50, 30, 150, 120), fill=(20, 20, 40))
    path = tmp_path / "photo.png"
    image.save(path)
    found = try_readings(path, Scene())
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
