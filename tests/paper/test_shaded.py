"""The shaded renderer: exact hits, depth order, soft edges, gradients, and what it tells of depth."""

import math

import numpy as np
import pytest
import torch

from knotfab.render.capsules import tensor_frame
from knotfab.render.silhouette import Frame, frame_of
from knotfab.render.tiled import render_tiled
from knotfab.scene.camera import camera_of
from knotfab_formats.scene import ResolvedView
from paper.shaded import curve_distance, fit, trial
from paper.shaded_render import Shading, capsule_hit, layers_of, render_shaded
from tests.corpus.curves import torus_knot

VIEW = ResolvedView(frame_width_mm=160.0, frame_height_mm=160.0)
LAMP = Shading(lamp_mm=(150.0, 200.0, 500.0))
RADIUS = 6.0


def _frame(pixels: int = 48) -> Frame:
    return tensor_frame(frame_of(camera_of(VIEW, pixels, pixels)), torch.float64)


def _strip(*points: tuple[float, float, float]) -> torch.Tensor:
    return torch.tensor(points, dtype=torch.float64)


@pytest.mark.slow
def test_hits_lie_on_the_surface_and_no_earlier_point_is_inside() -> None:
    generator = torch.Generator().manual_seed(3)
    a, b = torch.rand(2, 400, 3, generator=generator, dtype=torch.float64) * 40 - 20
    a, b = a + _strip((0, 0, 300)), b + _strip((0, 0, 300))
    q = torch.rand(400, 2, generator=generator, dtype=torch.float64) * 0.16 - 0.08
    radius = 8.0
    point, normal = capsule_hit(a, b, q[:, 0], q[:, 1], radius)
    ray = torch.cat([q, torch.ones(400, 1, dtype=torch.float64)], 1)
    ray = ray / ray.norm(dim=1, keepdim=True)

    def depth(p: torch.Tensor) -> torch.Tensor:
        """Distance from the segments."""
        share = (((p - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1)).clamp(0, 1)
        return (p - a - share[..., None] * (b - a)).norm(dim=-1)

    along = torch.linspace(250.0, 350.0, 2001, dtype=torch.float64)[:, None, None] * ray
    inside = depth(along) < radius
    # well inside the limb, where the exact point is asked for
    clear = depth(along).amin(0) < 0.98 * radius
    assert clear.sum() > 50
    first = inside.to(torch.int8).argmax(0)
    brute = along[first, torch.arange(400)]
    assert (point - brute).norm(dim=1)[clear].max() <= 0.11  # the samples are 0.05 mm apart
    torch.testing.assert_close(
        depth(point)[clear], torch.full((int(clear.sum()),), radius).double()
    )
    torch.testing.assert_close(normal.norm(dim=1), torch.ones(400, dtype=torch.float64))
    assert ((normal * ray).sum(1)[clear] < 0).all()  # it faces the eye


def test_a_sphere_is_lit_by_the_cosine_of_its_normal() -> None:
    frame, at = _frame(49), _strip((0.0, 0.0, 0.0))
    lamp = Shading(lamp_mm=(0.0, 400.0, 500.0), ambient=0.2, background=0.0)
    image = render_shaded(at, at, frame, 20.0, 8.0, lamp)
    # the middle ray hits (0, 0, 20), whose normal is +z
    cosine = 480.0 / math.hypot(400.0, 480.0)
    assert float(image[24, 24]) == pytest.approx(0.2 + 0.8 * cosine, rel=1e-3)
    assert float(image[18, 24]) > float(image[30, 24])  # lit from above
    assert float(image[0, 0]) == 0.0


@pytest.mark.parametrize("nearer", [10.0, -10.0])
def test_the_strand_in_front_is_seen_whatever_lies_behind(nearer: float) -> None:
    # two crossing bars: the lamp is far to the right, so the upright one is dark on its left side
    across = [(-60.0, 0.0, 0.0), (60.0, 0.0, 0.0)]
    upright = [(0.0, -60.0, nearer), (0.0, 60.0, nearer)]
    frame = _frame(49)
    starts, ends = _strip(across[0], upright[0]), _strip(across[1], upright[1])
    alone = torch.tensor([0, 1])
    lamp = Shading(lamp_mm=(2000.0, 0.0, 500.0))
    both = render_shaded(starts, ends, frame, RADIUS, 8.0, lamp, alone)
    front = 1 if nearer > 0 else 0
    part = slice(front, front + 1)
    single = render_shaded(starts[part], ends[part], frame, RADIUS, 8.0, lamp, torch.tensor([0]))
    other = slice(1 - front, 2 - front)
    wrong = render_shaded(starts[other], ends[other], frame, RADIUS, 8.0, lamp, torch.tensor([0]))
    middle = (slice(23, 26), slice(23, 26))
    torch.testing.assert_close(both[middle], single[middle], rtol=1e-3, atol=1e-3)
    assert float((both[middle] - wrong[middle]).abs().max()) > 0.05


def test_all_white_it_is_the_silhouette_of_one_strand() -> None:
    # ambient 1: every hit is white; a ring never covers itself, so its soft edges are the silhouette's
    s = 2 * np.pi * np.arange(60) / 60
    p = torch.as_tensor(np.column_stack([40 * np.cos(s), 40 * np.sin(s), 8 * np.sin(2 * s)]))
    frame = _frame()
    white = render_shaded(p, p.roll(-1, 0), frame, RADIUS, 2.0, Shading((0, 0, 500), 1.0))
    silhouette = render_tiled(p, p.roll(-1, 0), frame, RADIUS, 2.0)
    # outside the reach of the shaded picture the silhouette is below sigmoid(-6)
    assert float((white - silhouette).abs().max()) < 2.5e-3


def test_the_same_strand_counts_once_where_a_ring_closes() -> None:
    # a ring whose first and last capsules share pixels: coverage 1 - (1 - c)² would show as a bright seam
    s = 2 * np.pi * np.arange(60) / 60
    ring = torch.as_tensor(np.column_stack([40 * np.cos(s), 40 * np.sin(s), 0 * s]))
    frame = _frame()
    ahead = torch.arange(60).roll(-1)
    seen = layers_of(frame.local(ring), frame.local(ring.roll(-1, 0)), frame, RADIUS, 3.0, ahead)
    counts = torch.zeros(48 * 48)
    for pixel, _, _ in seen.layers:
        counts[pixel] += 1
    assert counts.max() == 1
    turned = ring.roll(30, 0)
    one, other = (render_shaded(p, p.roll(-1, 0), frame, RADIUS, 2.0, LAMP) for p in (ring, turned))
    torch.testing.assert_close(one, other, rtol=1e-6, atol=1e-6)


def test_chunks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    p = torch.as_tensor(torus_knot(2, 3, 38.0, 18.0, 60))
    frame = _frame()
    whole = render_shaded(p, p.roll(-1, 0), frame, RADIUS, 2.0, LAMP)
    monkeypatch.setattr("paper.shaded_render._CHUNK", 700)
    parts = render_shaded(p, p.roll(-1, 0), frame, RADIUS, 2.0, LAMP)
    assert torch.equal(whole, parts)


def test_what_is_outside_or_behind_is_not_drawn() -> None:
    away = _strip((900.0, 0.0, 0.0), (0.0, 0.0, 700.0))
    image = render_shaded(
        away, away, _frame(), RADIUS, 2.0, Shading((0, 0, 500), background=0.3), torch.arange(2)
    )
    assert (image == 0.3).all()


def test_gradient_is_that_of_finite_differences() -> None:
    p = torch.as_tensor(torus_knot(2, 3, 38.0, 18.0, 50))
    frame = _frame()
    ahead = torch.arange(50).roll(-1)
    seen = layers_of(frame.local(p), frame.local(p.roll(-1, 0)), frame, RADIUS, 6.0, ahead)
    generator = torch.Generator().manual_seed(4)
    weights = torch.rand(48, 48, generator=generator, dtype=torch.float64)

    def value(points: torch.Tensor) -> torch.Tensor:
        image = render_shaded(points, points.roll(-1, 0), frame, RADIUS, 1.0, LAMP, seen=seen)
        return (image * weights).sum()

    variable = p.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(value(variable), variable)
    assert torch.isfinite(gradient).all()
    for _ in range(5):
        way = torch.randn(p.shape, generator=generator, dtype=torch.float64)
        slope = float(value(p + 1e-6 * way) - value(p - 1e-6 * way)) / 2e-6
        assert float((gradient * way).sum()) == pytest.approx(slope, rel=1e-4, abs=1e-5)


@pytest.mark.slow
def test_shading_tells_the_depth_that_a_silhouette_hides() -> None:
    at = trial(samples=70, pixels=48)
    lit = fit(at, at.shade, 60, 5)
    outlined = fit(at, at.silhouette, 60, 5)
    before = curve_distance(at.start, at.truth)
    after, by_outline = curve_distance(lit, at.truth), curve_distance(outlined, at.truth)
    assert after < 0.5 * before
    assert after < 0.75 * by_outline
