"""A GIF from pictures that were written before: the verified shadows of a sequence, or a film."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PIL import Image

__all__ = ["write_gif", "write_shadows_gif"]

_LONGER_PX = 384  # longer side of the pictures


def write_gif(path: Path, images: Sequence[Image.Image], frame_ms: int | list[int]) -> None:
    """Write `images` (all of one size) as a GIF that repeats for ever, each shown for `frame_ms`.

    Raises:
        ValueError: no image, or images of different sizes.
    """
    if not images or any(image.size != images[0].size for image in images):
        raise ValueError("a GIF needs images of one size")
    palette = [image.convert("P", palette=Image.Palette.ADAPTIVE) for image in images]
    palette[0].save(
        path, format="GIF", save_all=True, append_images=palette[1:], duration=frame_ms, loop=0
    )


def write_shadows_gif(path: Path, shadows: Sequence[Path], cyclic: bool) -> None:
    """Write the verified shadows, one after the other, and back again where the sequence does not close.

    Raises:
        ValueError: no shadow.
    """
    images = []
    for shadow in shadows:
        with Image.open(shadow) as image:
            grey = image.convert("L")
        grey.thumbnail((_LONGER_PX, _LONGER_PX), Image.Resampling.BOX)
        images.append(grey)
    if not cyclic:
        images += images[-2:0:-1]
    write_gif(path, images, max(40, round(1200 / max(1, len(images)))))  # 1.2 s a round, in ms
