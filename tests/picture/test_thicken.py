"""Widened strokes are as wide as asked along their lines, and what is thick stays as it is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw
from scipy import ndimage

from knotfab.base.arrays import Mask
from knotfab.design.frames import widen_targets
from knotfab.picture.read import Target
from knotfab.picture.thicken import is_thin, thicken
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene, View
from knotfab_validators.files.strokes import widen_strokes


def drawn(*points: tuple[int, int], width: int, body: bool = False) -> Mask:
    """A line, and a thick square beside it."""
    image = Image.new("1", (200, 160))
    draw = ImageDraw.Draw(image)
    draw.line(points, fill=1, width=width, joint="curve")
    if body:
        draw.rectangle((130, 40, 180, 120), fill=1)
    return np.asarray(image).copy()


def disc_fits(mask: Mask, radius: float) -> Mask:
    """The opening by a disc."""
    inside = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] > radius
    return np.asarray(ndimage.distance_transform_edt(~inside) <= radius)


LINES = {
    "level": ((20, 80), (110, 80)),
    "steep": ((20, 20), (60, 140)),
    "bent": ((20, 130), (60, 30), (110, 120)),
}


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("width", [1, 2, 3, 5])
def test_strokes_become_as_wide_as_asked(name: str, width: int) -> None:
    thin, wanted = drawn(*LINES[name], width=width), 12
    wide = thicken(thin, wanted)
    assert (thin & ~wide).sum() == 0
    assert (wide & ~disc_fits(wide, 0.5 * wanted - 1)).sum() < 0.03 * wide.sum()
    line = drawn(*LINES[name], width=wanted)
    away = ndimage.distance_transform_edt(~line)
    assert away[wide].max() < 0.5 * wanted + 1  # round ends reach a radius further
    middle = (away == 0) & (np.abs(np.indices(line.shape)[1] - 65) < 25)
    assert (middle & ~wide).sum() < 0.08 * middle.sum()
    # it is no wider either, but for a pixel and its round ends
    assert wide.sum() < 1.2 * line.sum() + wanted**2
    assert ndimage.distance_transform_edt(~thin)[wide].max() <= 0.5 * wanted


def test_what_is_thick_stays_with_its_corners() -> None:
    body = drawn((0, 0), (0, 0), width=1, body=True)
    body[0, 0] = False
    assert (thicken(body, 12) == body).all()
    both = drawn((20, 80), (131, 80), width=3, body=True)
    wide = thicken(both, 12)
    assert ((wide ^ both)[:, 137:]).sum() == 0
    assert ndimage.label(wide)[1] == 1


def test_nothing_is_widened_twice() -> None:
    once = thicken(drawn(*LINES["bent"], width=3), 12)
    assert (thicken(once, 10) ^ once).sum() < 0.01 * once.sum()


@given(st.integers(0, 10**6), st.floats(4.0, 16.0))
@settings(deadline=None, max_examples=15)
def test_the_validators_widen_alike(seed: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    points = [(int(x), int(y)) for x, y in rng.integers(10, 120, (4, 2))]
    mask = drawn(*points, width=int(rng.integers(1, 8)), body=bool(seed % 2))
    np.testing.assert_array_equal(thicken(mask, width), widen_strokes(mask, width))


@pytest.mark.parametrize("sequence", [False, True])
def test_what_the_scene_asks_for_is_drawn_and_the_picture_kept(sequence: bool) -> None:
    mask = drawn(*LINES["bent"], width=2)
    targets = [Target("line", mask, b"", 200, 160)] * (3 if sequence else 1)
    scene = resolve(Scene(views=(View(thicken_mm="auto"),)))
    changed, found = widen_targets(scene, targets, sequence)
    # 1.1 times the shadow of a 1.6 mm tube falls on a wall 100 mm behind a piece 500 mm from the lamp
    assert changed.views[0].thicken_mm == pytest.approx(1.1 * 1.6 * 1.2)
    assert len(found) == len(targets)
    for target in found:
        assert (target.asked == mask).all() and "widened" in target.rule
        assert (target.mask == thicken(mask, 1.1 * 1.6 * 1.2 * 200 / 180)).all()
    assert widen_targets(scene.model_copy(update={"views": (View(lines=False),)}), targets[:1])[
        1
    ] == (targets[0],)


@pytest.mark.parametrize("width", [2, 5, 9, 14])
@pytest.mark.parametrize("body", [False, True])
def test_a_drawing_of_lines_is_one_whose_lines_are_thinner(width: int, body: bool) -> None:
    shape = drawn((10, 20), (90, 130), (110, 20), width=width, body=body)
    for asked in (3.0, 6.0, 12.0):
        # the square's area is more than a fifth, and its middle lines are less than half
        assert is_thin(shape, asked) == (width < asked - 0.5 and not body)
