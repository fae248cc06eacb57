"""The project's own test pictures: the same every time, with the features they are drawn for."""

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

import examples.pictures
from examples.pictures import pictures


@pytest.fixture(scope="module")
def images() -> dict[str, Image.Image]:
    return pictures()


def pieces_and_holes(image: Image.Image) -> tuple[int, int]:
    """Pieces and holes of the ink, without single pixels."""
    ink = np.asarray(image) < 128
    pieces, _ = ndimage.label(ink, np.ones((3, 3)))
    grounds, _ = ndimage.label(np.pad(~ink, 1, constant_values=True))
    counts = [int((np.bincount(label.ravel())[1:] > 9).sum()) for label in (pieces, grounds)]
    return counts[0], counts[1] - 1


@pytest.mark.slow
def test_there_are_enough_and_they_are_black_on_white(images: dict[str, Image.Image]) -> None:
    assert len(images) >= 16
    for name, image in images.items():
        assert image.mode == "L" and max(image.size) == 1024, name
        pixels = np.asarray(image)
        border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        assert (border == 255).all(), f"{name} is cut off"
        assert 0.04 < (pixels < 128).mean() < 0.75, name
        assert ((pixels < 16) | (pixels > 239)).mean() > 0.9, name
    assert len({image.size for image in images.values()}) >= 6


@pytest.mark.parametrize(
    ("name", "pieces", "holes"),
    [
        ("knight", 1, 3), ("smiley", 4, 1), ("face", 1, 3), ("heart", 1, 0), ("plane", 1, 0),
        ("anchor", 1, 1), ("notes", 1, 0), ("r", 1, 1), ("eight", 1, 2), ("ampersand", 1, 1),
        ("cat", 1, 0), ("bird", 1, 0), ("wheel", 1, 7), ("pieces", 3, 0), ("spiral", 1, 0),
        ("stickman", 1, 0), ("teapot", 1, 1),
    ],
)  # fmt: skip
def test_pieces_and_holes(
    images: dict[str, Image.Image], name: str, pieces: int, holes: int
) -> None:
    assert pieces_and_holes(images[name]) == (pieces, holes)


def test_bicycle_and_tree_have_thin_parts(images: dict[str, Image.Image]) -> None:
    pieces, holes = pieces_and_holes(images["bicycle"])
    assert pieces == 1 and holes >= 6
    for name in ("bicycle", "tree"):
        ink = np.asarray(images[name]) < 128
        reach = ndimage.distance_transform_edt(ink)
        opened = ndimage.distance_transform_edt(reach < 16) < 16
        assert (ink & opened).sum() < 0.6 * ink.sum(), name


@pytest.mark.slow
def test_pictures_are_the_same_every_time(images: dict[str, Image.Image]) -> None:
    again = {"tree": examples.pictures._tree(), "cat": examples.pictures._cat()}
    for name, image in again.items():
        assert image.tobytes() == images[name].tobytes(), name
