"""What a process inherits, a person's settings of matplotlib and a stack, and what it leaves unsaid."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tables import some

SETTINGS = {
    "of a notebook, and unreadable": (
        "module://matplotlib_inline.backend_inline",
        b"\xff\xfe\0bad",
    ),
    "a backend that is not here": ("module://nowhere.backend", None),
    "a window's": ("Qt4Agg", None),
}
# matplotlib draws the text, of which more is asked for than there is
PREVIEW = """import sys; sys.argv = "knotfab preview text:A --crop 0,0,7000,7000".split()
import atexit; atexit.register(lambda: print("backend", __import__("matplotlib").get_backend()))
from knotfab.cli.app import main; main()"""


@pytest.mark.slow
@pytest.mark.parametrize("case", some(SETTINGS, 3))
def test_settings_of_matplotlib_decide_nothing(case: str, tmp_path: Path) -> None:
    backend, settings = SETTINGS[case]
    if settings is not None:
        (tmp_path / "matplotlibrc").write_bytes(settings)
    done = subprocess.run(
        [sys.executable, "-c", PREVIEW], cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "MPLBACKEND": backend},
    )  # fmt: skip
    assert done.returncode == 2 and "reaches beyond its " in done.stderr, done.stderr
    assert done.stdout.strip().lower() == "backend agg"


def test_a_module_that_libraries_load_in_vain_is_whole_once_it_is_asked() -> None:
    asked = (
        "import sys; from knotfab_formats.libraries import *; defer_idle_modules();"
        "import pyvista.plotting, torch, matplotlib.pyplot as asked;"
        "was = [hasattr(asked, '__file__'), *({'matplotlib.projections', 'torch._decomp'} & {*sys.modules})];"
        "line = asked.figure().gca().plot([1, 2])[0];"
        "import matplotlib.pyplot as after; torch.export.Dim('n');"
        "print(was, len(line.get_xdata()), after.__file__)"
    )
    child = subprocess.run(
        [sys.executable, "-c", asked], capture_output=True, text=True,
        env={**os.environ, "MPLBACKEND": "agg"},
    )  # fmt: skip
    assert child.stdout.startswith("[False] 2 "), child.stderr
    assert child.stdout.strip().endswith("pyplot.py")


def test_a_stack_that_is_too_small_is_told(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    call = [sys.executable, "-m", "knotfab", "printers"]
    small = (256 * 1024, 256 * 1024)
    done = subprocess.run(
        call, cwd=tmp_path, capture_output=True, text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_STACK, small),
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (3, "")
    assert "its limit is 256 kB. Raise it: ulimit -s 8192" in done.stderr


def test_what_is_still_held_at_the_end_is_not_told() -> None:
    """The collector looks rarely while loops are compiled, and nanobind would list what it left."""
    ends = "import gc, sys; gc.disable(); import manifold3d; held = [manifold3d.Manifold()]"
    ends += "; held.append(held); del held; sys.argv = ['knotfab', '--version']"
    ends += "; from knotfab.cli.app import main; main()"
    done = subprocess.run([sys.executable, "-c", ends], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "") and done.stdout
