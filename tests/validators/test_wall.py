"""The wall: validators load without the maker or its libraries, and importing them stays light."""

import subprocess
import sys
from pathlib import Path

import pytest

import knotfab_validators

BANNED = ("knotfab", "knotfab_fixtures", "torch", "cadquery", "OCP", "manifold3d", "trimesh")
SHARED = Path(__file__).parents[1] / "shared"
FOLDER = Path(knotfab_validators.__file__).parent
MODULES = sorted(
    ".".join(p.relative_to(FOLDER).with_suffix("").parts)
    for p in FOLDER.rglob("*.py")
    if p.stem != "__init__"
)

BLOCK = f"""
import importlib, sys
banned = {BANNED!r}
class Wall:
    def find_spec(self, name, path=None, target=None):
        if any(name == b or name.startswith(b + ".") for b in banned):
            raise ModuleNotFoundError(f"banned: {{name}}", name=name)
sys.meta_path.insert(0, Wall())
"""


def run(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize("name", ["torch", "knotfab.knots", "manifold3d"])
def test_the_wall_can_be_hit(name: str) -> None:
    done = run(BLOCK + f"import {name}")
    assert done.returncode != 0 and "banned: " in done.stderr


@pytest.mark.slow
def test_every_module_loads_behind_the_wall_and_so_does_what_it_loads_late(tmp_path: Path) -> None:
    """Readers and checks that import inside functions run behind the wall too."""
    assert {"validate", "tube.thickness", "mesh.surface_checks", "service"} <= set(MODULES)
    code = f"""
for name in {MODULES!r}:
    importlib.import_module("knotfab_validators." + name)
print("all", [m for m in banned if m in sys.modules])
sys.path.insert(0, {str(SHARED)!r})
from pathlib import Path
from validator_parts import circle, tube
from knotfab_validators.files.scene import parse_knots
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.part_checks import part_checks
v, f = tube(circle(60, 20.0), 3.0, 24)
lines = ["solid t"]
for a, b, c in v[f]:
    corners = "".join(f"vertex {{p[0]}} {{p[1]}} {{p[2]}}\\n" for p in (a, b, c))
    lines.append("facet normal 0 0 0\\nouter loop\\n" + corners + "endloop\\nendfacet")
path = Path({str(tmp_path)!r}) / "t.stl"
path.write_text("\\n".join([*lines, "endsolid t"]))
knots = parse_knots({{"schema": 1, "radius_mm": 3.0,
                     "knots": [{{"points": circle(60, 20.0).tolist()}}]}})
checks = part_checks(read_mesh(path), knots, None, {{}})
print(len(checks), [m for m in banned if m in sys.modules])
"""
    done = run(BLOCK + code)
    assert done.returncode == 0, done.stderr
    loaded, checked = done.stdout.splitlines()
    assert loaded == "all []"
    assert int(checked.split()[0]) >= 8 and checked.split(maxsplit=1)[1] == "[]"


ORDERS = (
    "from knotfab_validators import validate",
    "import knotfab_validators.validate; from knotfab_validators import validate",
    "from knotfab_validators.validate import validate",
)


@pytest.mark.slow
def test_the_public_names_in_any_order_of_imports() -> None:
    """Each in a fork of one process, which has loaded libraries and nothing of the validators."""
    done = run(
        f"import os, sys, numba, numpy, scipy.spatial\nfor order in {ORDERS!r}:\n"
        " if child := os.fork():\n"
        "  assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0, order\n"
        "  continue\n"
        " assert not [m for m in sys.modules if m.startswith('knotfab')]\n"
        " exec(order)\n import knotfab_validators as k\n"
        " assert callable(validate) and k.validate is validate\n"
        " assert k.Check.__name__ == 'Check' and k.Verdict.__name__ == 'Verdict'\n"
        " assert not hasattr(k, 'nothing_of_the_sort')\n"
        " break"
    )
    assert done.returncode == 0, done.stderr
