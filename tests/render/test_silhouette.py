"""The silhouette, compiled and in torch, against finite differences, a cone, and the camera's projection."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose
from oracles import assert_slope
from torch import Tensor

from knotfab.base.arrays import Array
from knotfab.picture.silhouette import resample_mask
from knotfab.render import device as tensors
from knotfab.render import silhouette
from knotfab.render.capsules import capsule_distance, tensor_frame
from knotfab.render.device import render, render_torch, squared_error
from knotfab.render.image import image_at
from knotfab.render.silhouette import Frame, frame_of
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView

VIEW = ResolvedView(frame_width_mm=120.0, frame_height_mm=90.0)
RADIUS = 3.0


def frame_at(dtype: torch.dtype, width: int = 92, height: int = 69, tilt: float = 20.0) -> Frame:
    """An oblique view whose sides are no whole number of tiles."""
    view = VIEW.model_copy(update={"wall_tilt_deg": tilt})
    return tensor_frame(frame_of(camera_of(view, width, height)), dtype)


def tangle(count: int, seed: int, dtype: torch.dtype) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    scale = torch.tensor([110.0, 80.0, 90.0], dtype=torch.float64)
    return ((torch.rand(count, 3, generator=generator, dtype=torch.float64) - 0.5) * scale).to(
        dtype
    )


def target_at(frame: Frame, dtype: torch.dtype) -> Tensor:
    generator = torch.Generator().manual_seed(9)
    return torch.rand(frame.height, frame.width, generator=generator, dtype=torch.float64).to(dtype)


def torch_error(p: Tensor, frame: Frame, tau: float, target: Tensor, *rest: object) -> Tensor:
    seen = render_torch(p, p.roll(-1, 0), frame, RADIUS, tau, *rest)  # type: ignore[arg-type]
    return ((seen - target) ** 2).sum()


@pytest.mark.parametrize("tau", [0.3, 2.0])
def test_error_and_gradient_are_those_of_torch(tau: float) -> None:
    for dtype, most in ((torch.float32, 1e-4), (torch.float64, 1e-12)):
        p, frame = tangle(80, 5, dtype).requires_grad_(), frame_at(dtype)
        target = target_at(frame, dtype)
        ours = squared_error(p, p.roll(-1, 0), frame, RADIUS, tau, target)
        theirs = torch_error(p, frame, tau, target)
        assert float(ours.detach()) == pytest.approx(
            float(theirs.detach()), rel=10 * torch.finfo(dtype).eps
        )
        (g,), (w,) = torch.autograd.grad(3 * ours, p), torch.autograd.grad(3 * theirs, p)
        assert float((g - w).norm()) <= most * float(w.norm())
        # the image gives the same
        seen = render(p, p.roll(-1, 0), frame, RADIUS, tau)
        (g,) = torch.autograd.grad(3 * ((seen - target) ** 2).sum(), p)
        assert float((g - w).norm()) <= most * float(w.norm())


def test_gradient_against_finite_differences() -> None:
    p, frame = tangle(25, 6, torch.float64).requires_grad_(), frame_at(torch.float64)
    target = target_at(frame, torch.float64)

    def value(q: Tensor) -> Tensor:
        return squared_error(q, q.roll(-1, 0), frame, RADIUS, 1.0, target)

    (gradient,) = torch.autograd.grad(value(p), p)
    generator = torch.Generator().manual_seed(2)
    for _ in range(5):
        way = torch.randn(p.shape, generator=generator, dtype=torch.float64)
        h = 1e-5
        with torch.no_grad():
            slope = (value(p + h * way) - value(p - h * way)) / (2 * h)
        assert float((gradient * way).sum()) == pytest.approx(float(slope), rel=1e-5)


def test_winners_of_before_give_what_they_give_in_torch() -> None:
    p, frame = tangle(50, 7, torch.float64), frame_at(torch.float64)
    won = tensors.winners(p, p.roll(-1, 0), frame, RADIUS, 10.0)
    moved = (p + 0.5 * torch.randn(p.shape, dtype=torch.float64)).requires_grad_()
    target = target_at(frame, torch.float64)
    ours = squared_error(moved, moved.roll(-1, 0), frame, RADIUS, 1.0, target, 10.0, won)
    theirs = torch_error(moved, frame, 1.0, target, 10.0, won)
    (g,), (w,) = torch.autograd.grad(ours, moved), torch.autograd.grad(theirs, moved)
    assert float(ours.detach()) == pytest.approx(float(theirs.detach()), rel=1e-12)
    assert float((g - w).norm()) <= 1e-12 * float(w.norm())
    fresh = render(moved, moved.roll(-1, 0), frame, RADIUS, 1.0, 10.0)
    stale = render(moved, moved.roll(-1, 0), frame, RADIUS, 1.0, 10.0, won)
    assert bool((stale <= fresh + math.exp(-10)).all())


def test_winners_are_those_within_reach() -> None:
    p, frame = tangle(30, 8, torch.float64), frame_at(torch.float64, 200, 150)
    for reach in (0.0, 1.0, 12.0):
        pixel, capsule = tensors.winners(p, p.roll(-1, 0), frame, RADIUS, reach)
        assert len(pixel.unique()) == len(pixel) > 1000
        assert int(capsule.min()) >= 0 and int(capsule.max()) < len(p)
        # at a sharpness of 1 the image tells the distance
        seen = render_torch(p, p.roll(-1, 0), frame, RADIUS, 1.0, 30.0).flatten()
        within = seen > 1 / (1 + math.exp(reach))
        assert torch.equal(within.nonzero()[:, 0], pixel.long().sort().values)


@pytest.mark.slow
def test_slopes_in_the_views_own_numbers_are_those_of_torch() -> None:
    p, frame = tangle(40, 3, torch.float64), frame_at(torch.float64)
    target = target_at(frame, torch.float64)
    found = []
    for error in (squared_error, None):
        step, radius = (
            torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in (frame.step, RADIUS)
        )
        free = Frame(frame.axes, frame.eye, frame.u0, frame.v0, step, frame.width, frame.height)
        rows = (p, p.roll(-1, 0), free, radius, 1.0)
        seen = render_torch(*rows)
        loss = ((seen - target) ** 2).sum() if error is None else error(*rows, target)
        found.append(torch.stack(torch.autograd.grad(loss, (step, radius))))
    torch.testing.assert_close(found[0], found[1], rtol=1e-12, atol=0)


def test_points_far_out_or_nan_colour_nothing() -> None:
    frame = frame_at(torch.float32)
    p = tangle(20, 4, torch.float32)
    plain = render(p, p.roll(-1, 0), frame, RADIUS, 1.0)
    for wild in (math.nan, math.inf, -math.inf, 3e38, 1e12):
        more = torch.cat([p, torch.full((2, 3), wild)])
        ends = torch.cat([p.roll(-1, 0), torch.full((2, 3), wild)])
        seen = render(more, ends, frame, RADIUS, 1.0)
        assert bool(seen.isfinite().all())
        assert torch.equal(seen, plain)


@pytest.mark.slow
@pytest.mark.parametrize("rows", [69, 66])
def test_the_hard_shadow_is_where_rays_meet_the_tube(rows: int) -> None:
    """Where pixels are a twentieth higher than wide, a tube is drawn as much wider than it should be."""
    camera = camera_of(VIEW, 92, rows)
    p = tangle(6, 3, torch.float64).numpy()
    seen = silhouette.cast(p, np.roll(p, -1, 0), frame_of(camera, stretched=True), RADIUS)
    v, u = np.mgrid[:rows, :92]
    rays = camera.corner + u[..., None] * camera.du + v[..., None] * camera.dv - camera.eye
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    share = np.linspace(0, 1, 400)[:, None]
    least = np.full(seen.shape, np.inf)
    for a, b in zip(p, np.roll(p, -1, 0), strict=True):
        for point in a + share * (b - a) - camera.eye:
            off = np.linalg.norm(point - rays * (rays @ point)[..., None], axis=-1)
            least = np.minimum(least, off)
    assert seen[least < 0.95 * RADIUS].all() and not seen[least > 1.06 * RADIUS].any()
    assert 0.1 < seen.mean() < 0.9


def test_slopes_before_the_light_are_finite_differences() -> None:
    """Strands that come from behind the light, or lie far behind each other: ends are cut and exchanged."""
    frame = frame_of(camera_of(VIEW, 92, 69))
    generator = np.random.default_rng(5)
    p = generator.uniform([-40, -30, -60], [40, 30, 60], (24, 3))
    p[::3, 2] += frame.eye[2]  # before and behind it
    target = generator.uniform(size=(69, 92))

    def value(q: Array) -> tuple[float, Array]:
        total, one, two = silhouette.squared_error(q, np.roll(q, -1, 0), frame, RADIUS, 0.3, target)
        return total, one + np.roll(two, 1, 0)

    local = frame.local(p)
    assert (local[:, 2] < 2.5 * RADIUS).any() and (local[:, 2] > 2.5 * RADIUS).any()
    assert_slope(value, p, rel=1e-4, step=1e-6)
    of_tensors = tensors.squared_error(
        torch.as_tensor(p),
        torch.as_tensor(np.roll(p, -1, 0)),
        tensor_frame(frame, torch.float64),
        RADIUS,
        0.3,
        torch.as_tensor(target),
    )
    assert float(of_tensors) == pytest.approx(value(p)[0], rel=1e-12)


def test_places_are_rounded_alike_by_loops_and_by_numpy() -> None:
    rng = np.random.default_rng(6)
    for real in (np.float32, np.float64):
        frame = frame_of(camera_of(VIEW.model_copy(update={"azimuth_deg": 33.0}), 92, 69), real)
        points = rng.uniform(-90, 90, (400, 3)).astype(real)
        assert (frame.local(points) == frame.local(points[None])[0]).all()


def test_no_capsules_give_an_empty_image() -> None:
    frame = frame_at(torch.float32)
    none = torch.zeros(0, 3, requires_grad=True)
    target = target_at(frame, torch.float32)
    error = squared_error(none, none, frame, RADIUS, 1.0, target)
    assert float(error.detach()) == pytest.approx(float((target**2).sum()), rel=1e-6)
    assert torch.autograd.grad(error, none)[0].shape == (0, 3)


def test_winners_of_another_scene_are_refused() -> None:
    p, frame = tangle(20, 4, torch.float32), frame_at(torch.float32)
    won = tensors.winners(p, p.roll(-1, 0), frame, RADIUS, 5.0)
    for few, small in ((p[:5], frame), (p, frame_at(torch.float32, 20, 15))):
        with pytest.raises(IndexError, match="another scene"):
            render(few, few.roll(-1, 0), small, RADIUS, 1.0, 5.0, won)
    points, here = p.numpy(), frame.arrays()
    for pixel, capsule in (([-1, 3], [0, 1]), ([0, 3], [0, 20]), ([0, 1, 2], [0])):
        wrong = np.array(pixel, np.int32), np.array(capsule, np.int32)
        with pytest.raises(IndexError, match="another scene"):
            silhouette.render(points, np.roll(points, -1, 0), here, RADIUS, 1.0, 5.0, wrong)


def test_every_number_of_threads_gives_the_same_bits() -> None:
    p, frame = tangle(80, 5, torch.float32), frame_at(torch.float32)
    target = target_at(frame, torch.float32)

    def once(_: int = 0) -> tuple[Tensor, Tensor]:
        q = p.clone().requires_grad_()
        error = squared_error(q, q.roll(-1, 0), frame, RADIUS, 1.0, target)
        return error.detach(), torch.autograd.grad(error, q)[0]

    threads = torch.get_num_threads()
    try:
        found = []
        for count in (1, 4):
            torch.set_num_threads(count)
            found.append(once())
            with ThreadPoolExecutor(4) as pool:
                found.extend(pool.map(once, range(8)))
    finally:
        torch.set_num_threads(threads)
    for error, gradient in found[1:]:
        assert torch.equal(error, found[0][0]) and torch.equal(gradient, found[0][1])


# The target picture at the resolution of a phase: nothing of it is lost, grown or shifted.


RADIUS_MM = 2.0


@pytest.mark.slow
@pytest.mark.parametrize("pixels", [96, 192, 250, 384, 512, 1024, 1500])
@pytest.mark.parametrize("size", [(1023, 1024), (829, 1024), (1024, 655), (301, 200), (64, 64)])
def test_a_picture_keeps_its_area_and_its_place_at_any_size(
    size: tuple[int, int], pixels: int
) -> None:
    """A filter that counts whole pixels shifts a picture of twice its size by half of one of these."""
    width, height = size
    v, u = np.mgrid[:height, :width] + 0.5
    mask = np.hypot(u - 0.4 * width, v - 0.55 * height) < 0.35 * min(size)
    view = ResolvedView(frame_width_mm=0.1 * width, frame_height_mm=0.1 * height)
    image = image_at(view, mask, RADIUS_MM, pixels, precision="double")
    pixel = max(size) / pixels  # in the mask's
    target, high, wide = image.target, image.frame.height, image.frame.width
    assert target.sum() * pixel**2 == pytest.approx(mask.sum(), rel=1e-5)
    at = target.sum(axis=0) @ np.arange(wide), target.sum(axis=1) @ np.arange(high)
    middle = [m / target.sum() + 0.5 - 0.5 * n for m, n in zip(at, (wide, high), strict=True)]
    wanted = [(mask * w).sum() / mask.sum() - 0.5 * n for w, n in ((u, width), (v, height))]
    assert_allclose(np.multiply(middle, pixel), wanted, atol=5e-3)


def test_a_window_looks_at_a_part_of_a_mask_and_beyond_it() -> None:
    mask = np.random.default_rng(2).random((40, 60)) > 0.4
    wide = resample_mask(np.pad(mask, ((3, 5), (2, 4))), 33, 24)
    assert_allclose(resample_mask(mask, 33, 24, (-2.0, -3.0, 64.0, 45.0)), wide, atol=1e-6)
    part = resample_mask(mask[4:34, 10:50], 17, 11)
    assert_allclose(resample_mask(mask, 17, 11, (10.0, 4.0, 50.0, 34.0)), part, atol=1e-6)
    # a pixel half beyond the mask's edge is at most half covered
    edge = resample_mask(np.ones((10, 10), dtype=bool), 5, 5, (-1.0, 0.0, 9.0, 10.0))
    assert_allclose(edge, np.tile([0.5, 1, 1, 1, 1], (5, 1)), atol=1e-6)


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
