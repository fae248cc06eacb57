"""Whoever types what README says finds the pictures that it names."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from examples.readme_pictures import HERE, write_pictures
from knotfab.cli.commands import app

README = (HERE.parent / "README.md").read_text("utf-8")
TUTORIAL = (HERE.parent / "docs" / "tutorial.md").read_text("utf-8")


def calls() -> list[list[str]]:
    lines = re.findall(r"^knotfab .*$", README + TUTORIAL, re.M)
    return [shlex.split(re.split(r"\s{2,}#|\s#\s", line)[0]) for line in lines]


@pytest.mark.slow
def test_every_command_is_one_and_its_pictures_are_there() -> None:
    assert len(calls()) > 20
    pictures = set()
    for words in calls():
        command, bound, _ = app.parse_args(words[1:], exit_on_error=False, print_error=False)
        if command.__name__ in ("build", "preview", "batch", "tradeoff"):
            pictures |= {a for a in bound.args if isinstance(a, str)}
    named = {p for p in pictures if not p.startswith("text:")}
    assert {"cat.png", "badge.png", "logo.svg", "walk/", "logos/"} <= named
    for name in named:
        assert (HERE / name).exists(), name


@pytest.mark.slow
def test_the_pictures_are_those_that_the_script_draws(tmp_path: Path) -> None:
    for path in write_pictures(tmp_path):
        kept = HERE / path.relative_to(tmp_path)
        if path.suffix == ".svg":
            assert kept.read_text() == path.read_text()
            continue
        one, two = (np.asarray(Image.open(p).convert("RGBA"), dtype=float) for p in (kept, path))
        assert one.shape == two.shape and np.abs(one - two).mean() < 3
