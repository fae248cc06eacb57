"""The project's own test pictures: the same every time, with the features they are drawn for."""

import ast
import importlib
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from examples.pictures import pictures
from examples.readme_pictures import write_pictures
from knotfab.cli.commands import app


@pytest.fixture(scope="module")
def images() -> dict[str, Image.Image]:
    return pictures()


def pieces_and_holes(image: Image.Image) -> tuple[int, int]:
    """Pieces and holes of the ink, without single pixels."""
    ink = np.asarray(image) < 128
    pieces, _ = ndimage.label(ink, np.ones((3, 3)))
    grounds, _ = ndimage.label(np.pad(~ink, 1, constant_values=True))
    counts = [int((np.bincount(label.ravel())[1:] > 9).sum()) for label in (pieces, grounds)]
    return counts[0], counts[1] - 1


@pytest.mark.slow
def test_there_are_enough_and_they_are_black_on_white(images: dict[str, Image.Image]) -> None:
    assert len(images) >= 16
    for name, image in images.items():
        assert image.mode == "L" and max(image.size) == 1024, name
        pixels = np.asarray(image)
        border = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        assert (border == 255).all(), f"{name} is cut off"
        assert 0.04 < (pixels < 128).mean() < 0.75, name
        assert ((pixels < 16) | (pixels > 239)).mean() > 0.9, name
    assert len({image.size for image in images.values()}) >= 6


@pytest.mark.parametrize(
    ("name", "pieces", "holes"),
    [
        ("knight", 1, 3), ("smiley", 4, 1), ("face", 1, 3), ("heart", 1, 0), ("plane", 1, 0),
        ("anchor", 1, 1), ("notes", 1, 0), ("r", 1, 1), ("eight", 1, 2), ("ampersand", 1, 1),
        ("cat", 1, 0), ("bird", 1, 0), ("wheel", 1, 7), ("pieces", 3, 0), ("spiral", 1, 0),
        ("stickman", 1, 0), ("teapot", 1, 1),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_pieces_and_holes(
    images: dict[str, Image.Image], name: str, pieces: int, holes: int
) -> None:
    assert pieces_and_holes(images[name]) == (pieces, holes)


def test_bicycle_and_tree_have_thin_parts(images: dict[str, Image.Image]) -> None:
    pieces, holes = pieces_and_holes(images["bicycle"])
    assert pieces == 1 and holes >= 6
    for name in ("bicycle", "tree"):
        ink = np.asarray(images[name]) < 128
        reach = ndimage.distance_transform_edt(ink)
        opened = ndimage.distance_transform_edt(reach < 16) < 16
        assert (ink & opened).sum() < 0.6 * ink.sum(), name


# Whoever types what README says finds the pictures that it names.


HERE = Path(__file__).parents[2] / "examples"
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
def test_the_pictures_are_those_that_the_script_draws(
    images: dict[str, Image.Image], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = {name: image.copy() for name, image in images.items()}
    monkeypatch.setattr("examples.readme_pictures.pictures", lambda: drawn)
    for path in write_pictures(tmp_path):
        kept = HERE / path.relative_to(tmp_path)
        if path.suffix == ".svg":
            assert kept.read_text() == path.read_text()
            continue
        one, two = (np.asarray(Image.open(p).convert("RGBA"), dtype=float) for p in (kept, path))
        assert one.shape == two.shape and np.abs(one - two).mean() < 3


# What examples, benchmarks and the paper's scripts import is there: no test runs all of them.


ROOT = Path(__file__).parents[2]
SCRIPTS = [
    p for top in ("examples", "benchmarks", "paper") for p in sorted((ROOT / top).rglob("*.py"))
]
OWN = (
    "knotfab", "knotfab_validators", "knotfab_fixtures", "examples", "benchmarks", "paper", "tests",
)  # fmt: skip


def list_imports(path: Path) -> list[tuple[str, str]]:
    """(module, name) of every `from module import name` in a file, at whatever depth."""
    tree = ast.parse(path.read_text("utf-8"))
    return [
        (node.module, alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in OWN
        for alias in node.names
    ]


def is_there(module: str, name: str) -> bool:
    """Tell whether a module has that name, or a submodule of it."""
    try:
        return hasattr(importlib.import_module(module), name) or bool(
            importlib.import_module(f"{module}.{name}")
        )
    except ModuleNotFoundError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize("path", SCRIPTS, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_every_name_that_a_script_imports_is_there(path: Path) -> None:
    missing = [pair for pair in list_imports(path) if not is_there(*pair)]
    assert missing == []


def test_a_name_that_is_gone_is_found(tmp_path: Path) -> None:
    script = tmp_path / "gone.py"
    script.write_text(
        "def f():\n    from knotfab.knots import Knots, gone\n    from knotfab.no import x\n"
    )
    found = [pair for pair in list_imports(script) if not is_there(*pair)]
    assert found == [("knotfab.knots", "gone"), ("knotfab.no", "x")]


@pytest.mark.build
def test_the_stages_one_by_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from examples import stages

    assert stages.main(out=str(tmp_path / "stages"), accuracy="sketch") > 0.95
    said = capsys.readouterr().out
    for stage in ("1 knot(s), tube radius", "search: IoU", "shadow", "thickness"):
        assert stage in said
    assert "fail" not in said
