"""Frames in torch: the cone of a sphere, the camera's projection; render/test_kernels.py has the image."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from knotfab.render.capsules import capsule_distance, tensor_frame
from knotfab.render.silhouette import frame_of
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView

VIEW = ResolvedView(frame_width_mm=120.0, frame_height_mm=90.0)
TILTED = VIEW.model_copy(update={"wall_tilt_deg": 25.0})


def _frame(
    view: ResolvedView = VIEW, width: int = 48, height: int = 36, dtype: torch.dtype = torch.float64
):
    return tensor_frame(frame_of(camera_of(view, width, height)), dtype)


def _tangle(count: int, seed: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    scale = torch.tensor([80.0, 60.0, 90.0], dtype=dtype)
    return (torch.rand(count, 3, generator=generator, dtype=dtype) - 0.5) * scale


def test_a_sphere_is_seen_under_its_tangent_cone() -> None:
    # a zero-length capsule on the axis has sin(angle) = r / distance, not tan (the paper's erratum)
    frame, radius = _frame(), 12.0
    point = torch.tensor([[0.0, 0.0, 200.0]], dtype=torch.float64)
    local = frame.local(point)
    edge = math.tan(math.asin(radius / 300.0))
    for q, sign in ((edge * 0.9999, 1), (edge * 1.0001, -1)):
        s = capsule_distance(
            local,
            local,
            torch.tensor([q], dtype=torch.float64),
            torch.zeros(1, dtype=torch.float64),
            radius,
            frame.focal_px,
        )
        assert torch.sign(s).item() == sign


def test_oblong_pixels_are_refused() -> None:
    camera = camera_of(VIEW, 48, 48)
    with pytest.raises(ValueError, match="square"):
        tensor_frame(frame_of(camera), torch.float64)


def test_projection_of_the_frame_agrees_with_the_camera() -> None:
    for view in (VIEW, TILTED):
        camera = camera_of(view, 48, 36)
        points = _tangle(10, 4)
        ours = _frame(view).pixels(_frame(view).local(points)).numpy()
        np.testing.assert_allclose(ours, camera.project(points.numpy()), atol=1e-9)
