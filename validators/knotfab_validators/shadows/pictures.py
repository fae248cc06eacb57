"""Pictures of a verified shadow: the shadow alone, and beside its target with the difference."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotfab_validators.arrays import Mask
from knotfab_validators.shadows.frame import WorkingFrame

__all__ = ["write_compare", "write_shadow"]


PANEL_PX = 512  # longer side of a panel
GAP_PX = 16
PAPER = (250, 248, 244)
FRAME = (240, 237, 231)  # inside the picture's frame, a shade darker than the padding
INK = (44, 46, 52)
SHARED = (201, 203, 206)
SPILL = (214, 94, 50)  # shadow where none should be
MISSING = (38, 110, 168)  # the colour of missing shadow


def write_shadow(path: Path, shadow: Mask | NDArray[np.float32], frame: WorkingFrame) -> None:
    """Write the shadow inside the picture's frame, black on white, at the working resolution.

    Args:
        shadow: (H, W), on the padded working frame; a soft one from 0 to 1.
    """
    grey = np.rint(255.0 * (1.0 - shadow[frame.window])).astype(np.uint8)
    Image.fromarray(grey).save(path)


def write_compare(path: Path, target: Mask, shadow: Mask, frame: WorkingFrame) -> None:
    """Write target, shadow and their difference side by side, on the padded frame.

    In the difference grey is what both have, orange is spill, and blue is missing.
    """
    base = np.empty((*target.shape, 3), dtype=np.uint8)
    base[:] = PAPER
    base[frame.window] = FRAME
    panels = [_ink(base, target, INK), _ink(base, shadow, INK)]
    difference = _ink(base, target & shadow, SHARED)
    difference = _ink(difference, shadow & ~target, SPILL)
    panels.append(_ink(difference, target & ~shadow, MISSING))
    rows, columns = _crop_window(target | shadow, frame)
    panels = [panel[rows, columns] for panel in panels]
    sides = panels[0].shape[:2]
    scale = min(1.0, PANEL_PX / max(sides))
    height, width = (max(1, round(side * scale)) for side in sides)
    sheet = Image.new("RGB", (3 * width + 4 * GAP_PX, height + 2 * GAP_PX), PAPER)
    for i, panel in enumerate(panels):
        small = Image.fromarray(panel).resize((width, height), Image.Resampling.BOX)
        sheet.paste(small, (GAP_PX + i * (width + GAP_PX), GAP_PX))
    sheet.save(path)


def _crop_window(drawn: Mask, frame: WorkingFrame) -> tuple[slice, slice]:
    """Return the frame with a narrow margin, and as much of the padding as something is drawn in."""

    def span(occupied: Mask, pad: int, length: int) -> slice:
        margin = min(pad, max(frame.width, frame.height) // 24)
        at = np.flatnonzero(occupied)
        first = min(pad, int(at[0])) if len(at) else pad
        last = max(pad + length, int(at[-1]) + 1) if len(at) else pad + length
        return slice(max(0, first - margin), min(len(occupied), last + margin))

    return (
        span(np.any(drawn, axis=1), frame.pad_y, frame.height),
        span(np.any(drawn, axis=0), frame.pad_x, frame.width),
    )


def _ink(panel: NDArray[np.uint8], where: Mask, colour: tuple[int, int, int]) -> NDArray[np.uint8]:
    inked = panel.copy()
    inked[where] = colour
    return inked
