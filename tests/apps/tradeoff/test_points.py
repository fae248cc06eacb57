"""The presets are points of the measured front: docs/frontier.json, which `make frontier` writes."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from played_runs import beaten_by, make_measured, make_run

from knotfab.apps.tradeoff.points import (
    COMBINED,
    KNOBS,
    PRESET,
    Measured,
    Point,
    combine,
    frontier,
    halve,
    list_changes,
    list_effects,
    list_points,
    list_steps,
    merge_turns,
)
from knotfab_formats.search import PRESETS

STUDY = json.loads((Path(__file__).parents[3] / "docs/frontier.json").read_text("utf-8"))
WHOLE = [p for p in STUDY["points"] if p["pictures"] == STUDY["compared_over"]]
OF_PRESET = {p["point"]: p for p in WHOLE if p["knob"] == PRESET}
MOST = 1.2  # times what another point takes, or is off


def excess(preset: dict[str, Any], points: list[dict[str, Any]]) -> float:
    """The factor by which a point of the study that may lie on the front beats a preset."""
    one, *others = (
        SimpleNamespace(seconds=p["seconds"], error=1 - p["iou"])
        for p in (preset, *(p for p in points if p["eligible"]))
    )
    return beaten_by(one, others)  # type: ignore[arg-type]


def test_the_study_is_of_the_presets_that_are() -> None:
    assert len(STUDY["pictures"]) >= 12 and STUDY["compared_over"] == len(STUDY["pictures"])
    assert OF_PRESET.keys() == PRESETS.keys()
    for name, row in OF_PRESET.items():
        changes = list_changes(PRESETS[name], PRESETS["standard"])
        assert row["changed"] == {key: new for key, (_, new) in changes.items()}


@pytest.mark.parametrize("name", PRESETS)
def test_no_preset_is_dominated(name: str) -> None:
    assert excess(OF_PRESET[name], WHOLE) <= MOST


def test_a_dominated_preset_is_found() -> None:
    row = OF_PRESET["standard"]
    for better in (
        {**row, "seconds": row["seconds"] / 1.3},
        {**row, "iou": 1 - (1 - row["iou"]) / 1.3},
    ):
        assert excess(row, [*WHOLE, better]) > MOST


def test_each_preset_costs_more_and_brings_more() -> None:
    rows = sorted(OF_PRESET.values(), key=lambda row: row["seconds"])
    assert [row["point"] for row in rows] == list(PRESETS)
    assert sorted(row["iou"] for row in rows) == [row["iou"] for row in rows]


# Which points nothing beats, which are kept, and what a step buys.


def _random(seed: int, count: int = 40) -> list[Measured]:
    random = np.random.default_rng(seed)
    # few digits, so that some are equal in one or both
    times, errors = random.integers(1, 30, count) / 4, random.integers(1, 30, count) / 1000
    sound = random.random(count) > 0.2
    rough = random.choice([0.15, 0.2, 0.3], count)
    return [
        make_measured(1 - e, t, bool(s), curvature=float(c))
        for t, e, s, c in zip(times, errors, sound, rough, strict=True)
    ]


def _beats(one: Measured, other: Measured) -> bool:
    """A point beats another that is no better in either figure, and worse in one."""
    mine, others = (one.seconds, one.error), (other.seconds, other.error)
    return mine != others and all(a <= b for a, b in zip(mine, others, strict=True))


@pytest.mark.parametrize("seed", range(8))
def test_the_frontier_is_what_nothing_beats(seed: int) -> None:
    measured, middle = _random(seed), make_measured(0.99, 2.0)
    sound = [m for m in measured if m.keeps(middle)]
    wanted = {(m.seconds, m.error) for m in sound if not any(_beats(o, m) for o in sound)}
    best = frontier(measured, middle)
    assert {(m.seconds, m.error) for m in best} == wanted and len(best) == len(wanted)
    assert all(m.feasible and m.curvature <= 1.1 * 0.2 for m in best)
    for one, two in pairwise(best):
        assert one.seconds < two.seconds and one.error > two.error


@pytest.mark.parametrize("seed", range(4))
def test_what_beats_a_point_says_by_how_much(seed: int) -> None:
    sound = [m for m in _random(seed) if m.feasible]
    best = frontier(sound)
    for one in sound:
        factor = beaten_by(one, sound)
        assert (factor > 1.0) == any(_beats(o, one) for o in sound)
        # a point that is by so much faster and better is beaten by nothing
        mended = make_measured(1 - one.error / factor / 1.001, one.seconds / factor / 1.001)
        assert beaten_by(mended, sound) == 1.0 or factor == 1.0
    assert all(beaten_by(one, sound) == 1.0 for one in best)


@pytest.mark.parametrize("seed", range(8))
def test_halving_keeps_the_best(seed: int) -> None:
    measured, middle = _random(seed), make_measured(0.985, 3.0)
    kept = halve(measured, middle, [middle])
    sound = [m for m in measured if m.keeps(middle)]
    assert min(sound, key=lambda m: (m.error, m.seconds)).point in kept
    assert min(sound, key=lambda m: (m.seconds, m.error)).point in kept
    assert len(kept) == min(len(sound), -(-len(measured) // 2))
    # on the front come before those off it: what is dropped from it makes room for no other
    on = {m.point for m in frontier([*sound, middle])}
    assert on - {middle.point} <= set(kept) or set(kept) <= on
    assert all(p in [m.point for m in sound] for p in kept)


def test_what_is_slow_and_no_better_goes_no_further() -> None:
    """A renderer 25 times as slow as the middle's, of its error, kept a study busy for hours."""
    middle = PRESETS["standard"]
    capsule, ellipse = (p for p in list_points() if p.knob == "renderer")
    at = Measured(Point("preset", "standard", middle), (make_run(2.0, 0.99),))
    slow = Measured(capsule, (make_run(50.0, 0.9901),))
    for iou, kept in ((0.9901, False), (0.995, True)):
        other = Measured(ellipse, (make_run(50.0, iou),))
        assert (ellipse in halve([slow, other], at, [at])) is kept
        assert (capsule in halve([slow, other], at, [at])) is False
        effects = list_effects([at, slow, other], at)
        assert list(effects.get("renderer", {})) == (["ellipse"] if kept else [])


def test_repeated_runs_are_one_with_their_median() -> None:
    turns = [make_run(s, 0.99) for s in (3.0, 1.0, 2.0)]
    assert merge_turns(turns) == make_run(2.0, 0.99)
    assert not merge_turns([turns[0], make_run(1.0, 0.99, feasible=False)]).feasible


def test_every_point_is_a_setting_of_its_own() -> None:
    for own in (None, PRESETS["draft"].scaled(1.1)):
        asked = list_points(own)
        assert len({p.settings for p in asked}) == len(asked)
        named = {p.label for p in asked if p.knob == "preset"}
        assert named == set(PRESETS) | ({"the scene's"} if own else set())


def test_steps_are_between_neighbours_on_the_same_pictures() -> None:
    middle = PRESETS["standard"]
    turned = {p.label: p for p in list_points() if p.knob == "picture size"}
    measured = [
        Measured(Point("preset", "standard", middle), tuple(make_run(4.0, 0.99) for _ in range(3))),
        Measured(turned["384 px"], (make_run(1.0, 0.97), make_run(1.0, 0.99))),
        Measured(turned["1024 px"], (make_run(8.0, 0.996),)),
    ]
    steps = [s for s in list_steps(measured, middle) if s.knob == "picture size"]
    assert [(s.before, s.after, s.pictures) for s in steps] == [
        ("384 px", "640 px", 2),
        ("640 px", "1024 px", 1),
    ]
    assert steps[0].iou == pytest.approx(0.01) and steps[0].seconds == pytest.approx(4.0)
    assert str(steps[1]) == "picture size 640 px → 1024 px: +.0060 IoU, ×2.00 seconds"


def test_combinations_are_new_and_the_same_for_a_seed() -> None:
    middle = PRESETS["standard"]
    asked = list_points()
    measured = [
        Measured(p, (make_run(1.0 + k % 7, 0.98 + 0.001 * (k % 11)),)) for k, p in enumerate(asked)
    ]
    at = next(m for m in measured if m.point.settings == middle)
    effects = list_effects(measured, at)
    assert effects
    made = combine(middle, effects, asked, 10, seed=3)
    assert made == combine(middle, effects, asked, 10, seed=3)
    assert 1 < len({p.settings for p in made}) == len(made) <= 10
    assert not {p.settings for p in made} & {p.settings for p in asked}
    single = {
        key: {list_changes(k.turn(middle, v), middle)[key][1] for v in effects[k.name]
              if key in list_changes(k.turn(middle, v), middle)}
        for k in KNOBS if k.name in effects for v in effects[k.name]
        for key in list_changes(k.turn(middle, v), middle)
    }  # fmt: skip
    for point in made:
        assert point.knob == COMBINED and point.label
        for key, (_, new) in list_changes(point.settings, middle).items():
            assert new in single[key]
    assert combine(middle, effects, asked, 0) == combine(middle, {}, asked, 5) == []
