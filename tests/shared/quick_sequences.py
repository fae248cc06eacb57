"""Sequences that are searched in a second: discs on small pictures, with few iterations."""

from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw

from knotfab.design.film import Chain, SequenceFrame
from knotfab.picture.frames import read_frames
from knotfab.picture.read import Target

QUICK = {
    "coarse_px": 64, "fine_px": 64, "coarse_iterations": 12, "fine_iterations": 8, "settle_iterations": 8,
    "depth_candidates": 2,
}  # fmt: skip


def discs(folder: Path, sizes: Sequence[int]) -> tuple[Target, ...]:
    """A disc in the middle, of so many pixels' radius in each frame."""
    names = []
    for number, size in enumerate(sizes):
        image = Image.new("L", (128, 128), 255)
        ImageDraw.Draw(image).ellipse((64 - size, 64 - size, 64 + size, 64 + size), fill=0)
        names.append(str(folder / f"{number}.png"))
        image.save(names[-1])
    return read_frames(names)


def in_order(chain: Chain) -> list[SequenceFrame]:
    return sorted(chain.frames(), key=lambda frame: frame.number)
