"""Slice the written 3MF with PrusaSlicer, beside the build, without touching anybody's settings."""

from __future__ import annotations

import os
import shlex
import shutil
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from knotfab.files.threemf import Body, read_bodies, write_3mf
from knotfab.scene.model import Scene
from knotfab.slicer.cross_checks import box_of, compare_gcode, compare_info
from knotfab.slicer.find import REMEDY, find_slicer
from knotfab.slicer.gcode import BadGcode, read_gcode
from knotfab.slicer.known_warnings import read_warnings
from knotfab.slicer.process import OUT_OF_TIME, Ended, run_limited
from knotfab.slicer.profile import profile, profile_text, why_not_sliced
from knotfab.slicer.result import NotSliced, Sliced

__all__ = ["TIMEOUT_S", "Slicing", "slice_part"]

Array = NDArray[np.float64]

TIMEOUT_S = 300.0
MOST_QUOTED = 400  # characters of what it said


def slice_part(
    part_3mf: Path,
    scene: Scene,
    work: Path,
    timeout_s: float = TIMEOUT_S,
    program: str | None = None,
) -> Sliced | NotSliced:
    """Slice a part as `write_3mf` wrote it, and compare the G-code with it.

    Args:
        scene: resolved; its printer and material give the profile.
        work: an existing folder for temporary files, all of which are removed again.
        timeout_s: over both runs of the program.
        program: of PrusaSlicer; the one on the path by default.
    """
    with Slicing(part_3mf, scene, work, timeout_s, program) as slicing:
        return slicing.result()


class Slicing:
    """`slice_part` on a thread, so that the other core slices while this one verifies.

    Leaving the context ends the program if it still runs and removes the temporary files.

        with Slicing(part, scene, work) as slicing:
            ...
            sliced = slicing.result()
    """

    def __init__(
        self,
        part_3mf: Path,
        scene: Scene,
        work: Path,
        timeout_s: float = TIMEOUT_S,
        program: str | None = None,
    ) -> None:
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._folder: Path | None = None
        self._error: BaseException | None = None
        program = program or find_slicer()
        reason = why_not_sliced(scene)
        if reason is not None:
            self._result: Sliced | NotSliced | None = NotSliced("process", reason)
            return
        if program is None:
            self._result = NotSliced("missing", "PrusaSlicer is not installed", REMEDY)
            return
        self._result = None
        self._folder = Path(tempfile.mkdtemp(prefix="slicer-", dir=work))
        try:
            bodies = read_bodies(part_3mf)
            job = _Job(program, self._folder, bodies, scene, timeout_s, self._stop)
            job.write(part_3mf)
        except BaseException:
            self._clear()
            raise
        self._thread = threading.Thread(target=self._work, args=(job,), daemon=True)
        self._thread.start()

    def __enter__(self) -> Slicing:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        self._clear()

    def result(self) -> Sliced | NotSliced:
        """Wait for the program, and say what came of it."""
        if self._thread is not None:
            self._thread.join()
        if self._error is not None:
            raise self._error
        assert self._result is not None
        return self._result

    def _work(self, job: _Job) -> None:
        try:
            self._result = job.run()
        except BaseException as error:  # of the thread, raised where the result is asked for
            self._error = error

    def _clear(self) -> None:
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None


class _Job:
    """Everything one slicing needs, in a folder of its own."""

    def __init__(
        self,
        program: str,
        folder: Path,
        bodies: Sequence[Body],
        scene: Scene,
        timeout_s: float,
        stop: threading.Event,
    ) -> None:
        self.program, self.folder, self.bodies, self.scene = program, folder, bodies, scene
        self.timeout_s, self.stop = timeout_s, stop
        self.began = time.monotonic()
        self.settings = profile(scene)
        low, high = box_of(bodies)
        across, deep, _ = scene.printer.build_volume_mm
        self.middle = np.array([across / 2, deep / 2])
        self.shift = np.append(self.middle - (low + high)[:2] / 2, -low[2])

    def write(self, part_3mf: Path) -> None:
        (self.folder / "slicer.ini").write_text(profile_text(self.settings), encoding="utf-8")
        shutil.copyfile(part_3mf, self.folder / "part.3mf")
        if len(self.bodies) > 1:
            write_3mf(self.folder / "one.3mf", [_together(self.bodies)])

    def run(self) -> Sliced | NotSliced:
        # PrusaSlicer drops every object of a file onto the bed by itself, and holds up only what is
        # above the bed within one object: several bodies are sliced as one object, as its window
        # does on request.
        sliced_file = "one.3mf" if len(self.bodies) > 1 else "part.3mf"
        center = ",".join(f"{x:g}" for x in self.middle)
        options = ["--load", "slicer.ini", "--dont-arrange", "--center", center]
        info = self._call("--info", "part.3mf")
        if isinstance(info, NotSliced):
            return info
        objects, reading = compare_info(info.out, self.bodies)
        ended = self._call(*options, "--export-gcode", "--output", "part.gcode", sliced_file)
        if isinstance(ended, NotSliced):
            return ended
        try:
            gcode = read_gcode(self.folder / "part.gcode")
        except BadGcode as error:
            return NotSliced("crashed", f"exit code 0, but {error}", said=_quoted(ended))
        return Sliced(
            program=gcode.program,
            version=gcode.version,
            time_s=gcode.time_s,
            filament_m=gcode.filament_mm / 1000,
            filament_g=gcode.filament_g,
            support_m=gcode.filament_mm / 1000 * gcode.support_share,
            layers=gcode.layers,
            objects=objects,
            warnings=tuple([*read_warnings(ended.out), *read_warnings(ended.err)]),
            checks=(reading, *compare_gcode(gcode, self.bodies, self.scene, self.shift)),
            command=shlex.join(["prusa-slicer", *options, "--export-gcode", "part.3mf"]),
            profile=self.settings,
            seconds=time.monotonic() - self.began,
        )

    def _call(self, *arguments: str) -> Ended | NotSliced:
        """Run the program; NotSliced where it did not end well."""
        left = self.timeout_s - (time.monotonic() - self.began)
        command = [self.program, "--datadir", "settings", *arguments]
        try:
            ended = run_limited(command, self.folder, self._environment(), left, self.stop)
        except OSError as error:
            reason = f"{Path(self.program).name} cannot be started ({error.strerror})"
            return NotSliced("missing", reason, REMEDY)
        said = _quoted(ended)
        if ended.stopped:
            late = f"no answer in {self.timeout_s:g} s; a build can do without: --skip slicer"
            reason = late if ended.stopped == OUT_OF_TIME else ended.stopped
            return NotSliced("stopped", reason, said=said)
        if ended.code < 0:
            return NotSliced("crashed", f"PrusaSlicer ended by signal {-ended.code}", said=said)
        if ended.code > 0:
            reason = said or f"exit code {ended.code}, without a word"
            return NotSliced("refused", f"PrusaSlicer refuses the part: {reason}", said=said)
        return ended

    def _environment(self) -> dict[str, str]:
        """That of this process, but with a home of its own, no display and no other language."""
        home = str(self.folder)
        kept = {
            key: value
            for key, value in os.environ.items()
            if not key.startswith(("LC_", "XDG_")) and key not in ("DISPLAY", "WAYLAND_DISPLAY")
        }
        return {**kept, "HOME": home, "XDG_CONFIG_HOME": home, "LANG": "C.UTF-8"}


def _together(bodies: Sequence[Body]) -> tuple[Array, NDArray[np.int32]]:
    """All bodies as one mesh."""
    first = np.cumsum([0, *(len(body.vertices) for body in bodies[:-1])])
    faces = [body.faces + shift for body, shift in zip(bodies, first, strict=True)]
    return np.concatenate([b.vertices for b in bodies]), np.concatenate(faces).astype(np.int32)


def _quoted(ended: Ended) -> str:
    """What the program said beside its progress, in one line."""
    said = [*read_warnings(ended.err), *read_warnings(ended.out)]
    text = "; ".join(" ".join(warning.text.split()) for warning in said)
    return text if len(text) <= MOST_QUOTED else text[:MOST_QUOTED] + " …"
