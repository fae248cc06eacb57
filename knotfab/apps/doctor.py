"""Examine what this machine has and lacks for knotfab, with a remedy for each fault."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from knotfab.base.pool import count_cores, measure_memory_gb

Status = Literal["ok", "missing", "warning"]

LIBRARIES = (  # distribution, import name
    ("numpy", "numpy"),
    ("scipy", "scipy"),
    ("shapely", "shapely"),
    ("manifold3d", "manifold3d"),
    ("trimesh", "trimesh"),
    ("pymeshlab", "pymeshlab"),
    ("libigl", "igl"),
    ("lib3mf", "lib3mf"),
    ("cadquery", "cadquery"),
    ("resvg-py", "resvg_py"),
    ("pillow", "PIL"),
    ("uharfbuzz", "uharfbuzz"),
)
EXTRAS = (  # the extra, its use, import names
    ("studio", "the studio", ("starlette", "uvicorn", "websockets")),
)
GLYPH_FONTS = ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf")
RENDER_REMEDY = "apt-get install libegl1 libgl1"
LEAST_MEMORY_GB, LEAST_DISK_GB = 4.0, 1.0
CHILD_TIMEOUT_S, TOO_SLOW = 60, 128

# In a child process, because VTK crashes where OpenGL is missing.
RENDER_CHILD = """
import os, sys
if sys.platform.startswith("linux"):
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(32, 32))
plotter.add_mesh(pyvista.Sphere(), color="white", lighting=False)
plotter.background_color = "black"
image = plotter.screenshot(return_img=True)
assert image.max() > 200, "the picture stayed black"
print("pyvista", pyvista.__version__, "with VTK", ".".join(map(str, pyvista.vtk_version_info)))
"""
# Compiled libraries can crash the process too, so each name is printed before it is imported.
IMPORT_CHILD = """
import importlib, sys
for name in sys.argv[1:]:
    print("?", name, flush=True)
    try:
        importlib.import_module(name)
    except Exception as error:
        print("-", " ".join(f"{type(error).__name__}: {error}".split()), flush=True)
    else:
        print("+", flush=True)
"""
TORCH_CHILD = """
import torch
cuda = torch.cuda.get_device_name(0) if torch.cuda.is_available() else "no CUDA device"
print(f"{torch.__version__}, {torch.get_num_threads()} threads, {cuda}")
"""


@dataclass(frozen=True)
class Finding:
    """What was found about one requirement, and what to do about it."""

    name: str
    status: Status
    detail: str
    remedy: str = ""


def examine() -> list[Finding]:
    """Examine everything a build needs, without loading anything heavy into this process.

    `missing` breaks a required step; a `warning` costs only speed or an optional one.
    """
    return [
        Finding("python", "ok", f"{platform.python_version()} on {platform.platform(terse=True)}"),
        _torch(),
        *_libraries(LIBRARIES),
        _rendering(),
        _fonts(),
        _slicer(),
        *(_look_for_extra(*extra) for extra in EXTRAS),
        *_machine(),
    ]


def run_loops(*, drawing: bool = False) -> None:
    """Have the compiled loops of most builds loaded: design a bar that prints without supports."""
    from knotfab.design.design import design_knots
    from knotfab.geometry.tube import sweep
    from knotfab.picture.read import read_target
    from knotfab.render.hung_picture import draw_hung
    from knotfab.render.part_picture import PartPainter, why_undrawn
    from knotfab.scene.catalogue import resolve
    from knotfab_formats.piece import Accuracy, Piece
    from knotfab_formats.scene import Scene

    few = {"depth_candidates": 4, "radius_candidates": 2}
    piece = Piece(printed=True, supports="none")
    asked = Scene(accuracy=Accuracy(name="sketch"), search=few, piece=piece)
    made = design_knots(resolve(asked), [read_target("text:▬")])
    if drawing and why_undrawn() is None:
        tube = sweep(made.knots.knots[0].points, made.knots.radius_mm, 8)
        with PartPainter(*tube) as painter:
            draw_hung(painter, made.scene.views)


def compile_loops() -> Finding:
    """Compile the loops that most builds run, the validators' too; rarer ones are compiled where they run."""
    from knotfab.base.errors import MachineError
    from knotfab.pipeline.verifier import Files, Verifier, copy_early

    begun, skip = time.perf_counter(), {"shadow-render"}
    with copy_early(skip), Verifier(skip) as verifier:
        validators = verifier.submit(Files(None))
        run_loops(drawing=True)
        failed = None
        try:
            validators.result()
        except MachineError as error:
            failed = error
    from knotfab.base.compiled import count_loops  # not sooner: it loads numba

    loops, compiled, folder = count_loops()
    kept = f"kept under {folder}" if folder else "there is no place to keep them"
    said = (
        f"{loops}, {compiled} of them compiled now, in {time.perf_counter() - begun:.0f} s; {kept}"
    )
    if failed is not None:
        said += f"; but not the validators': {failed.why}"
        return Finding("compiled loops", "warning", said, failed.remedy)
    return _judge("compiled loops", said, bool(folder), "Set NUMBA_CACHE_DIR to a folder of yours")


def _judge(name: str, detail: str, good: bool, remedy: str, worse: Status = "warning") -> Finding:
    return Finding(name, "ok", detail) if good else Finding(name, worse, detail, remedy)


def _torch() -> Finding:
    found = _look_for("torch", "torch")
    if found.status != "ok":
        return found
    ran, said = _answer(TORCH_CHILD)
    return _judge("torch", said, ran, "pip install --force-reinstall torch")


def _libraries(wanted: Sequence[tuple[str, str]]) -> list[Finding]:
    """Check that libraries are installed and can be imported, in a child process."""
    found = {module: _look_for(distribution, module) for distribution, module in wanted}
    broken = _import_errors([module for module, one in found.items() if one.status == "ok"])
    for module, why in broken.items():
        one = found[module]
        remedy = f"pip install --force-reinstall {one.name}; {RENDER_REMEDY}"
        found[module] = Finding(one.name, "missing", f"{one.detail}, but {why}", remedy)
    return list(found.values())


def _look_for(distribution: str, module: str) -> Finding:
    remedy = f"pip install {distribution}"
    try:
        version = metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return Finding(distribution, "missing", "not installed", remedy)
    there = importlib.util.find_spec(module) is not None
    detail = version if there else f"{version} is listed, but {module} is not there"
    return _judge(distribution, detail, there, f"{remedy} --force-reinstall", "missing")


def _look_for_extra(extra: str, what: str, modules: Sequence[str]) -> Finding:
    lacking = [name for name in modules if importlib.util.find_spec(name) is None]
    detail = f"{', '.join(lacking)} not installed" if lacking else ", ".join(modules)
    return _judge(what, detail, not lacking, f"In knotfab's folder: pip install '.[{extra}]'")


def _import_errors(modules: Sequence[str]) -> dict[str, str]:
    """Import modules in a child process. Returns by name why some cannot be imported."""
    errors: dict[str, str] = {}
    left = list(modules)
    while left:
        code, said, _ = _child(IMPORT_CHILD, *left)
        last = ""
        for line in said.splitlines():
            if line.startswith("? "):
                last = line[2:]
            elif line.startswith("- "):
                errors[last] = line[2:]
        if code == 0:
            break
        # The child crashed at the last name that it printed: go on with the next.
        last = last or left[0]
        errors[last] = _ending(code)
        left = left[left.index(last) + 1 :]
    return errors


def _rendering() -> Finding:
    name = "rendering (pyvista)"
    if importlib.util.find_spec("pyvista") is None:
        return Finding(name, "missing", "pyvista is not installed", "pip install pyvista")
    from knotfab_validators.shadows.render import why_no_rendering

    reason = why_no_rendering()
    if reason is not None:
        return Finding(name, "missing", reason, RENDER_REMEDY)
    ran, said = _answer(RENDER_CHILD)
    detail = f"{said}, a picture was rendered off-screen" if ran else f"it fails off-screen: {said}"
    return _judge(name, detail, ran, RENDER_REMEDY, "missing")


def _fonts() -> Finding:
    name, remedy = "fonts for text:…", "pip install --force-reinstall matplotlib"
    found = importlib.util.find_spec("matplotlib")
    if found is None or found.origin is None:
        return Finding(name, "missing", "matplotlib is not installed", "pip install matplotlib")
    folder = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf"
    lacking = [font for font in GLYPH_FONTS if not (folder / font).is_file()]
    detail = f"matplotlib lacks {', '.join(lacking)}" if lacking else "DejaVu Sans, with matplotlib"
    return _judge(name, detail, not lacking, remedy)


def _slicer() -> Finding:
    from knotfab.part.slicer_process import REMEDY, ask_help, find_slicer

    name, path = "prusa-slicer", find_slicer()
    if path is None:
        detail = "not found: builds go without the slicer's own reading of the file"
        return Finding(name, "warning", detail, REMEDY)
    ended = ask_help(path)
    if ended.code:
        lines = ended.err.strip().splitlines() or [ended.stopped or _ending(ended.code)]
        detail = f"{path} does not run: {lines[-1]}"
        return Finding(name, "warning", detail, f"{REMEDY} --reinstall")
    version = next((word for word in ended.out.split() if word.startswith("PrusaSlicer")), "")
    return Finding(name, "ok", f"{path}, {version.partition('+')[0]}".rstrip(", "))


def _machine() -> Iterator[Finding]:
    """Yield what is found of cores, memory and disk."""
    cores, limit = count_cores(), os.environ.get("OMP_NUM_THREADS", "")
    if limit.isdigit() and int(limit) < cores:
        detail = f"{cores}, but OMP_NUM_THREADS={limit} keeps the search to {limit}"
        yield Finding("cores", "warning", detail, "unset OMP_NUM_THREADS")
    else:
        yield _judge("cores", str(cores), cores > 1, "Expect builds to take twice as long")
    total = measure_memory_gb()
    told = "cannot be read here" if total is None else f"{total:.1f} GB"
    enough = total is not None and total >= LEAST_MEMORY_GB
    yield _judge("memory", told, enough, "Use --accuracy draft if it is less than 4 GB")
    free = shutil.disk_usage(Path.cwd()).free / 2**30
    told = f"{free:.1f} GB free in the current folder"
    yield _judge("disk", told, free >= LEAST_DISK_GB, "Free some space, or give --out another disk")


def _answer(code: str) -> tuple[bool, str]:
    """Run `code` in a child process. Returns whether it succeeded, and the last line that it printed."""
    ending, out, err = _child(code)
    lines = (out if ending == 0 else err).strip().splitlines()
    return ending == 0, lines[-1] if lines and ending >= 0 else _ending(ending)


def _child(code: str, *arguments: str) -> tuple[int, str, str]:
    """Run `code` in a child process. Returns exit code (128: too slow), standard output and error."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=CHILD_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return TOO_SLOW, "", ""
    return done.returncode, done.stdout, done.stderr


def _ending(code: int) -> str:
    if code == TOO_SLOW:
        return f"no answer in {CHILD_TIMEOUT_S} s"
    return f"ended by signal {-code}" if code < 0 else f"exit code {code}"
