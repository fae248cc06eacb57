"""What the studies share: pictures as files and as questions, builds as processes of their own, time."""

from __future__ import annotations

import contextlib
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

if TYPE_CHECKING:
    from knotfab.design.question import Question
    from knotfab_formats.scene import Scene

STOPPED = 124  # the exit code of a build that was stopped, as `timeout` has it
# seconds between looks at the memory: counting it takes a tenth of that on a busy machine
_POLL_S = 0.5


class Stopwatch:
    """Seconds since it was made: on the wall and of this process's CPUs, of its children's since then."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), time.process_time()
        self._children = _children_s()

    @property
    def wall_s(self) -> float:
        return time.perf_counter() - self._wall

    @property
    def cpu_s(self) -> float:
        return time.process_time() - self._cpu

    @property
    def children_s(self) -> float:
        """CPU seconds of the child processes that have ended since."""
        return _children_s() - self._children


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run_study(main: Callable[..., int | None]) -> None:
    """Call a study's `main` with the words of the command line, and end with what it returns.

    Its parameters are the arguments and, by keyword, the options; the help is its module's docstring.
    """
    from cyclopts import App, Parameter

    options = Parameter(negative=(), consume_multiple=True)
    app = App(
        help=sys.modules[main.__module__].__doc__, version_flags=(), default_parameter=options
    )
    app.default(main)
    app()


def make_folder(asked: Path | None, name: str) -> Path:
    """Make the folder that was asked for, or a new temporary one; it exists."""
    folder = asked or Path(tempfile.mkdtemp(prefix=f"knotfab-{name}-"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def save_pictures(
    drawn: Mapping[str, Image.Image], folder: Path, names: Iterable[str] = ()
) -> dict[str, Path]:
    """Write the pictures that are named (all, where none is) into `folder`; their files by name."""
    asked = set(names)
    files = {}
    for name, image in drawn.items():
        if not asked or name in asked:
            files[name] = folder / f"{name.replace(' ', '-')}.png"
            image.save(files[name])
    return files


def read_question(picture: str | Path | Image.Image, scene: Scene | None = None) -> Question:
    """Read what a search is asked for one picture in a scene, the default one if none is given."""
    # torch takes seconds to load, and what only runs other commands has no use for it
    from knotfab.api import pose_question
    from knotfab.picture.read import read_target
    from knotfab_formats.scene import Scene

    if not isinstance(picture, Image.Image):
        return pose_question(scene or Scene(), [read_target(picture)])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        picture.save(path)
        return pose_question(scene or Scene(), [read_target(path)])


@dataclass(frozen=True)
class Built:
    """What came of `knotfab build` in a process of its own."""

    code: int  # exit code; STOPPED where the limit was up
    wall_s: float
    cpu_s: float  # the build's and its children's
    peak_mb: float  # resident memory, all its processes together, what they share once
    # report.json of the folder or of its `rejected`; None where none was written
    report: dict[str, Any] | None
    said: str  # on stderr, or else on stdout

    @property
    def clear(self) -> bool:
        """True if it ended as a build may: with 0, or with 1 or 2 and a sentence and no traceback."""
        told = self.code == 0 or bool(self.said)
        return self.code in (0, 1, 2) and told and "Traceback" not in self.said


def build_apart(
    picture: Path | str,
    out: Path,
    *options: str,
    limit_s: float | None = None,
    printing: bool = True,
    checkout: Path | None = None,
) -> Built:
    """Build `picture` with `options` into `out`, with --print where `printing`; killed after `limit_s`.

    The packages may be those of another `checkout`.
    """
    call = [sys.executable, "-m", "knotfab", "build", str(picture)]
    call += [*(["--print"] if printing else []), "--out", str(out), "--quiet", *options]
    watch, peak = Stopwatch(), 0.0
    # files and not pipes: a pipe that nobody reads while the memory is polled would fill up
    with tempfile.TemporaryFile("w+") as told, tempfile.TemporaryFile("w+") as errors:
        child = subprocess.Popen(call, stdout=told, stderr=errors, text=True, **_stand_in(checkout))
        while child.poll() is None:
            peak = max(peak, _resident_mb(child.pid))
            if limit_s is not None and watch.wall_s > limit_s:
                _stop(child)
                said = f"still at work after {limit_s:.0f} s"
                return Built(STOPPED, watch.wall_s, watch.children_s, peak, None, said)
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(_POLL_S)
        wall_s = watch.wall_s
        errors.seek(0)
        told.seek(0)
        said = errors.read().strip() or told.read().strip()
    code = child.returncode
    # beside a rejected build an earlier good one may stand
    report = read_report(out if code == 0 else out / "rejected")
    return Built(code, wall_s, watch.children_s, peak, report, said)


def _stand_in(checkout: Path | None) -> dict[str, Any]:
    """Return arguments of Popen with which Python imports the packages of another checkout."""
    if checkout is None:
        return {}
    places = [checkout.resolve() / part for part in ("", "formats", "validators", "fixtures")]
    return {"cwd": checkout, "env": os.environ | {"PYTHONPATH": ":".join(map(str, places))}}


def _stop(child: subprocess.Popen[str]) -> None:
    """End a build, which tidies up when it is asked to and is given 10 s for it."""
    child.terminate()
    try:
        child.wait(10.0)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def _resident_mb(process: int | str) -> float:
    """Return memory of a process and all its descendants, MB; pages that several share are counted once."""
    folder = Path(f"/proc/{process}")
    try:
        (pages,) = re.findall(r"^Pss:\s+(\d+) kB", (folder / "smaps_rollup").read_text(), re.M)
        children = [c for t in folder.glob("task/*/children") for c in t.read_text().split()]
    except (OSError, ValueError):
        return 0.0  # it has just ended
    return int(pages) / 1024 + sum(map(_resident_mb, children))


def read_report(out: Path) -> dict[str, Any] | None:
    """Read the report in a build's folder, or of the rejected build in it; None where there is neither."""
    for folder in (out, out / "rejected"):
        if (folder / "report.json").is_file():
            report: dict[str, Any] = json.loads((folder / "report.json").read_text())
            return report
    return None


def failed_checks(report: Mapping[str, Any]) -> list[str]:
    """Return the names of the checks that failed."""
    return [check["name"] for check in report["checks"] if check["status"] == "fail"]


def mean_bend(report: Mapping[str, Any]) -> float:
    """Return the mean of curvature × radius over the length of all knots."""
    knots = report["knots"]
    length = sum(k["length_mm"] for k in knots)
    return float(sum(k["mean_curvature_radii"] * k["length_mm"] for k in knots) / length)


def paint_comparison(seen: NDArray[np.bool_], wanted: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return (H, W, 3) a shadow over its target: black where both are, red too much, blue missing."""
    picture = np.full((*wanted.shape, 3), 255, dtype=np.uint8)
    picture[seen & wanted] = (40, 40, 40)
    picture[seen & ~wanted] = (210, 50, 40)
    picture[~seen & wanted] = (70, 120, 220)
    return picture


def stack(rows: Sequence[Image.Image], wide: int, paper: str | tuple[int, ...]) -> Image.Image:
    """Return pictures under each other, each `wide` pixels wide; one row of paper where there is none."""
    rows = [row.resize((wide, round(row.height * wide / row.width))) for row in rows]
    sheet = Image.new("RGB", (wide, max(1, sum(row.height for row in rows))), paper)
    top = 0
    for row in rows:
        sheet.paste(row, (0, top))
        top += row.height
    return sheet
