"""A picture in colours taken apart: grain and detail that no strand draws are no areas of their own."""

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import label

from knotfab.base.arrays import Array
from knotfab.picture.lamps import Separation, separate

LAMPS = np.eye(3)
SIDE = 300
V, U = np.mgrid[:SIDE, :SIDE]


def photograph(grain: float, dots: bool = False) -> Array:
    """A red ball on grass before a pale sky that darkens to one side, in sRGB of 255."""
    colours = np.empty((SIDE, SIDE, 3))
    colours[:] = (225, 235, 245)
    colours[V > 190] = (90, 150, 60)
    colours[np.hypot(V - 150, U - 140) < 75] = (205, 60, 50)
    if dots:
        colours[(V % 60 < 5) & (U % 60 < 5) & (V < 190)] = (40, 60, 200)
    colours *= (0.9 + 0.1 * U / SIDE)[..., None]
    noise = np.random.default_rng(3).normal(0.0, grain, colours.shape)
    return np.clip(colours + noise, 0, 255)


def parted(picture: Array, **more: float) -> Separation:
    image = Image.fromarray(np.rint(picture).astype(np.uint8))
    return separate(image, ("red", "green", "blue"), LAMPS, "photo", **more)  # type: ignore[arg-type]


def pieces(found: Separation) -> int:
    return sum(int(label(mask)[1]) for mask in found.masks)


@pytest.mark.parametrize("grain", [6.0, 12.0])
@pytest.mark.slow
def test_grain_is_smoothed_and_edges_stay(grain: float) -> None:
    clean, grainy = parted(photograph(0.0)), parted(photograph(grain))
    assert pieces(grainy) <= pieces(clean) + 1
    assert (clean.masks == grainy.masks).mean() > 0.99


def test_what_is_no_photograph_is_not_smoothed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("knotfab.picture.lamps._without_grain", lambda _: 1 / 0)
    assert pieces(parted(photograph(0.0)))
    with pytest.raises(ZeroDivisionError):
        parted(photograph(6.0))


@pytest.mark.parametrize("more", [{"smooth_px": 6.0}, {"speck_px": 40}])
@pytest.mark.slow
def test_smooth_and_specks_leave_out_detail(more: dict[str, float]) -> None:
    without, dotted = photograph(0.0), photograph(0.0, dots=True)
    assert pieces(parted(dotted)) > pieces(parted(without)) + 10
    assert pieces(parted(dotted, **more)) <= pieces(parted(without)) + 1
