"""Poses are found again from shadows of knots that are known."""

import numpy as np
import pytest
import torch

from knotfab.geometry.polylines import polylines_of_sizes
from knotfab.problem import ViewNumbers
from knotfab.render.capsules import posed_frame
from knotfab.render.silhouette import Sheet
from knotfab.render.tiled import render_tiled
from knotfab.search.free_pose import Bounds, turn_of
from paper.fit_view import fit_view
from tests.corpus.curves import torus_knot

TREFOIL = torus_knot(2, 3, 35.0, 18.0, 120)


def _numbers(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


def _shadow(points: np.ndarray, numbers: ViewNumbers, sheet: Sheet) -> torch.Tensor:
    n = numbers
    at = _numbers(n.azimuth_deg, n.elevation_deg, n.roll_deg)
    frame = posed_frame(sheet, at, *_numbers(n.light_distance_mm, n.wall_distance_mm))
    p = torch.as_tensor(points)
    return (render_tiled(p, p.roll(-1, 0), frame, n.radius_mm, 10.0) > 0.5).float()


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
