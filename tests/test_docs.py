"""What README, CONTRIBUTING and the pages of docs name is there: files, headings, modules, make targets."""

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
MAKEFILE = (ROOT / "Makefile").read_text("utf-8")
TARGETS = set(re.findall(r"^([a-z][a-z-]*):", MAKEFILE, re.M))


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


@pytest.mark.slow
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
    assert "wall_radius_mm" in text["conventions.html#scenetoml-schema-1"]
    assert "progress" in text["api.html#build"]  # both are made from code, by a hook
    html = (tmp_path / "site" / "index.html").read_text("utf-8")
    assert not re.findall(r'(?:src|href)="https?://(?!squidfunk)', html)  # nothing is fetched
