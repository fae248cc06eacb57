"""Viviani's curve from three sides: its tube's own three shadows are drawn, and rebuilt into one part.

`python -m paper.viviani --out DIR`: writes the three pictures and a scene, builds from the
pictures alone, and prints a line a view. The curve, where a sphere of radius 2a meets a cylinder of
radius a through its middle: (a (1 + cos t), a sin t, 2a sin(t / 2)), t from 0 to 4 pi.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from benchmarks.build_table import draw_sheet
from benchmarks.measurement import Stopwatch, run_study
from knotfab.picture.read import read_targets
from knotfab.pipeline.build import run_build
from knotfab.render.capsules import tensor_frame
from knotfab.render.device import render
from knotfab.render.silhouette import frame_of
from knotfab.request import Outcome, Request
from knotfab.scene.camera import camera_of
from knotfab.scene.catalogue import resolve
from knotfab_formats.piece import Accuracy, Piece
from knotfab_formats.scene import ResolvedView, Scene
from paper.camera import even_ring, viviani

A_MM, RADIUS_MM = 28.0, 2.0
_FRAME_MM, _PIXELS = 160.0, 640


def views_of_viviani() -> tuple[ResolvedView, ...]:
    """Look from the front (an eight), from the side (an arc) and from above (a circle)."""
    sides = {"front": (0.0, 0.0), "side": (90.0, 0.0), "above": (0.0, 90.0)}
    return tuple(
        ResolvedView(
            name=name,
            picture=f"{name}.png",
            frame_width_mm=_FRAME_MM,
            frame_height_mm=_FRAME_MM,
            azimuth_deg=azimuth,
            elevation_deg=elevation,
        )
        for name, (azimuth, elevation) in sides.items()
    )


def draw(p: Tensor, view: ResolvedView, path: Path) -> None:
    """Draw the shadow in a view, black on white, of the tube about points [n, 3], mm."""
    frame = tensor_frame(frame_of(camera_of(view, _PIXELS, _PIXELS)), torch.float64)
    seen = render(p, p.roll(-1, 0), frame, RADIUS_MM, 20.0, 5.0) > 0.5
    Image.fromarray(np.where(seen.numpy(), 0, 255).astype(np.uint8)).save(path)


def rebuild(folder: Path, start: str = "circle", printing: bool = False) -> Outcome:
    """Draw the pictures into `folder` and build a part from them; `start` is "filling" or "circle"."""
    folder.mkdir(parents=True, exist_ok=True)
    views = views_of_viviani()
    curve = 2 * A_MM * viviani(even_ring(600))[:, [1, 2, 0]]  # z of the formula upwards
    for view in views:
        draw(curve, view, folder / view.picture)
    asked = Scene(
        piece=Piece(tube_radius_mm=RADIUS_MM),
        views=views,
        accuracy=Accuracy(iou_floor=0.9),
        search={"network_start": start},
    )
    scene = resolve(asked)
    targets = read_targets([view.picture for view in views], scene.views, base=folder)
    return run_build(Request(scene, targets, folder / "built", printing))


def main(
    *, out: Path, start: Literal["filling", "circle"] = "circle", picture: Path | None = None
) -> None:
    """Rebuild, and print what each view came to."""
    watch = Stopwatch()
    outcome = rebuild(out, start)
    ious = []
    for view in outcome.report["views"]:
        ious.append(view["iou"])
        print(f"{view['name']:8} IoU {view['iou']:.4f}  bound {view['bound']:.4f}")
    checks = {c["name"]: c["status"] for c in outcome.report["checks"]}
    print(f"mean IoU {np.mean(ious):.4f}, thickness {checks.get('thickness')}", end=", ")
    print(f"{watch.wall_s:.0f} s ({watch.cpu_s:.0f} CPU s)")
    if picture:
        draw_sheet({"viviani": outcome.folder}, picture, wide=760)


if __name__ == "__main__":
    run_study(main)
