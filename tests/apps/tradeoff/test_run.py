"""What each way to build costs: the front, ways that fail, what is kept, and refusals."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from command import Done, knotfab, picture, square
from tables import some

from knotfab.apps.tradeoff import run
from knotfab.apps.tradeoff.run import CHOSEN, KNOBS, Options, Way, front_of, list_ways, tell_worth
from knotfab.base.errors import MachineError, SceneError
from knotfab.base.progress import Progress
from knotfab.pipeline.options import list_given, options_from
from knotfab_formats.errors import InputError
from knotfab_formats.search import PRESETS, SearchSettings

QUIET, MIDDLE = Progress("quiet"), PRESETS["standard"]
NO_TRADE = {"seed", "start", "iou_slack"}  # keys that trade no seconds for likeness


def report(hours: float, iou: float, seconds: float, status: str = "pass") -> dict[str, Any]:
    return {
        "status": status,
        "checks": [{"name": "gap", "required": True, "status": status}],
        "views": [{"iou": 1.0}, {"iou": iou}],
        "settings": {"tube_radius_mm": 2.0},
        "timings": {"total": seconds},
        "print": {
            "time_s": 3600 * hours, "filament_g": 10 * hours, "support_g": 1.0,
            "supports": {"way": "none"}, "pose": {"height_mm": 80.0},
        },
    }  # fmt: skip


class Played:
    """Builds that nothing searched for."""

    def __init__(self) -> None:
        self.asked: list[Options] = []

    def __call__(self, picture: str, folder: Path, options: Options) -> dict[str, Any]:
        self.asked.append(options)
        if options.get("plate") == "full":
            raise SceneError("plate", "the bed is too small", "Take a larger one")
        if options.get("plate") == "pegs":
            return report(1.0, 0.9999, 1.0, "fail")
        if "depth" in options:
            return report(float(options["depth"]) / 20, 0.99, 3.0)
        found = {"sketch": (4.0, 0.97, 1.0), "draft": (5.0, 0.98, 2.0), "fine": (6.0, 0.999, 9.0)}
        if "search" in options:
            return report(5.0, 0.996 if options["search"].get("tau") else 0.99, 3.5)
        return report(*found.get(options.get("accuracy", ""), (5.0, 0.995, 3.0)))


def measure(tmp_path: Path, printed: bool, played: Played, **more: Any) -> list[Way]:
    files = [str(picture(tmp_path / f"{name}.png", square(32 + len(name)))) for name in ("a", "bb")]
    given, out = more.pop("given", {}), tmp_path / "out"
    return run.tradeoff(
        files, out, given, MIDDLE, "standard", QUIET, printed, builder=played, **more
    )


@pytest.mark.parametrize("printed", some([True, False], 2))
@pytest.mark.slow
def test_the_front_has_what_nothing_beats(printed: bool, tmp_path: Path) -> None:
    ways = measure(tmp_path, printed, Played())
    front, sound = front_of(ways), [way for way in ways if not way.failed]
    assert {"sketch", "draft", "fine"} <= {way.label for way in front}  # presets count too
    for way in sound:
        pairs = [(o.costs, zip(o.costs, way.costs, strict=True)) for o in sound]
        beaten = any(costs != way.costs and all(a <= b for a, b in both) for costs, both in pairs)
        assert (way in front) != beaten, way.label
    line = front_of(ways, "seconds", "error")
    for a, b in pairwise(line):
        assert a.seconds <= b.seconds and a.error >= b.error
    content = json.loads((tmp_path / "out" / "tradeoff.json").read_text("utf-8"))["ways"]
    assert [row["front"] for row in content] == [way in front for way in ways]
    assert (tmp_path / "out" / "tradeoff.png").read_bytes().startswith(b"\x89PNG")
    failed = {way.label: way.failed for way in ways if way.failed}
    assert failed.keys() == ({"full plate", "pegs on a plate"} if printed else set())
    if printed:
        assert "the bed is too small" in failed["full plate"] and "gap" in failed["pegs on a plate"]
        assert {"tube 3.0 mm thick", "depth 60 mm", "depth 104 mm"} <= {w.label for w in ways}
    else:
        assert "tau" in tell_worth(ways) and all(way.hours == 0 for way in ways)


def test_every_setting_of_the_search_is_measured() -> None:
    ways = list_ways(MIDDLE, "standard", False)
    turned = {key for _, options in ways for key in options.get("search", {})}
    own = {k for k in SearchSettings.model_fields if not k.startswith("free_")}
    assert own - NO_TRADE <= turned
    for knob in KNOBS:
        assert MIDDLE.but(**knob) != MIDDLE  # each is one that the model takes, and another


@pytest.mark.slow
def test_the_same_call_builds_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "draw", lambda ways: b"")
    played = Played()
    assert measure(tmp_path, False, played, limit_s=0.0) == [] and not played.asked
    first = measure(tmp_path, False, played)
    count = len(played.asked)
    assert measure(tmp_path, False, played) == first and len(played.asked) == count
    measure(tmp_path, False, played, given={"tube_radius": "3"})
    assert len(played.asked) == 2 * count
    (tmp_path / "out" / "tradeoff-runs.json").write_text("[")  # a broken one is none
    assert measure(tmp_path, False, played) == first


def test_a_scene_keeps_its_keys_beside_those_of_a_way(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(
        'schema = 1\n[[views]]\npicture = "x.png"\nframe_width_mm = 90\n[search]\nseed = 3\n'
    )
    text = run._scene_of({"scene": tmp_path / "scene.toml", "search": {"tau": 12.0}})
    assert "seed = 3" in text and "tau = 12" in text and "90" in text and "x.png" not in text


def test_options_are_those_of_every_build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[Options]()
    build = lambda _, __, options: asked.append(options) or report(5.0, 0.99, 3.0)  # noqa: E731
    monkeypatch.setattr(run, "_build", build)
    monkeypatch.setattr(run, "draw", lambda ways: b"")
    call = ("--crop", "0,0,40,30", "--size", "120", "--seed", "7", "--mount", "stand", "--quiet")
    file = picture(tmp_path / "a.png", square(64))
    assert knotfab("tradeoff", file, *call, "--out", tmp_path / "out") == Done(0, "", "")
    given = {"crop": (0, 0, 40, 30), "size": 120.0, "mount": "stand", "print_": False}
    _, first, *others = asked  # the very first warms the process
    assert first == {**given, "search": {"seed": 7}}
    assert all(one["search"]["seed"] == 7 and given.items() <= one.items() for one in others)
    assert {"seed": 7, "tau": 12.0} in [one["search"] for one in others]
    plain = {key: value for key, value in first.items() if key != "search"}
    assert list_given(options_from(plain)) == {k: v for k, v in plain.items() if v is not False}


def test_nothing_is_worth_it_where_a_build_fails() -> None:
    assert tell_worth([Way(CHOSEN, failed="fails gap")]).startswith("No way")


def test_without_a_slicer_there_are_no_hours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "find_slicer", lambda: None)
    with pytest.raises(MachineError, match="PrusaSlicer"):
        run.tradeoff(["a.png"], tmp_path, {}, MIDDLE, "standard", QUIET, True)


def test_wrong_calls_are_refused(tmp_path: Path) -> None:
    (tmp_path / "words.png").write_text("no picture")
    (tmp_path / "file").write_text("")
    for words, said in (
        (("tradeoff",), "no picture is named"),
        (("tradeoff", tmp_path / "words.png"), "it is not a picture"),
        (("tradeoff", "text:I", "--out", tmp_path / "file"), "cannot be made"),
        (("tradeoff", "text:I", "--time-limit", "soon"), "--time-limit"),
        (("tradeoff", "text:I", "--sequence"), "a piece of its own"),
        (("tradeoff", "text:I", "--directions", "front"), "several pictures of one part"),
        (("tradeoff", "text:I", "--mount", "rope"), "Choose from"),
        (("tradeoff", "text:I", "--jobs", "2"), "knotfab 2 does not have it"),
    ):
        done = knotfab(*words)
        assert done.code == 2 and said in done.err and done.err.count("\n") == 1, done.err


def test_a_refused_place_gives_way_to_a_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for taken in (tmp_path / "file", tmp_path / "file" / "within"):
        with pytest.raises(InputError, match="Name a folder"):
            run._make_writable(taken)
    run._make_writable(tmp_path / "new" / "folder")
    assert (tmp_path / "file").read_text() == ""
