"""The paper's losses: printed definitions as oracles, gradients, and every degenerate curve."""

import math
from collections.abc import Callable
from importlib.util import find_spec

import numpy as np
import pytest
import torch
from knot_curves import judge_type, linking_numbers
from torch import Tensor

from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.problem import ViewNumbers
from knotfab.render.capsules import posed_frame
from knotfab.render.device import render_torch
from knotfab.render.silhouette import Sheet
from knotfab.search.free_pose import Bounds, turn_of
from knotfab_formats.errors import InputError
from knotfab_formats.knots import BRAIDS
from paper.camera import circle, even_ring, random_ring
from paper.curves import closed_braid
from paper.fit_view import fit_view
from paper.losses import (
    ball,
    bending_loss,
    box,
    image_loss,
    knot_lengths,
    length_loss,
    mobius_loss,
    occupancy_loss,
    random_pairs,
    squared_curvature,
)
from paper.table import SECTIONS
from paper.tighten import tighten
from tests.corpus.curves import torus_knot

RADIUS = 0.2


def _generator(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def _tangle(n: int, seed: int, knots: int = 1) -> Tensor:
    return torch.rand(knots, n, 3, generator=_generator(seed), dtype=torch.float64)


def _every_pair(count: int) -> tuple[Tensor, Tensor]:
    u, v = torch.meshgrid(torch.arange(count), torch.arange(count), indexing="ij")
    return u[u != v], v[u != v]


def test_image_loss_is_a_sum_over_pixels() -> None:
    one, two = torch.zeros(3, 4), torch.full((3, 4), 0.5)
    assert float(image_loss(one, two)) == 3.0


def test_length_counts_only_above_the_budget() -> None:
    square = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]], dtype=torch.float64)
    both = torch.cat([square, 2 * square])
    assert knot_lengths(both).tolist() == [4.0, 8.0]
    assert float(length_loss(both, 10.0)) == 2.0
    assert float(length_loss(both, 12.5)) == 0.0


def test_mobius_is_the_printed_sum() -> None:
    knots = _tangle(12, 1, knots=2)
    u, v = _every_pair(24)
    total = 0.0
    for i, j in zip(u.tolist(), v.tolist(), strict=True):
        (k, a), (m, b) = divmod(i, 12), divmod(j, 12)
        d = float((knots[k, a] - knots[m, b]).norm())
        energy = 1 / d**2
        if k == m:
            ways = [
                sum(float((knots[k, s % 12] - knots[k, s % 12 - 1]).norm()) for s in steps)
                for steps in (
                    range(min(a, b) + 1, max(a, b) + 1),
                    range(max(a, b) + 1, min(a, b) + 13),
                )
            ]
            energy -= 1 / min(ways) ** 2
        total += energy * max(2 * RADIUS - d, 0)
    assert total > 0
    ours = mobius_loss(knots, RADIUS, (u, v))
    assert float(ours) == pytest.approx(total / len(u), rel=1e-12)


def test_mobius_sees_strands_that_touch_and_not_a_straight_one() -> None:
    pairs = random_pairs(20_000, 400, _generator(2))
    round_one = circle(1.0)(even_ring(400))
    flat = round_one * torch.tensor([1.0, 0.05, 1.0])  # both sides 0.1 apart
    free = float(mobius_loss(round_one[None], RADIUS, pairs))
    assert float(mobius_loss(flat[None], RADIUS, pairs)) > 100 * free
    # between neighbours of a circle of radius 1 the energy tends to 1 / 12
    near = mobius_loss(round_one[None], RADIUS, (torch.tensor([0]), torch.tensor([2])))
    d = 2 * math.sin(math.pi / 200)
    # g is the way along the polygon
    g = 4 * math.sin(math.pi / 400)
    assert float(near) == pytest.approx((1 / d**2 - 1 / g**2) * (2 * RADIUS - d), rel=1e-9)


def test_occupancy_is_what_sticks_out() -> None:
    spots = torch.tensor([[[0.0, 0, 0], [0.9, 0, 0], [1.5, 0, 0], [1.3, 1.4, 0]]])
    region = box((-1, -1, -1), (1, 1, 1))
    assert torch.allclose(region(spots)[0], torch.tensor([1.0, 0.1, -0.5, -0.5]))
    # with RADIUS 0.2 they count nothing, 0.1, 0.7, 0.7
    assert float(occupancy_loss(spots, RADIUS, region)) == pytest.approx(1.5)
    assert torch.allclose(ball((0, 0, 0), 1.0)(spots)[0, :3], torch.tensor([1.0, 0.1, -0.5]))


def test_curvature_of_a_circle_for_uneven_samples_too() -> None:
    places = torch.cat([even_ring(300), even_ring(300) + 0.001]).sort().values
    squared = squared_curvature(circle(2.0)(places)[None])
    assert torch.allclose(squared, torch.full_like(squared, 0.25), rtol=1e-3)
    assert float(bending_loss(circle(2.0)(places)[None], 0.26)) == 0
    over = float(bending_loss(circle(2.0)(places)[None], 0.15))
    assert over == pytest.approx(600 * 0.1, rel=1e-2)


def test_curvature_is_an_angle_over_a_length() -> None:
    corner = torch.tensor([[[0.0, 0, 0], [2, 0, 0], [2, 1, 0]]], dtype=torch.float64)
    assert float(squared_curvature(corner)[0, 1]) == pytest.approx((math.pi / 2 / 1.5) ** 2)


def _losses(pairs: tuple[Tensor, Tensor]) -> dict[str, Callable[[Tensor], Tensor]]:
    return {
        "length": lambda k: length_loss(k, 0.5),
        "mobius": lambda k: mobius_loss(k, RADIUS, pairs),
        "box": lambda k: occupancy_loss(k, RADIUS, box((0.1, 0.2, 0.3), (0.7, 0.8, 0.9))),
        "ball": lambda k: occupancy_loss(k, RADIUS, ball((0.5, 0.5, 0.5), 0.5)),
        "bending": lambda k: bending_loss(k, 1.0),
    }


def _double() -> Tensor:
    knots = _tangle(20, 6)
    knots[0, 5] = knots[0, 4]
    knots[0, 0] = knots[0, 19]
    return knots


def _crossing() -> Tensor:
    knots = _tangle(20, 7)
    knots[0, 3] = knots[0, 13]
    return knots


def _hairpin() -> Tensor:
    x = torch.cat([torch.arange(10.0), torch.arange(10.0, 0, -1)]) / 10
    return torch.stack([x, 0 * x, 0 * x], -1)[None].double()


DEGENERATE: dict[str, Callable[[], Tensor]] = {
    "doubled points": _double,
    "coincident points": _crossing,
    "there and back on a straight line, two cusps": _hairpin,
    "one point": lambda: torch.full((1, 20, 3), 0.3, dtype=torch.float64),
    "two knots in one place": lambda: _tangle(10, 8).repeat(2, 1, 1),
    "minute": lambda: 1e-200 * _tangle(20, 9),
    "huge": lambda: 1e100 * _tangle(20, 10),
    "nearly doubled": lambda: _double() + 1e-15 * _tangle(20, 11),
}


@pytest.mark.parametrize("case", DEGENERATE)
@pytest.mark.parametrize("name", ["length", "mobius", "box", "ball", "bending"])
def test_degenerate_curves_have_finite_values_and_gradients(case: str, name: str) -> None:
    knots = DEGENERATE[case]().requires_grad_()
    value = _losses(_every_pair(20))[name](knots)
    (gradient,) = torch.autograd.grad(value, knots)
    assert bool(value.isfinite()) and bool(gradient.isfinite().all())


def test_degenerate_limits() -> None:
    straight = squared_curvature(_hairpin())[0]
    # ten steps of 0.1 there and back: half a turn at either end, none between
    ends = torch.tensor([0, 10])
    assert torch.allclose(straight[ends], torch.tensor((math.pi / 0.1) ** 2).double(), rtol=1e-6)
    assert float(straight.sum() - straight[ends].sum()) == pytest.approx(0, abs=1e-9)
    assert float(length_loss(torch.zeros(1, 5, 3), 1.0)) == 0
    assert float(mobius_loss(torch.zeros(1, 5, 3), RADIUS, _every_pair(5))) == 0
    # strands that meet are pushed apart: the energy grows as they near, to the last
    near = [_strands(gap) for gap in (0.1, 0.01, 0.003)]
    values = [float(mobius_loss(k, RADIUS, _every_pair(20))) for k in near]
    assert values[0] < values[1] < values[2]


def _strands(gap: float) -> Tensor:
    """A loop whose two long sides are `gap` apart."""
    x = torch.cat([torch.arange(10.0), torch.arange(9.0, -1, -1)])
    y = torch.cat([torch.zeros(10), torch.full((10,), gap)])
    return torch.stack([x, y, 0 * x], -1)[None].double()


def test_random_pairs_are_of_different_points_and_reach_all() -> None:
    u, v = random_pairs(5000, 7, _generator(12))
    assert bool((u != v).all())
    assert len(set(zip(u.tolist(), v.tolist(), strict=True))) == 42


def test_random_rings_are_sorted_and_repeatable() -> None:
    one, two = random_ring(100, _generator(13)), random_ring(100, _generator(13))
    assert torch.equal(one, two) and bool((one.diff() >= 0).all())
    assert float(one[0]) >= 0 and float(one[-1]) < 1


# Closed braids are the links that they are called; test_corpus has the other curves judged.


def test_two_positive_letters_are_a_right_handed_hopf_link() -> None:
    assert linking_numbers(*closed_braid([1, 1])) == [1]
    assert linking_numbers(*closed_braid([-1, -1, -1, -1])) == [-2]


@pytest.mark.parametrize("word", [[], [1, 0]])
def test_a_braid_of_no_letters_is_refused(word: list[int]) -> None:
    with pytest.raises(InputError, match="must not be 0"):
        closed_braid(word)


# Poses are found again from shadows of knots that are known.


TREFOIL = torus_knot(2, 3, 35.0, 18.0, 120)


def _numbers(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def _shadow(points: np.ndarray, numbers: ViewNumbers, sheet: Sheet) -> torch.Tensor:
    n = numbers
    at = _numbers(n.azimuth_deg, n.elevation_deg, n.roll_deg)
    frame = posed_frame(sheet, at, *_numbers(n.light_distance_mm, n.wall_distance_mm))
    p = torch.as_tensor(points)
    return (render_torch(p, p.roll(-1, 0), frame, n.radius_mm, 10.0) > 0.5).float()


def _angle_deg(one: ViewNumbers, other: ViewNumbers) -> float:
    cosine = 0.5 * (np.trace(turn_of(one).T @ turn_of(other)) - 1)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.8, 1.2])
def test_pose_and_light_distance_are_found_again(share: float) -> None:
    sheet = Sheet(112, 112, 1.8)
    truth = ViewNumbers(400.0, 100.0, 3.0, 8.0, -14.0, 11.0)
    start = ViewNumbers(400.0 * share, 100.0, 3.0, 20.0, -2.0, -1.0)
    assert _angle_deg(start, truth) > 15
    rings = polylines_of_sizes((len(TREFOIL),))
    bounds = Bounds(("azimuth", "elevation", "roll", "light"))
    found = fit_view(TREFOIL, rings, sheet, _shadow(TREFOIL, truth, sheet), start, bounds, 60)
    assert _angle_deg(found.numbers, truth) < 0.5
    assert found.numbers.light_distance_mm == pytest.approx(400.0, rel=0.02)
    assert (found.numbers.wall_distance_mm, found.numbers.radius_mm) == (100.0, 3.0)


# The table of what compares with the paper: each of its commands is there.


@pytest.mark.parametrize("name", SECTIONS)
def test_every_section_is_a_module(name: str) -> None:
    assert find_spec(SECTIONS[name].module) is not None


# A braid is tightened to a short knot of its type.


@pytest.mark.slow
def test_tightening_a_braid_gives_a_short_knot_of_its_type() -> None:
    tight = tighten(closed_braid(BRAIDS["3_1"])[0])
    # the ropelength of the trefoil is 32.74 (radius 1): the polygon comes near from above
    assert 32.7 < tight.length < 34.0
    assert tight.gap >= 2.0 and tight.bend >= 1.0
    assert judge_type(tight.points)[0] == "right-handed 3_1, proved"
