"""Whole builds of the hardest pictures: each must end with exit code 0, 1 or 2 and a clear sentence.

    python -m examples.studies.hardest_builds [--only WORD] [--out DIR] [--limit-s 900]

Each picture is built with `--print --accuracy draft` in a process of its own. A crash, a traceback, another
code or a build that is longer than the limit is a fault; any fault ends this with 1.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from examples.hard_cases.pictures import HardPicture, hard_pictures

__all__ = ["Built", "built", "main"]

HUNG = 124


@dataclass(frozen=True)
class Built:
    """What came of one build: exit code (124 where it was stopped), CPU seconds, what it said last."""

    name: str
    code: int
    cpu_s: float
    wall_s: float
    iou: float | None
    said: str

    @property
    def clear(self) -> bool:
        """Whether it ended as a build may: 0, or 1 or 2 with a sentence and no traceback."""
        told = self.code == 0 or bool(self.said)
        return self.code in (0, 1, 2) and told and "Traceback" not in self.said


def built(case: HardPicture, folder: Path, limit_s: float) -> Built:
    """Draw the picture into `folder` and build it there."""
    picture = folder / f"{case.name}.png"
    case.image().save(picture)
    out = folder / case.name
    call = [sys.executable, "-m", "knotfab", "build", str(picture), "--print", "--mount", "none"]
    call += ["--accuracy", "draft", "--out", str(out), "--quiet"]
    before, start = _children_s(), time.perf_counter()
    try:
        run = subprocess.run(call, capture_output=True, text=True, timeout=limit_s, check=False)
        code, said = run.returncode, (run.stderr.strip() or run.stdout.strip())
    except subprocess.TimeoutExpired:
        code, said = HUNG, f"still at work after {limit_s:.0f} s"
    wall_s = time.perf_counter() - start
    report = next((p for p in (out, out / "rejected") if (p / "report.json").exists()), None)
    views = json.loads((report / "report.json").read_text())["views"] if report else []
    iou = min((v["iou"] for v in views), default=None)
    return Built(case.name, code, _children_s() - before, wall_s, iou, said)


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(argv: list[str] | None = None) -> int:
    """Print one line a picture; 1 where any build ended as none may."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="pictures whose name holds this word")
    parser.add_argument("--out", type=Path, help="folder to keep the builds in")
    parser.add_argument("--limit-s", type=float, default=900.0)
    asked = parser.parse_args(argv)
    faults = 0
    print(f"{'picture':<14} {'code':>4} {'IoU':>7} {'CPU s':>7} {'wall s':>7}  said", flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = asked.out or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for case in hard_pictures():
            if asked.only not in case.name:
                continue
            row = built(case, folder, asked.limit_s)
            faults += not row.clear
            iou = "" if row.iou is None else f"{row.iou:.4f}"
            last = " ".join(row.said.split())[:300]
            print(
                f"{row.name:<14} {row.code:>4} {iou:>7} {row.cpu_s:>7.1f} {row.wall_s:>7.1f}  {last}",
                flush=True,
            )
    print(f"{faults} builds ended as none may")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
