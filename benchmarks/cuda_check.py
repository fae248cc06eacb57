"""Whether a device gives what the CPU gives: renderer, optimizer, network and free view, with their times.

`python -m benchmarks.cuda_check` takes some minutes on a machine with CUDA; `--device cpu` tries the script.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

import knotfab
from benchmarks.measurement import run_study
from knotfab.design.design import design_knots
from knotfab.picture.read import read_target
from knotfab.render.image import image_at
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene

_NEAR_IOU = 0.01  # sums on a device run in another order, and a search amplifies that
_NEAR_SLOPE = 1e-3  # share of the largest slope, in single precision


def _draw(device: str) -> tuple[float, np.ndarray]:
    """Return the picture's error and its slope for a ring before a heart, drawn on a device."""
    question = knotfab.pose_question(Scene(), [read_target("text:\u2665")])
    seen = question.problem.views[0]
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    points = np.stack([45 * np.cos(angle), 45 * np.sin(angle), 10 * np.sin(3 * angle)], axis=1)
    rings = knotfab.Knots((knotfab.Knot(points),), 4.0).rings
    image = image_at(seen.view, seen.mask, 4.0, 384, device)
    error, slope = image.squared_error(points, rings, 4.0, 2.0)
    return float(error), slope


def _search(device: str, **search: Any) -> float:
    """Search a heart on a device; return the IoU of the knots found."""
    scene = resolve(Scene.model_validate({"accuracy": {"name": "sketch"}, "search": search}))
    return float(design_knots(scene, [read_target("text:\u2665")], device).result.iou_estimate)


def _time(call: Callable[[], Any]) -> tuple[Any, float]:
    begun = time.perf_counter()
    found = call()
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return found, time.perf_counter() - begun


def main(device: str = "cuda") -> int:
    """Compare a device with the CPU, a line each; 1 where one differs by more than rounding explains."""
    if device != "cpu":
        from knotfab.request import require_device

        require_device(device)
        print(torch.cuda.get_device_name())
    wrong = 0
    (here, slope), on_cpu = _time(lambda: _draw("cpu"))
    (there, other), on_device = _time(lambda: _draw("cpu:0" if device == "cpu" else device))
    off = max(abs(here - there) / here, float(np.abs(slope - other).max() / np.abs(slope).max()))
    wrong += off > _NEAR_SLOPE
    print(f"renderer    off by {off:.1e}  {on_cpu:.2f} s on the CPU, {on_device:.2f} s there")
    for name, search in {
        "optimizer": {},
        "network": {"method": "inn", "network_iterations": 60},
        "free view": {"free_view": True},
    }.items():
        here, on_cpu = _time(lambda search=search: _search("cpu", **search))
        there, on_device = _time(lambda search=search: _search(device, **search))
        wrong += abs(here - there) > _NEAR_IOU
        print(
            f"{name:<11} IoU {here:.4f} and {there:.4f}"
            f"  {on_cpu:.1f} s on the CPU, {on_device:.1f} s there"
        )
    print("the same" if not wrong else f"{wrong} differ")
    return int(wrong > 0)


if __name__ == "__main__":
    run_study(main)
