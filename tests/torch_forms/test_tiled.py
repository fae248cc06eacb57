"""The renderers: known silhouettes, tiled against dense, gradients against finite differences."""

import math

import numpy as np
import pytest
import torch

from knotfab.render.frame import frame_of
from knotfab.scene.camera import camera_of
from knotfab.torch_forms.capsule import capsule_distance
from knotfab.torch_forms.dense import render_dense
from knotfab.torch_forms.posed_frame import tensor_frame
from knotfab.torch_forms.tiled import render_tiled
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


def test_a_ray_meets_capsules_where_the_distance_is_positive() -> None:
    # brute force: the least distance of the ray's line to densely sampled points of the segment
    frame, radius = _frame(TILTED), 4.0
    points = _tangle(40, 3)
    a, b = frame.local(points[:20]), frame.local(points[20:])
    q = torch.rand(20, 2, dtype=torch.float64) * 0.2 - 0.1
    s = capsule_distance(a, b, q[:, 0], q[:, 1], radius, frame.focal_px)
    t = torch.linspace(0, 1, 4001, dtype=torch.float64)[:, None]
    for k in range(20):
        d = torch.tensor([q[k, 0], q[k, 1], 1.0], dtype=torch.float64)
        d = d / d.norm()
        on = a[k] + t * (b[k] - a[k])
        least = (on - (on @ d)[:, None] * d).norm(dim=1).min()
        assert (s[k] > 0).item() == (least < radius).item()


@pytest.mark.parametrize("view", [VIEW, TILTED])
@pytest.mark.parametrize("tau", [0.3, 2.0])
def test_tiled_gives_the_dense_image_and_gradient(view: ResolvedView, tau: float) -> None:
    frame = _frame(view)
    points = _tangle(60, 1).requires_grad_()
    weights = torch.rand(frame.height, frame.width, dtype=torch.float64)
    images, gradients = [], []
    for render in (render_dense, render_tiled):
        image = render(points, points.roll(-1, 0), frame, 3.0, tau)
        (gradient,) = torch.autograd.grad((image * weights).sum(), points)
        images.append(image.detach())
        gradients.append(gradient)
    assert torch.allclose(images[0], images[1], rtol=1e-5, atol=1e-12)
    assert (gradients[0] - gradients[1]).norm() <= 1e-5 * gradients[0].norm()


def test_gradient_against_finite_differences() -> None:
    frame = _frame()
    points = _tangle(12, 5)
    weights = torch.rand(frame.height, frame.width, dtype=torch.float64)

    def value(p: torch.Tensor) -> torch.Tensor:
        return (render_tiled(p, p.roll(-1, 0), frame, 3.0, 1.0) * weights).sum()

    variable = points.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(value(variable), variable)
    generator = torch.Generator().manual_seed(2)
    for _ in range(5):
        way = torch.randn(points.shape, generator=generator, dtype=torch.float64)
        h = 1e-5
        slope = (value(points + h * way) - value(points - h * way)) / (2 * h)
        assert float((gradient * way).sum()) == pytest.approx(float(slope), rel=1e-5)


def test_winners_of_before_bound_the_image_from_below() -> None:
    from knotfab.torch_forms.tiled import winners

    frame = _frame()
    points = _tangle(30, 7)
    ends = points.roll(-1, 0)
    won = winners(frame.local(points), frame.local(ends), frame, 3.0, 10.0)
    moved = points + 0.5 * torch.randn(points.shape, dtype=torch.float64)
    stale = render_tiled(moved, moved.roll(-1, 0), frame, 3.0, 1.0, 10.0, won)
    fresh = render_tiled(moved, moved.roll(-1, 0), frame, 3.0, 1.0, 10.0)
    assert bool((stale <= fresh + math.exp(-10)).all())


def test_single_precision_keeps_its_digits() -> None:
    points = _tangle(60, 11)
    exact = render_tiled(points, points.roll(-1, 0), _frame(), 3.0, 1.0)
    single = points.float()
    rough = render_tiled(single, single.roll(-1, 0), _frame(dtype=torch.float32), 3.0, 1.0)
    assert float((exact - rough).abs().max()) < 2e-4


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
