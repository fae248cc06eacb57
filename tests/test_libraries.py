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
from questions import ask_quick

ROOT = Path(__file__).resolve().parents[1]
PROCESSES = {
    "build": "build",
    "validators": "knotfab_validators.service",
    "modeller": "knotfab_fixtures.service",
}
# every process of a build has it on its path, notes each package that it asks for, and finds no apps
TRACE = """
import os, sys
class Gone:
    def find_spec(self, name, path=None, target=None):
        if name.startswith("knotfab.apps"):
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Gone())
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


@pytest.mark.build
def test_a_build_without_the_apps_loads_and_tells_what_is_on_the_page(tmp_path: Path) -> None:
    """The core alone builds the knight. That what is left out is not told is tested in pipeline."""
    traced = tmp_path / "traced"
    traced.mkdir()
    (tmp_path / "sitecustomize.py").write_text(TRACE)
    (tmp_path / "quick.toml").write_text(ask_quick(iou_floor=0.9))
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", str(ROOT))])
    env = {**os.environ, "PYTHONPATH": paths, "TRACED": str(traced)}
    knotfab = [sys.executable, "-m", "knotfab"]
    call = ["build", str(ROOT / "examples" / "knight.png"), "--scene", str(tmp_path / "quick.toml")]
    call += ["--tube-radius", "4", "--print", "--mount", "stand", "--skip", "slicer", "--quiet"]
    out = tmp_path / "out"
    subprocess.run([*knotfab, *call, "--out", str(out)], check=True, env=env)
    assert (out / "part.stl").is_file()
    settings = json.loads((out / "report.json").read_text("utf-8"))["settings"]
    parts, versions, names = settings["parts"], settings["versions"], packages_distributions()
    loaded = {
        process: {
            name.lower().replace("tomli_w", "tomli-w")
            for module in (traced / file).read_text().split()
            for name in names.get(module, [module])
        }
        for process, file in PROCESSES.items()
        if (traced / file).exists()
    }
    page = rows_of_the_page()
    assert set(loaded) == set(PROCESSES)
    for process, found in loaded.items():
        for name, row in page.items():
            assert name not in found or process in row.processes, (name, process)
            assert process not in row.works or name in found, (name, process)
    for name, did in parts.items():
        assert did and set(did.split(", ")) <= page[name.lower()].deeds, (name, did)
    assert set(parts) | {"knotfab", "python"} == set(versions)
    every = {name for name, row in page.items() if row.works and row.deeds}
    assert every | {"cadquery", "matplotlib"} <= {name.lower() for name in parts}
    assert parts["cadquery"] == "modelled the mount"
    assert parts["manifold3d"] == "swept the tubes, joined tubes and mount"
    gone = subprocess.run([*knotfab, "batch"], capture_output=True, text=True, env=env)
    assert gone.returncode == 2 and "batch" in gone.stderr
