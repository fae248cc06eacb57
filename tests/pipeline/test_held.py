"""The holder of a printed piece: the cheapest by a guess comes first, and the next where a check fails."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pieces import EMPTY, VIEW, knots, ring
from reports import VERDICT, report_with

from knotfab.base.errors import SceneError
from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.design.candidates import WORD_HOURS, price_of
from knotfab.effects.base import World
from knotfab.pipeline import plan as planning
from knotfab.pipeline.held import Guess, can_hold, guess_holders
from knotfab.pipeline.plan import plan_holders, with_mount
from knotfab.pipeline.workshop import Workshop
from knotfab.plan import Attempts
from knotfab.request import Request
from knotfab.scene.catalogue import resolve
from knotfab_formats.errors import read_as
from knotfab_formats.print_figures import MountFigures
from knotfab_formats.scene import ResolvedScene, Scene
from knotfab_formats.verdict import Check, Recognition

ONE, TWO = knots(ring(50.0)), knots(ring(50.0), ring(25.0, 10.0))
BAD = Check("islands", "fail", True, 3.0, 0.0, "places", "begin in mid-air")


def scene_of(**keys: object) -> ResolvedScene:
    return resolve(Scene.model_validate({"views": [VIEW.model_dump()], **keys}))


def made_of(scene: ResolvedScene, of: Any = ONE, feasible: bool = True) -> Any:
    @dataclass(frozen=True)
    class Made:
        scene: ResolvedScene
        knots: Any = of
        result: Any = field(default_factory=lambda: SimpleNamespace(feasible=feasible))

    return Made(scene)


TARGET: Any = SimpleNamespace(mask=EMPTY, width=EMPTY.shape[1], height=EMPTY.shape[0])


@pytest.mark.parametrize(
    ("keys", "kinds"),
    [
        ({}, {"hang", "stand", "wall"}),
        ({"views": [{}, {"azimuth_deg": 90.0}]}, {"hang", "stand"}),
        ({"views": [{"kind": "eye"}]}, {"hang", "stand"}),
        ({"piece": {"supports": "none"}}, set()),
    ],
)
def test_what_a_scene_allows(keys: dict[str, Any], kinds: set[str]) -> None:
    assert set(can_hold(scene_of(**keys))) == kinds


def test_a_plate_is_guessed_to_cost_more_than_an_eyelet() -> None:
    found = {one.kind: one for one in guess_holders(made_of(scene_of()), [TARGET])}
    order = [one.price() for one in found.values()]
    assert order == sorted(order) and found["hang"].grams < found["stand"].grams
    margin, mount = 2 * Scene().mount.plate_margin_mm, Scene().mount
    plate = np.prod([side + margin for side in VIEW.frame_mm]) * mount.thickness_mm * 1e-3
    assert found["wall"].grams >= plate * scene_of().material.density_g_cm3
    drilled = guess_holders(made_of(scene_of(mount={"foot": "dowel"})), [TARGET])
    assert next(one for one in drilled if one.kind == "wall").grams < found["wall"].grams


class Played(Workshop):
    """A workshop that builds nothing: each kind of mount fails the checks that are told of it."""

    def play(
        self,
        fails: Mapping[str, tuple[str, ...]],
        unheld: Set[str],
        words: Mapping[str, str],
        dark: Mapping[str, float],
    ) -> Played:
        self.__dict__.update(fails=fails, unheld=unheld, words=words, dark=dark, built=[])
        return self

    def settle(self, request: Request, _: Any, made: Any, *__: Any) -> Any:
        """Stand in for `plan_places`."""
        yield from ()
        kind = made.scene.mount.kind
        dark = self.__dict__["dark"].get(kind, 0.0)
        figures = MountFigures(kind=kind, predicted_intrusion=dark)
        mounted = SimpleNamespace(figures=figures, check_sag=lambda: None)
        part = SimpleNamespace(mounted=mounted)
        if kind in self.__dict__["unheld"]:
            raise SceneError("the mount", "nothing reaches it", "")
        return made, part, None

    def finish(self, request: Request, made: Any, settled: Any = None, note: str = "") -> Any:
        kind = made.scene.mount.kind
        assert request.scene.mount == made.scene.mount
        self.__dict__["built"].append(kind)
        checks = [replace(BAD, name=name) for name in self.__dict__["fails"].get(kind, ())]
        word = self.__dict__["words"].get(kind, "faithful")
        piece = SimpleNamespace(made=made, scene=made.scene, note=note, suffix="", slicing=None)
        self.folder.write("part.stl", kind)
        verdict = read_as(Recognition, {**VERDICT, "word": word})
        return piece, replace(report_with(), checks=tuple(checks), verdict=verdict, notes=(note,))


def finish_held(
    place: Path,
    request: Request,
    fails: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
    unheld: Set[str] = frozenset(),
    words: Mapping[str, str] = MappingProxyType({}),
    dark: Mapping[str, float] = MappingProxyType({"hang": 0.008}),
) -> tuple[Played, str, str]:
    """The workshop when it is done, the mount of the part that lies in its folder, and the report's notes."""
    nothing: Any = SimpleNamespace(forget=lambda: None)
    attempts = Attempts(Progress("quiet"))
    with OutputFolder(place / "out") as folder, pytest.MonkeyPatch.context() as patch:
        shop = Played(folder, nothing, nothing, attempts.progress)
        shop.play(fails, unheld, words, dark)
        patch.setattr(planning, "plan_places", shop.settle)
        piece, report = attempts.carry_out(plan_holders(shop, request, made_of(request.scene)))
        assert len(attempts.made) == len(shop.__dict__["built"])
        (file,) = folder.work.iterdir()
        assert piece.scene.mount.kind == file.read_text()
        assert report.notes[0] == piece.note
        return shop, file.read_text(), " ".join(report.notes)


EACH = {"hang": ("level",), "stand": ("mount",), "wall": ("tube",)}
CASES: list[tuple[dict[str, Any], set[str], dict[str, Any], list[str]]] = [
    ({}, set(), {}, ["hang"]),
    ({}, {"hang"}, {}, ["stand"]),
    ({}, {"hang", "stand", "wall"}, {}, ["none"]),
    ({"hang": ("level",)}, set(), {}, ["hang", "stand"]),
    ({"hang": ("level",)}, {"stand"}, {}, ["hang", "wall"]),
    (EACH, set(), {}, ["hang", "stand", "wall", "none"]),
    ({"hang": ("bend",), "stand": ("bend",)}, set(), {}, ["hang", "stand"]),  # it is the knots' own
    # unless the holder shows, and may have spoilt the picture itself
    (dict.fromkeys(("hang", "stand"), ("recognisable",)), set(), {}, ["hang", "stand", "wall"]),
    ({"hang": ("level",)}, set(), {"time_budget_s": 30.0}, ["hang"]),
]


@pytest.mark.parametrize(("fails", "unheld", "keys", "built"), CASES)
def test_the_next_holder_is_tried_where_one_fails(
    tmp_path: Path,
    fails: dict[str, tuple[str, ...]],
    unheld: set[str],
    keys: dict[str, Any],
    built: list[str],
) -> None:
    request = Request(scene_of(), (TARGET,), Path(), printing=True, **keys)
    assert request.chooses_holder
    dark = {"hang": 0.008} | {k: 0.008 for k, why in fails.items() if "recognisable" in why}
    shop, kept, note = finish_held(tmp_path, request, fails, unheld, dark=dark)
    assert shop.__dict__["built"] == built and kept == built[-1]
    wanted = ["No holder"] if built[-1] == "none" else ["Held by"]
    wanted += ["It darkens 0.8% of"] if built == ["hang"] else []
    assert all(words in note for words in wanted)
    for kind in unheld & {"hang"}:
        assert "nothing reaches it" in note, kind


@pytest.mark.parametrize(
    ("words", "dear", "built", "kept"),
    [
        ({}, set(), ["hang"], "hang"),
        ({"hang": "good"}, set(), ["hang", "stand"], "stand"),
        ({"hang": "good", "stand": "good"}, set(), ["hang", "stand"], "hang"),  # no second time
        ({"hang": "good"}, {"stand"}, ["hang", "wall"], "wall"),
        ({"hang": "good"}, {"stand", "wall"}, ["hang"], "hang"),
        ({"hang": "coarse"}, {"stand", "wall"}, ["hang", "stand"], "stand"),
    ],
)
def test_a_holder_that_spoils_the_word_gives_way_to_one_that_is_not_dear(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: dict[str, str],
    dear: set[str],
    built: list[str],
    kept: str,
) -> None:
    own = {"hang": 0.0, "stand": 1.0, "wall": 2.0} | dict.fromkeys(dear, 10.0)
    monkeypatch.setattr(
        Guess, "price", lambda self, word="faithful": own[self.kind] + WORD_HOURS[word]
    )
    shop, last, note = finish_held(
        tmp_path, Request(scene_of(), (TARGET,), Path(), printing=True), words=words
    )
    assert shop.__dict__["built"] == built and last == kept
    # what was made and dropped is told
    assert ("Tried as well, and not taken: a stand" in note) == (len(built) > 1 and kept == "hang")


@pytest.mark.parametrize(
    ("unheld", "kept", "told"),
    [
        ({"wall"}, "hang", "Tried as well, and not taken: a stand (it darkens 0.4% of"),
        (set(), "wall", "; not a stand (it darkens 0.4% of"),
    ],
)
def test_a_holder_that_shows_as_well_is_not_dropped_without_a_word(
    tmp_path: Path, unheld: set[str], kept: str, told: str
) -> None:
    asked, dark = (
        Request(scene_of(), (TARGET,), Path(), printing=True),
        {"hang": 0.008, "stand": 0.004},
    )
    words = {"hang": "coarse"}
    _, last, note = finish_held(tmp_path, asked, unheld=unheld, words=words, dark=dark)
    assert last == kept and told in note


def test_hours_grams_and_words_have_one_price() -> None:
    light = Guess("hang", 2.0, 1.0)
    assert light.price() == pytest.approx(1.1)
    assert replace(light, grams=22.0).price() == replace(light, hours=2.0).price()
    assert replace(light, hours=float("nan")).price() == pytest.approx(0.1)  # not of filament
    words = [light.price(word) for word in WORD_HOURS]
    assert words == sorted(words) and price_of(1.0, 2.0, 0.3) == pytest.approx(light.price() + 3.0)


@pytest.mark.parametrize("kind", ["wall", "stand", "hang", "none"])
def test_a_mount_that_is_given_is_not_chosen(kind: str) -> None:
    request = Request(scene_of(mount={"kind": kind}), (), Path(), printing=True)
    assert not request.chooses_holder
    assert not Request(scene_of(), (TARGET,), Path()).chooses_holder  # not printed


def test_the_scene_that_is_written_is_searched_as_the_one_left_open_was() -> None:
    for of in (ONE, TWO):
        count = len(of.knots)
        request = Request(scene_of(), (TARGET,), Path(), printing=True)
        asked, made = with_mount(request, made_of(request.scene, of), "hang")
        for scene in (asked.scene, made.scene):
            taken, left_open = (
                World.from_scene(one).holding(count) for one in (scene, request.scene)
            )
            assert taken.turns == left_open.turns == (of is ONE)
