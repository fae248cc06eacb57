"""Adam takes the steps of torch's own, without what that loads."""

from __future__ import annotations

import re
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import torch

import knotfab
from knotfab.search.optimizer import Adam


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
