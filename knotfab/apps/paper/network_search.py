"""The paper's search: optimise the weights of an invertible network that maps a template to the knots."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from knotfab.base.arrays import Array
from knotfab.geometry.carry import (
    Carried,
    Curves,
    Parameters,
    carry,
    certify_same_type,
    refine_parameters,
    space_evenly,
)
from knotfab.geometry.measures import Neighbours
from knotfab.geometry.polylines import dot, polylines_of, split_alike
from knotfab.problem import Report
from knotfab.search.flow import find_felt, three_phases
from knotfab.search.optimizer import Adam, one_thread
from knotfab.search.state import SearchState

_REFRESH = 40  # iterations after which the curves are sampled evenly again
_EDGE = 0.8  # vertex spacing in tube radii, coarser than the flow's, whose vertices are all free
_TAU = (1.0, 6.0)  # softer at first than the flow's, since there is farther to go
_FURTHER = 2.0  # ratio of the rate from a circle to that from a filling template
_SLOPE = 20.0  # slope of the hidden units, each of which bends about a twentieth of the piece
_FINE = 0.6  # share of the iterations after which the fine picture is used


@dataclass(frozen=True)
class _Map:
    """The network as an isotopy of points in mm; its unit is `size` mm."""

    network: CouplingNetwork
    size: float
    device: str

    def __call__(self, points: Array, share: float = 1.0) -> Array:
        """Map points (N, 3) a share of the way from the identity, 0, to the network, 1."""
        with torch.no_grad():
            there = self.network(torch.as_tensor(points / self.size, device=self.device), share)
        return np.asarray((self.size * there).cpu().numpy())

    def images(self, curves: Curves, where: Parameters) -> list[Array]:
        """Return the images [(n, 3)] of the points at given parameters of each curve."""
        start = curves.at(where)
        return split_alike(self(np.concatenate(start)), start)


@one_thread()
def search_network(state: SearchState, report: Report | None = None) -> None:
    """Optimise the network's weights so that the images of the state's polylines draw the pictures.

    The curves are smooth and pass through the start's vertices. Adam minimises the flow's objective, with a
    rate set by the distance that vertices should move in a step, so that it suits any depth and width. At
    the end the polygons are carried from start to result in certified steps (`geometry.carry`), with twice
    the samples each time that fails. If no sampling can be carried all the way, the knots stay where the
    best one got to.
    """
    template = state.rings.split(state.points)
    curves = Curves.through(template)
    settings = state.settings
    network = CouplingNetwork(
        settings.network_depth, settings.network_width, settings.seed, gain=_SLOPE
    ).to(state.device)
    mapped = _Map(network, float(np.abs(state.points).max()), state.device)
    where = _descend(state, curves, mapped, report)
    best = Carried(np.concatenate(template), 0.0, 0, 0, np.inf)
    rings, doublings = polylines_of(template), 0
    for refinement in range(6):  # at most five doublings of the samples
        start = curves.at(where)
        begun = certify_same_type(template, curves.knots, start, where, curves.periods)
        if begun.reached == 1.0:
            sampled = polylines_of(where)
            way = carry(np.concatenate(start), sampled, mapped, _EDGE * state.radius)
            if way.reached > best.reached:
                margin = min(begun.least_margin, way.least_margin)
                best, rings, doublings = replace(way, least_margin=margin), sampled, refinement
        if best.reached == 1.0:
            break
        where = refine_parameters(where, curves.periods)
    state.points, state.rings = best.points, rings
    state.log.accepted += best.steps
    state.log.add_margin(best.least_margin)
    state.log.template += f"; {_describe(best, doublings)}"


def _describe(way: Carried, doublings: int) -> str:
    if way.reached == 0.0:
        return "not carried along the invertible network: no step of it could be certified"
    percent = np.floor(1000 * way.reached) / 10  # never rounded up to 100 %
    far = "" if way.reached == 1.0 else f", {percent:.1f}% of the way"
    said = f"carried along the invertible network in {way.steps} steps, with"
    return f"{said} {doublings} doublings of its samples{far}"


def _descend(state: SearchState, curves: Curves, mapped: _Map, report: Report | None) -> Parameters:
    """Optimise the network's weights with Adam. Returns the parameters of even samples at the end."""
    network, settings, limits = mapped.network, state.settings, state.limits
    rate = 1e-3 / settings.network_width
    adam = Adam(network.parameters(), betas=(0.9, 0.99))
    edge, radius = _EDGE * limits.radius, limits.radius
    total = settings.network_iterations
    first = settings.network_rate_radii * (_FURTHER if settings.network_start == "circle" else 1.0)
    phases = [
        replace(phase, tau=_TAU) for phase in three_phases(settings, len(state.problem.views))[:2]
    ]
    where = curves.knots
    for iteration in range(total):
        progress = iteration / max(1, total - 1)
        number = int(progress >= _FINE)
        if iteration % _REFRESH == 0 or number != int((iteration - 1) / max(1, total - 1) >= _FINE):
            where = _sample(state, curves, mapped, where, edge)
            start = torch.as_tensor(
                np.concatenate(curves.at(where)) / mapped.size, device=state.device
            )
            state.judge_effects()
            phase = phases[number]
            objective = state.objective(phase)
            update, since = state.between(objective, phase), iteration
            near: Neighbours | None = None
            before: Array | None = None
        images = mapped.size * network(start)
        x = images.detach().cpu().numpy()
        if near is None or near.moved(x) > 0.3 * radius:
            near = find_felt(x, state.rings, radius, limits.separation)
        if before is not None:
            goal = first * 0.1**progress * radius  # decays to a tenth
            moved = float(np.sqrt(dot(x - before, x - before).mean()))
            rate *= float(np.sqrt(np.clip(goal / max(moved, 1e-300), 0.5, 2.0)))
        before = x
        update(x, near, iteration - since, progress)
        if state.watch is not None:  # not certified before the end
            state.watch(partial(state.knots_at, x, state.rings), False)
        _, slope = objective(x, near, progress)
        along = torch.as_tensor(slope, dtype=images.dtype, device=images.device)
        adam.zero_grad()
        images.backward(along)
        adam.step(rate)
        if report is not None and iteration % 10 == 0:
            report(progress, min(objective.ious(x)))
    where = _sample(state, curves, mapped, where, edge)
    state.judge_effects()
    if report is not None:
        report(1.0, min(state.ious()))
    return where


def _sample(
    state: SearchState, curves: Curves, mapped: _Map, where: Parameters, edge_mm: float
) -> Parameters:
    """Sample the images of the curves evenly into the state, and return the samples' parameters."""
    where = space_evenly(where, mapped.images(curves, where), curves.periods, edge_mm)
    state.rings = polylines_of(where)
    state.points = np.concatenate(mapped.images(curves, where))
    return where


class CouplingNetwork(nn.Module):
    """An orientation-preserving homeomorphism of space, whatever its weights.

    Paper, supplement, "Network Architecture", with corrections (see `Coupling`): a rigid layer, then `depth`
    times a coupling layer and a rigid layer. Its hidden units bend inside the cube [-1, 1]^3, so points
    should have that size.

    Args:
        depth: number of coupling layers (8 in the paper).
        width: hidden units of each S and T (1024 in the paper).
        seed: of the permutations and the hidden units.
        log_scale: each layer's scale stays between exp(-log_scale) and exp(log_scale).
        gain: standard deviation of the hidden units' slopes; higher values deform finer details.
        dtype: float64 or float32. A seed gives the same network in both, up to rounding.

    Raises:
        ValueError: an argument is not positive.
    """

    def __init__(
        self,
        depth: int = 8,
        width: int = 128,
        seed: int = 0,
        *,
        log_scale: float = 1.0,
        gain: float = 3.0,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        super().__init__()
        if min(depth, width) < 1 or not (log_scale > 0 and gain > 0):
            raise ValueError(
                "depth, width, log_scale and gain must be positive, "
                f"got {depth}, {width}, {log_scale}, {gain}"
            )
        generator = torch.Generator().manual_seed(seed)
        layers: list[Rigid | Coupling] = [Rigid(dtype)]
        for _ in range(depth):
            order = torch.randperm(3, generator=generator)
            layers.append(Coupling(order, width, log_scale, gain, generator, dtype))
            layers.append(Rigid(dtype))
        self.layers = nn.ModuleList(layers)

    def forward(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Map points.

        `share` runs through an ambient isotopy from the identity (0) to the network (1).
        """
        for layer in self.layers:
            points = layer(points, share)
        return points

    def inverse(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Map points back. The error is rounding times the condition number of the map."""
        for layer in reversed(self.layers):
            assert isinstance(layer, Rigid | Coupling)
            points = layer.inverse(points, share)
        return points


class Perceptron(nn.Module):
    """A scalar field of the plane: one hidden layer of tanh units, zero everywhere at the start.

    The units' slopes are normally distributed with standard deviation `gain`, and each unit bends along a
    line through a random point of the square [-1, 1]^2. The field is bounded.
    """

    def __init__(
        self, width: int, gain: float, generator: torch.Generator, dtype: torch.dtype
    ) -> None:
        super().__init__()
        slopes = gain * torch.randn(width, 2, generator=generator, dtype=torch.float64)
        middle = 2 * torch.rand(width, 2, generator=generator, dtype=torch.float64) - 1
        self.hidden = nn.Linear(2, width, dtype=dtype)
        self.out = nn.Linear(width, 1, dtype=dtype)
        with torch.no_grad():
            self.hidden.weight.copy_(slopes)
            self.hidden.bias.copy_(-(slopes * middle).sum(1))
            self.out.weight.zero_()
            self.out.bias.zero_()

    def forward(
        self,
        uv: Tensor,  # [..., 2]
    ) -> Tensor:
        """Return the scalar field at `uv`, [..., 1]."""
        found: Tensor = self.out(torch.tanh(self.hidden(uv)))
        return found


class Coupling(nn.Module):
    """An affine coupling layer: (u, v, w) = x[order] becomes (u, v, w S(u, v) + T(u, v)), put back in order.

    It starts as the identity. Paper, supplement, "Affine Coupling layer", with two corrections. The inverse
    takes the coordinates in the same order as the forward pass (the printed order is wrong for permutations
    of order 3). The scale is S = exp(b tanh(s / b)), between exp(-b) and exp(b), since zero would have no
    inverse and a negative one would mirror.

    Args:
        order: which coordinates are u, v and w.
        width: hidden units of S and of T.
        log_scale: the bound b.
        gain: see `Perceptron`.
    """

    order: Tensor
    back: Tensor

    def __init__(
        self,
        order: Tensor,  # [3]
        width: int,
        log_scale: float,
        gain: float,
        generator: torch.Generator,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        super().__init__()
        self.log_scale = log_scale
        self.register_buffer("order", order)
        self.register_buffer("back", torch.argsort(order))
        self.scale = Perceptron(width, gain, generator, dtype)
        self.shift = Perceptron(width, gain, generator, dtype)

    def _affine(self, uv: Tensor, share: float) -> tuple[Tensor, Tensor]:
        """Return scale and shift [..., 1] at `uv` [..., 2]."""
        log = self.log_scale * torch.tanh(share * self.scale(uv) / self.log_scale)
        return log.exp(), share * self.shift(uv)

    def _parts(self, points: Tensor, share: float) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return (u, v) [..., 2], w, its scale and its shift [..., 1]."""
        ordered = points[..., self.order]
        uv, w = ordered[..., :2], ordered[..., 2:]
        return uv, w, *self._affine(uv, share)

    def forward(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Map points, with `share` below 1 only part of the way from the identity."""
        uv, w, scale, shift = self._parts(points, share)
        return torch.cat([uv, w * scale + shift], -1)[..., self.back]

    def inverse(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Map points back."""
        uv, w, scale, shift = self._parts(points, share)
        return torch.cat([uv, (w - shift) / scale], -1)[..., self.back]


def rotation(turn: Tensor) -> Tensor:
    """Return the rotation matrix [3, 3] of the quaternion (1, turn) / |(1, turn)| for `turn` [3].

    Its axis is `turn` and its angle 2 atan |turn| (Cayley). It depends smoothly on every `turn`, without the
    singularities of Euler angles.
    """
    # scaled first, since the squares of huge numbers would overflow
    size = torch.maximum(turn.abs().amax(), torch.ones_like(turn[0])).detach()
    q = torch.cat([torch.ones_like(turn[:1]) / size, turn / size])
    w, x, y, z = q / q.norm()
    rows = (
        (w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )
    return torch.stack([torch.stack(row) for row in rows])


class Rigid(nn.Module):
    """A rigid motion x -> R x + shift, the identity at the start.

    Paper, supplement, "Rigid Transformation layer".
    """

    def __init__(self, dtype: torch.dtype = torch.float64) -> None:
        super().__init__()
        self.turn = nn.Parameter(torch.zeros(3, dtype=dtype))
        self.shift = nn.Parameter(torch.zeros(3, dtype=dtype))

    def forward(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Move points, with `share` below 1 only part of the way from the identity."""
        return points @ rotation(share * self.turn).T + share * self.shift

    def inverse(
        self,
        points: Tensor,  # [..., 3]
        share: float = 1.0,
    ) -> Tensor:
        """Move points back."""
        return (points - share * self.shift) @ rotation(share * self.turn)
