"""A deformed sphere mesh beside the tube: what each makes of pictures with holes.

`python -m paper.sphere_mesh [NAME ...] [--out DIR]` prints a table and draws sphere-mesh.png.
The mesh is a sphere whose soft silhouette (Liu et al., "Soft Rasterizer", ICCV 2019, section 3.2)
follows the picture under Adam, with Laplacian and flattening terms; the tube is the product's own
search.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib
import numpy as np
import torch
import trimesh
from matplotlib.figure import Figure
from PIL import Image, ImageDraw
from scipy.ndimage import label
from torch import Tensor

from benchmarks.measurement import Stopwatch, read_question, run_study
from examples.pictures import Canvas, pictures
from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.design.design import choose_tube
from knotfab.picture.silhouette import mask_iou, resample_mask
from knotfab.search.optimizer import Adam, one_thread
from knotfab.search.search import search
from knotfab_formats.search import search_settings
from paper.search_compare import find_shadows

NAMES = ("ring", "wheel", "smiley", "teapot")
COMPARED_PX = 512
_CUTOFF = 8.0  # a triangle's pull ends where its sigmoid falls below 0.03 %


def ring_picture() -> Image.Image:
    """Return a plain ring, the simplest picture with a hole."""
    sheet = Canvas()
    sheet.ring(0.5, 0.5, 0.33, 0.2)
    return sheet.finish()


def soft_silhouette(corners: Tensor, pixels: int, sigma: float) -> Tensor:
    """Return [pixels, pixels] 1 - prod(1 - D) over triangles `corners` [m, 3, 2] in [-1, 1]², y down.

    D = sigmoid(±d² / sigma), d the distance to the triangle's boundary, + inside. Pairs of pixel and
    triangle that are too far apart to matter are left out.
    """
    half = 2.0 / pixels
    reach = (_CUTOFF * sigma) ** 0.5
    with torch.no_grad():
        low = ((corners.amin(1) - reach + 1) / half - 0.5).ceil().long().clamp_min(0)
        high = ((corners.amax(1) + reach + 1) / half - 0.5).floor().long().clamp_max(pixels - 1)
        spans = (high - low + 1).clamp_min(0)
        counts = spans[:, 0] * spans[:, 1]
        face = torch.repeat_interleave(torch.arange(len(corners)), counts)
        k = torch.arange(len(face)) - (torch.cumsum(counts, 0) - counts)[face]
        u, v = low[face, 0] + k % spans[face, 0], low[face, 1] + k // spans[face, 0]
    at = torch.stack([(u + 0.5) * half - 1, (v + 0.5) * half - 1], -1).to(corners.dtype)
    start = corners[face]  # [k, 3, 2]
    edge = start.roll(-1, 1) - start
    to = at[:, None] - start
    share = ((to * edge).sum(-1) / (edge * edge).sum(-1).clamp_min(1e-12)).clamp(0, 1)
    gap = to - share[..., None] * edge
    distance = (gap * gap).sum(-1).amin(1)
    cross = edge[..., 0] * to[..., 1] - edge[..., 1] * to[..., 0]
    inside = (cross > 0).all(1) | (cross < 0).all(1)
    signed = torch.where(inside, distance, -distance) / sigma
    missed = torch.zeros(pixels * pixels, dtype=corners.dtype)
    # log(1 - D) = -softplus(signed)
    missed = missed.index_add(0, v * pixels + u, -torch.nn.functional.softplus(signed))
    return (1 - missed.exp()).reshape(pixels, pixels)


def _flattening(vertices: Tensor, pairs: Tensor, normals_of: Tensor) -> Tensor:
    """Sum over edges of (cosine of the angle between its faces' normals - 1)²."""
    a, b, c = vertices[normals_of].unbind(1)
    normal = torch.linalg.cross(b - a, c - a)
    normal = normal / normal.norm(dim=-1, keepdim=True).clamp_min(1e-9)
    cosine = (normal[pairs[:, 0]] * normal[pairs[:, 1]]).sum(-1)
    return ((cosine - 1) ** 2).sum()


def fit_sphere(
    target: Tensor, iterations: int = 200, subdivisions: int = 4
) -> tuple[Array, Indices]:
    """Give vertices (n, 3) and faces (m, 3) of a sphere deformed to the picture `target` [p, p], in [-1, 1]³.

    Parallel projection along z, y down in the picture. Loss: 1 - soft IoU, 0.01 of the squared
    uniform Laplacian a vertex, 0.0005 of the flattening an edge. Sigma falls from 1e-3 to 3e-5.
    """
    pixels = target.shape[0]
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions)
    faces = torch.tensor(np.asarray(sphere.faces), dtype=torch.long)
    rows, columns = (target > 0.5).nonzero().unbind(1)
    middle = torch.tensor(
        [float(columns.min() + columns.max()), float(rows.min() + rows.max()), 0.0]
    )
    middle = (middle + 1) / pixels - 1
    middle[2] = 0.0
    across = max(int(columns.max() - columns.min()), int(rows.max() - rows.min())) / pixels
    vertices = (torch.tensor(np.asarray(sphere.vertices)) * across + middle).float()
    vertices.requires_grad_()
    edges = torch.tensor(np.asarray(sphere.edges_unique), dtype=torch.long)
    both = torch.cat([edges, edges.flip(1)])
    degree = torch.bincount(both[:, 0])[:, None].float()
    pairs = torch.tensor(np.asarray(sphere.face_adjacency), dtype=torch.long)
    adam = Adam([vertices])
    for iteration in range(iterations):
        progress = iteration / max(1, iterations - 1)
        sigma = 1e-3 * (3e-5 / 1e-3) ** progress
        image = soft_silhouette(vertices[faces][..., :2], pixels, sigma)
        both_cover = (image * target).sum()
        loss = 1 - both_cover / (image + target - image * target).sum()
        mean = torch.zeros_like(vertices).index_add(0, both[:, 0], vertices[both[:, 1]]) / degree
        loss = loss + 0.01 * ((vertices - mean) ** 2).sum()
        loss = loss + 0.0005 * _flattening(vertices, pairs, faces) / len(pairs)
        adam.zero_grad()
        loss.backward()
        adam.step(0.01)
    return vertices.detach().double().numpy(), faces.numpy()


def hard_silhouette(vertices: Array, faces: Indices, pixels: int) -> Mask:
    """Return (pixels, pixels) the union of the projected triangles."""
    sheet = Image.new("1", (pixels, pixels))
    draw = ImageDraw.Draw(sheet)
    at = (vertices[:, :2] + 1) * (pixels / 2) - 0.5
    for face in faces:
        draw.polygon([tuple(at[i]) for i in face], fill=1)
    return np.asarray(sheet)


def holes(mask: Mask, least: int = 20) -> int:
    """Count how many pieces of background of at least `least` pixels do not reach the frame."""
    numbers, count = label(~np.pad(mask, 1))
    sizes = np.bincount(numbers.ravel(), minlength=count + 1)
    return int(sum(sizes[k] >= least for k in range(1, count + 1) if k != numbers[0, 0]))


def _square(mask: Mask, pixels: int) -> Array:
    """Return the mask's coverage on a square of its own middle, `pixels` on a side."""
    height, width = mask.shape
    side = max(mask.shape)
    left, top = 0.5 * (width - side), 0.5 * (height - side)
    window = (left, top, left + side, top + side)
    return resample_mask(mask, pixels, pixels, window).astype(np.float64)


def _tube(picture: Image.Image) -> tuple[Mask, Mask]:
    """Return (target, the tube's shadow), squares of COMPARED_PX, by the product's own search at draft."""
    question, settings = read_question(picture), search_settings("draft", {})
    question, radius, start, _ = choose_tube(question, settings, Progress("quiet"))
    knots = search(question.problem, start, radius, settings).knots
    ((seen, wanted),) = find_shadows(question.problem, knots, pixels=COMPARED_PX)
    return _square(wanted, COMPARED_PX) > 0.5, _square(seen, COMPARED_PX) > 0.5


def main(*names: str, out: Path = Path("sphere-mesh-out"), pixels: int = 96) -> None:
    """Print the table and draw the figure."""
    every = {"ring": ring_picture(), **pictures()}
    out.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(6.6, 2.3 * len(names or NAMES)), layout="constrained")
    axes = figure.subplots(len(names or NAMES), 3, squeeze=False)
    print("                holes             IoU              CPU seconds")
    print("picture    target mesh tube   mesh    tube      mesh    tube")
    for row, name in zip(axes, (names or NAMES), strict=True):
        with one_thread():
            watch = Stopwatch()
            try:
                target, tube = _tube(every[name])
            except SceneError as error:
                print(f"{name:<10} {error}")
                continue
            tube_s = watch.cpu_s
            coarse = torch.as_tensor(_square(target, pixels), dtype=torch.float32)
            mesh = hard_silhouette(*fit_sphere(coarse), COMPARED_PX)
            mesh_s = watch.cpu_s - tube_s
        print(
            f"{name:<10} {holes(target):>5} {holes(mesh):>5} {holes(tube):>4}   "
            f"{mask_iou(mesh, target):.4f}  {mask_iou(tube, target):.4f}  {mesh_s:>7.1f} {tube_s:>7.1f}",
            flush=True,
        )
        for axis, mask, title in zip(
            row, (target, mesh, tube), (name, "sphere mesh", "tube"), strict=True
        ):
            axis.imshow(~mask, cmap=matplotlib.colormaps["gray"], vmin=0, vmax=1)
            share = "" if title == name else f", IoU {mask_iou(mask, target):.3f}"
            axis.set_title(title + share, fontsize=9)
            axis.set_axis_off()
    figure.savefig(out / "sphere-mesh.png", dpi=110)
    print(out / "sphere-mesh.png")


if __name__ == "__main__":
    run_study(main)
