"""Each thing of a piece is reckoned once, from the preview to its part."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import picture
from tables import some

from knotfab import problem
from knotfab.base.progress import Progress
from knotfab.design.design import plan_searches
from knotfab.design.film import Chain
from knotfab.part.assemble import part_of
from knotfab.pipeline.options import options_from
from knotfab.pipeline.plan import plan_places
from knotfab.pipeline.prepare import prepare_build
from knotfab.plan import Attempts
from knotfab.start import start as starts

QUIET = Progress("quiet")
ASKED: dict[str, dict[str, Any]] = {
    "in roots": {"tube_radius": 3.0},
    "hung": {"mount": "hang", "tube_radius": 3.0},
    "a frame after another": {"sequence": True, "tube_radius": 4.0},
    "on a plate": {"plate": "rounded", "tube_radius": 3.0},
    "tied": {"knot": "trefoil", "tube_radius": 2.0},
    "from a free view": {"free": "view"},
}


def make_parts(pictures: list[str], out: Path, **options: Any) -> None:
    given = options_from({"accuracy": "sketch", "print_": True, "out": out, **options})
    request, attempts = prepare_build(pictures, given, "", QUIET), Attempts(QUIET)
    scene, targets = request.scene, request.targets
    if not request.sequence:
        made = attempts.carry_out(plan_searches(scene, targets, "cpu", QUIET))
        attempts.carry_out(plan_places(request, targets, made, QUIET))
        return
    chain = Chain(scene, targets)
    for number in chain.order:
        frame = attempts.carry_out(chain.plan(number))
        part_of(frame.made, True, [targets[number]])


@pytest.mark.parametrize("name", some(ASKED, 3))
def test_bars_are_planned_once_for_each_set_of_strands_and_each_start_is_placed_once(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    braced, placed = Counter[bytes](), Counter[bytes]()

    def plan_bars(legs: Any, *how: Any, **more: Any) -> Any:
        braced[b"".join(leg.points.tobytes() for leg in legs)] += 1
        return plan(legs, *how, **more)

    def lift(asked: Any, template: Any, radius: float, *how: Any) -> Any:
        told = repr((radius, asked.depth_mm, asked.arched, how[1:]))
        placed[told.encode() + np.concatenate(template.curves).tobytes()] += 1
        return place(asked, template, radius, *how)

    plan, place = problem.plan_bars, starts.lift_template
    monkeypatch.setattr(problem, "plan_bars", plan_bars)
    monkeypatch.setattr(starts, "lift_template", lift)
    pictures = ["text:♥"]
    if "sequence" in ASKED[name]:
        v, u = np.mgrid[:64, :64] - 31.5
        discs = [np.hypot(u, share * v) < 24.0 for share in (1.0, 1.1)]
        pictures = [str(picture(tmp_path / f"{n}.png", disc)) for n, disc in enumerate(discs)]
    make_parts(pictures, tmp_path / "out", **ASKED[name])
    assert braced and set(braced.values()) == {1}
    assert set(placed.values()) == {1}
