"""What README and docs name is there, and so are all places of a limit, an effect, a mount and a check."""

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import get_args

import pytest

from examples.api_page import on_page_markdown
from knotfab.effects.survey import EFFECTS
from knotfab.limits.feasibility import LIMITS
from knotfab_formats import verdict
from knotfab_formats.piece import Mount

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
PRODUCT = ("knotfab", "validators", "formats", "fixtures", "web/src")
CODE = [
    path.relative_to(ROOT).as_posix()
    for folder in (*PRODUCT, "benchmarks", "examples", "paper", "tests", "docs")
    for path in (ROOT / folder).rglob("*.*")
]
TARGETS = set(" ".join(re.findall(r"^([a-z][a-z -]*):", MAKEFILE, re.M)).split())


def prose_of(page: Path) -> str:
    """The page without its blocks of code."""
    return re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)


def links_of(page: Path) -> list[tuple[Path, str]]:
    """The files of this project that the page links to, each with the heading's anchor, or none."""
    targets = re.findall(r"\]\(([^)\s]+)\)", prose_of(page))
    parts = [t.partition("#") for t in targets if "://" not in t]
    return [((page.parent / file).resolve() if file else page, anchor) for file, _, anchor in parts]


def anchors_of(page: Path) -> set[str]:
    """The anchors that GitHub gives the page's headings."""
    heads = re.findall(r"^#+ +(.*)$", prose_of(page), re.M)
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head).strip().lower() for head in heads]
    return {re.sub(r"[^\w\- ]", "", head).replace(" ", "-") for head in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_a_page_names_is_there(page: Path) -> None:
    for file, anchor in links_of(page):
        assert file.exists(), file
        assert not anchor or anchor in anchors_of(file), f"{file.name}#{anchor}"
    text = page.read_text("utf-8")
    for name in re.findall(
        r"`((?:docs|examples|benchmarks|paper|knotfab|tests|web)/[\w./-]+)`", text
    ):
        assert (ROOT / name).exists(), name
    for module in re.findall(r"python -m ((?:examples|benchmarks|paper|knotfab)[\w.]*)", text):
        assert find_spec(module), module
    for target in re.findall(r"`make ([a-z-]+)", text):
        assert target in TARGETS, target


def test_every_page_is_reached_from_readme() -> None:
    reached, waiting = set(), [PAGES[0]]
    while waiting:
        page = waiting.pop()
        reached.add(page)
        linked = {file for file, _ in links_of(page) if file.suffix == ".md"}
        waiting += sorted(linked - reached)
    assert set(PAGES) <= reached


def test_no_target_is_taken_for_a_file() -> None:
    found = re.search(r"^\.PHONY:(.*)$", MAKEFILE, re.M)
    assert found and set(found.group(1).split()) == TARGETS


def test_the_menu_of_the_site_has_every_page() -> None:
    menu = (ROOT / "mkdocs.yml").read_text("utf-8")
    assert {page.name for page in (ROOT / "docs").glob("*.md")} == set(re.findall(r"\S+\.md", menu))


def test_what_the_site_has_from_code_is_on_its_pages() -> None:
    def shown(name: str) -> str:
        return on_page_markdown("its text", SimpleNamespace(file=SimpleNamespace(src_uri=name)))

    keys = (ROOT / "docs" / "scene.toml").read_text("utf-8")
    assert shown("conventions.md") == f"its text\n```toml\n{keys}```\n" and "wall_tilt_deg" in keys
    (call,) = re.findall(r"^### build\n\n```python\nbuild\((.*)\)", shown("api.md"), re.M)
    assert "progress" in call and shown("tutorial.md") == "its text"


@pytest.mark.study
def test_the_pages_are_a_site_in_which_each_is_found(tmp_path: Path) -> None:
    """Built strictly: a broken link, a heading that is gone or a page outside the menu ends it."""
    pytest.importorskip("mkdocs", reason="the extra docs is not installed")
    call = [sys.executable, "-m", "mkdocs", "build", "-q", "-d", str(tmp_path / "site")]
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    subprocess.run(call, cwd=ROOT, env=quiet, check=True)
    index = json.loads((tmp_path / "site" / "search" / "search_index.json").read_text("utf-8"))
    found = {entry["location"].partition("#")[0] for entry in index["docs"]}
    assert {page.stem for page in (ROOT / "docs").glob("*.md")} == {Path(p).stem for p in found}
    text = {entry["location"]: entry["text"] for entry in index["docs"]}
    assert "wall_tilt_deg" in text["conventions.html#scenetoml-schema-1"]
    assert "progress" in text["api.html#build"]  # both are made from code, by a hook
    html = (tmp_path / "site" / "index.html").read_text("utf-8")
    assert not re.findall(r'(?:src|href)="https?://(?!squidfunk)', html)  # nothing is fetched


MOUNTS = [k for k in get_args(Mount.model_fields["kind"].annotation) if k not in ("auto", "none")]
CHECKS = [
    name
    for group in ("KNOTS", "MESH", "FILES", "TUBE", "HELD", "PRINTING", "UPRIGHT", "TABLE")
    for name in getattr(verdict, group)
]
# by kind: its names, and in each file what must stand there, NAME for a name and CAPS for it in capitals
PLACES: dict[str, tuple[list[str], dict[str, str]]] = {
    "a limit": (
        [limit.name for limit in LIMITS],
        {
            "knotfab/limits/feasibility.py": r'"NAME" in broken',
            "knotfab/search/objective.py": r"^    NAME: float = ",
            "knotfab/design/retries.py": r'"NAME": \(',
        },
    ),
    "an effect": (
        [effect.name for effect in EFFECTS],
        {
            "knotfab/effects/survey.py": r"\bCAPS\b",
            "formats/knotfab_formats/views.py": r"^    NAME: Switch",
            "docs/effects.md": r"`NAME`",
        },
    ),
    "a kind of mount": (
        MOUNTS,
        {
            "knotfab/hold/mount.py": r"knotfab\.hold\.NAME import",
            "validators/knotfab_validators/part_checks.py": r'mount\.kind == "NAME"',
            "docs/report.md": r"NAME",
        },
    ),
    "a check": (CHECKS, {"docs/report.md": r"`NAME`"}),
}
CASES = [
    (kind, name, file, wanted)
    for kind, (names, places) in PLACES.items()
    for name in names
    for file, wanted in places.items()
]


@pytest.mark.parametrize(("kind", "name", "file", "wanted"), CASES)
def test_no_place_is_missed(kind: str, name: str, file: str, wanted: str) -> None:
    pattern = wanted.replace("NAME", re.escape(name)).replace("CAPS", name.upper())
    text = (ROOT / file).read_text("utf-8")
    assert re.search(pattern, text, re.M), f"{kind}, {name}: {file} lacks it (docs/architecture.md)"


@pytest.mark.parametrize("kind", PLACES)
def test_the_page_names_each_place(kind: str) -> None:
    page = (ROOT / "docs/architecture.md").read_text("utf-8")
    (row,) = re.findall(rf"^\| {kind} \|.*$", page, re.M)
    for file in PLACES[kind][1]:
        short = file.removeprefix("knotfab/").removeprefix("validators/knotfab_validators/")
        assert f"`{short}`" in row, f"the row of {kind} lacks {short}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_file_of_the_code_that_a_page_names_is_there(page: Path) -> None:
    """Pages leave out `knotfab/` and the like; NAME stands for any."""
    named = set(re.findall(r"`([\w./-]+\.(?:py|js|j2|css))`", prose_of(page)))
    missing = {
        n for n in named if "NAME" not in n and not any(f"/{f}".endswith(f"/{n}") for f in CODE)
    }
    assert not missing
