"""No traceback reaches a person: every command and every option, given what nobody should give them."""

import contextlib
import os
import random
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from command import knotfab, picture, square

from knotfab.base.errors import SceneError
from knotfab.cli.commands import app
from knotfab.pipeline.options import BuildOptions, PlanOptions, ToldOptions

pytestmark = pytest.mark.usefixtures("copies")

PART = "solid a\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendfacet\nendsolid"
WORDS = (
    "", " ", "-1", "0", "1e308", "-1e308", "1e-300", "nan", "inf", "9" * 5000, "1,2,3", "true", "[" * 3000,
    "a" * 300, "a/" * 3000, "nul\0l", "caf\udce9", "~nobody/x", "text:", "text:\u202e", "*", "{}", "💥", "--",
    "-x", "/dev/zero", "/dev/full", "/proc/self/mem", "/", "..", "8_19#", "x=on", "12px", "180km", "0x10",
)  # fmt: skip
OPTIONS = {
    "build": [f.name for f in fields(BuildOptions)] + ["events"],
    "batch": [f.name for f in fields(BuildOptions)] + ["jobs", "cluster"],
    "preview": [f.name for f in fields(PlanOptions)] + ["out"],
    "validate": ["knots", "scene", "failures", "skip"],
    "shadow": ["scene", "out", "view"],
    "compare": ["corners", "view", "out"],
    "tradeoff": [f.name for f in fields(ToldOptions)] + ["out", "time_limit", "repeats"],
    "studio": ["port", "out"],
}  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder of odd files, which is the current one; nothing is built, served or measured."""
    folder = tmp_path_factory.mktemp("odd")
    picture(folder / "good.png", square())
    os.mkfifo(folder / "pipe")
    (folder / "folder.png").mkdir()
    (folder / "loop").symlink_to("loop")
    files: dict[str, bytes] = {
        "part.stl": PART.encode(), "empty": b"", "binary": bytes(range(256)) * 8,
        "deep.json": b"[" * 100_000, "deep.toml": b"a=" + b"[" * 100_000,
        "long.toml": b"[search]\nseed = " + b"9" * 5000,
        "marked.toml": b"\xef\xbb\xbf[piece]\nknots = 1\n", "null.json": b"null",
        "odd.json": b'{"knots": [{"points": [[1e308, "x"]], "type": null}], "radius_mm": []}',
        "huge.toml": b"[[views]]\nwall_distance_mm = 1e308\n",
    }  # fmt: skip
    for name, content in files.items():
        (folder / name).write_bytes(content)
    with (folder / "sparse.png").open("wb") as file:
        file.truncate(5 * 2**30)

    def refuse(*_: Any, **__: Any) -> Any:
        raise SceneError("the stub", "it builds nothing", "Leave it.")

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr("knotfab.pipeline.build.run_build", refuse)
        patch.setattr("knotfab.pipeline.prepare._survey", refuse)
        patch.setattr("knotfab.apps.batch.run._open_client", refuse)
        patch.setattr("knotfab.apps.tradeoff.run.tradeoff", refuse)
        patch.setattr("knotfab.apps.studio.run.serve", refuse)
        patch.setattr("knotfab.pipeline.verifier.load_early", lambda *_: contextlib.nullcontext())
        patch.setattr("knotfab.pipeline.verifier.Verifier.__enter__", refuse)
        patch.setattr("knotfab_validators.shadows.render.SilhouetteRenderer", refuse)
        yield folder


def hold(*call: str) -> None:
    """One sentence with a code of the contract, whatever the call."""
    done = knotfab(*call)
    told = [line for line in done.err.splitlines() if not line.startswith(("warning:", " "))]
    assert done.code in (0, 1, 2, 3), call
    assert "Traceback" not in done.err and "mistake of knotfab" not in done.err, (call, done.err)
    assert done.code == 0 or any(line.startswith("knotfab: ") for line in told), (call, done.err)
    assert len(done.err) < 20_000, call


FEW_OPTIONS = ("validate", "shadow", "compare", "studio")


def odd_words(folder: Path) -> list[str]:
    return [*WORDS, *sorted(p.name for p in folder.iterdir()), "./text:a.png", "good.png/x"]


@pytest.mark.slow
@pytest.mark.parametrize("command", OPTIONS)
def test_no_option_ends_in_a_traceback(place: Path, command: str) -> None:
    names = [o for o in app[command].assemble_argument_collection() if o.show]
    assert len(names) > 1  # and each of them is tried
    chance = random.Random(command)
    first = {"validate": ["part.stl"], "shadow": ["part.stl"], "compare": ["good.png", "."]}
    given = [] if command == "studio" else first.get(command, ["good.png"])
    for option in OPTIONS[command]:
        flag = "--" + option.strip("_").replace("_", "-")
        words = chance.sample(odd_words(place), 6 if command in FEW_OPTIONS else 1)
        for word in words:
            values = [word] * 4 if option == "corners" else [word]
            out = (
                []
                if option == "out" or command in ("validate", "compare")
                else ["--out", "o/o.png"]
            )
            hold(
                command,
                *given,
                *out,
                *([f"{flag}={word}"] if len(values) == 1 else [flag, *values]),
            )


# these read a picture as `build` does
BESIDE_BUILD = ("batch", "preview", "tradeoff")
FILES = [c for c in OPTIONS if c not in (*BESIDE_BUILD, "studio")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "every"),
    [
        *((command, 1) for command in FILES),
        *((command, 4) for command in BESIDE_BUILD),
        *(pytest.param(command, 1, marks=pytest.mark.study) for command in BESIDE_BUILD),
    ],
)
def test_no_file_ends_in_a_traceback(place: Path, command: str, every: int) -> None:
    for word in odd_words(place)[::every]:
        if command in ("build", "batch") and word == "*":
            continue
        more = {"shadow": ["--scene", word, "--out", "o.png"], "compare": [word]}.get(command, [])
        hold(command, *more, "--", word)
    words = [re.sub("[^ -~]", "?", w)[:40] for w in odd_words(place)]
    assert len(set(words)) > 40


@pytest.mark.slow
def test_no_pair_of_options_ends_in_a_traceback(place: Path) -> None:
    chance, words = random.Random(7), odd_words(place)
    for _ in range(40):
        command = chance.choice(["build", "batch", "preview", "tradeoff"])
        options = chance.sample(OPTIONS[command], 2)
        flags = ["--" + o.strip("_").replace("_", "-") for o in options]
        hold(
            command,
            *(f"{flag}={chance.choice(words)}" for flag in flags),
            "--",
            chance.choice(words),
        )
