"""Contact sheets of the hard cases: one small picture of each, drawn with matplotlib."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from knotfab.base.arrays import Array
from knotfab.render.frame import frame_of
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView
from paper.shaded_render import Shading, render_shaded

Draw = Callable[[Axes], None]  # draws one case
INK, PALE, WARM, COOL = "#222222", "#c9c9c9", "#d9480f", "#1c6fb5"
_COLOURS = 96  # of a sheet's palette: a third of the bytes
_SLANT = np.array(
    [[0.94, 0.0, 0.342], [0.196, 0.819, -0.539], [-0.28, 0.574, 0.77]]
)  # 35, 20 degrees
_TILT = np.array([[1, 0, 0], [0, 0.5, -0.8660254], [0, 0.8660254, 0.5]])  # 60 degrees about x


def sheet(path: Path, cells: Sequence[tuple[str, Draw]], columns: int = 6) -> None:
    """Write a PNG with every case under its name."""
    columns = min(columns, len(cells))
    rows = -(-len(cells) // columns)
    figure = Figure(figsize=(2 * columns, 2.1 * rows), layout="constrained")
    places = figure.subplots(rows, columns, squeeze=False).flat
    for place, (name, draw) in zip(places, cells, strict=False):
        draw(place)
        place.set_title(name, fontsize=8)
    for place in places:
        place.axis("off")
    for place in figure.axes:
        place.axis("off")
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=80, facecolor="white", metadata={"Software": None})
    Image.open(drawn).convert("RGB").quantize(_COLOURS).save(path, optimize=True)


def draw_image(place: Axes, image: Tensor) -> None:
    """A picture [h, w] from 0 (white) to 1 (black)."""
    wide = min(image.shape) >= 3
    shown = 1 - image.detach().numpy()
    place.imshow(shown, cmap="gray", vmin=0, vmax=1, aspect="equal" if wide else "auto")


def draw_loss(place: Axes, points: Array, slope: Array) -> None:
    """The polygon (n, 3) that a loss is taken of, seen along z, and where the loss pulls its points."""
    ring = np.concatenate([points, points[:1]])
    place.plot(*ring[:, :2].T, color=INK, lw=0.8)
    place.plot(*points[:, :2].T, "o", color=INK, ms=1.8)
    size = float(np.ptp(points[:, :2], axis=0).max()) or 1.0
    steepest = float(np.linalg.norm(slope, axis=1).max())
    if steepest > 0:
        pull = -0.25 * size / steepest * slope
        place.quiver(
            *points[:, :2].T,
            *pull[:, :2].T,
            angles="xy",
            scale_units="xy",
            scale=1,
            color=WARM,
            width=0.008,
        )
    middle = 0.5 * (points[:, :2].max(0) + points[:, :2].min(0))
    place.set_xlim(middle[0] - 0.8 * size, middle[0] + 0.8 * size)
    place.set_ylim(middle[1] - 0.8 * size, middle[1] + 0.8 * size)
    place.set_aspect("equal")


def draw_map(place: Axes, move: Callable[[Tensor], Tensor], size: float) -> None:
    """Circles and spokes in the plane z = 0, on the left before and on the right after `move`."""
    turn = torch.linspace(0, 2 * np.pi, 241, dtype=torch.float64)
    spoke = torch.linspace(0, 1, 41, dtype=torch.float64)
    lines = [(r * turn.cos(), r * turn.sin()) for r in (0.25, 0.5, 0.75, 1.0)]
    lines += [(spoke * np.cos(a), spoke * np.sin(a)) for a in np.arange(12) * np.pi / 6]
    before = [size * torch.stack([x, y, torch.zeros_like(x)], -1) for x, y in lines]
    with torch.no_grad():
        after = [move(line) for line in before]
    for left, curves, colour in ((-1.3, before, INK), (1.3, after, WARM)):
        flat = torch.cat(curves)[:, :2]
        middle = 0.5 * (flat.amax(0) + flat.amin(0))
        half = float((flat.amax(0) - flat.amin(0)).max()) / 2 or 1.0
        for curve in curves:
            x, y = ((curve[:, :2] - middle) / half).T.numpy()
            place.plot(left + x, y, color=colour, lw=0.6)
    place.annotate("", (0.2, 0), (-0.2, 0), arrowprops={"arrowstyle": "->", "lw": 0.8})
    place.set_xlim(-2.5, 2.5)
    place.set_ylim(-1.6, 1.6)
    place.set_aspect("equal")


def draw_knots(place: Axes, polygons: Sequence[Array]) -> None:
    """Closed polygons (n, 3) seen at a slant, nearer edges over farther ones; a thin one is fattened."""
    extent = np.ptp(np.concatenate(polygons), axis=0)
    fatten = np.where(extent < 0.05 * extent.max(), 8.0, 1.0) if len(polygons) == 1 else 1.0
    pieces = []
    share = np.linspace(0, 1, 9)[:, None, None]
    for polygon, colour, wide in zip(polygons, (COOL, WARM), (3.2, 1.4), strict=False):
        p = polygon * fatten @ _SLANT.T
        cut = p + share * (np.roll(p, -1, 0) - p)
        for a, b in zip(cut[:-1].reshape(-1, 3), cut[1:].reshape(-1, 3), strict=True):
            pieces.append((a[2] + b[2], np.stack([a, b])[:, :2], colour, wide))
    for k, (_, ends, colour, wide) in enumerate(sorted(pieces, key=lambda piece: piece[0])):
        place.plot(*ends.T, color="white", lw=wide + 1.2, solid_capstyle="butt", zorder=k)
        place.plot(*ends.T, color=colour, lw=wide, solid_capstyle="round", zorder=k)
    place.margins(0.1)
    place.set_aspect("equal")


def draw_tube(place: Axes, points: Array, radius: float) -> None:
    """A tube about a closed polygon (n, 3), lit, seen at a slant."""
    points = points[:: max(1, len(points) // 1000)]
    scale = 62.0 / (float(np.abs(points).max()) + radius)
    seen = torch.as_tensor(scale * points @ _TILT.T)
    view = ResolvedView(frame_width_mm=150.0, frame_height_mm=150.0)
    frame = frame_of(camera_of(view, 150, 150)).tensors(torch.float64)
    shading = Shading(lamp_mm=(-150.0, 250.0, 400.0), background=1.0)
    image = render_shaded(seen, seen.roll(-1, 0), frame, max(scale * radius, 0.8), 2.0, shading)
    place.imshow(image.numpy(), cmap="gray", vmin=0, vmax=1)


def draw_outline(
    place: Axes, mask: NDArray[np.bool_], curves: Sequence[Array], closed: bool = True
) -> None:
    """A silhouette (H, W) in its frame, and the curves (n, 2) that fill it or run along it, in pixels."""
    place.imshow(np.where(mask, 0.75, 1.0), cmap="gray", vmin=0, vmax=1)
    height, width = mask.shape
    frame = Rectangle((-0.5, -0.5), width, height, fc="none", ec=PALE, lw=0.8, clip_on=False)
    place.add_patch(frame)
    drawn = [np.concatenate([c, c[:1]]) for c in curves] if closed else curves
    place.add_collection(LineCollection(drawn, colors=WARM, linewidths=0.7))


def draw_rays(
    place: Axes, light: tuple[float, float], on: Array, to: Array, lamp_mm: float = 0.0
) -> None:
    """From aside: a light, what its rays meet at `on` (n, 2), and where they end on a flat wall, (n, 2)."""
    place.plot(*on.T, "o-", color=INK, lw=1.0, ms=1.5)
    place.plot(*to.T, "o-", color=PALE, lw=1.0, ms=1.5)
    rays = [np.array([light, end]) for end in to[:: max(1, len(to) // 8)]]
    place.add_collection(LineCollection(rays, colors=WARM, linewidths=0.4))
    place.add_patch(Circle(light, max(0.5 * lamp_mm, 0.02 * light[1]), color=WARM))
    place.margins(0.1)
    place.set_aspect("equal", "datalim")


def draw_shadow(place: Axes, target: NDArray[np.bool_], shadow: Array) -> None:
    """A target (H, W) in pale red, and over it the shadow (H, W) got, from 0 to 1."""
    shown = np.ones((*target.shape, 3))
    shown[target] = (1.0, 0.72, 0.66)
    place.imshow(shown * (1 - shadow[..., None]) + 0.13 * shadow[..., None])
