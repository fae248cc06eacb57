"""The flow's own arithmetic: the H1 gradient of each ring."""

import re
import subprocess
import sys
import textwrap
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

import knotfab
from benchmarks.hard.crossing import linking_number, passes_through
from benchmarks.hard.isotopy import fuzz, types_of
from benchmarks.hard.pictures import HardKnot, circle, hard_knots
from knotfab.base.arrays import Array
from knotfab.geometry.carry import certify
from knotfab.geometry.measures import Neighbours, find_neighbours
from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.limits.terms import Felt
from knotfab.search.flow import FlowSettings, precondition
from knotfab.search.optimizer import Adam, CertifiedFlow, descend
from knotfab_formats.errors import InputError


@pytest.mark.parametrize("sigma", [0.0, 0.3, 2.3, 40.0])
def test_the_h1_gradient_solves_its_equation_on_each_ring(sigma: float) -> None:
    rng = np.random.default_rng(1)
    bounds = np.array([0, 1, 3, 6, 22, 119])
    gradient = rng.normal(size=(119, 3))
    found = precondition(gradient, bounds, sigma)
    for begin, end in pairwise(bounds):
        own = np.eye(end - begin)
        bending = 2 * own - np.roll(own, 1, 0) - np.roll(own, -1, 0)
        exact = np.linalg.solve(
            own + sigma**2 * bending, (own - 0.25 * bending) @ gradient[begin:end]
        )
        np.testing.assert_allclose(found[begin:end], exact, rtol=1e-10, atol=1e-12)


def test_the_h1_gradient_keeps_what_moves_a_ring_as_a_whole() -> None:
    rng = np.random.default_rng(2)
    gradient = rng.normal(size=(50, 3))
    found = precondition(gradient, np.array([0, 50]), 4.0)
    np.testing.assert_allclose(found.mean(0), gradient.mean(0), atol=1e-13)
    assert np.ptp(np.diff(found, axis=0)) < 0.3 * np.ptp(np.diff(gradient, axis=0))


@pytest.mark.parametrize("case", hard_knots(), ids=lambda case: case.name)
def test_adversarial_steps_never_change_the_type(case: HardKnot) -> None:
    found = fuzz(case, 150, seed=11)
    assert found.accepted > 0
    assert found.faults == 0
    assert found.changed == 0


def test_the_judge_sees_a_strand_pass_through_another() -> None:
    # the fuzz is worth nothing if its own judge cannot tell
    rings = [circle(7), circle(8) + (2.3, 0.0, 0.1)]
    points, sizes = np.concatenate(rings), polylines_of_sizes((7, 8))
    step = np.zeros_like(points)
    step[7:] = (-1.0, 0.0, -0.2)
    assert passes_through(points, step, sizes.next)
    assert not passes_through(points, 0.1 * step, sizes.next)
    near = find_neighbours(points, sizes, 20.0, 2)
    assert not certify(points, step, sizes, near).valid
    assert certify(points, 0.1 * step, sizes, near).valid
    linked = [rings[0], rings[0][:, [0, 2, 1]] + (1.0, 0.05, 0.03)]
    assert types_of(linked) != types_of(rings)


def test_strands_that_touch_cannot_be_moved_together() -> None:
    points = np.concatenate([circle(10), circle(10)])
    rings = polylines_of_sizes((10, 10))
    near = find_neighbours(points, rings, 10.0, 2)
    step = np.zeros_like(points)
    for size in (0.0, 1e-300, 1e-9, 1.0):
        step[:10, 2] = size
        assert not certify(points, step, rings, near).valid


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_step_that_is_not_finite_is_refused(bad: float) -> None:
    points, rings = circle(10), polylines_of_sizes((10,))
    step = np.zeros_like(points)
    step[3, 1] = bad
    verdict = certify(points, step, rings, find_neighbours(points, rings, 10.0, 2))
    assert not verdict.valid and "finite" in verdict.reason


def test_a_flow_that_is_pulled_through_itself_stops_short() -> None:
    # two rings, one pulled to a place on the other side of the other: it must stay linked
    one = circle(24, 10.0)
    two = one[:, [0, 2, 1]] + (10.0, 0.0, 0.0)
    points, rings = np.concatenate([one, two]), polylines_of_sizes((24, 24))
    goal = np.concatenate([one, two + (30.0, 0.0, 0.0)])

    def pull(p: Array, near: Neighbours, progress: float) -> Felt:
        return float(((p - goal) ** 2).sum()), 2 * (p - goal)

    before = linking_number(one, two)
    assert abs(before) == pytest.approx(1, abs=1e-9)
    result = descend(points, rings, pull, 1.0, FlowSettings(iterations=150, rate=0.5, rate_end=0.5))
    assert np.isfinite(result.points).all()
    assert linking_number(*rings.split(result.points)) == pytest.approx(before, abs=1e-6)
    assert float(((result.points[24:] - goal[24:]) ** 2).sum(1).max()) > 1.0
    assert result.least_margin > 0


def test_a_flat_or_infinite_slope_moves_nothing() -> None:
    points, rings = circle(24, 10.0), polylines_of_sizes((24,))

    def nothing(p: Array, near: Neighbours, progress: float) -> Felt:
        return 0.0, np.zeros_like(p)

    def steep(p: Array, near: Neighbours, progress: float) -> Felt:
        return 1e300 * float(p.sum()), np.full_like(p, 1e300)

    settings = FlowSettings(iterations=5, evening=0.0)
    still = descend(points, rings, nothing, 1.0, settings).points
    assert np.array_equal(still, points)
    moved = descend(points, rings, steep, 1.0, settings).points
    assert np.isfinite(moved).all()


def test_the_optimizer_alone_moves_the_vertices(monkeypatch: pytest.MonkeyPatch) -> None:
    points, rings = circle(24, 10.0), polylines_of_sizes((24,))

    def pull(p: Array, near: Neighbours, progress: float) -> Felt:
        return float((p**2).sum()), 2 * p

    settings = FlowSettings(iterations=5)
    assert not np.array_equal(descend(points, rings, pull, 1.0, settings).points, points)
    monkeypatch.setattr(CertifiedFlow, "step", lambda self: None)
    assert np.array_equal(descend(points, rings, pull, 1.0, settings).points, points)


def test_any_loss_of_torch_drives_it() -> None:
    start, rings = circle(60, 10.0), polylines_of_sizes((60,))
    points = torch.from_numpy(start.copy()).requires_grad_()
    optimizer = CertifiedFlow(points, rings, 1.0, FlowSettings(iterations=40))
    for _ in range(40):
        optimizer.zero_grad()
        loss = (points[:, 0] - 5.0).square().mean()
        loss.backward()
        optimizer.step()
    assert optimizer.result.accepted == 40
    moved = points.detach().numpy()
    assert abs(moved[:, 0].mean() - 5.0) < abs(start[:, 0].mean() - 5.0)
    assert np.array_equal(moved, optimizer.result.points)


@pytest.mark.parametrize("fault", ["no gradient", "not finite", "else than the optimizer"])
def test_what_no_certificate_could_cover_is_refused(fault: str) -> None:
    points = torch.from_numpy(circle(60, 10.0)).requires_grad_()
    optimizer = CertifiedFlow(points, polylines_of_sizes((60,)), 1.0, FlowSettings())
    if fault != "no gradient":
        points.grad = torch.full_like(points, np.nan if fault == "not finite" else 1.0)
    if "else" in fault:
        with torch.no_grad():
            points += 1.0
    with pytest.raises(InputError, match=fault):
        optimizer.step()


# Adam takes the steps of torch's own, without what that loads.


def test_the_first_step_is_the_rate_whatever_the_gradient() -> None:
    x = torch.tensor([3.0, -2.0, 5.0], dtype=torch.float64)
    adam = Adam([x, still := torch.ones(2, dtype=torch.float64)])
    x.grad, still.grad = torch.tensor([1e-3, -40.0, 0.0]).double(), torch.zeros(2).double()
    adam.step((0.25, 1.0))
    assert x.tolist() == pytest.approx([2.75, -1.75, 5.0], abs=1e-5)
    assert still.tolist() == [1.0, 1.0]


def test_the_least_of_a_narrow_bowl_is_found() -> None:
    x = torch.tensor([1.0, 1.0], dtype=torch.float64, requires_grad=True)
    adam = Adam([x], betas=(0.8, 0.95))
    for k in range(600):
        loss = (x**2 * torch.tensor([1.0, 1e3])).sum()
        adam.zero_grad()
        loss.backward()
        adam.step(0.05 * 0.98**k)
    assert x.abs().max() < 1e-4 and x.requires_grad


def test_steps_are_those_of_the_papers_algorithm() -> None:
    """As written down in "Adam: a method for stochastic optimization", with other betas than by default."""
    draw = np.random.default_rng(1)
    x = torch.zeros(3, dtype=torch.float64)
    adam, (first, second) = Adam([x], betas=(0.8, 0.95)), (0.8, 0.95)
    at, mean, square = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(1, 20):
        g, rate = draw.normal(size=3), 0.1 / k
        x.grad = torch.as_tensor(g)
        adam.step(rate)
        mean, square = first * mean + (1 - first) * g, second * square + (1 - second) * g * g
        at -= rate * mean / (1 - first**k) / (np.sqrt(square / (1 - second**k)) + 1e-8)
        assert x.numpy() == pytest.approx(at, rel=1e-12, abs=1e-15)


def test_no_module_takes_an_optimizer_of_torchs_own() -> None:
    """Making one loads a compiler for seconds; its base class is all that is taken of that package."""
    texts = [p.read_text("utf-8") for p in Path(knotfab.__path__[0]).rglob("*.py")]
    taken = {line for text in texts for line in re.findall(r"^.*torch\.optim.*$", text, re.M)}
    assert taken == {"from torch.optim import Optimizer"}


# a process of its own: torch's brings a compiler along that cannot share one with what renders
_BESIDE_TORCH = """
    import sys
    import torch
    import knotfab.apps.paper.network_search, knotfab.search.free_pose
    from knotfab.search.optimizer import Adam

    def run(step, tensors):
        draw = torch.Generator().manual_seed(1)
        for k in range(40):
            for t in tensors:
                t.grad = torch.randn(t.shape, generator=draw, dtype=t.dtype)
            step(0.1 / (1 + k))
        return torch.cat(tensors)

    mine = [torch.zeros(n, dtype=torch.float64) for n in (3, 4)]
    ours = run(Adam(mine, betas=(0.8, 0.95)).step, mine)
    assert "torch._dynamo" not in sys.modules and "triton" not in sys.modules
    theirs = [torch.zeros(n, dtype=torch.float64) for n in (3, 4)]
    adam = torch.optim.Adam(theirs, betas=(0.8, 0.95))

    def step(rate):
        for group in adam.param_groups:
            group["lr"] = rate
        adam.step()

    assert torch.equal(ours, run(step, theirs))
"""


@pytest.mark.study
def test_steps_are_those_of_torch_and_no_compiler_is_loaded() -> None:
    subprocess.run([sys.executable, "-c", textwrap.dedent(_BESIDE_TORCH)], check=True, timeout=120)
