"""README's and the tutorial's commands are typed as they stand there; builds are stood for by their files."""

import contextlib
import io
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from command import knotfab
from reports import report_with

from benchmarks.typed_pages import PAGES, ROOT, broken_promises, commands_of, take_photograph
from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.cli import make
from knotfab.cli.commands import app
from knotfab.design import survey
from knotfab.design.frames import frame_view
from knotfab.design.radius import RadiusChoice
from knotfab.part.write import make_pose
from knotfab.pipeline import build as pipeline
from knotfab.request import Outcome, Request
from knotfab.scene.load import dump_scene


def build(request: Request, progress: Progress) -> Outcome:
    """Write what a later command reads: scene, pictures, and that there is a report."""
    views = [frame_view(v, t) for v, t in zip(request.scene.views, request.targets, strict=False)]
    with OutputFolder(request.out) as folder:
        for view, target in zip(views, request.targets, strict=False):
            folder.write(view.picture, target.png_bytes)
        made = {"views": tuple(views), "pose": make_pose(np.eye(4))}
        folder.write("scene.toml", dump_scene(request.scene.model_copy(update=made)))
        folder.write("report.json", "{}")
        folder.commit()
    return Outcome(0, report_with(views=[]), request.out)


@contextlib.contextmanager
def page(out: Path, say: object) -> Iterator[tuple[io.StringIO, None]]:
    yield io.StringIO(), None


@pytest.mark.slow
@pytest.mark.parametrize("name", PAGES)
def test_a_page_can_be_typed_from_its_first_line_to_its_last(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "run_build", build)
    monkeypatch.setattr(make, "open_page", page)
    # which tube several pictures take is found by drawing starts, for seconds
    monkeypatch.setattr(survey, "choose_radius", lambda *_, **__: RadiusChoice(2.0, ()))
    folder = shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(folder)
    commands = commands_of((ROOT / name).read_text("utf-8"))
    assert len(commands) >= (15 if name == "README.md" else 4)
    for words in commands:
        if words[0] in ("build", "preview", "compare"):
            if words[0] == "compare":
                take_photograph(folder / words[2], folder / words[1])
            done = knotfab(*words)
            assert done.code == 0, (words, done.err)
            if words[0] == "compare":
                assert done.out.startswith("9"), done.out  # % alike
        else:
            app.parse_args(words, exit_on_error=False, print_error=False)


def test_a_promise_that_is_off_by_more_than_a_tenth_is_told() -> None:
    said = "pass\n  faithful, 10.1 h, 86 g, 44% of it supports: open badge/report.html\n"
    for promise, kept in (("9.5 h, 90 g", True), ("22 h, 86 g", False), ("10.1 h, 99 g", False)):
        text = f"    faithful, {promise}, 44% of it supports: open badge/report.html\n"
        assert (broken_promises(text, said) == []) == kept
    other = "    good, 10.1 h, 86 g, 44% of it supports: open badge/report.html\n"
    assert broken_promises(other, said)
    assert commands_of("```sh\ncd x\nknotfab build a b  # c\n```\n    knotfab no\n") == [
        ["build", "a", "b"]
    ]
