"""The paper's search: Adam on the weights of an invertible network that carries the template.

Paper, sections 3.2 to 3.4. One view and one knot, one view and several knots (one homeomorphism of space
carries them all, so they stay unlinked), or several views of one knot (their image losses add up).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from benchmarks.measurement import Stopwatch
from knotfab.apps.paper.outlines import REACH, Pinhole, Won, render_outlines, winners
from knotfab.base.errors import SceneError
from knotfab.search.optimizer import Adam, one_thread
from knotfab_formats.errors import InputError
from paper.camera import Curve, circle, even_ring, random_ring
from paper.losses import (
    Region,
    bending_loss,
    image_loss,
    length_loss,
    mobius_loss,
    occupancy_loss,
    random_pairs,
)
from paper.settings import PAPER, PaperSettings


@dataclass(frozen=True)
class PaperView:
    """A camera and the picture that it is to see: coverage [height, width] in 0 .. 1."""

    camera: Pinhole
    target: Tensor


@dataclass(frozen=True)
class PaperResult:
    """What a search found, in the paper's unit and world."""

    knots: tuple[NDArray[np.float64], ...]  # (samples, 3) each, at even places of the template
    network: nn.Module  # maps points about `template_middle`
    losses: tuple[dict[str, float], ...]  # each iteration: weighted terms by name, and "total"
    ious: tuple[tuple[float, ...], ...]  # each iteration: of each view
    final_ious: tuple[float, ...]  # the knots' IoU at each view's own pixels
    seconds: float
    cpu_seconds: float


def iou(image: Tensor, target: Tensor) -> float:
    """Return intersection over union of two images at half coverage; 1 where both are empty."""
    seen, wanted = image > 0.5, target > 0.5
    union = (seen | wanted).sum()
    return float((seen & wanted).sum() / union) if union > 0 else 1.0


def search_paper(
    views: Sequence[PaperView],
    settings: PaperSettings = PAPER,
    *,
    templates: Sequence[Curve] | None = None,
    region: Region | None = None,
    network: nn.Module | None = None,
    report: Callable[[int, float], None] | None = None,
) -> PaperResult:
    """Search for knots that look like the views' pictures.

    Args:
        views: cameras with their targets, all seen at once.
        templates: closed curves of order 1 about the origin; one circle where there are none.
        region: signed distance (world, positive inside) of where the tube must stay.
        network: [..., 3] -> [..., 3], trained in place; by default the paper's.
        report: called with (iteration, loss) after each.

    Raises:
        InputError: no view, or a target of another size than its camera's image.
        SceneError: the loss or a point is no longer finite.
    """
    _check(views)
    curves = [circle()] if templates is None else list(templates)
    if network is None:
        from knotfab.apps.paper.network_search import CouplingNetwork

        network = CouplingNetwork(settings.depth, settings.width, settings.seed)
    watch = Stopwatch()
    adam = Adam(network.parameters())
    generator = torch.Generator().manual_seed(settings.seed)
    losses: list[dict[str, float]] = []
    ious: list[tuple[float, ...]] = []
    won: list[Won | None] = [None] * len(views)
    start = torch.empty(0)
    with one_thread():
        for iteration in range(settings.iterations):
            if iteration % settings.resample_every == 0:
                start = _sample(curves, [random_ring(settings.samples, generator) for _ in curves])
                won = [None] * len(views)
            knots = _carry(network, start, settings)
            terms, images, won = _terms(knots, views, settings, region, generator, won)
            total = torch.stack(list(terms.values())).sum()
            value = float(total.detach())
            # points that are lost are in no image, so the loss alone does not tell
            if not (np.isfinite(value) and bool(knots.isfinite().all())):
                raise SceneError(
                    f"the paper's search, iteration {iteration}",
                    "its loss or its points are no longer finite",
                    "Use a smaller learning rate",
                )
            adam.zero_grad()
            total.backward()
            adam.step(settings.learning_rate)
            losses.append({name: float(t.detach()) for name, t in terms.items()} | {"total": value})
            ious.append(tuple(iou(i, v.target) for i, v in zip(images, views, strict=True)))
            if report is not None:
                report(iteration, value)
        with torch.no_grad():
            start = _sample(curves, [even_ring(settings.samples) for _ in curves])
            knots = _carry(network, start, settings)
            images = [_seen(knots, view, settings, None)[0] for view in views]
    return PaperResult(
        tuple(knots.numpy()),
        network,
        tuple(losses),
        tuple(ious),
        tuple(iou(i, v.target) for i, v in zip(images, views, strict=True)),
        watch.wall_s,
        watch.cpu_s,
    )


def _check(views: Sequence[PaperView]) -> None:
    if not views:
        raise InputError("the paper's search", "it has no view", "Give one camera and picture")
    for number, view in enumerate(views, 1):
        size = (view.camera.height, view.camera.width)
        if tuple(view.target.shape) != size:
            raise InputError(
                f"the picture of view {number}",
                f"it has {tuple(view.target.shape)} rows and columns, its camera {size}",
                "Scale it to the camera's image",
            )


def _sample(curves: Sequence[Curve], places: Sequence[Tensor]) -> Tensor:
    """Return [knots, n, 3] float64 points of the templates."""
    return torch.stack([curve(place) for curve, place in zip(curves, places, strict=True)])


def _carry(network: nn.Module, start: Tensor, settings: PaperSettings) -> Tensor:
    """Return [knots, n, 3] where the network and the template's place carry the sampled points."""
    middle = torch.tensor(settings.template_middle, dtype=start.dtype)
    carried: Tensor = network(start) + middle
    return carried


def _seen(
    knots: Tensor, view: PaperView, settings: PaperSettings, won: Won | None
) -> tuple[Tensor, Won]:
    """Return the image [height, width] of the knots in a view, and the winners it was made of."""
    starts = knots.reshape(-1, 3)
    ends = knots.roll(-1, 1).reshape(-1, 3) if settings.renderer == "capsule" else starts
    if won is None:
        won = winners(starts, ends, view.camera, settings.radius, REACH / settings.tau)
    image = render_outlines(starts, ends, view.camera, settings.radius, settings.tau, won=won)
    return image, won


def _terms(
    knots: Tensor,
    views: Sequence[PaperView],
    settings: PaperSettings,
    region: Region | None,
    generator: torch.Generator,
    won: Sequence[Won | None],
) -> tuple[dict[str, Tensor], list[Tensor], list[Won | None]]:
    """Return the weighted terms that are asked for, the images, and the winners."""
    seen = [_seen(knots, view, settings, w) for view, w in zip(views, won, strict=True)]
    images = [image for image, _ in seen]
    differences = [
        image_loss(image, view.target.to(image.dtype))
        for image, view in zip(images, views, strict=True)
    ]
    terms = {"image": settings.image_weight * torch.stack(differences).sum()}
    if settings.longest is not None and settings.length_weight > 0:
        terms["length"] = settings.length_weight * length_loss(knots, settings.longest)
    if settings.mobius_weight > 0:
        pairs = random_pairs(settings.pairs, knots.shape[0] * knots.shape[1], generator)
        terms["mobius"] = settings.mobius_weight * mobius_loss(knots, settings.radius, pairs)
    if region is not None and settings.occupancy_weight > 0:
        terms["occupancy"] = settings.occupancy_weight * occupancy_loss(
            knots, settings.radius, region
        )
    if settings.sharpest is not None and settings.bending_weight > 0:
        terms["bending"] = settings.bending_weight * bending_loss(knots, settings.sharpest)
    return terms, [image.detach() for image in images], [w for _, w in seen]
