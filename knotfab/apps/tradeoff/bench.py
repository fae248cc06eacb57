"""Schedule the runs of a trade-off: each is measured once, if time is left, and kept in a journal."""

from __future__ import annotations

import json
import os
import pickle
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from knotfab.apps.tradeoff.measure import Run, Study, run_point, warm_up
from knotfab.apps.tradeoff.points import (
    PRESET,
    Measured,
    Point,
    combine,
    frontier,
    halve,
    list_effects,
    merge_turns,
)
from knotfab.base import errors
from knotfab.base.disk import open_stream, temporary_folder
from knotfab.base.errors import MachineError
from knotfab.base.pool import ONE_THREAD, Crash, Workers
from knotfab_formats.errors import InputError, KnotfabError
from knotfab_formats.search import SearchSettings


@dataclass(frozen=True)
class WantedRun:
    """A run to be measured: index of the picture, settings, and number of the repeat."""

    picture: int
    settings: SearchSettings
    turn: int = 0


Runner = Callable[[Iterator[WantedRun]], Iterator[tuple[WantedRun, Run]]]


def make_writable(out: Path) -> None:
    """Make the folder of the results.

    Raises:
        InputError: it cannot be made or written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out {out}", f"it cannot be made: {error.strerror}", "Name a folder"
        ) from error
    if not os.access(out, os.W_OK):
        raise InputError(f"--out {out}", "it may not be written", "Name another folder")


class Journal:
    """The finished runs by key, in a file with one line of JSON each; lines cut off are ignored.

    Raises:
        InputError: the file cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.runs: dict[str, Run] = {}
        self.used: set[str] = set()
        try:
            text = path.read_text("utf-8") if path.exists() else ""
            for line in text.splitlines():
                try:
                    told = json.loads(line)
                    self.runs[told["key"]] = Run(**told["run"])
                except (ValueError, TypeError, KeyError):
                    continue
            self._file = open_stream(path, "a")
            if text and not text.endswith("\n"):
                self._file.write("\n")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path}", f"it is no journal ({error})", "Move it away") from error

    def find(self, key: str) -> Run | None:
        """Return the run with this key if it was measured before."""
        self.used.add(key)
        return self.runs.get(key)

    def add(self, key: str, run: Run, **told: Any) -> None:
        """Append a finished run; `told` is written for human readers only."""
        self.runs[key] = run
        self._file.write(json.dumps({"key": key, **told, "run": run.to_dict()}) + "\n")
        self._file.flush()

    @property
    def unused(self) -> int:
        """How many of its runs this call did not ask for: those of other pictures, settings or versions."""
        return len(self.runs.keys() - self.used)

    def close(self) -> None:
        self._file.close()


class Bench:
    """Measures points on pictures and remembers every run.

    Args:
        run: measures the runs that it takes from an iterator, in any order.
        limit_s: a run that would probably end later is not started; None for no limit.
        report: is called with the number of finished runs and the best IoU so far.
    """

    def __init__(
        self,
        studies: Sequence[Study],
        run: Runner,
        journal: Journal,
        repeats: int = 1,
        limit_s: float | None = None,
        clock: Callable[[], float] = time.monotonic,
        report: Callable[[int, float | None], None] | None = None,
    ) -> None:
        self.studies, self.repeats = tuple(studies), repeats
        self._run, self._journal, self._report = run, journal, report
        self._clock, self._limit_s, self._begun = clock, limit_s, clock()
        self._runs: dict[WantedRun, Run] = {}
        self._lasted: list[float] = []
        self.left_out: dict[WantedRun, None] = {}

    def measure(self, points: Sequence[Point], pictures: int) -> list[Measured]:
        """Measure points on the first `pictures` while time is left, and return `measured(points)`.

        Points alternate within each picture and repeat, so that other load on the machine affects all alike.
        """
        asked = [
            WantedRun(picture, point.settings, turn)
            for picture in range(pictures)
            for turn in range(self.repeats)
            for point in points
        ]
        missing = []
        for request in dict.fromkeys(asked):
            if request not in self._runs:
                kept = self._journal.find(self._key(request))
                if kept is None:
                    missing.append(request)
                else:
                    self._runs[request] = kept
        last = self._clock()
        for request, run in self._run(self._in_time(missing)):
            self._runs[request] = run
            told = {"picture": self.studies[request.picture].name}
            self._journal.add(self._key(request), run, **told, turn=request.turn)
            now = self._clock()
            self._lasted.append(now - last)
            last = now
            if self._report is not None:
                best = max((run.iou or 0.0 for run in self._runs.values()), default=None)
                self._report(len(self._runs), best)
        return self.measured(points)

    def measured(self, points: Iterable[Point]) -> list[Measured]:
        """Return the runs of each point, up to the first picture that it was not measured on."""
        found = []
        for point in points:
            runs: list[Run] = []
            for picture in range(len(self.studies)):
                turns = [WantedRun(picture, point.settings, t) for t in range(self.repeats)]
                known = [self._runs[turn] for turn in turns if turn in self._runs]
                if not known or known[0].iou is None:
                    break
                runs.append(merge_turns(known))
            if runs:
                found.append(Measured(point, tuple(runs)))
        return found

    def _key(self, request: WantedRun) -> str:
        return self.studies[request.picture].key(request.settings, request.turn)

    def _in_time(self, requests: Sequence[WantedRun]) -> Iterator[WantedRun]:
        for request in requests:
            lasts = statistics.median(self._lasted) if self._lasted else 0.0
            spent = self._clock() - self._begun
            if self._limit_s is not None and spent + lasts > self._limit_s:
                self.left_out[request] = None
            else:
                yield request


def run_all(studies: Sequence[Study], jobs: int = 1) -> Runner:
    """Return a runner that searches in this process, or in `jobs` parallel processes of one thread each.

    The runner raises MachineError if a process dies.
    """
    warm: list[bool] = []

    def here(requests: Iterator[WantedRun]) -> Iterator[tuple[WantedRun, Run]]:
        for request in requests:
            study = studies[request.picture]
            if not warm:
                warm_up(study, request.settings)
                warm.append(True)
            yield request, run_point(study, request.settings, request.turn == 0)

    def beside(requests: Iterator[WantedRun]) -> Iterator[tuple[WantedRun, Run]]:
        first = next(requests, None)
        if first is None:
            return
        with temporary_folder("knotfab-studies-") as place:
            file = place / "studies"
            file.write_bytes(pickle.dumps(list(studies)))
            env = {**os.environ, **ONE_THREAD}
            with Workers(__name__, str(file), jobs=jobs, env=env) as workers:
                running: dict[Future[dict[str, Any]], WantedRun] = {}

                def ask(request: WantedRun | None) -> None:
                    if request is not None:
                        told = {"picture": request.picture, "judge": request.turn == 0}
                        asked = {**told, "settings": request.settings.model_dump()}
                        running[workers.ask(asked)] = request

                ask(first)
                for _ in range(jobs - 1):
                    ask(next(requests, None))
                while running:
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        request = running.pop(future)
                        yield request, _read(future, jobs)
                        ask(next(requests, None))

    return here if jobs == 1 else beside


_studies: list[Study] = []  # in a worker process
_warm: list[bool] = []


def begin(file: str) -> None:
    """Load in a worker process the studies that its parent pickled."""
    _studies[:] = pickle.loads(Path(file).read_bytes())


def answer(request: dict[str, Any], told: object) -> dict[str, Any]:
    """Measure one run in a worker process: {"picture": index of the study, "settings", "judge"}."""
    del told
    study, settings = _studies[request["picture"]], SearchSettings(**request["settings"])
    try:
        if not _warm:
            warm_up(study, settings)
            _warm.append(True)
        return run_point(study, settings, request["judge"]).to_dict()
    except KnotfabError as error:
        return {"refused": [type(error).__name__, error.what, error.why, error.remedy]}


def _read(future: Future[dict[str, Any]], jobs: int) -> Run:
    try:
        answer = future.result()
    except Crash as crash:
        said = f"the process of a point ended ({crash.said or crash.code})"
        raise MachineError(f"--jobs {jobs}", said, "Try --jobs 1.") from crash
    if "refused" in answer:
        kind, *told = answer["refused"]
        raise getattr(errors, kind)(*told)
    return Run(**answer)


@dataclass(frozen=True)
class Explored:
    """All points that were measured on at least one picture.

    `compared` is the number of first pictures on which every preset was measured; `middle` has the
    settings whose knobs were turned.
    """

    measured: tuple[Measured, ...]
    middle: Measured
    compared: int

    @property
    def whole(self) -> list[Measured]:
        """The points measured on all compared pictures, without their runs on other pictures."""
        return [m.over(self.compared) for m in self.measured if len(m.runs) >= self.compared]

    @property
    def front(self) -> list[Measured]:
        """The points of `whole` that no other one beats."""
        return frontier(self.whole, self.middle.over(self.compared))

    def sets_apart(self, one: Measured) -> bool:
        """Return whether a point saw too few pictures to be compared, or may not stand on the front."""
        middle = self.middle.over(self.compared)
        return len(one.runs) < self.compared or not one.over(self.compared).keeps(middle)

    def cost_of(self, one: Measured) -> tuple[float, float]:
        """Return (seconds, error) over the compared pictures.

        If the point saw fewer of them, its ratios to the middle on these are assumed to hold for all.
        """
        seen = min(len(one.runs), self.compared)
        one, here, all_ = one.over(seen), self.middle.over(seen), self.middle.over(self.compared)
        return one.seconds * all_.seconds / here.seconds, one.error * all_.error / here.error


def list_rungs(pictures: int) -> list[int]:
    """List how many pictures each round of halving measures: an eighth, a quarter, …, all."""
    sizes = [-(-pictures // 8)]
    while sizes[-1] < pictures:
        sizes.append(min(2 * sizes[-1], pictures))
    return sizes


def explore(
    bench: Bench, points: Sequence[Point], middle: SearchSettings, combinations: int
) -> Explored | None:
    """Measure points and combinations of their good values, by successive halving over the pictures.

    Returns None if there was no time to measure the middle settings once.
    """
    total = len(bench.studies)
    presets = [p for p in points if p.knob == PRESET or p.settings == middle]
    alive = [p for p in points if p not in presets]
    first, *others = list_rungs(total)
    bench.measure(presets, first)
    measured = bench.measure([*presets, *alive], first)
    at = _find(measured, middle)
    if at is not None and combinations:
        whole = [m for m in measured if len(m.runs) >= len(at.runs)]
        effects = list_effects([m.over(len(at.runs)) for m in whole], at)
        made = combine(middle, effects, points, combinations, middle.seed)
        bench.measure(made, first)
        alive += made
    points = [*presets, *alive]
    for before, pictures in zip([first, *others], others, strict=False):
        measured = [m.over(before) for m in bench.measured(points) if len(m.runs) >= before]
        at = _find(measured, middle)
        if at is None:
            break
        beside = [m for m in measured if m.point in presets]
        alive = halve([m for m in measured if m.point in alive], at, beside)
        bench.measure(presets, pictures)
        bench.measure(alive, pictures)
    measured = bench.measured(points)
    at = _find(measured, middle)
    if at is None:
        return None
    seen = [len(m.runs) for m in measured if m.point in presets]
    return Explored(tuple(measured), at, min(seen))


def _find(measured: Sequence[Measured], settings: SearchSettings) -> Measured | None:
    return next((m for m in measured if m.point.settings == settings), None)
