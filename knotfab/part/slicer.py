"""Slice written 3MF files with PrusaSlicer, beside the build, whatever the user's own settings."""

from __future__ import annotations

import re
import shlex
import shutil
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from knotfab.base.disk import temporary_folder
from knotfab.geometry.tube import box_of
from knotfab.part.files import read_shells
from knotfab.part.gcode import BadGcode, compare_gcode, compare_info, read_gcode
from knotfab.part.slicer_process import (
    OUT_OF_TIME,
    REMEDY,
    Ended,
    NotSliced,
    Sliced,
    find_slicer,
    run_limited,
)
from knotfab.part.slicer_profile import read_profile, read_warnings, why_not_sliced
from knotfab_formats.scene import ResolvedScene
from knotfab_formats.slicer_ini import PROFILE

TIMEOUT_S = 300.0  # a slicer that takes longer is ended
# SIGHUP, SIGINT, SIGKILL, SIGTERM, SIGXCPU, SIGXFSZ: what says nothing of the part
_FROM_OUTSIDE = (1, 2, 9, 15, 24, 25)
MOST_QUOTED = 400  # characters quoted of its output


class SlicerQueue:
    """Runs `slice_part` on file after file, on its own threads, while others search and verify.

    Leaving the context ends the program if it still runs, and removes its temporary files.

    Args:
        work: an existing folder for temporary files; the machine's by default.
        jobs: files that are sliced side by side.
    """

    def __init__(
        self,
        work: Path | None = None,
        timeout_s: float = TIMEOUT_S,
        program: str | None = None,
        jobs: int = 1,
    ) -> None:
        self._work = work
        self._timeout_s, self._program = timeout_s, program
        self.done = 0.0  # the share of the file that is sliced, 0 to 1
        self._ended, self._threads = threading.Event(), ThreadPoolExecutor(jobs)
        self._asked: list[Future[Sliced | NotSliced]] = []

    def __enter__(self) -> SlicerQueue:
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._threads.shutdown(cancel_futures=True)

    def forget(self) -> None:
        """End the program if it runs, and drop the files that wait."""
        self._ended.set()
        wait([one for one in self._asked if not one.cancel()])
        self._ended = threading.Event()
        self._asked.clear()

    def submit(self, part_3mf: Path, scene: ResolvedScene) -> Future[Sliced | NotSliced]:
        """Queue a file that `write_3mf` wrote. Arguments are as for `slice_part`."""
        given = self._work, self._timeout_s, self._program, self._ended, self._hear
        self._asked.append(self._threads.submit(slice_part, part_3mf, scene, *given))
        return self._asked[-1]

    def _hear(self, said: str) -> None:
        """Note the largest percentage that the program has printed; it goes back and forth."""
        self.done = max(
            (int(n) / 100 for n in re.findall(r"^ *(\d+) => ", said, re.M)), default=0.0
        )


def slice_part(
    part_3mf: Path,
    scene: ResolvedScene,
    work: Path | None = None,
    timeout_s: float = TIMEOUT_S,
    program: str | None = None,
    stop: threading.Event | None = None,
    hear: Callable[[str], None] | None = None,
) -> Sliced | NotSliced:
    """Slice a written part with the profile that lies beside it, and compare the G-code with it.

    Both files are taken byte for byte, and the command is the one that is reported: run by hand in
    their folder it writes the same G-code, but for its date.

    Args:
        part_3mf: as `write_3mf` wrote it, beside the `slicer.ini` of `write_profile`.
        scene: resolved; its printer is what the G-code must keep to.
        work: an existing folder for temporary files, all removed again; the machine's by default.
        timeout_s: for both runs of the program together.
        program: path of PrusaSlicer; the one on the path by default.
        stop: ends the program when it is set. hear: called with what it prints while it slices.

    Raises:
        ValueError: the file is not a 3MF.
    """
    program = program or find_slicer()
    reason = why_not_sliced(scene)
    if reason is not None:
        return NotSliced("process", reason)
    if program is None:
        return NotSliced("missing", "PrusaSlicer is not installed", REMEDY)
    with temporary_folder("knotfab-slicer-", work) as own:
        for path in (part_3mf, part_3mf.with_name(PROFILE)):
            shutil.copyfile(path, own / path.name)
        return _Job(program, own, part_3mf.name, scene, timeout_s, stop, hear).run()


@dataclass(frozen=True)
class _Job:
    """One slicing in its own folder, with the files there."""

    program: str
    folder: Path
    name: str
    scene: ResolvedScene
    timeout_s: float
    stop: threading.Event | None
    hear: Callable[[str], None] | None
    began: float = field(default_factory=time.monotonic)

    def run(self) -> Sliced | NotSliced:
        shells = read_shells(self.folder / self.name)
        written = Path(self.name).with_suffix(".gcode")
        low, high = box_of(shells)
        across, deep, _ = self.scene.printer.build_volume_mm
        middle = np.array([across / 2, deep / 2])
        shift = np.append(middle - (low + high)[:2] / 2, -low[2])
        command = [
            *("--load", PROFILE, "--dont-arrange", "--center", ",".join(f"{x:g}" for x in middle)),
            *("--export-gcode", "--output", str(written), self.name),
        ]
        info = self._call("--info", self.name)
        if isinstance(info, NotSliced):
            return info
        objects, reading = compare_info(info.out, shells)
        ended = self._call(*command, heard=self.hear)
        if isinstance(ended, NotSliced):
            return ended
        try:
            gcode = read_gcode(self.folder / written)
        except BadGcode as error:
            return NotSliced("crashed", f"exit code 0, but {error}", said=_quote(ended))
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
            checks=(reading, *compare_gcode(gcode, shells, self.scene, shift)),
            command=shlex.join(["prusa-slicer", *command]),
            profile=read_profile(self.folder),
            seconds=time.monotonic() - self.began,
            retractions=gcode.retractions,
            starts_per_layer=gcode.starts_per_layer,
        )

    def _call(
        self, *arguments: str, heard: Callable[[str], None] | None = None
    ) -> Ended | NotSliced:
        """Run the program; NotSliced if it did not end well."""
        left = self.timeout_s - (time.monotonic() - self.began)
        command = [self.program, "--datadir", "settings", *arguments]
        if heard is not None and (flush := shutil.which("stdbuf")):
            command = [flush, "-oL", *command]  # else it says how far it is when it has ended
        try:
            ended = run_limited(command, self.folder, left, self.stop, heard)
        except OSError as error:
            reason = f"{Path(self.program).name} cannot be started ({error.strerror})"
            return NotSliced("missing", reason, REMEDY)
        said = _quote(ended)
        if ended.stopped:
            late = f"no answer in {self.timeout_s:g} s; a build can do without: --skip slicer"
            reason = late if ended.stopped == OUT_OF_TIME else ended.stopped
            return NotSliced("stopped", reason, said=said)
        if -ended.code in _FROM_OUTSIDE:
            reason = f"somebody ended PrusaSlicer (signal {-ended.code}), or the memory was used up"
            return NotSliced(
                "stopped", f"{reason}; a build can do without: --skip slicer", said=said
            )
        if ended.code < 0:
            return NotSliced("crashed", f"PrusaSlicer ended by signal {-ended.code}", said=said)
        if ended.code > 0:
            reason = said or f"exit code {ended.code}, without a word"
            return NotSliced("refused", f"PrusaSlicer refuses the part: {reason}", said=said)
        return ended


def _quote(ended: Ended) -> str:
    """Quote what the program said apart from its progress, in one line."""
    said = [*read_warnings(ended.err), *read_warnings(ended.out)]
    text = "; ".join(" ".join(warning.text.split()) for warning in said)
    return text if len(text) <= MOST_QUOTED else text[:MOST_QUOTED] + " …"
