"""Holds README's figures of its first command against what `make demo` built; fails where they differ.

`python -m benchmarks.readme_figures demo-out`: grams and hours by over 5 %, the IoU by over .001. Another
processor rounds otherwise, which leads a search elsewhere.
"""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks.measurement import run_study
from knotfab_formats.report import Report, read_report

README = Path(__file__).resolve().parents[1] / "README.md"
FIGURES = r"knight of ([\d.]+) g that prints in ([\d.]+) h .*?is ([\d.]+)\."


def compare_figures(text: str, report: Report) -> list[str]:
    """Name each figure of README's sentence that is farther from the report's than processors differ."""
    told = re.search(FIGURES, text, re.DOTALL)
    if told is None:
        return ["README has no sentence on what make demo gives"]
    grams, seconds = report.print.filament_g, report.print.time_s
    measured = {
        "grams": (grams, 0.05 * (grams or 0.0)),
        "hours": (seconds and seconds / 3600, 0.05 * (seconds or 0.0) / 3600),
        "IoU": (report.views[0].iou, 0.001),
    }
    wrong = []
    for (name, (found, within)), said in zip(measured.items(), told.groups(), strict=True):
        if found is None or abs(found - float(said)) > within:
            wrong.append(f"{name}: README says {said}, the build {found}")
    return wrong


def main(folder: Path = Path("demo-out"), /) -> int:
    """Print what differs; the exit code is 1 if anything does."""
    wrong = compare_figures(README.read_text("utf-8"), read_report(folder / "report.json"))
    print("\n".join(wrong) or "README says what was built.")
    return int(bool(wrong))


if __name__ == "__main__":
    run_study(main)
