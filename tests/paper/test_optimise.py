"""The paper's loop: each setting improves, stays finite at absurd rates, repeats itself, and refuses."""

import math

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from knotfab.apps.paper.outlines import Pinhole, render_outlines
from knotfab.base.errors import SceneError
from knotfab_formats.errors import InputError
from paper.camera import camera_around, circle, even_ring, paper_camera
from paper.losses import ball
from paper.optimise import PaperResult, PaperView, iou, search_paper
from paper.settings import PAPER

pytestmark = pytest.mark.slow

CAMERA = paper_camera(width=32, height=32)
SMALL = PAPER.model_copy(
    update={
        "radius": 0.12,
        "samples": 60,
        "pairs": 2000,
        "tau": 40.0,
        "depth": 2,
        "width": 16,
        "learning_rate": 1e-2,
        "iterations": 40,
        "resample_every": 2,
    }
)


def _view(camera: Pinhole, *loops: Tensor) -> PaperView:
    """A camera and the hard image of loops [n, 3] at radius 0.12."""
    starts = torch.cat(loops)
    ends = torch.cat([loop.roll(-1, 0) for loop in loops])
    return PaperView(camera, (render_outlines(starts, ends, camera, 0.12, 40.0) > 0.5).double())


def _oval(wide: float, high: float, x: float = 0.0) -> Tensor:
    p = circle()(even_ring(60)) * torch.tensor([wide, high, 1.0], dtype=torch.float64)
    return p + torch.tensor([x, 0.0, 3.0], dtype=torch.float64)


def _assert_improvement(result: PaperResult) -> None:
    assert result.losses[-1]["image"] < 0.5 * result.losses[0]["image"]
    assert np.mean(result.final_ious) > np.mean(result.ious[0]) + 0.1
    assert len(result.losses) == len(result.ious) == SMALL.iterations
    for terms in result.losses:
        parts = [value for name, value in terms.items() if name != "total"]
        assert terms["total"] == pytest.approx(sum(parts))
    assert result.cpu_seconds > 0 and result.seconds > 0


@pytest.mark.parametrize("renderer", [pytest.param("ellipse", marks=pytest.mark.study), "capsule"])
def test_one_view_one_knot(renderer: str) -> None:
    settings = SMALL.model_copy(update={"renderer": renderer})
    seen: list[int] = []
    result = search_paper(
        [_view(CAMERA, _oval(0.75, 1.2))], settings, report=lambda i, _: seen.append(i)
    )
    _assert_improvement(result)
    assert [k.shape for k in result.knots] == [(60, 3)]
    assert seen == list(range(40))
    if renderer == "capsule":
        again = search_paper([_view(CAMERA, _oval(0.75, 1.2))], settings)
        assert all(np.array_equal(a, b) for a, b in zip(result.knots, again.knots, strict=True))
        assert again.losses == result.losses


def test_one_view_several_knots() -> None:
    view = _view(CAMERA, _oval(0.3, 0.8, -0.7), _oval(0.3, 0.8, 0.7))
    templates = [circle(0.4, (-0.6, 0.0, 0.0)), circle(0.4, (0.6, 0.0, 0.0))]
    result = search_paper([view], SMALL, templates=templates)
    _assert_improvement(result)
    assert [k.shape for k in result.knots] == [(60, 3), (60, 3)]
    # carried by one homeomorphism, they keep their sides
    assert result.knots[0][:, 0].mean() < -0.3 < 0.3 < result.knots[1][:, 0].mean()


def test_several_views_one_knot() -> None:
    # a tilted ring, from in front and from the side
    s = 2 * math.pi * even_ring(60)
    ring = torch.stack([s.cos(), s.sin(), 3 + 0.25 * s.cos()], -1)
    cameras = [
        camera_around((0.0, 0.0, 3.0), 3.0, azimuth, width=32, height=32) for azimuth in (0, 90)
    ]
    result = search_paper([_view(camera, ring) for camera in cameras], SMALL)
    _assert_improvement(result)
    assert len(result.final_ious) == 2
    assert result.final_ious[1] > result.ious[0][1] + 0.1


def test_terms_are_those_that_are_asked_for() -> None:
    view = _view(CAMERA, _oval(0.75, 1.2))
    short = SMALL.model_copy(update={"iterations": 1, "mobius_weight": 0.0})
    assert set(search_paper([view], short).losses[0]) == {"image", "total"}
    every = short.model_copy(update={"mobius_weight": 1e-3, "longest": 3.0, "sharpest": 0.5})
    result = search_paper([view], every, region=ball((0.0, 0.0, 3.0), 1.0))
    first = result.losses[0]
    assert set(first) == {"image", "length", "mobius", "occupancy", "bending", "total"}
    # the circle of radius 1 is a random polygon, and every ball of 0.12 sticks out by 0.12
    assert first["length"] == pytest.approx(1e-2 * (2 * math.pi - 3), rel=0.02)
    assert first["occupancy"] == pytest.approx(1e-2 * 60 * 0.12, rel=1e-6)


def test_the_length_budget_is_kept() -> None:
    view = _view(CAMERA, _oval(1.2, 1.2))
    settings = SMALL.model_copy(update={"longest": 5.0, "length_weight": 1e3})
    knot = search_paper([view], settings).knots[0]
    assert np.linalg.norm(np.roll(knot, -1, 0) - knot, axis=1).sum() < 5.3


@pytest.mark.parametrize("renderer", ["ellipse", "capsule"])
@pytest.mark.parametrize("rate", [1e3])
def test_absurd_rates_stay_finite(renderer: str, rate: float) -> None:
    settings = SMALL.model_copy(
        update={
            "renderer": renderer,
            "learning_rate": rate,
            "iterations": 12,
            "longest": 5.0,
            "sharpest": 4.0,
        }
    )
    result = search_paper(
        [_view(CAMERA, _oval(0.75, 1.2))], settings, region=ball((0.0, 0.0, 3.0), 1.5)
    )
    assert all(math.isfinite(value) for terms in result.losses for value in terms.values())
    assert all(np.isfinite(k).all() for k in result.knots)


class _Broken(nn.Module):
    """A map that loses its points at the second call."""

    def __init__(self) -> None:
        super().__init__()
        self.shift = nn.Parameter(torch.zeros(3, dtype=torch.float64))
        self.calls = 0

    def forward(self, points: Tensor) -> Tensor:
        self.calls += 1
        return points + self.shift + (math.nan if self.calls > 1 else 0.0)


def test_a_loss_that_is_not_finite_is_named() -> None:
    with pytest.raises(SceneError, match="iteration 1: its loss or its points"):
        search_paper([_view(CAMERA, _oval(0.75, 1.2))], SMALL, network=_Broken())


def test_wrong_calls_are_refused() -> None:
    with pytest.raises(InputError, match="no view"):
        search_paper([], SMALL)
    with pytest.raises(InputError, match="picture of view 1"):
        search_paper([PaperView(CAMERA, torch.zeros(8, 8))], SMALL)


def test_iou() -> None:
    one = torch.tensor([[1.0, 1.0, 0.0, 0.0]])
    assert iou(one, torch.tensor([[1.0, 0.0, 1.0, 0.0]])) == pytest.approx(1 / 3)
    assert iou(0 * one, 0 * one) == 1.0
