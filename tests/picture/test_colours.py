"""Drawings under uneven light keep their shape; what is no drawing on paper stays as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from knotfab.base.arrays import Array, Mask
from knotfab.picture.colours import even_out
from knotfab.picture.read import read_target
from knotfab.picture.silhouette import holes_of, mask_iou, pieces_of

Y, X = np.mgrid[:400, :400] / 400
PASSING = np.where((Y > 0.35) & (Y < 0.6), 0.55, 1.0)  # a shadow over the paper
LIGHTS = {
    "falls off": 0.95 - 0.65 * (X + Y) / 2,
    "from one side": 0.97 - 0.8 * X,
    "half in a shadow": ndimage.gaussian_filter(np.where(X + 0.5 * Y > 0.75, 0.4, 0.95), 8),
    "in a dark corner": 0.95 - 0.75 * np.clip(np.hypot(X - 0.5, Y - 0.5) / 0.7, 0, 1) ** 2,
    "a shadow across": ndimage.gaussian_filter((0.9 - 0.45 * X) * PASSING, 4),
}
DISC = np.hypot(X - 0.5, Y - 0.5) < 0.22


def drawings() -> dict[str, Mask]:
    """Two rings one on the other, a box within a pen's ring, and a thick ring."""
    far = np.hypot(X - 0.5, Y - 0.5)
    eight = (abs(np.hypot(X - 0.5, Y - 0.36) - 0.13) < 0.05) | (
        abs(np.hypot(X - 0.5, Y - 0.65) - 0.16) < 0.05
    )
    box = np.maximum(abs(X - 0.5), abs(Y - 0.5))
    return {
        "eight": eight,
        "pen": (abs(far - 0.35) < 0.01) | (abs(box - 0.12) < 0.01),
        "ring": abs(far - 0.27) < 0.07,
    }


def photograph(grey: Array) -> Image.Image:
    """Warm white paper of this brightness, with the noise of a camera."""
    noisy = grey + np.random.default_rng(1).normal(0, 0.01, grey.shape)
    colours = np.clip(noisy[..., None] * (1.0, 0.97, 0.9), 0, 1)
    return Image.fromarray((255 * colours).astype(np.uint8))


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("drawn", drawings())
def test_a_drawing_keeps_its_holes(drawn: str, light: str, tmp_path: Path) -> None:
    ink = drawings()[drawn]
    photograph(LIGHTS[light] * np.where(ink, 0.12, 1.0)).save(tmp_path / "photo.jpg", quality=88)
    read = read_target(tmp_path / "photo.jpg")
    assert mask_iou(read.mask, ink) > 0.95
    assert len(holes_of(read.mask)[1]) == len(holes_of(ink)[1])
    assert len(pieces_of(read.mask)[1]) == len(pieces_of(ink)[1])
    assert "uneven" in read.notes[0]
    (tmp_path / "kept.png").write_bytes(read.png_bytes)
    again = read_target(tmp_path / "kept.png")  # as a build's folder has it: even already
    assert (again.mask == read.mask).all() and not again.notes and again.png_bytes == read.png_bytes


@pytest.mark.parametrize(
    "grey",
    [
        0.9 - 0.01 * X + 0 * Y,  # even light
        np.where(DISC, 1.0, 0.05 + 0.6 * Y),  # a light shape on a dark gradient
        np.where(DISC, 0.5, 0.05 + 0.85 * Y),
        np.where(X < 0.5, 0.3, 0.9),
        np.where((6 * X).astype(int) + (6 * Y).astype(int) & 1, 0.25, 0.9),
        np.where(np.maximum(abs(X - 0.5), abs(Y - 0.5)) < 0.4, 0.9, 0.15),
        sum(
            s * ndimage.gaussian_filter(np.random.default_rng(5).normal(size=X.shape), s)
            for s in (2, 8, 30, 90)
        )
        / 2.5
        + 0.5,
    ],
    ids=["even", "light shape", "grey shape", "halves", "checks", "dark frame", "texture"],
)
def test_what_is_no_drawing_on_paper_stays(grey: Array) -> None:
    assert even_out(photograph(grey)) is None
