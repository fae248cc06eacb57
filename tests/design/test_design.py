"""A build repeats from its own scene: what was chosen on the way is written, as one number, into it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from knotfab.design.design import design_knots
from knotfab.design.settings import GRACE
from knotfab.picture.read import read_target
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene
from knotfab_formats.search import SearchSettings

pytestmark = pytest.mark.slow

FEW = {
    "coarse_px": 48,
    "fine_px": 64,
    "coarse_iterations": 12,
    "fine_iterations": 8,
    "depth_candidates": 4,
}


@pytest.mark.parametrize(
    ("scene", "flatter", "sparser"),
    [
        ({"placing": {"lamp_mm": 80.0, "turn_deg": 8.0}}, True, False),
        # strands as the picture's own filling has them bend more than that
        (
            {
                "piece": {"tube_radius_mm": 7.0},
                "placing": {"lamp_mm": 80.0, "turn_deg": 8.0},
                "material": {"min_bend_radius_mm": 45.0},
            },
            False,
            True,
        ),
        ({"piece": {"depth": "flat"}}, False, False),
    ],
    ids=["careless placing", "sparser strands", "flat"],
)
def test_the_scene_of_a_build_repeats_it(
    scene: dict[str, Any], flatter: bool, sparser: bool
) -> None:
    target = read_target("text:8")
    piece = {"tube_radius_mm": 3.0, **scene.pop("piece", {})}
    given = {"schema": 1, "views": [{"picture": "8.png"}], "search": FEW, "piece": piece, **scene}
    made = design_knots(resolve(Scene.model_validate(given)), [target])
    assert (made.unmet is not None) == sparser
    if flatter:
        usual = design_knots(resolve(Scene.model_validate({**given, "placing": {}})), [target])
        assert made.scene.piece.depth < 0.8 * usual.scene.piece.depth
    again = design_knots(made.scene, [target])
    assert again.scene.piece == made.scene.piece
    np.testing.assert_array_equal(made.knots.points, again.knots.points)


def test_the_scene_of_two_views_repeats_them() -> None:
    targets = [read_target(f"text:{glyph}") for glyph in "oI"]
    views = [{"picture": f"{n}.png", "name": f"v{n}", "azimuth_deg": 90.0 * n} for n in range(2)]
    few = {
        "coarse_px": 64,
        "fine_px": 64,
        "coarse_iterations": 5,
        "fine_iterations": 5,
        "settle_iterations": 5,
    }
    given = {"schema": 1, "views": views, "search": few, "piece": {"tube_radius_mm": 4.0}}
    made = design_knots(resolve(Scene.model_validate(given)), targets)
    # a given grace stays, and the one that was taken is written as that number
    assert {key: made.scene.search[key] for key in few} == few
    assert made.scene.search["grace"] == pytest.approx(GRACE["several"][0] * SearchSettings().grace)
    again = design_knots(made.scene, targets)
    np.testing.assert_array_equal(made.knots.points, again.knots.points)
