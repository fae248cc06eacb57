"""The invertible network: exact inverses, the paper's errata, and weights that mean ill."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from questions import ask_heart, start_and_search
from torch import Tensor

from knotfab.apps.paper import network_search
from knotfab.apps.paper.network_search import Coupling, CouplingNetwork, Perceptron, Rigid, rotation
from knotfab.base.errors import SceneError
from knotfab.geometry.carry import Carried
from knotfab.problem import Problem
from knotfab.search.state import SearchResult
from knotfab.start.filling import Template
from knotfab.start.start import start_at_circles
from knotfab_formats.errors import InputError
from knotfab_formats.search import PRESETS, SearchSettings, search_settings

DTYPES = (torch.float64, torch.float32)
ORDERS = tuple(itertools.permutations(range(3)))


def _points(count: int, dtype: torch.dtype = torch.float64, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return (2 * torch.rand(count, 3, generator=generator, dtype=torch.float64) - 1).to(dtype)


def _shaken(network: torch.nn.Module, size: float, seed: int = 1) -> None:
    """Normal weights of standard deviation `size` everywhere."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for weight in network.parameters():
            weight.copy_(size * torch.randn(weight.shape, generator=generator, dtype=torch.float64))


def _layer(order: tuple[int, ...], dtype: torch.dtype = torch.float64) -> Coupling:
    generator = torch.Generator().manual_seed(3)
    layer = Coupling(torch.tensor(order), 16, 1.0, 2.0, generator, dtype)
    _shaken(layer, 0.5)
    return layer


def _rounding(net: Perceptron, uv: Tensor) -> Tensor:
    """[N] what one unit of relative rounding in its sums may change a perceptron's output by."""
    inner = net.hidden(uv)
    terms = uv.abs() @ net.hidden.weight.abs().T + net.hidden.bias.abs()
    unit = torch.tanh(inner).abs() + terms / torch.cosh(inner.clamp(-300, 300)) ** 2
    return (unit @ net.out.weight.abs().T + net.out.bias.abs())[:, 0]


def _jacobians(of_points: Callable[[Tensor], Tensor], points: Tensor) -> Tensor:
    """[N, 3, 3] of a map that takes each point on its own; torch.func's would load torch's compiler."""
    at = points.detach().requires_grad_()
    sums = of_points(at).sum(0)
    rows = [torch.autograd.grad(sums[k], at, retain_graph=True)[0] for k in range(3)]
    return torch.stack(rows, dim=1)


def _condition(network: CouplingNetwork, points: Tensor) -> Tensor:
    """[N] what one unit of relative rounding in each layer does to a point that goes there and back.

    With y_k the point after the first k layers and J_k their Jacobian, an error of |y_k| there and as much
    again on the way back comes to |inv J_k| |y_k| at the start: the condition number of the
    first k layers as a map, at this point. The sum over k bounds all of it to first order.
    """
    total = torch.zeros(len(points), dtype=torch.float64)
    jacobian = torch.eye(3, dtype=torch.float64).expand(len(points), 3, 3)
    y = points
    for layer in network.layers:
        jacobian = _jacobians(layer, y) @ jacobian
        before, y = y, layer(y)
        within = y.abs().amax(1) + before.abs().amax(1)
        if isinstance(layer, Coupling):
            uv = y[:, layer.order[:2]]
            steep = 1 / torch.cosh((layer.scale(uv)[:, 0] / layer.log_scale).clamp(-300, 300)) ** 2
            of_scale = 1 + steep * _rounding(layer.scale, uv)
            within = within * of_scale + _rounding(layer.shift, uv) * (1 + of_scale)
        else:
            within = within + layer.shift.abs().amax()
        total = total + torch.linalg.matrix_norm(torch.linalg.inv(jacobian), 2) * within
    return total.detach()


@pytest.mark.parametrize("dtype", DTYPES)
def test_the_start_is_the_identity_and_share_0_is_always(dtype: torch.dtype) -> None:
    network = CouplingNetwork(5, 16, 2, dtype=dtype)
    x = _points(40, dtype)
    assert (network(x) == x).all()
    assert network(x).dtype == dtype
    _shaken(network, 1.0)
    assert not torch.allclose(network(x), x, atol=0.1)
    assert (network(x, 0.0) == x).all()
    assert torch.equal(network(x, 1.0), network(x))


@pytest.mark.slow
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("depth", [1, 8, 64])
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_there_and_back_again(dtype: torch.dtype, depth: int, share: float) -> None:
    network = CouplingNetwork(depth, 32, depth, dtype=dtype)
    _shaken(network, 0.1)
    x = _points(60, dtype)
    back = network.inverse(network(x, share), share)
    if share < 1:
        assert torch.allclose(back, x, atol=1e4 * torch.finfo(dtype).eps)
        return
    exact = CouplingNetwork(depth, 32, depth)
    exact.load_state_dict(network.state_dict())
    bound = torch.finfo(dtype).eps * _condition(exact.double(), x.double())
    assert bound.median() < 1e-2  # the bound says something
    assert ((back - x).norm(dim=1) <= bound).all()
    if dtype == torch.float64 and depth < 64:  # and the other way about
        torch.testing.assert_close(network(network.inverse(x)), x, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_every_layer_keeps_the_handedness() -> None:
    network = CouplingNetwork(6, 16, 4)
    _shaken(network, 2.0)
    jacobian = _jacobians(network, _points(200))
    sign, _ = torch.linalg.slogdet(jacobian)
    assert (sign > 0).all()
    for layer in network.layers:
        if isinstance(layer, Coupling):
            each = torch.linalg.det(_jacobians(layer, _points(200)))
            assert (each >= np.exp(-1.0) * (1 - 1e-12)).all()
            assert (each <= np.exp(1.0) * (1 + 1e-12)).all()


def _apply_as_printed(layer: Coupling, points: Tensor) -> Tensor:
    """The inverse pass as printed: permuted by the inverse of the order first, by the order last."""
    ordered = points[..., layer.back]
    uv, w = ordered[..., :2], ordered[..., 2:]
    scale, shift = layer._affine(uv, 1.0)
    return torch.cat([uv, (w - shift) / scale], -1)[..., layer.order]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.slow
def test_the_printed_inverse_is_wrong_for_order_three(order: tuple[int, ...]) -> None:
    layer, x = _layer(order), _points(50)
    y = layer(x)
    torch.testing.assert_close(layer.inverse(y), x, rtol=0, atol=1e-14)
    third = order in ((1, 2, 0), (2, 0, 1))
    error = float((_apply_as_printed(layer, y) - x).abs().max().detach())
    assert error > 0.1 if third else error < 1e-14


@pytest.mark.parametrize(
    "turn", [(0, 0, 0), (1e-9, 0, 0), (0.3, -2, 1), (1e3, 1, 0), (0, 1e200, 1e200)]
)
def test_rotations_are_rotations(turn: tuple[float, ...]) -> None:
    half = torch.tensor(turn, dtype=torch.float64, requires_grad=True)
    matrix = rotation(half)
    torch.testing.assert_close(
        matrix @ matrix.T, torch.eye(3, dtype=torch.float64), rtol=0, atol=1e-15
    )
    assert float(torch.linalg.det(matrix).detach()) == pytest.approx(1, abs=1e-15)
    close = 1e-15 * float(half.detach().abs().max())
    torch.testing.assert_close(matrix @ half, half, rtol=1e-14, atol=close)
    angle = 2 * np.arctan(
        float(
            half.detach().abs().max() * (half / half.abs().max().clamp_min(1e-300)).norm().detach()
        )
    )
    assert float(matrix.trace().detach()) == pytest.approx(1 + 2 * np.cos(angle), abs=1e-14)
    (gradient,) = torch.autograd.grad(matrix.sum(), half)
    assert torch.isfinite(gradient).all()


def test_rigid_layers_turn_about_the_origin_then_shift() -> None:
    layer = Rigid()
    with torch.no_grad():
        layer.turn.copy_(torch.tensor([0.0, 0.0, 1.0]))  # a quarter turn about z
        layer.shift.copy_(torch.tensor([5.0, 0.0, 0.0]))
    x = torch.tensor([1.0, 0.0, 2.0], dtype=torch.float64)
    torch.testing.assert_close(layer(x), torch.tensor([5.0, 1.0, 2.0], dtype=torch.float64))
    torch.testing.assert_close(layer.inverse(layer(x)), x, rtol=0, atol=1e-15)


def test_seeds_and_precisions() -> None:
    one, same, other = (CouplingNetwork(6, 8, seed) for seed in (0, 0, 1))
    for a, b in zip(one.state_dict().values(), same.state_dict().values(), strict=True):
        assert torch.equal(a, b)
    assert any(
        not torch.equal(a, b)
        for a, b in zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    )
    single = CouplingNetwork(6, 8, 0, dtype=torch.float32).state_dict()
    for name, value in one.state_dict().items():
        torch.testing.assert_close(single[name], value.to(single[name].dtype), rtol=0, atol=0)
    found = {
        tuple(layer.order.tolist())
        for layer in CouplingNetwork(200, 1, 0).layers
        if isinstance(layer, Coupling)
    }
    assert found == set(ORDERS)


def test_layers_alternate_and_shapes_are_kept() -> None:
    network = CouplingNetwork(3, 4)
    kinds = [type(layer) for layer in network.layers]
    assert kinds == [Rigid, Coupling, Rigid, Coupling, Rigid, Coupling, Rigid]
    assert network(torch.zeros(2, 5, 3, dtype=torch.float64)).shape == (2, 5, 3)
    assert network(torch.zeros(3, dtype=torch.float64)).shape == (3,)
    for bad in ({"depth": 0}, {"width": 0}, {"log_scale": 0.0}, {"gain": float("nan")}):
        with pytest.raises(ValueError, match="positive"):
            CouplingNetwork(**bad)


# The network's search: samples whose type is proved, honest refusals, and pictures that get better.


RADIUS = 5.0
QUICK = PRESETS["draft"].model_copy(
    update={
        "coarse_px": 96,
        "fine_px": 128,
        "coarse_iterations": 25,
        "fine_iterations": 20,
        "depth_candidates": 60,
        "method": "inn",
        "network_depth": 6,
        "network_width": 32,
        "network_iterations": 60,
    }
)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return ask_heart()


def _search(
    problem: Problem, settings: SearchSettings, repairs: int = 0
) -> tuple[SearchResult, list[float], list[float]]:
    """The result, and the shares done and the IoU that were reported on the way."""
    shares: list[float] = []
    seen: list[float] = []

    def report(share: float, iou: float | None) -> None:
        shares.append(share)
        seen.append(iou or 0.0)

    result = start_and_search(problem, RADIUS, settings, repairs=repairs, report=report)
    return result, shares, seen


@pytest.mark.slow
def test_circles_are_convex_and_in_planes_of_their_own(problem: Problem) -> None:
    curves = (np.array([[0.0, 0], [40, 0], [40, 90]]), np.array([[1.0, 0], [1, 9], [0, 0]]))
    template = Template(curves, problem.polygons[0], 2.0)
    start = start_at_circles(replace(problem, clearance=0.5), 2.0, QUICK, template)
    assert start.far and start.types == ("unknot", "unknot")
    found = start.curves
    for circle, middle, around in zip(found, ([20, 45], [0.5, 4.5]), (14.0, 8.0), strict=True):
        assert np.ptp(circle[:, 2]) == 0
        np.testing.assert_allclose(np.linalg.norm(circle[:, :2] - middle, axis=1), around)
    assert found[1][0, 2] - found[0][0, 2] == 9.0


@pytest.mark.slow
def test_from_a_circle_the_picture_is_found_and_the_type_kept(problem: Problem) -> None:
    circle = QUICK.model_copy(update={"network_start": "circle"})
    result, _, seen = _search(problem, circle)
    assert result.log.certified
    assert "circle" in result.log.template
    assert result.depth is None
    assert result.iou_estimate > seen[0] + 0.1


@pytest.mark.slow
def test_network_then_flow_ends_feasible(problem: Problem) -> None:
    settings = QUICK.model_copy(update={"method": "inn+flow", "network_iterations": 30})
    result, fractions, _ = _search(problem, settings, repairs=4)
    assert result.feasible
    assert result.log.certified
    assert result.iou_estimate > 0.97
    assert fractions == sorted(fractions)
    assert fractions[-1] <= 1


@pytest.mark.slow
def test_the_same_seed_gives_the_same_knots(problem: Problem) -> None:
    short = QUICK.model_copy(update={"network_iterations": 5})
    one, two = (_search(problem, short)[0].knots.points for _ in range(2))
    assert (one == two).all()


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.7, 0.0])
def test_what_cannot_be_carried_stays_where_it_is_certified(
    problem: Problem, monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    tried: list[np.ndarray] = []

    def stuck(
        points: np.ndarray, _: object, path: Callable[..., np.ndarray], *__: object
    ) -> Carried:
        tried.append(path(points, share))
        return Carried(tried[-1], share, 12, 3, 0.1)

    monkeypatch.setattr(network_search, "carry", stuck)
    short = QUICK.model_copy(update={"network_iterations": 3})
    result = _search(problem, short)[0]
    assert result.log.certified
    counts = [len(points) for points in tried]
    assert [b / a for a, b in pairwise(counts)] == [2.0] * 5
    if share > 0:
        assert "70.0% of the way" in result.log.template
    else:  # nothing could be carried: the start, whose type is known
        assert "no step of it could be certified" in result.log.template
    # repairs would carry all that proved nothing
    assert sum(len(k.points) for k in result.knots.knots) <= 2 * counts[0]


@pytest.mark.parametrize(
    ("reached", "told"),
    [
        (1.0, "its samples"), (0.9996, "99.9% of the way"), (0.7, "70.0% of the way"), (0.0, "certified"),
    ],
)  # fmt: skip
def test_what_is_not_all_of_the_way_is_not_told_as_all(reached: float, told: str) -> None:
    way = Carried(np.zeros((3, 3)), reached, 12 if reached else 0, 3, 0.1)
    said = network_search._describe(way, 1)
    assert said.endswith(told) and ("in 12 steps" in said) == (reached > 0)


@pytest.mark.slow
def test_the_flow_runs_no_network(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    def explode(*_: object, **__: object) -> None:
        raise AssertionError("a network where none is asked for")

    monkeypatch.setattr(network_search, "CouplingNetwork", explode)
    flow = QUICK.model_copy(update={"method": "flow", "coarse_iterations": 2})
    flow = flow.model_copy(update={"fine_iterations": 0, "settle_iterations": 0})
    _search(problem, flow)
    with pytest.raises(AssertionError, match="none is asked for"):
        _search(problem, QUICK)


@pytest.mark.slow
def test_a_circle_cannot_be_a_trefoil(problem: Problem) -> None:
    settings = QUICK.model_copy(update={"network_start": "circle"})
    tied = replace(problem, knot="trefoil")
    with pytest.raises(SceneError, match="a trefoil is asked for"):
        _search(tied, settings)


def test_settings_of_the_network() -> None:
    assert SearchSettings().method == "flow"
    assert search_settings("draft", {"method": "inn+flow"}).method == "inn+flow"
    with pytest.raises(InputError, match=r"\[search\] method"):
        search_settings("draft", {"method": "sgd"})
    with pytest.raises(InputError, match=r"\[search\] network_depth"):
        search_settings("draft", {"network_depth": 0})
    assert SearchSettings(network_iterations=100).scaled(0.5).network_iterations == 50
