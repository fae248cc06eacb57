"""What is handed to a stranger: the wheel, the pins, the schema of scene.toml, and what an extra brings."""

import json
import re
import subprocess
import sys
import tomllib
import zipfile
from email import message_from_string
from pathlib import Path
from typing import Any

import pytest
from command import knotfab

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
        "dask",
        "docs",
        "photo",
        "mcp",
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


@pytest.mark.slow
def test_a_missing_extra_is_named_with_its_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    picture = tmp_path / "a.png"
    picture.write_bytes(b"")
    done = knotfab("batch", picture, "--out", tmp_path / "out", "--cluster", "tcp://127.0.0.1:1")
    assert done.code == 3 and done.out == "" and done.err.count("\n") == 1
    assert "--cluster tcp://127.0.0.1:1: it needs distributed, which is not" in done.err
    assert "pip install 'knotfab[dask]'" in done.err
    assert not (tmp_path / "out").exists()
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    for module in [name for name in sys.modules if name.startswith("knotfab.apps.studio")]:
        monkeypatch.delitem(sys.modules, module)
    for call in (("studio",), ("build", "text:l", "--watch")):
        done = knotfab(*call, "--out", tmp_path / "out")
        assert done.code == 3 and "needs uvicorn, which is not installed" in done.err
        assert "pip install 'knotfab[studio]'" in done.err and not (tmp_path / "out").exists()


def _known(node: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """A part of the schema, its reference followed."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rpartition("/")[2]]
    return node


def test_the_schema_of_scenes_is_that_of_the_model() -> None:
    """Run `knotfab schema > docs/scene.schema.json` after a change of the model."""
    done = knotfab("schema")
    assert done.code == 0 and done.err == ""
    assert done.out == (ROOT / "docs" / "scene.schema.json").read_text("utf-8")
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
