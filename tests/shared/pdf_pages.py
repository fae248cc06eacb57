"""What stands on the pages of a PDF that matplotlib wrote, in mm."""

import re
import zlib
from pathlib import Path

import numpy as np

POINT = 72 / 25.4  # points in a mm


def page_sizes(path: Path) -> np.ndarray:
    """(k, 2) width and height of each page."""
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", path.read_bytes())
    return np.array(boxes, dtype=float) / POINT


def page_contents(path: Path) -> list[str]:
    """The drawing commands of its pages, and of what else in it is drawn."""
    found = []
    for part in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", path.read_bytes(), re.DOTALL):
        try:
            found.append(zlib.decompress(part).decode("latin-1"))
        except zlib.error:  # a font's own
            continue
    return found


def segments(text: str) -> np.ndarray:
    """(k, 4) the lines of one move and one line."""
    pairs = re.findall(r"([-\d.]+) ([-\d.]+) m\n([-\d.]+) ([-\d.]+) l\n", text)
    return np.array(pairs, dtype=float).reshape(-1, 4) / POINT
