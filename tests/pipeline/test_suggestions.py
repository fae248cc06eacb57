"""Every refusal names an option that would do, and that option does: each suggestion is tried."""

import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pieces
import pytest
from PIL import Image, ImageDraw

from knotfab.base.errors import OPTION, MachineError
from knotfab.base.progress import Progress
from knotfab.design import sentence
from knotfab.pipeline import prepare
from knotfab.pipeline.build import run_build
from knotfab.pipeline.options import options_from
from knotfab.pipeline.prepare import prepare_build, survey_pictures
from knotfab.request import Request, require_device
from knotfab.search import search as searching
from knotfab_formats.errors import KnotfabError

# most read and survey pictures twice
pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("thrifty")]
HERE = Path(__file__).parents[2] / "examples"
Options = dict[str, Any]
# what is typed after `knotfab build`: pictures, and the options of each call with them; where a picture is
# surveyed, a tube that is given spares the choice of one
REFUSED: dict[str, str] = {
    "cat.png": "--print --tube-radius 3 --max-hours 4.5 | --print --max-grams 25",
    "heart.png": """
        --print --max-grams 30 --tube-radius 2 | --print --supports none --size 600 |
        --size 100 --width 90 | --width 100 --height 300 | --size 100000 | --time-budget 1 |
        --time-budget never | --max-hours never | --width 0 | --width far | --wall-distance 0 |
        --lamp-distance 0 | --lamp-distance far | --tube-radius 1e9 | --bend abc | --threshold abc |
        --effect sag=maybe | --directions front,side | --font Arial | --lamps rgb | --nozzle 3 |
        --nozzle 0.6 --printer form-3 | --nozzle 0.6 --printer hp-mjf | --printer form-3 --material pla |
        --material resin | --printer prusa-mk5 | --device cuda | --bend 3 | --mount wall --supports none |
        --mount stand --supports none | --plate pegs --supports none | --depth flat --supports none |
        --supports none --printer form-3 | --plate roots --printer form-3 |
        --plate rounded --printer hp-mjf | --plate roots --mount stand | --plate rounded --depth flat |
        --plate rounded --free view | --plate rounded --size 300 | --mount stand --plate rounded |
        --mount stand --plate none --supports none | --tube-radius 0.6 | --thicken 200 | --ink alpha |
        --crop 0,0,9000,9000 | --start kept.json --free view | --start kept.json --knot trefoil |
        --tube-radius 4 --mount stand --wall-distance 20 | --tube-radius 4 --mount stand --scene at-60.toml |
        --tube-radius 4 --mount stand --scene at-80.toml | --tube-radius 4 --mount stand --scene at-90.toml |
        --tube-radius 4 --mount hang --wall-distance 20 --supports none | --lamp-diameter 1200""",
    "walk/01.png walk/02.png": """
        --no-loop | --sequence --lamps rgb | --sequence --lines on | --sequence --start kept.json |
        --sequence --knots 9""",
    "heart.png teapot.png": """
        --directions front | --plate roots | --supports none | --depth 20 | --mount wall | --lines on |
        --size 2000""",
    "text:Hi": "--font NoSuchFont | --mount hang --supports none",
    "badge.png teapot.png": "--lamps rgb",
    "badge.png": """
        --lamps switch | --lamps red | --lamps rgb --plate roots | --lamps rgb --supports none |
        --lamps rgb --mount wall | --lamps rgb --free view""",
    "ring.png": "--lines on --thicken 3 --tube-radius 4",
    "pale.png": "",
    "veiled.png": "--ink alpha",
    "ball.png": "",
    "flag.png": "",
    "fine.png": "--size 45 | --size 45 --tube-radius 3",
    "many.png": "",
    "dot.png": "--size 6 | --size 20 --tube-radius 4",
    "leap/": "--sequence",
}
# and what is refused once a build has begun, before or between its searches
REFUSED_LATE: dict[str, str] = {
    "heart.png": """
        --depth 220 | --depth 500 --wall-distance 300 | --depth 160 --lamp-distance 75 | --tube-radius 110
        | --print --plate rounded --wall-distance 3 | --print --plate pegs --wall-distance 3 |
        --knot 8_19 --tube-radius 8 --size 80""",
    "heart.png teapot.png": """
        --knot 8_19 --tube-radius 14 | --tube-radius 16 --size 90 | --knots 12 --tube-radius 6 --size 90""",
    "teapot.png": "--lines on | --lines on --thicken 10 --supports none",
}
# what a person may give to an option that a refusal names without a value
GIVEN: dict[str, Options] = {
    "heart.png --size 100000": {"size": 300},
    "heart.png --printer prusa-mk5": {"printer": "prusa-mk4"},
    "heart.png --tube-radius 0.6": {"printer": "form-3"},
    "heart.png --lamp-diameter 1200": {"lamp-diameter": 20, "lamp-distance": 900},
    "heart.png --depth 220": {"wall-distance": 300},
    "heart.png --depth 160 --lamp-distance 75": {"lamp-distance": 500},
    "heart.png --print --plate pegs --wall-distance 3": {"wall-distance": 60, "tube-radius": 1},
    "heart.png --knot 8_19 --tube-radius 8 --size 80": {"tube-radius": 3},
    "heart.png teapot.png --knot 8_19 --tube-radius 14": {"tube-radius": 4},
    "heart.png teapot.png --tube-radius 16 --size 90": {"tube-radius": 3},
    "heart.png teapot.png --knots 12 --tube-radius 6 --size 90": {"tube-radius": 2},
    "teapot.png --lines on": {"thicken": 12},
}


def calls(table: dict[str, str]) -> list[str]:
    """List the calls of a table."""
    each = ((pictures, " ".join(text.split()).split(" | ")) for pictures, text in table.items())
    return [f"{pictures} {options}".strip() for pictures, many in each for options in many]


def parse(words: str) -> tuple[list[str], Options]:
    """Split a call into its pictures and its options."""
    pictures, options, name = list[str](), Options(), ""
    for word in shlex.split(words):
        if word.startswith("--"):
            name = word[2:]
            options[name] = True
        elif name:
            options[name] = _read(word)
            name = ""
        else:
            pictures.append(word)
    return pictures, options


def _read(word: str) -> object:
    if word.isdigit():
        return int(word)
    return float(word) if re.fullmatch(r"[\d.]+", word) else word


class Surveyed(Exception):
    """A call got as far as the survey of its pictures."""


def refuse(
    pictures: list[str], asked: Options, begin: Callable[[Request], object] = require_device
) -> KnotfabError | None:
    """Return the error with which a build ends before its search."""
    named = {name.replace("-", "_"): value for name, value in asked.items()}
    try:
        options = options_from({"accuracy": "sketch", "out": "nowhere", **named})
        begin(prepare_build(pictures, options, "", Progress("quiet")))
    except KnotfabError as error:
        return error
    except Surveyed:
        pass
    return None


def refuse_late(pictures: list[str], asked: Options) -> KnotfabError | None:
    """Return the error with which a build ends before it first searches."""

    def reach(*_: object, **__: object) -> None:
        raise Surveyed

    with TemporaryDirectory() as place, pytest.MonkeyPatch.context() as patch:
        patch.setattr(searching, "search", reach)
        return refuse(pictures, {**asked, "out": Path(place) / "built"}, run_build)


def suggest(error: KnotfabError, asked: Options, given: Options) -> Iterator[Options]:
    """Yield the options that each suggestion of an error makes of those that were asked for."""
    for clause in re.split(r"[;.]? or (?=--|[Ll]eave)|[;,] (?:or )?", error.remedy):
        named = [
            (name, "" if re.match("[A-Z]{2}", value) else value)
            for name, value in OPTION.findall(clause)
        ]
        if not named and (such := re.search(r"""such as ("[^"]*"|\S+[^\s.,])""", clause)):
            named = [(OPTION.findall(error.what)[0][0], such[1])]
        if re.search(r"\b([Ll]eave|one of (?:them|the two|--))", clause):
            words = [name for name, _ in named] or [
                n for n, _ in OPTION.findall(f"{error.what} {error.why}")
            ]
            for name in dict.fromkeys(words):
                assert name in asked, f"--{name} is to be left out, and was not given"
                yield {key: value for key, value in asked.items() if key != name}
            continue
        for name, value in named:
            known = value.strip('"') or given.get(name, True)
            yield {**asked, name: _read(str(known)) if known is not True else True}


def _draw(folder: Path) -> None:
    """Draw pictures that are refused, pale, too fine, too small, or far apart, and knots to start from."""
    rng = np.random.default_rng(4)
    pale = np.uint8(245 + rng.integers(0, 2, (200, 200)))
    pale[60:140, 60:140] -= 2
    Image.fromarray(pale).save(folder / "pale.png")
    veiled = Image.fromarray(np.where(pale > 244, 255, 0).astype(np.uint8)).convert("RGBA")
    veiled.putalpha(250)
    veiled.save(folder / "veiled.png")
    x, y = np.mgrid[-1:1:300j, -1:1:300j]
    lit = 40 + 180 * (0.8 * x + 0.6 * np.sqrt(np.maximum(0.3 - x**2 - y**2, 0))).clip(0, 1)
    Image.fromarray(np.uint8(np.where(x**2 + y**2 < 0.3, lit, 25))).save(folder / "ball.png")
    ring = Image.new("L", (400, 400), 255)
    ImageDraw.Draw(ring).ellipse((60, 60, 340, 340), outline=0, width=6)
    ring.save(folder / "ring.png")
    comb = np.full((100, 100), 255, np.uint8)
    comb[10:90, 10:90] = np.where(np.arange(80) % 4 < 2, 0, 255)
    Image.fromarray(comb).save(folder / "fine.png")
    dots = np.full((480, 480), 255, np.uint8)
    for row in range(16):
        for column in range(16):
            dots[30 * row + 4 : 30 * row + 26, 30 * column + 4 : 30 * column + 26] = 0
    Image.fromarray(dots).save(folder / "many.png")
    dot = Image.new("L", (400, 400), 255)
    ImageDraw.Draw(dot).ellipse((40, 40, 360, 360), fill=0)
    dot.save(folder / "dot.png")
    flag = np.full((200, 200, 3), (200, 20, 20), np.uint8)
    flag[:, :100] = 20, 40, 200
    Image.fromarray(flag).save(folder / "flag.png")
    (folder / "kept.json").write_text(pieces.knots(pieces.ring(40.0)).dump_start())
    for up in (60, 80, 90):
        (folder / f"at-{up}.toml").write_text(f"schema = 1\n[[views]]\nelevation_deg = {up}\n")
    (folder / "leap").mkdir()
    for number, up in enumerate((-230, 230), start=1):
        frame = Image.new("L", (450, 350), 255)
        wings = [(45, 175 + up // 2), (225, 175), (405, 175 + up // 2)]
        ImageDraw.Draw(frame).line(wings, fill=0, width=25, joint="curve")
        frame.save(folder / "leap" / f"{number}.png")


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drawn")
    _draw(folder)
    return folder


# the dearest, for which others stand: grams of another picture, what a machine lacks, a size in test_question
DEAR = (
    *("cat.png --print --max-grams 25", "heart.png --device cuda"),
    "heart.png teapot.png --size 2000",
)


@pytest.mark.parametrize(
    "words", [pytest.param(w, marks=[pytest.mark.study] * (w in DEAR)) for w in calls(REFUSED)]
)
def test_what_a_refusal_suggests_does(
    words: str, drawn: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pictures, asked = parse(words)
    found = {
        name: str(place / name)
        for name in (*pictures, *map(str, asked.values()))
        for place in (HERE, drawn)
        if (place / name).exists()
    }
    pictures = [found.get(name, name) for name in pictures]
    asked = {option: found.get(str(value), value) for option, value in asked.items()}

    def reach(*_: object, **__: object) -> None:
        raise Surveyed

    with monkeypatch.context() as patch:  # what needs no survey is tried without one
        patch.setattr(prepare, "_survey", reach)
        error = refuse(pictures, asked)
        if error is not None:
            _try_each(error, pictures, asked, GIVEN.get(words, {}))
    if error is None:
        error = refuse(pictures, asked)
        assert error is not None
        _try_each(error, pictures, asked, GIVEN.get(words, {}))


@pytest.mark.parametrize("words", calls(REFUSED_LATE))
def test_what_a_refusal_within_a_build_suggests_does(words: str) -> None:
    names, asked = parse(words)
    pictures = [str(HERE / name) for name in names]
    error = refuse_late(pictures, asked)
    assert error is not None
    _try_each(error, pictures, asked, GIVEN.get(words, {}), refuse_late)


@pytest.mark.parametrize(
    "words", [w for w in calls(REFUSED_LATE) if w.startswith("heart.png teapot")]
)
def test_a_preview_refuses_as_the_build_would(words: str) -> None:
    names, asked = parse(words)
    pictures = [str(HERE / name) for name in names]
    named = {name.replace("-", "_"): value for name, value in asked.items()}
    found = survey_pictures(pictures, options_from({"accuracy": "sketch", **named}))
    assert str(found.refusal) == str(refuse_late(pictures, asked))


def _try_each(
    error: KnotfabError,
    pictures: list[str],
    asked: Options,
    given: Options,
    refused: Callable[[list[str], Options], KnotfabError | None] = refuse,
) -> None:
    tried = list(suggest(error, asked, given))
    assert tried, error.remedy
    for options in tried:
        again = refused(pictures, options)
        lacking = isinstance(again, MachineError)  # of this machine, not of the call
        assert again is None or lacking, f"{error.remedy}: {options}: {again}"


def test_a_piece_larger_than_the_bed_or_two_days_is_told_with_a_size_that_is_neither(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sentence, "_LONG_H", 8.0)  # a cat of 440 mm takes a day and a half

    def said(**asked: object) -> str:
        found = survey_pictures(
            (str(HERE / "cat.png"),), options_from({"accuracy": "sketch", **asked})
        )
        return "\n".join(sentence.describe(found))

    for size, words in ((600, "larger than"), (220, "two days")):
        told = said(size=size)
        assert words in told and told.count("would") == 1
        better = re.search(r"--size (\d+) would", told)
        assert better is not None
        again = said(size=float(better[1]))
        assert "larger than" not in again and "two days" not in again
