"""A piece that cannot be held where it is is searched again, where the scene leaves that open."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rings import ring

import knotfab.flatten as flattening
from knotfab.design.frames import frame_view
from knotfab.flatten import flatten
from knotfab.knots import Knot, Knots
from knotfab.mount.wall import NotHeldError
from knotfab.progress import Progress
from knotfab.request import Request
from knotfab.scene.load import parse_scene
from knotfab.scene.model import Scene
from knotfab.target.read import Target, read_target

MESSAGE = "it sags 1.00 mm on its pegs, 0.2 are allowed"


class Maker:
    """Designs and parts of two rings, which nothing holds farther from the wall than `holds_mm`."""

    def __init__(self, target: Target, holds_mm: float) -> None:
        self.target, self.holds = target, holds_mm
        self.asked: list[Scene] = []
        self.thoroughly: list[bool] = []

    def design(self, scene: Scene, *_: Any) -> Any:
        self.asked.append(scene)
        piece = scene.piece
        depth = 90.0 if isinstance(piece.depth, str) else piece.depth
        radius = 0.8 if isinstance(piece.tube_radius_mm, str) else piece.tube_radius_mm
        half = 0.5 * depth - 3.0
        curves = (ring(12.0, half, 40, 3.0), ring(20.0, -half, 60, 3.0))
        view = frame_view(scene.views[0], self.target)
        return Made(
            SimpleNamespace(piece=piece, views=(view,), material=scene.material, mount=scene.mount),
            Knots(tuple(Knot(c) for c in curves), radius),
        )

    def part(self, made: Any, *_: Any, thoroughly: bool) -> Any:
        self.thoroughly.append(thoroughly)
        if not thoroughly and made.scene.views[0].wall_distance_mm > self.holds:
            raise NotHeldError("the wall mount", MESSAGE, "")
        return SimpleNamespace(pose=SimpleNamespace(account=None))


@dataclass(frozen=True)
class Made:
    """Of a design, what is asked here."""

    scene: Any
    knots: Knots
    radius: str | None = None


@pytest.fixture(scope="module")
def target() -> Target:
    return read_target("text:i")


def run(
    target: Target, scene: str, holds_mm: float, patch: pytest.MonkeyPatch, **keys: Any
) -> tuple[Maker, Any]:
    """What is asked for a scene, and what is said of it."""
    maker = Maker(target, holds_mm)
    patch.setattr(flattening, "design_knots", maker.design)
    patch.setattr(flattening, "part_of", maker.part)
    request = Request(parse_scene(scene), ("i",), Path("out"), **{"printing": True, **keys})
    first = replace(maker.design(request.scene), radius="chosen")
    made, _, said = flatten(request, target, first, Progress("quiet"))
    if len({scene.views[0].wall_distance_mm for scene in maker.asked}) == 1:
        assert made.radius == "chosen"  # how it was chosen is told, not that it was then given
    return maker, said


def test_a_piece_that_is_held_is_left_as_it_is(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, "", 100.0, monkeypatch)
    assert (len(maker.asked), maker.thoroughly, said) == (1, [False], None)


def test_what_pegs_do_not_hold_is_searched_again_nearer_to_its_wall(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, "", 99.0, monkeypatch)
    _, again = maker.asked
    assert maker.thoroughly == [False, False]
    assert again.views[0].wall_distance_mm < 99.0
    assert said.unheld == MESSAGE and said.wall_mm == (100.0, again.views[0].wall_distance_mm)
    assert said.from_mm == pytest.approx(90.0) and said.to_mm <= said.from_mm
    assert again.piece.depth == pytest.approx(said.to_mm, abs=0.1)
    assert (
        again.piece.tube_radius_mm == "auto"
    )  # the piece is larger there: its tube is chosen anew


def test_it_is_searched_no_oftener_than_that(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, "", 0.0, monkeypatch)
    assert len(maker.asked) <= 1 + flattening.ROUNDS and said.unheld == MESSAGE
    assert maker.thoroughly[-1] and not any(maker.thoroughly[:-1])


@pytest.mark.parametrize(
    ("scene", "keys"),
    [
        ("[piece]\ndepth = 90.0\n[[views]]\nwall_distance_mm = 100.0", {}),
        ("", {"time_budget_s": 60.0}),
        ("", {"printing": False}),
        ("[search]\nstart = 'knots.json'", {}),
    ],
    ids=["given", "time", "not printed", "start"],
)
def test_what_is_given_is_not_overruled(
    target: Target, scene: str, keys: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, scene, 0.0, monkeypatch, **keys)
    assert (len(maker.asked), maker.thoroughly, said) == (1, [True], None)


def test_a_wall_that_is_given_stays_where_it_is(
    target: Target, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker, said = run(target, "[[views]]\nwall_distance_mm = 100.0", 0.0, monkeypatch)
    assert {scene.views[0].wall_distance_mm for scene in maker.asked} == {100.0}
    assert said.to_mm < said.from_mm
