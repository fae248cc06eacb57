"""The losses and the network on hard cases; what a limit costs; faults that a fuzz found once."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from hard_cases.pictures import hard_pictures
from hard_cases.values import ValueCase, loss_cases, network_cases, value_error

from examples.nightly_fuzz import KINDS
from knotfab.design import design
from knotfab.report.of_build import add_binding, check_limits
from knotfab.report.report_json import plain
from knotfab.scene.model import Scene
from knotfab.search.price import SHORT
from knotfab.search.radius import template_iou
from knotfab.target.read import read_target
from knotfab.target.silhouette import polygon_of
from knotfab.template.filling import fill

CASES = {case.name: case for case in (*loss_cases(), *network_cases())}


@pytest.mark.parametrize("name", CASES)
def test_single_precision_and_gradients_are_within_their_condition(name: str) -> None:
    case = CASES[name]
    found = value_error(case)
    assert found.finite
    assert found.share <= 1
    if case.smooth:
        assert found.double <= 1e-6
        assert found.single <= 1e-3


def test_a_wrong_gradient_is_found_out() -> None:
    class Wrong(torch.autograd.Function):
        @staticmethod
        def forward(ctx, x):  # type: ignore[no-untyped-def]
            return x.clone()

        @staticmethod
        def backward(ctx, g):  # type: ignore[no-untyped-def]
            return 1.001 * g

    case = CASES["length"]
    wrong: ValueCase = replace(case, f=lambda k: case.f(Wrong.apply(k)))  # type: ignore[no-untyped-call]
    assert value_error(wrong).double > 5e-4


@pytest.mark.parametrize("seed", [1023, 1045, 1319, 1461, 1867, 1885, 2286])
def test_segments_through_the_lights_plane_that_were_once_off(seed: int) -> None:
    assert KINDS["capsules"](np.random.default_rng([seed, 0])) == ""


def test_noise_whose_inset_once_crossed_itself_is_filled() -> None:
    assert KINDS["picture"](np.random.default_rng([2613, 1])) == ""


def test_a_template_that_crosses_itself_has_an_iou() -> None:
    comb = polygon_of(next(c for c in hard_pictures() if c.name == "comb").draw())
    for radius in (2.0, 3.0):
        assert 0 <= template_iou(fill(comb, radius), comb) <= 1


def test_a_length_budget_below_need_is_named_with_its_price(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    few = {"coarse_px": 96, "fine_px": 96, "coarse_iterations": 12, "settle_iterations": 8}
    for name, value in {**few, "fine_iterations": 4, "depth_candidates": 1}.items():
        monkeypatch.setitem(SHORT, name, value)
    given = {
        "schema": 1,
        "piece": {"tube_radius_mm": 5.0},
        "material": {"max_length_mm": 600.0},
        "accuracy": {"name": "draft"},
        "search": {
            **{"coarse_px": 96, "fine_px": 128, "depth_candidates": 4},
            **{"coarse_iterations": 20, "fine_iterations": 10, "settle_iterations": 10},
        },
        "views": [{"picture": "heart.png"}],
    }
    made = design(Scene.model_validate(given), read_target("text:♥"))
    [price] = made.binding
    assert price.limits == ("length",) and price.met_without
    assert price.iou_without > price.iou + 0.2
    assert price.needed[0] > 600.0
    assert made.result.standing.violations == []
    assert made.result.standing.length_mm <= 600.0
    report: dict[str, object] = {}
    add_binding(report, made)
    told = json.loads(json.dumps(plain(report)))
    assert "max_length_mm = 600 mm" in told["notes"][0]
    assert told["binding"][0]["keys"] == ["[material] max_length_mm"]
    assert check_limits(made)["status"] == ("pass" if made.unmet is None else "fail")
