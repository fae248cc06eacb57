"""What is handed to a stranger: wheel, pins, schema, extras, and the libraries that a build loads."""

import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from contextlib import suppress
from email import message_from_string
from importlib.metadata import PackageNotFoundError, metadata, packages_distributions
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from command import knotfab, picture, square
from packaging.specifiers import SpecifierSet
from questions import ask_quick

import knotfab as package
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Scene

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PACKAGES = [
    ROOT / name for name in PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
]
BUILD = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    call = [sys.executable, "-c", BUILD, str(folder)]
    subprocess.run(call, cwd=ROOT, check=True, capture_output=True)
    return zipfile.ZipFile(next(folder.glob("*.whl")))


def test_the_wheel_holds_the_packages_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    """Code, data, templates and py.typed, byte for byte; no tests, no studies."""
    aside = re.compile(r"(^|/)(__pycache__|\.\w+|ruff\.toml)(/|$)")  # caches, settings of tools
    found = {p.relative_to(f.parent).as_posix(): p for f in PACKAGES for p in f.rglob("*")}
    expected = {name: p for name, p in found.items() if p.is_file() and not aside.search(name)}
    for name in ("knotfab", "knotfab_formats", "knotfab_validators", "knotfab_fixtures"):
        assert f"{name}/py.typed" in expected
    suffixes = {path.suffix for path in expected.values()}
    assert suffixes >= {".py", ".j2", ".toml"}
    held = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert held == set(expected)
    for name, path in expected.items():
        assert wheel.read(name) == path.read_bytes(), name


def test_the_wheel_says_what_it_is(wheel: zipfile.ZipFile) -> None:
    told = f"knotfab-{package.__version__}.dist-info"
    assert wheel.read(f"{told}/licenses/LICENSE") == (ROOT / "LICENSE").read_bytes()
    assert "knotfab = knotfab.cli.app:main" in wheel.read(f"{told}/entry_points.txt").decode()
    meta = message_from_string(wheel.read(f"{told}/METADATA").decode())
    assert set(meta.get_all("Provides-Extra", [])) == {
        "docs",
        "studio",
        "pathtracer",
        "test",
        "torch",
        "all",
    }
    wanted = [r for r in meta.get_all("Requires-Dist", []) if "extra" not in r]
    assert len(wanted) == len(PROJECT["project"]["dependencies"])
    cited = (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"\nversion: {package.__version__}\n" in cited


def test_everything_that_is_required_is_pinned() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = {normal(line.partition("==")[0]) for line in lines if "==" in line}
    extras = PROJECT["project"]["optional-dependencies"]
    wanted = [*PROJECT["project"]["dependencies"], *(r for e in extras.values() for r in e)]
    names = {normal(re.match(r"[\w.-]+", requirement).group()) for requirement in wanted}  # type: ignore[union-attr]
    assert names - pins == {"knotfab"}
    (everything,) = extras["all"]
    assert set(re.findall(r"\w+", everything)) == {"knotfab", *extras} - {"all"}


def test_every_pin_can_be_installed_by_the_oldest_python_that_the_project_takes() -> None:
    """Debian 12 has Python 3.11.2: a pin that takes 3.11.5 or newer ends `make demo` there."""
    oldest = PROJECT["project"]["requires-python"].removeprefix(">=") + ".0"
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        name, _, version = line.partition("==")
        with suppress(PackageNotFoundError):
            told = metadata(name)
            if told["Version"] == version:
                (takes,) = told.get_all("Requires-Python") or [""]
                assert SpecifierSet(takes).contains(oldest), line


@pytest.mark.slow
def test_a_missing_extra_is_named_with_its_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    for module in [name for name in sys.modules if name.startswith("knotfab.apps.studio")]:
        monkeypatch.delitem(sys.modules, module)
    done = knotfab("studio", "--out", tmp_path / "out")
    assert done.code == 3 and "needs uvicorn, which is not installed" in done.err
    assert "pip install 'knotfab[studio]'" in done.err and not (tmp_path / "out").exists()


def _known(node: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """A part of the schema, its reference followed."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rpartition("/")[2]]
    return node


def test_the_schema_of_scenes_is_that_of_the_model() -> None:
    done = knotfab("schema")
    assert done.code == 0 and done.err == ""
    schema = json.loads(done.out)
    tables = resolve(Scene()).model_dump(by_alias=True, mode="json", exclude_none=True)
    assert set(tables) <= set(schema["properties"])
    for name, table in tables.items():
        node = _known(schema["properties"][name], schema)
        if isinstance(table, dict):
            assert node["additionalProperties"] is False
            assert set(table) <= set(node["properties"]), name
    assert schema["properties"]["schema"]["const"] == 1


def test_completion_is_installed_for_a_shell(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    done = knotfab("--install-completion", "--shell", "bash")
    assert done.code == 0, done
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert any("--time-budget" in path.read_text() for path in written)


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
@pytest.mark.study
def test_a_build_without_the_apps_loads_and_tells_what_is_on_the_page(tmp_path: Path) -> None:
    """The core alone builds a part. That what is left out is not told is tested in pipeline."""
    traced = tmp_path / "traced"
    traced.mkdir()
    (tmp_path / "sitecustomize.py").write_text(TRACE)
    (tmp_path / "quick.toml").write_text(ask_quick(iou_floor=0.9))
    paths = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", str(ROOT))])
    env = {**os.environ, "PYTHONPATH": paths, "TRACED": str(traced), "KNOTFAB_JOBS": "1"}
    knotfab = [sys.executable, "-m", "knotfab"]
    drawn = picture(tmp_path / "square.png", square(128))
    call = ["build", str(drawn), "--scene", str(tmp_path / "quick.toml")]
    call += ["--tube-radius", "6", "--print", "--mount", "stand", "--skip", "slicer", "--quiet"]
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
