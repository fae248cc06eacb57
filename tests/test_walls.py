"""What a light command may load; the walls between the packages are import-linter's (`make lint`)."""

import ast
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command import picture, square

HEAVY = ("torch", "vtk", "vtkmodules", "pyvista", "scipy", "matplotlib", "cadquery", "OCP")
# modules that may be loaded by a call that reads a picture, or draws text
LATER = {"scipy": ("good", "blank", "words", "page"), "matplotlib": ("text:", "--font")}

# Runs commands one after the other in a process of its own, and tells what of the heavy each loaded.
RUN = """
import json, sys
import knotfab
knotfab.Scene, knotfab.InputError, knotfab.Knots
from knotfab.cli.app import main
told = [["import", None, [m for m in HEAVY if m in sys.modules]]]
for call in json.loads(sys.argv[1]):
    code = None
    try:
        main(call)
    except SystemExit as left:
        code = left.code
    told.append([" ".join(call), code, [m for m in HEAVY if m in sys.modules]])
import knotfab.pipeline.build  # starts its validators before it loads what it needs itself
told.append(["import", None, [m for m in HEAVY if m in sys.modules]])
print(json.dumps(told), file=sys.__stderr__)
"""
LIGHT = [["--help"], ["build", "--help"], ["printers"], ["preview", "good.png", "--json"]]
REFUSED = [
    ["build", "nowhere.png", "--accuracy", "superb"],
    ["build", "missing.png"],
    ["build", "blank.png"],
    ["build", "words.png"],
    ["build", "good.png", "missing.png"],
    ["build", "page.svg"],
    ["preview", "missing.png"],
    ["preview", "blank.png"],
    ["preview", "words.png"],
    *(
        ["build", "good.png", *wrong.split()]
        for wrong in (
            *("--threshold 2", "--ink plaid", "--crop 1,2", "--crop 0,0,9000,20", "--width -3"),
            *("--lamp-distance 0", "--tube-radius thick", "--nonsense 1"),
        )
    ),
    ["build", "good.png", "--time-budget", "soon"],
    ["build", "good.png", "--printer", "nonsense"],
    ["build", "good.png", "--skip", "everything"],
    ["build", "good.png", "--knot", "9_99"],
    ["build", "good.png", "--scene", "missing.toml"],
    ["build", "good.png", "--scene", "search.toml"],
    ["build", "--sequence", "good.png"],
    ["build"],
    ["tradeoff", "missing.png"],
    ["tradeoff", "blank.png", "--accuracy", "draft"],
    ["validate", "missing"],
    ["build", "good.png", "--font", "DejaVu Sans"],
    ["build", "text: "],
]


def run(folder: Path, calls: list[list[str]], before: str = "") -> list[tuple[str, int, list[str]]]:
    """Tell each call's exit code, and the heavy libraries that are loaded after it."""
    code = f"{before}\nHEAVY = {HEAVY!r}\n{RUN}"
    done = subprocess.run(
        [sys.executable, "-c", code, json.dumps(calls)],
        cwd=folder,
        env={**os.environ, "KNOTFAB_JOBS": "1"},  # a build has one process of validators, not two
        capture_output=True,
        encoding="utf-8",
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return [tuple(told) for told in json.loads(done.stderr.splitlines()[-1])]


@pytest.mark.slow
def test_a_light_command_and_what_is_refused_load_nothing_heavy(tmp_path: Path) -> None:
    picture(tmp_path / "good.png", square())
    picture(tmp_path / "blank.png", np.zeros((64, 64), dtype=bool))
    (tmp_path / "words.png").write_text("I am no picture.")
    (tmp_path / "page.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg" width="0"/>')
    (tmp_path / "search.toml").write_text("[search]\niterations = 10\n")
    told, allowed = run(tmp_path, [["build", "missing.png"], *LIGHT, *REFUSED]), set()
    for call, code, heavy in told:
        allowed |= {name for name, words in LATER.items() if any(w in call for w in words)}
        assert not set(heavy) - allowed, f"{call} loads {heavy}"
        assert code == (0 if call.split() in LIGHT else None if call == "import" else 2), call


ALONE = {
    "from knotfab_fixtures.solids import wall_plate; wall_plate(60, 30, 3, 4)": (
        *("torch", "knotfab", "knotfab_validators"),
    ),
    "from knotfab.apps import doctor; doctor._child = lambda *a: (0, 'x', ''); doctor.examine()": (
        *("torch", "vtkmodules", "OCP", "pyvista"),
    ),
    "from knotfab.base.progress import Progress\n"
    "with Progress('verbose', sys.stderr) as p:\n    with p.stage('a'): p.update(0.5)": ("rich",),
    "import knotfab_validators": ("numpy",),
    # each half of a verdict has a process of its own, and the process that asks measures nothing
    "from knotfab.cli.summary import print_checks; print_checks([])": ("numba", "scipy"),
    **{
        f"from knotfab_validators.validate import measure_piece, read_piece\n"
        f"measure_piece(read_piece(None), only={half!r})": left
        for half, left in {
            "geometry": ("scipy.ndimage", "knotfab_validators.shadows.part_shadows"),
            "shadows": ("igl", "pymeshlab", "knotfab_validators.part_checks"),
        }.items()
    },
    "import knotfab, knotfab.pipeline.finish\n"
    "few = {'coarse_iterations': 2, 'fine_iterations': 2, 'settle_iterations': 2, 'coarse_px': 48}\n"
    "scene = knotfab.Scene.model_validate({'views': [{}], 'search': {**few, 'fine_px': 48}})\n"
    "knotfab.pose_question(scene, [knotfab.read_picture('text:I')])": ("torch",),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "code",
    # import-linter knows what the fixtures import, and a modeller takes seconds to load
    [pytest.param(c, marks=[pytest.mark.study] * ("fixtures" in c)) for c in ALONE],
)
def test_what_needs_no_library_loads_none(code: str) -> None:
    whole = f"import sys\n{code}\nprint([m for m in {ALONE[code]} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", whole], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.slow
def test_what_was_loaded_is_seen(tmp_path: Path) -> None:
    for _, _, heavy in run(tmp_path, [["validate", "missing"]], "import scipy"):
        assert heavy == ["scipy"]


@pytest.mark.parametrize("folder", ["formats", "validators", "fixtures"])
def test_the_folders_are_no_packages(folder: str) -> None:
    """`formats`, `validators` and `fixtures` are import names of packages that others publish."""
    assert not (Path(__file__).parents[1] / folder / "__init__.py").exists()


# What packages and examples may import.


ROOT = Path(__file__).parents[1]


def imports_of(source: str) -> set[str]:
    """Every absolute name that a file imports, wherever in it the import stands."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
        elif (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name | ast.Attribute)
            and (getattr(node.func, "id", None) or getattr(node.func, "attr", None))
            in ("import_module", "__import__")
            and node.args
            and isinstance(node.args[0], ast.Constant)
        ):
            found.add(str(node.args[0].value))
    return found


SCRIPTS = r"\b(examples|benchmarks|paper|tests)\b"


def imported(folder: str) -> set[str]:
    """What the files of a folder import that name one of the folders of scripts."""
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    texts = [file.read_text("utf-8") for file in files]
    # a file without these words imports none of them
    names = set().union(*(imports_of(text) for text in texts if re.search(SCRIPTS, text)))
    return {name.partition(".")[0] for name in names}


def test_no_module_loads_one_of_ours_by_a_name_that_import_linter_cannot_see() -> None:
    for folder in ("knotfab", "validators", "formats", "fixtures"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            text = file.read_text("utf-8")
            assert not re.search(r"(?:import_module|__import__)\(\s*[\"']knotfab", text), file


@pytest.mark.slow
def test_no_package_imports_a_script_or_a_test_and_no_example_a_test() -> None:
    for folder in ("knotfab", "validators", "formats", "fixtures"):
        assert not imported(folder) & {"examples", "benchmarks", "paper", "tests"}
    assert "tests" not in imported("examples")
    assert "tests" in imported("benchmarks")  # the corpus: the scan finds what there is
