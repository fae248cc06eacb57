"""Adam: the steps of torch's own, without what that loads."""

import subprocess
import sys
import textwrap

import pytest
import torch

from knotfab.torch_forms.adam import Adam


def test_the_first_step_is_the_rate_whatever_the_gradient() -> None:
    x = torch.tensor([3.0, -2.0, 5.0], dtype=torch.float64)
    adam = Adam([x, still := torch.ones(2, dtype=torch.float64)])
    adam.step([torch.tensor([1e-3, -40.0, 0.0]).double(), torch.zeros(2).double()], (0.25, 1.0))
    assert x.tolist() == pytest.approx([2.75, -1.75, 5.0], abs=1e-5)
    assert still.tolist() == [1.0, 1.0]


def test_the_least_of_a_narrow_bowl_is_found() -> None:
    x = torch.tensor([1.0, 1.0], dtype=torch.float64, requires_grad=True)
    adam = Adam([x], betas=(0.8, 0.95))
    for k in range(600):
        loss = (x**2 * torch.tensor([1.0, 1e3])).sum()
        adam.step(torch.autograd.grad(loss, adam.tensors), 0.05 * 0.98**k)
    assert x.abs().max() < 1e-4 and x.requires_grad


# a process of its own: torch's brings a compiler along that cannot share one with what renders
_BESIDE_TORCH = """
    import sys
    import torch
    import knotfab.torch_forms.network_search, knotfab.torch_forms.pose
    from knotfab.torch_forms.adam import Adam

    def run(step, tensors):
        draw = torch.Generator().manual_seed(1)
        for k in range(40):
            step([torch.randn(t.shape, generator=draw, dtype=t.dtype) for t in tensors], 0.1 / (1 + k))
        return torch.cat(tensors)

    mine = [torch.zeros(n, dtype=torch.float64) for n in (3, 4)]
    ours = run(Adam(mine, betas=(0.8, 0.95)).step, mine)
    assert "torch._dynamo" not in sys.modules and "triton" not in sys.modules
    theirs = [torch.zeros(n, dtype=torch.float64) for n in (3, 4)]
    adam = torch.optim.Adam(theirs, betas=(0.8, 0.95))

    def step(gradients, rate):
        for tensor, gradient in zip(theirs, gradients):
            tensor.grad = gradient
        for group in adam.param_groups:
            group["lr"] = rate
        adam.step()

    assert torch.equal(ours, run(step, theirs))
"""


@pytest.mark.slow
def test_steps_are_those_of_torch_and_no_compiler_is_loaded() -> None:
    subprocess.run([sys.executable, "-c", textwrap.dedent(_BESIDE_TORCH)], check=True, timeout=120)
