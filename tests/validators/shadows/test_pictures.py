"""The pictures of a verified shadow say what the masks say."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from knotfab_validators.files.picture import read_silhouette
from knotfab_validators.shadows.frame import padded_mask, working_frame
from knotfab_validators.shadows.pictures import MISSING, SPILL, write_compare, write_shadow


def test_the_shadows_picture_reads_back_as_the_shadow(tmp_path: Path) -> None:
    frame = working_frame(100, 60)
    shape = np.zeros((60, 100), dtype=bool)
    shape[10:40, 20:70] = True
    shadow = padded_mask(shape, frame)
    write_shadow(tmp_path / "shadow.png", shadow, frame)
    back = read_silhouette(tmp_path / "shadow.png")
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
