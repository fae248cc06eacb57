"""The paper's renderers as the search sees them: the same silhouette, and a slope that is the error's own."""

import math
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
import shapely
import torch
from oracles import render_dense as render_rays
from tables import some
from torch import Tensor

from benchmarks.hard.measure import distances
from benchmarks.hard.rendering import render_cases
from benchmarks.hard.terms import applies, paper_error, printed_corners, printed_fails
from knotfab.apps.paper.ellipse import clip_segments, project_spheres, support, support_point
from knotfab.apps.paper.outlines import (
    OutlineImage,
    Pinhole,
    render_outlines,
    signed_distance,
    winners,
)
from knotfab.base.arrays import Array, Mask
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.render.image import ViewImage, image_at
from knotfab.render.silhouette import Frame
from knotfab_formats.scene import ResolvedView
from knotfab_formats.search import Renderer
from paper.camera import camera_around, paper_camera

pytestmark = pytest.mark.slow

VIEW = ResolvedView(
    frame_width_mm=120.0, frame_height_mm=90.0, azimuth_deg=30.0, light_distance_mm=600.0
)
RADIUS = 3.0
RINGS = polylines_of_sizes((90, 40))


def disc() -> Mask:
    y, x = np.mgrid[:60, :80]
    return np.asarray(np.hypot(x - 40, y - 30) < 22)


def tangle() -> Array:
    t, u = (2 * np.pi * np.arange(n) / n for n in RINGS.sizes)
    one = np.column_stack([30 * np.cos(t), 24 * np.sin(t), 8 * np.cos(3 * t)])
    return np.concatenate([one, np.column_stack([9 * np.cos(u), 3 * np.sin(u), 9 * np.sin(u)])])


def image(renderer: Renderer, view: ResolvedView = VIEW) -> ViewImage:
    return image_at(view, disc(), RADIUS, 96, "double", renderer)


@pytest.mark.parametrize("renderer", ["capsule", "ellipse"])
@pytest.mark.parametrize("kept", [False, True])
def test_the_slope_is_the_errors_own(renderer: Renderer, kept: bool) -> None:
    points, seen = tangle(), image(renderer)
    won = seen.find_winners(points, RINGS, RADIUS, 1.0) if kept else None
    _, slope = seen.squared_error(points, RINGS, RADIUS, 1.0, won)
    assert slope.shape == points.shape and np.isfinite(slope).all()
    rng = np.random.default_rng(3)
    way, step = rng.normal(size=points.shape), 1e-6
    ends = (
        seen.squared_error(points + s * step * way, RINGS, RADIUS, 1.0, won)[0] for s in (1, -1)
    )
    ahead, behind = ends
    # a pixel within the cutoff, of which sigmoid leaves 0.7 %, may come or go where winners are found anew
    assert (ahead - behind) / (2 * step) == pytest.approx(float((slope * way).sum()), rel=2e-3)


def test_near_the_outline_the_errors_are_those_of_rays() -> None:
    points = tangle()
    rays, capsules = (
        image(kind).squared_error(points, RINGS, RADIUS, 4.0) for kind in ("ray", "capsule")
    )
    assert capsules[0] == pytest.approx(rays[0], rel=1e-2)
    cosine = (capsules[1] * rays[1]).sum() / np.sqrt(
        (capsules[1] ** 2).sum() * (rays[1] ** 2).sum()
    )
    assert cosine > 0.98


def test_another_pose_keeps_the_renderer() -> None:
    turned = VIEW.model_copy(update={"azimuth_deg": 50.0})
    here, there = image("capsule"), image("capsule", turned)
    moved = here.from_frame(there.frame)
    drawn = [cast(OutlineImage, image._drawn) for image in (moved, here)]
    assert drawn[0].target is drawn[1].target
    one, other = (i.squared_error(tangle(), RINGS, RADIUS, 1.0) for i in (moved, there))
    assert one[0] == other[0] and (one[1] == other[1]).all()


# The paper's renderers: printed formulas as oracles, exact distances, limits, gradients, winners.


CAMERA = paper_camera(width=40, height=32, focal=(1.0, 0.8, 2.0))
TAU = 60.0


def render_outlines_dense(
    starts: Tensor,  # [n, 3] world
    ends: Tensor | None,  # [n, 3]; None: the ellipse renderer
    camera: Pinhole,
    radius: float,
    tau: float,
    pixels_at_once: int = 512,
) -> Tensor:
    """[height, width] the same image from every primitive at every pixel; slow."""
    b = starts if ends is None else ends
    count, n = camera.width * camera.height, len(starts)
    parts = []
    for first in range(0, count, pixels_at_once):
        pixel = torch.arange(first, min(count, first + pixels_at_once), device=starts.device)
        u, v = (pixel % camera.width).to(starts.dtype), (pixel // camera.width).to(starts.dtype)
        q = camera.plane(u, v).repeat_interleave(n, 0)
        s = signed_distance(
            starts.repeat(len(pixel), 1), b.repeat(len(pixel), 1), q, camera, radius
        )
        parts.append(torch.sigmoid(tau * s).reshape(len(pixel), n).amax(1))
    return torch.cat(parts).reshape(camera.height, camera.width)


def conic(
    centres: Tensor,  # [..., 3]
    radius: float,
    focal_z: float,
) -> Tensor:
    """[..., 6] A..F of the silhouette A x^2 + B x y + C y^2 + D x + E y + F = 0, positive inside.

    The paper's coefficients with k^2 = |p|^2 - r^2, which is cos^2(theta) |p|^2 with sin(theta) = r / |p|.
    """
    x, y, z = centres.unbind(-1)
    k = x * x + y * y + z * z - radius * radius
    return torch.stack(
        [
            x * x - k,
            2 * x * y,
            y * y - k,
            2 * focal_z * x * z,
            2 * focal_z * y * z,
            focal_z * focal_z * (z * z - k),
        ],
        -1,
    )


def _points(count: int, seed: int, depth: float = 3.0) -> Tensor:
    """Points spread over the view at depths within 0.8 of `depth`."""
    generator = torch.Generator().manual_seed(seed)
    p = 2 * torch.rand(count, 3, generator=generator, dtype=torch.float64) - 1
    p[:, 2] = depth + 0.8 * p[:, 2]
    p[:, :2] *= 0.5 * p[:, 2:]
    return p


def _plane(count: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return 2.4 * torch.rand(count, 2, generator=generator, dtype=torch.float64) - 1.2


def test_conic_support_and_half_axes_are_one_ellipse() -> None:
    centres, radius, focal = _points(50, 1), 0.3, 2.0
    coefficients = conic(centres, radius, focal)
    shape = project_spheres(centres, radius, focal)
    turn = torch.linspace(0, 2 * math.pi, 13, dtype=torch.float64)[:, None]
    u = torch.stack([turn.cos(), turn.sin()], -1).expand(13, 50, 2)
    q = support_point(u, centres, radius, focal)
    assert torch.allclose((u * q).sum(-1), support(u, centres, radius, focal), rtol=1e-13)
    x, y = q.unbind(-1)
    monomials = torch.stack([x * x, x * y, y * y, x, y, torch.ones_like(x)], -1)
    assert float((monomials * coefficients).sum(-1).abs().max()) < 1e-11
    d = q - shape.middle
    along = (d * shape.axis).sum(-1)
    across = d[..., 1] * shape.axis[:, 0] - d[..., 0] * shape.axis[:, 1]
    assert torch.allclose(
        (along / shape.major) ** 2 + (across / shape.minor) ** 2, torch.ones(13, 50).double()
    )
    # a ray to the outline passes the centre at the radius
    ray = torch.cat([q, torch.full_like(q[..., :1], focal)], -1)
    miss = torch.linalg.cross(centres.expand_as(ray), ray).norm(dim=-1) / ray.norm(dim=-1)
    assert torch.allclose(miss, torch.full_like(miss, radius))


def _hull(a: Tensor, b: Tensor, radius: float, focal: float, steps: int = 3000) -> shapely.Polygon:
    turn = torch.linspace(0, 2 * math.pi, steps + 1, dtype=torch.float64)[:-1, None]
    u = torch.cat([turn.cos(), turn.sin()], -1)
    outline = torch.cat([support_point(u, p[None], radius, focal) for p in (a, b)])
    return shapely.MultiPoint(outline.numpy()).convex_hull


@pytest.mark.parametrize(("radius", "depth"), [(0.08, 3.0), (0.6, 2.0)])
def test_signed_distance_is_that_of_the_hull_of_both_ellipses(radius: float, depth: float) -> None:
    # the larger radius brings spheres to 1.9 radii from the eye's plane: ellipses of 2:1
    camera = replace(CAMERA, near=1e-2)
    a, b, q = _points(6, 4, depth), _points(6, 5, depth), _plane(60, 6)
    for k in range(6):
        if k % 4 == 3:
            b[k] = a[k]
        outline = _hull(a[k], b[k], radius, 2.0)
        ours = signed_distance(a[k].expand(60, 3), b[k].expand(60, 3), q, camera, radius)
        spots = shapely.points(q.numpy())
        inside = np.where(shapely.contains(outline, spots), 1.0, -1.0)
        exact = inside * shapely.distance(spots, outline.exterior)
        np.testing.assert_allclose(ours.numpy(), exact, atol=2e-5)


def _ray_frame(camera: Pinhole) -> Frame:
    """The camera as the frame of `knotfab.render` (square pixels, the eye at the origin)."""
    assert camera.pitch[0] == pytest.approx(camera.pitch[1])
    axes, eye = torch.eye(3, dtype=torch.float64), torch.zeros(3, dtype=torch.float64)
    corner = (-0.5 * (camera.width - 1), -0.5 * (camera.height - 1))
    return Frame(axes, eye, *corner, camera.pitch[0] / camera.focal[2], camera.width, camera.height)


def test_images_agree_with_the_ray_distance_form() -> None:
    # one silhouette, two distances: that of the image plane, and that of rays, larger off the axis
    # by at most 1 / cos; sharp images differ by what that leaves at the outline
    camera = paper_camera(width=40, height=32, focal=(1.0, 31 / 39, 2.0))
    a, b, radius = _points(15, 7), _points(15, 8), 0.06
    pixel = camera.pitch[0]
    ours = render_outlines_dense(a, b, camera, radius, TAU)
    rays = render_rays(a, b, _ray_frame(camera), radius, TAU * pixel)
    assert torch.equal(ours > 0.5, rays > 0.5)
    assert float((ours - rays).abs().max()) < 0.06
    assert float((ours - rays).abs().mean()) < 0.006


@pytest.mark.parametrize("ball", [False, True])
@pytest.mark.parametrize("tau", [8.0, 100.0])
def test_winners_give_the_dense_image_and_gradient(ball: bool, tau: float) -> None:
    points = _points(25, 9).requires_grad_()
    ends = None if ball else points.roll(-1, 0)
    weights = torch.rand(CAMERA.height, CAMERA.width, dtype=torch.float64)
    images, gradients = [], []
    for draw in (render_outlines_dense, render_outlines):
        image = draw(points, ends, CAMERA, 0.05, tau)
        (gradient,) = torch.autograd.grad((image * weights).sum(), points)
        images.append(image.detach())
        gradients.append(gradient)
    assert float((images[0] - images[1]).abs().max()) < 2e-7
    assert (gradients[0] - gradients[1]).norm() < 1e-5 * gradients[0].norm()


@pytest.mark.parametrize("ball", [False, True])
def test_gradient_against_finite_differences(ball: bool) -> None:
    points = _points(14, 10)
    generator = torch.Generator().manual_seed(11)
    weights = torch.rand(CAMERA.height, CAMERA.width, generator=generator, dtype=torch.float64)
    camera = camera_around((0.0, 0.0, 3.0), 3.0, 20.0, -10.0, width=40, height=32)

    def value(p: Tensor) -> Tensor:
        image = render_outlines(p, None if ball else p.roll(-1, 0), camera, 0.1, 30.0)
        return (image * weights).sum()

    variable = points.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(value(variable), variable)
    for _ in range(5):
        way = torch.randn(points.shape, generator=generator, dtype=torch.float64)
        h = 1e-6
        slope = (value(points + h * way) - value(points - h * way)) / (2 * h)
        assert float((gradient * way).sum()) == pytest.approx(float(slope), rel=1e-4, abs=1e-5)


# ends of a segment and a motion that makes it an ordinary one
SINGULAR = {
    "equal depths": ([-0.4, 0.1, 3.0], [0.5, -0.2, 3.0]),
    "upright": ([0.2, -0.4, 2.5], [0.2, 0.5, 2.5]),
    "no length": ([0.3, -0.2, 3.0], [0.3, -0.2, 3.0]),
    "one image inside the other": ([0.1, 0.05, 2.0], [0.12, 0.07, 3.0]),
    "along the eye's ray": ([0.2, 0.1, 2.0], [0.3, 0.15, 3.0]),
    "on the axis": ([0.0, 0.0, 2.0], [0.0, 0.0, 3.0]),
    "images that touch inside": ([0.08, 0.0, 2.0], [0.08, 0.0, 3.0]),
}


@pytest.mark.parametrize("case", SINGULAR)
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_singular_capsules_are_their_limits(case: str, dtype: torch.dtype) -> None:
    ends = torch.tensor(SINGULAR[case], dtype=dtype)
    q = _plane(300, 12).to(dtype)
    # the middle of a circle has no one nearest point: any subgradient serves, but not NaN
    q[:1] = 0
    radius, small = 0.08, 1e-7 if dtype == torch.float64 else 1e-4
    generator = torch.Generator().manual_seed(13)

    def at(pair: Tensor) -> tuple[Tensor, Tensor]:
        p = pair.clone().requires_grad_()
        s = signed_distance(p[:1].expand(300, 3), p[1:].expand(300, 3), q, CAMERA, radius)
        slope = torch.stack(
            [torch.autograd.grad(part.sum(), p, retain_graph=True)[0] for part in (s[:1], s[1:])]
        )
        assert bool(s.isfinite().all()) and bool(slope.isfinite().all())
        return s.detach(), slope[1]

    s, slope = at(ends)
    for _ in range(4):
        moved = ends + small * torch.randn(2, 3, generator=generator).to(dtype)
        near, near_slope = at(moved)
        # distances move no faster than the images of the points do
        assert float((near - s).abs().max()) < 10 * small + 1e-5 * (dtype == torch.float32)
        if case not in ("no length", "images that touch inside"):  # there it may jump
            assert float((near_slope - slope).norm()) < 2e-2 * float(slope.norm())


def test_a_segment_towards_the_eye_shows_its_near_end() -> None:
    a = torch.tensor([[0.2, 0.1, 2.0]], dtype=torch.float64).expand(200, 3)
    q = _plane(200, 14)
    alone = signed_distance(a, a, q, CAMERA, 0.1)
    for end in (a * 1.5, a * 1.5 + torch.tensor([0.01, -0.02, 0.0])):
        both = signed_distance(a, end, q, CAMERA, 0.1)
        assert torch.allclose(both, alone, atol=1e-12)
        assert torch.allclose(signed_distance(end, a, q, CAMERA, 0.1), alone, atol=1e-12)


def test_what_reaches_the_eye_is_cut_and_beyond_it_unseen() -> None:
    camera = replace(CAMERA, near=0.05)
    a = torch.tensor([[0.1, 0.0, 2.0], [0.1, 0.0, 2.0], [0.0, 0.0, -1.0], [0.0, 0.3, 2000.0]])
    b = torch.tensor([[0.1, 0.2, 1.0], [0.3, 0.1, -2.0], [0.3, 0.0, -2.0], [0.1, 0.3, 1500.0]])
    a, b = a.double().requires_grad_(), b.double()
    one, two, index = clip_segments(a, b, 0.1, camera.near, camera.far)
    assert index.tolist() == [0, 1]
    assert torch.equal(one, a[:2]) and torch.equal(two[0], b[0])
    assert float(two[1, 2].detach()) == pytest.approx(0.15, abs=1e-12)
    image = render_outlines(a, b, camera, 0.1, TAU)
    (gradient,) = torch.autograd.grad(image.sum(), a)
    assert bool(image.isfinite().all()) and bool(gradient.isfinite().all())
    assert gradient[:2].norm() > 0 and gradient[2:].norm() == 0
    hidden = render_outlines(a[2:].detach(), b[2:], camera, 0.1, TAU)
    assert float(hidden.abs().max()) == 0


def test_few_samples_break_ellipses_and_not_capsules() -> None:
    # the paper's figure of renderings by N shows a circle of radius 1 at depth 3
    def images(count: int) -> tuple[Tensor, Tensor]:
        s = 2 * math.pi * torch.arange(count, dtype=torch.float64) / count
        p = torch.stack([s.cos(), s.sin(), torch.full_like(s, 3.0)], -1)
        return tuple(
            render_outlines(p, e, paper_camera(width=96, height=96), 0.05, 100.0)
            for e in (None, p.roll(-1, 0))
        )  # type: ignore[return-value]

    (few, few_joined), (many, many_joined) = images(24), images(1000)
    assert bool((few <= few_joined + 1e-7).all())
    assert float((many - many_joined).abs().max()) < 0.02
    assert float((few > 0.5).sum()) < 0.7 * float((many > 0.5).sum())
    assert float((few_joined > 0.5).sum()) == pytest.approx(float((many > 0.5).sum()), rel=0.1)


def test_winners_of_before_bound_the_image_from_below() -> None:
    points = _points(30, 15)
    won = winners(points, points.roll(-1, 0), CAMERA, 0.05, 0.2)
    moved = points + 0.01 * torch.randn(30, 3, generator=torch.Generator().manual_seed(1))
    stale = render_outlines(moved, moved.roll(-1, 0), CAMERA, 0.05, TAU, won=won)
    fresh = render_outlines(moved, moved.roll(-1, 0), CAMERA, 0.05, TAU)
    assert bool((stale <= fresh + 1e-5).all())


CASES = {case.name: case for case in render_cases(samples=5_000) if applies(case)}


@pytest.mark.parametrize("balls", [True, False], ids=["ellipse", "capsule"])
@pytest.mark.parametrize("name", some(CASES, 3))
def test_the_papers_renderers_are_within_their_condition(name: str, balls: bool) -> None:
    with torch.autograd.set_detect_anomaly(True):
        error, share, finite = paper_error(CASES[name], balls, most=100)
    assert finite
    assert share <= 1.0
    if CASES[name].real:
        assert error <= 1e-3


def test_the_printed_forms_serve_only_where_nothing_is_hard() -> None:
    assert printed_fails(CASES["ordinary"]) == ""
    for name in ("one depth", "zero length", "towards the light", "sphere in sphere"):
        assert printed_fails(CASES[name]) == "not finite"
        assert bool(distances(CASES[name], torch.float64).s.isfinite().all())
    # in general place its corners lie on the true outline
    one, other = np.array([0.3, -0.2, 3.0]), np.array([-0.4, 0.3, 3.5])
    rays = np.concatenate([printed_corners(one, other, 0.01), np.ones((2, 1))], 1)
    miss = np.linalg.norm(np.cross(rays, one), axis=1) / np.linalg.norm(rays, axis=1)
    assert miss == pytest.approx([0.01, 0.01], rel=1e-4)
