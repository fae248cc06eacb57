"""docs/libraries.md and report.json against what the processes of a build load and tell."""

import json
import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROCESSES = {
    "build": "build",
    "validators": "knotfab_validators.service",
    "modeller": "knotfab_fixtures.service",
}
# every process of a build has it on its path, and notes each package that it asks for
TRACE = """
import os, sys
seen = set()
def hear(event, given):
    name = given[0].partition(".")[0] if event == "import" else ""
    if name and name not in seen:
        seen.add(name)
        where = next((w for w in sys.orig_argv if w.startswith("knotfab_")), "build")
        with open(os.path.join(os.environ["TRACED"], where), "a") as file:
            file.write(name + "\\n")
sys.addaudithook(hear)
"""


class Row(NamedTuple):
    """A line of the page, for one of its libraries."""

    processes: frozenset[str]  # in which it may be loaded
    works: frozenset[str]  # in which it is, in every build
    deeds: frozenset[str]


def rows_of_the_page() -> dict[str, Row]:
    found = {}
    text = (ROOT / "docs" / "libraries.md").read_text("utf-8")
    for line in re.findall(r"^\| (?!library)(.*)\|$", text, re.M):
        names, where, when, _, deeds = (cell.strip() for cell in line.split("|"))
        plain = re.sub(r"\([^)]*\)", "", where)
        own = [{p for p in PROCESSES if p in w} for w in (where, plain)]
        told = frozenset(filter(None, (deed.strip() for deed in deeds.split(";"))))
        works = own[1] if when == "every build" else set()
        for name in names.split(", "):
            found[name.lower()] = Row(frozenset(own[0]), frozenset(works), told)
    return found


def plain_name(requirement: str) -> str:
    found = re.match(r"[\w.-]+", requirement)
    assert found is not None
    return found[0].lower()


def test_the_page_has_a_line_for_each_library_of_the_project_and_no_other() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    needed = {plain_name(line) for line in project["dependencies"]}
    assert set(rows_of_the_page()) == needed


def build(
    folder: Path, *options: str
) -> tuple[dict[str, str], dict[str, str], dict[str, set[str]]]:
    """Parts and versions that a build reports, and the distributions that its processes loaded."""
    traced = folder / "traced"
    traced.mkdir()
    (folder / "sitecustomize.py").write_text(TRACE)
    paths = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", str(ROOT))])
    command = [sys.executable, "-m", "knotfab", "build", str(ROOT / "examples" / "heart.png")]
    command += ["--accuracy", "sketch", "--out", str(folder / "out"), "--quiet", *options]
    env = {**os.environ, "PYTHONPATH": paths, "TRACED": str(traced)}
    subprocess.run(command, check=True, env=env)
    settings = json.loads((folder / "out" / "report.json").read_text("utf-8"))["settings"]
    names = packages_distributions()
    loaded = {
        process: {
            name.lower().replace("tomli_w", "tomli-w")
            for module in (traced / file).read_text().split()
            for name in names.get(module, [module])
        }
        for process, file in PROCESSES.items()
        if (traced / file).exists()
    }
    return settings["parts"], settings["versions"], loaded


@pytest.mark.build
def test_what_a_build_loads_and_tells_is_on_the_page(tmp_path: Path) -> None:
    mounted = "--print", "--mount", "stand", "--skip", "slicer"
    parts, versions, loaded = build(tmp_path, *mounted)
    page = rows_of_the_page()
    assert set(loaded) == set(PROCESSES)
    for process, names in loaded.items():
        for name, row in page.items():
            assert name not in names or process in row.processes, (name, process)
            assert process not in row.works or name in names, (name, process)
    for name, did in parts.items():
        assert did and set(did.split(", ")) <= page[name.lower()].deeds, (name, did)
    assert set(parts) | {"knotfab", "python"} == set(versions)
    every = {name for name, row in page.items() if row.works and row.deeds}
    assert every | {"cadquery", "matplotlib"} <= {name.lower() for name in parts}
    assert parts["cadquery"] == "modelled the mount"
    assert parts["manifold3d"] == "swept the tubes, joined tubes and mount"


@pytest.mark.build
def test_a_stage_left_out_is_not_told(tmp_path: Path) -> None:
    skipped = "--skip", "shadow-render", "--mount", "none"
    parts, versions, loaded = build(tmp_path, *skipped)
    left = {"cadquery", "matplotlib", "pyvista", "resvg-py", "knot_floer_homology"}
    assert not left & (set(parts) | set(versions)) and "modeller" not in loaded
    assert parts["manifold3d"] == "swept the tubes" and parts["trimesh"] == "wrote part.glb"
