"""The comparison's mesh: its soft silhouette is right, it follows a disc, and it cannot make a hole."""

import numpy as np
import pytest
import torch

from paper.sphere_mesh import fit_sphere, hard_silhouette, holes, soft_silhouette


def _disc(pixels: int, radius: float, hole: float = 0.0) -> torch.Tensor:
    at = (torch.arange(pixels) + 0.5) * 2 / pixels - 1
    r = (at[:, None] ** 2 + at[None] ** 2).sqrt()
    return ((r < radius) & (r >= hole)).float()


def test_the_soft_silhouette_is_that_of_the_triangle() -> None:
    corners = torch.tensor([[[-0.5, -0.5], [0.6, -0.4], [0.0, 0.7]]], dtype=torch.float64)
    image = soft_silhouette(corners, 64, 1e-4)
    area = float((image > 0.5).sum()) * (2 / 64) ** 2
    exact = 0.5 * abs(1.1 * 1.2 - 0.5 * 0.1)
    assert area == pytest.approx(exact, rel=0.02)
    # the point lies at a known distance below the lower edge's middle: straight up in the picture
    assert float(image[5, 32]) < 1e-3 and float(image[30, 32]) > 0.99


def test_triangles_over_each_other_count_as_a_union() -> None:
    one = torch.tensor([[[-0.5, -0.5], [0.6, -0.4], [0.0, 0.7]]], dtype=torch.float64)
    single = soft_silhouette(one, 32, 1e-2)
    both = soft_silhouette(torch.cat([one, one]), 32, 1e-2)
    torch.testing.assert_close(both, 1 - (1 - single) ** 2)


def test_its_gradient_against_finite_differences() -> None:
    generator = torch.Generator().manual_seed(2)
    corners = torch.rand(6, 3, 2, generator=generator, dtype=torch.float64) * 1.6 - 0.8
    weights = torch.rand(24, 24, generator=generator, dtype=torch.float64)

    def value(c: torch.Tensor) -> torch.Tensor:
        return (soft_silhouette(c, 24, 1e-2) * weights).sum()

    variable = corners.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(value(variable), variable)
    way = torch.randn(corners.shape, generator=generator, dtype=torch.float64)
    slope = float(value(corners + 1e-7 * way) - value(corners - 1e-7 * way)) / 2e-7
    assert float((gradient * way).sum()) == pytest.approx(slope, rel=1e-4)


def test_holes_are_counted() -> None:
    assert holes(_disc(80, 0.8).numpy() > 0) == 0
    assert holes(_disc(80, 0.8, 0.4).numpy() > 0) == 1
    speck = _disc(80, 0.8).numpy() > 0
    speck[40, 40] = False
    assert holes(speck) == 0


@pytest.mark.slow
def test_a_sphere_becomes_an_oval_and_never_a_ring() -> None:
    at = (torch.arange(40) + 0.5) / 20 - 1
    oval = ((at[:, None] / 0.8) ** 2 + (at[None] / 0.5) ** 2 < 1).float()
    ring = _disc(40, 0.8, 0.4)
    masks = [hard_silhouette(*fit_sphere(t, 60, 2), 160) for t in (oval, ring)]
    wanted = [np.kron(t.numpy(), np.ones((4, 4))) > 0 for t in (oval, ring)]
    shares = [(m & w).sum() / (m | w).sum() for m, w in zip(masks, wanted, strict=True)]
    assert shares[0] > 0.93
    assert shares[1] < 0.85
    assert holes(masks[1]) == 0 and holes(wanted[1]) == 1
