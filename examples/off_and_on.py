"""A built piece from the door, its lamp off, beside the same piece with its lamp on: README's first picture.

`python -m examples.off_and_on BUILT PICTURE.webp`
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image


def main(built: Path, picture: Path) -> None:
    """Draw both, from what a build has drawn of each."""
    off, on = (Image.open(built / name).convert("RGB") for name in ("unlit.png", "piece.png"))
    wide, high = off.height * on.width // on.height, off.height
    both = Image.new("RGB", (2 * wide, high))
    both.paste(off, (0, 0))  # the door is the first of its panels
    both.paste(on.resize((wide, high)), (wide, 0))
    both.save(picture, quality=88)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
