"""Give all readers thousands of broken files: each must end in a result or a sentence, soon and small.

    python -m benchmarks.fuzz_files [--count 10000] [--strangers 600] [--seed 0]

The files made by hand come first, then `count` of the validators' and `strangers` of the maker's (pictures,
drawings, scenes, starts, templates, reports), which are good ones changed at random. Each is validated in a
worker process, so that a crash, a hang (over 60 s) or a hunger for memory (over 1 GB; 2 GB)
takes only that worker. Ends with 1 if there was any; the offending files are kept in fuzz-failures/.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
import time
from collections import Counter
from itertools import chain
from multiprocessing.connection import Connection
from pathlib import Path

from benchmarks.measurement import run_study
from tests.corpus.fuzzed import fuzz_file
from tests.corpus.hostile import Hostile, handmade
from tests.corpus.judge import Outcome, examine
from tests.corpus.strangers import fuzz_stranger

SLOW_S = 60.0  # by the clock, of a machine that may be busy
MOST_MB = 1000.0
MOST_STRANGER_MB = 2000.0  # for pictures and whatever else the maker reads
WORKERS = 2
FILES_PER_WORKER = 500


def _work(pipe: Connection) -> None:
    with tempfile.TemporaryDirectory() as folder:
        while (file := pipe.recv()) is not None:
            pipe.send(examine(file, Path(folder)))


class _Worker:
    """A process that examines files one by one, and is replaced when one of them breaks it."""

    def __init__(self) -> None:
        self.file: Hostile | None = None
        self.begin()

    def begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs,), daemon=True)
        self.process.start()
        theirs.close()
        self.done, self.fresh = 0, True

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()

    def give(self, file: Hostile) -> None:
        if self.done >= FILES_PER_WORKER:  # memory is watched as a peak: start anew at times
            self.end()
            self.begin()
        self.file, self.started = file, time.perf_counter()
        self.most_mb = MOST_STRANGER_MB if file.reader else MOST_MB
        self.pipe.send(file)

    def outcome(self) -> Outcome | None:
        """Tell how the file in hand ended; None while it is examined."""
        waited = time.perf_counter() - self.started
        try:
            if self.pipe.poll(0.0):
                found: Outcome = self.pipe.recv()
                self.done, self.fresh = self.done + 1, False
                if found.seconds > SLOW_S:
                    return Outcome("slow", found.said, found.seconds, found.peak_mb)
                if found.peak_mb > self.most_mb:
                    self.done = FILES_PER_WORKER
                    return Outcome("hungry", found.said, found.seconds, found.peak_mb)
                return found
        except (EOFError, OSError):
            code = self.process.exitcode
            self.end()
            self.begin()
            return Outcome("crashed", f"the process ended with {code}", waited, 0.0)
        if waited > (4 if self.fresh else 2) * SLOW_S:  # a fresh one loads its libraries first
            self.end()
            self.begin()
            return Outcome("slow", "still at work", waited, 0.0)
        return None


def run_all(
    count: int, seed: int, show: bool = True, strangers: int = 0
) -> list[tuple[Hostile, Outcome]]:
    """Examine the files made by hand and fuzzed ones, `count` and `strangers`, on two workers."""
    first = seed * 1_000_003
    queue = chain(
        handmade() if count else (),
        (fuzz_file(first + i) for i in range(count)),
        (fuzz_stranger(first + i) for i in range(strangers)),
    )
    workers = [_Worker() for _ in range(WORKERS)]
    results: list[tuple[Hostile, Outcome]] = []
    try:
        busy = [w for w in workers if _next(w, queue)]
        while busy:
            for worker in list(busy):
                found = worker.outcome()
                if found is None:
                    continue
                assert worker.file is not None
                results.append((worker.file, found))
                if show and len(results) % 1000 == 0:
                    print(f"{len(results)} files", file=sys.stderr, flush=True)
                if not _next(worker, queue):
                    busy.remove(worker)
            time.sleep(0.0005)
    finally:
        for worker in workers:
            worker.end()
    return results


def _next(worker: _Worker, queue: object) -> bool:
    file = next(queue, None)  # type: ignore[call-overload]
    if file is not None:
        worker.give(file)
    return file is not None


def main(*, count: int = 10000, strangers: int = 600, seed: int = 0) -> int:
    start = time.perf_counter()
    results = run_all(count, seed, strangers=strangers)
    kinds = Counter(outcome.kind for _, outcome in results)
    bad = [(f, o) for f, o in results if o.kind in ("crashed", "slow", "hungry")]
    bad += [(f, o) for f, o in results if f.says and (o.kind != "refused" or f.says not in o.said)]
    print(f"{len(results)} hostile files in {time.perf_counter() - start:.0f} s")
    for kind in ("pass", "fail", "refused", "crashed", "slow", "hungry"):
        print(f"  {kind:8} {kinds[kind]}")
    print(f"  slowest {max(o.seconds for _, o in results):.2f} s, ", end="")
    print(f"largest memory {max(o.peak_mb for _, o in results):.0f} MB")
    folder = Path("fuzz-failures")
    for number, (file, outcome) in enumerate(bad):
        folder.mkdir(exist_ok=True)
        (folder / f"{number:03}-{file.name}").write_bytes(file.content)
        print(f"  {number:03}-{file.name}: {outcome.kind}, {outcome.seconds:.1f} s, {outcome.said}")
    return 1 if bad else 0


if __name__ == "__main__":
    run_study(main)
