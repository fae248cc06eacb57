"""Read the mask and the colours of a picture file; widen, mirror and bend a mask as its view is drawn."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotfab_formats.disk import write_whole
from knotfab_formats.verdict import Bending
from knotfab_formats.views import is_mask
from knotfab_validators.arrays import Array, Mask
from knotfab_validators.check import BadFile, read_bytes

if TYPE_CHECKING:
    from knotfab_formats.views import View

MOST_BYTES = 200_000_000


class PictureError(ValueError):
    """A picture cannot be read; the message says which one and why."""


def read_mask(path: Path) -> Mask:
    """Read the silhouette (H, W) that a build wrote, True where the shape is.

    Raises:
        PictureError: the file is missing, damaged, or no such mask.
    """
    data = _read(path)
    if not is_mask(data):
        raise PictureError(
            f"{path.name}: is not a silhouette's mask: written by knotfab 1.x: build it again with --scene"
        )
    return ~np.asarray(_decode(path, data).convert("1"))


def read_colours(path: Path, size: tuple[int, int], drawn: tuple[int, int]) -> NDArray[np.uint8]:
    """Read a picture as sRGB (H, W, 3), over white if transparent, resampled to `size` (width, height).

    Args:
        drawn: width and height of the masks that it was taken apart into; it must be as large.

    Raises:
        PictureError: the file is missing, damaged, or has another size.
    """
    image = _decode(path, _read(path))
    if image.size != drawn:
        raise PictureError(f"{path.name}: its size is {image.size}, that of the masks is {drawn}")
    rgba = image.convert("RGBA")
    whole = Image.new("RGBA", rgba.size, (255, 255, 255, 255))
    whole.alpha_composite(rgba)
    return np.asarray(whole.convert("RGB").resize(size, Image.Resampling.BOX))


def _read(path: Path) -> bytes:
    try:
        return read_bytes(path, MOST_BYTES)
    except BadFile as error:
        raise PictureError(str(error)) from error


def _decode(path: Path, data: bytes) -> Image.Image:
    try:
        image = Image.open(io.BytesIO(data), formats=["PNG"])
        image.load()
        return image
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise PictureError(f"{path.name}: is damaged, or no PNG ({error})") from error


# Thin strokes are widened as a scene's `thicken_mm` asks (docs/silhouette.md).


def widen_strokes(mask: Mask, width_px: float) -> Mask:
    """Draw a disc of diameter `width_px` at each point of the middle lines of the mask's thin strokes.

    A stroke is what no such disc inside the mask covers, where it goes further from what they cover than
    half the width. On its middle line no neighbour lies 0.7 px further in.
    """
    from scipy import ndimage

    half = width_px / 2
    depth: Array = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] - 0.5
    depth[~mask] = 0.0
    covered = _mark_within(depth >= half, half)
    strokes, found = ndimage.label(mask & ~covered, np.ones((3, 3)))
    beyond = ~_mark_within(covered, half)
    middle = np.zeros_like(mask)
    for number, box in enumerate(ndimage.find_objects(strokes, found), start=1):
        stroke = strokes[box] == number
        if not (stroke & beyond[box]).any():
            continue
        wide = tuple(slice(max(0, s.start - 1), s.stop + 1) for s in box)
        further = ndimage.grey_dilation(depth[wide], size=(3, 3))
        line = (strokes[wide] == number) & (depth[wide] > further - 0.7)  # px
        middle[wide] |= line
    return np.asarray(mask | _mark_within(middle, half))


def _mark_within(mask: Mask, reach: float) -> Mask:
    """Mark pixels whose centre is at most `reach` from one of the mask."""
    if not mask.any():
        return mask
    from scipy import ndimage

    return np.asarray(ndimage.distance_transform_edt(~mask) <= reach)


# A silhouette mirrored and bent as its view in the scene says (docs/conventions.md).

# The outermost rows and columns of control points lie one step outside the frame.
ROWS, COLUMNS = 15, 11
UNIT = 1e-4  # a share of the picture's height


@dataclass(frozen=True)
class Bend:
    """A view's change of its picture: mirrored first, then displaced pixel by pixel.

    `points` (2, ROWS, COLUMNS) are the coefficients of a cubic B-spline of displacements, right and down,
    in shares of the picture's height. None: the picture is mirrored only.
    """

    mirrored: bool
    points: Array | None


@dataclass(frozen=True)
class Bent:
    """A bent silhouette (H, W), and how far its pixels moved, in shares of the height (`rms`, `most`).

    `stretch` is the largest factor by which a length changes anywhere in the frame; infinite where the
    picture folds.
    """

    mask: Mask
    rms: float
    most: float
    stretch: float
    mirrored: bool

    @property
    def figures(self) -> Bending:
        """Return the figures for the report."""
        return Bending(
            rms=self.rms, most=self.most, stretch=self.stretch, mirrored=self.mirrored or None
        )


def bend_of(view: View) -> Bend | None:
    """Read a view's change of its picture; None where the picture stays as it is."""
    if not view.bend_points:
        return Bend(True, None) if view.mirrored else None
    pairs = [[pair.split(",") for pair in row.split(" ")] for row in view.bend_points]
    points = np.moveaxis(np.array(pairs, dtype=np.float64), -1, 0)
    return Bend(bool(view.mirrored), UNIT * points)


def bend_silhouette(mask: Mask, bend: Bend) -> Bent:
    """Mirror and bend the silhouette as its view asks."""
    height, width = mask.shape
    if bend.mirrored:
        mask = np.fliplr(mask)
    if bend.points is None:
        return Bent(mask, 0.0, 0.0, 1.0, bend.mirrored)
    from scipy import ndimage

    # control points that lie on the frame's edges or inside it
    down = 1 + (np.arange(height) + 0.5) / height * (ROWS - 3)
    right = 1 + (np.arange(width) + 0.5) / width * (COLUMNS - 3)
    at = np.stack(np.meshgrid(down, right, indexing="ij"))
    dx, dy = (
        height * ndimage.map_coordinates(axis, at, order=3, prefilter=False) for axis in bend.points
    )
    y, x = np.mgrid[:height, :width]
    inside = ndimage.map_coordinates(mask.astype(np.float64), [y + dy, x + dx], order=1)
    bent = inside >= 0.5
    moved = np.hypot(dx, dy)[bent] / height if bent.any() else np.zeros(1)
    rms, most = float(np.sqrt(np.mean(moved**2))), float(moved.max())
    return Bent(bent, rms, most, _largest_stretch(dx, dy), bend.mirrored)


def _largest_stretch(dx: Array, dy: Array) -> float:
    """Return the largest factor of stretch or shrinking; infinite where the picture folds."""
    (xy, xx), (yy, yx) = np.gradient(dx), np.gradient(dy)
    jacobian = np.stack([1 + xx, xy, yx, 1 + yy], axis=-1).reshape(-1, 2, 2)
    if np.linalg.det(jacobian).min() <= 0:
        return float("inf")
    # singular values of 2 x 2: the sum of squares is that of all entries, their product the determinant
    squares, product = (jacobian**2).sum((1, 2)), np.linalg.det(jacobian)
    longest = np.sqrt(0.5 * (squares + np.sqrt(np.maximum(squares**2 - 4 * product**2, 0))))
    return float(max(longest.max(), (longest / product).max()))


def write_image(path: Path, image: Image.Image) -> None:
    """Write a PNG whole or not at all."""
    content = io.BytesIO()
    image.save(content, "PNG")
    write_whole(path, content.getvalue())
