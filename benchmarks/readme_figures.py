"""Holds README's figures of its first command against what `make demo` built; fails where they differ.

`python -m benchmarks.readme_figures demo-out`
"""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks.measurement import run_study
from knotfab_formats.report import Report, read_report

README = Path(__file__).resolve().parents[1] / "README.md"
FIGURES = r"knight of ([\d.]+) g that prints in ([\d.]+) h .*?is ([\d.]+)\."


def compare_figures(text: str, report: Report) -> list[str]:
    """Name each figure of README's sentence that is not the report's, as rounded there."""
    told = re.search(FIGURES, text, re.DOTALL)
    if told is None:
        return ["README has no sentence on what make demo gives"]
    grams, seconds = report.print.filament_g, report.print.time_s
    measured = {
        "grams": grams,
        "hours": None if seconds is None else seconds / 3600,
        "IoU": report.views[0].iou,
    }
    wrong = []
    for (name, found), said in zip(measured.items(), told.groups(), strict=True):
        places = len(said.partition(".")[2])
        if found is None or f"{found:.{places}f}" != said:
            wrong.append(f"{name}: README says {said}, the build {found}")
    return wrong


def main(folder: Path = Path("demo-out"), /) -> int:
    """Print what differs; the exit code is 1 if anything does."""
    wrong = compare_figures(README.read_text("utf-8"), read_report(folder / "report.json"))
    print("\n".join(wrong) or "README says what was built.")
    return int(bool(wrong))


if __name__ == "__main__":
    run_study(main)
