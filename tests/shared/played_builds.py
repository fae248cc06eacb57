"""Builds of a batch as a script plays them, which does what the picture's text says."""

from __future__ import annotations

import sys
import textwrap
from pathlib import Path

PYTHON = sys.executable  # itself, where that which builds run with is played

PLAYED = """\
    #!{python} -S
    import json, os, pathlib, signal, sys, time
    here = pathlib.Path({runs!r})
    out = pathlib.Path(next(a for a in sys.argv if a.startswith("--out=")).removeprefix("--out="))
    at = sys.argv.index("build") + 1
    picture = pathlib.Path(sys.argv[at])
    told = picture.read_text()
    if told == "once" and not (here / "b.parent").exists():
        (here / "b.parent").write_text(str(os.getppid()))
        told = "wait"
    with open(here / (picture.stem + ".runs"), "a") as runs:
        runs.write(" ".join(sys.argv[at + 1:]) + "\\n")
    if told == "real":
        os.execv({python!r}, [{python!r}, *sys.argv[1:]])
    if told == "fill":
        out.mkdir()
        with open(out / "part.stl", "wb", buffering=0) as file:
            while file.write(bytes(4096)) == 4096:
                pass
    if told == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if told == "wait":
        time.sleep(60)
    if told == "wrong":
        print("knotfab: " + str(picture) + ": no picture. Draw one.", file=sys.stderr)
        sys.exit(2)
    place = out / "rejected" if told == "fail" else out
    place.mkdir(parents=True, exist_ok=True)
    (place / "report.json").write_text(json.dumps(
        {{"views": [{{"iou": 0.97}}, {{"iou": 0.95}}], "verdict": {{"word": "good"}}}}))
    (place / "compare-front.png").write_bytes(b"")
    (place / "report.html").write_text("report")
    if told == "fail":
        print("knotfab: shadow failed: see there", file=sys.stderr)
        sys.exit(1)
"""


def write_player(tmp_path: Path) -> tuple[Path, Path]:
    """The script that stands for the interpreter, and the folder in which it keeps a line a run."""
    runs = tmp_path / "runs"
    runs.mkdir()
    script = tmp_path / "played"
    script.write_text(textwrap.dedent(PLAYED).format(python=PYTHON, runs=str(runs)))
    script.chmod(0o755)
    return script, runs


def draw(folder: Path, **told: str) -> Path:
    folder.mkdir(exist_ok=True)
    for name, text in told.items():
        (folder / f"{name}.png").write_text(text)
    return folder


def count(runs: Path) -> dict[str, int]:
    return {p.stem: len(p.read_text().splitlines()) for p in runs.glob("*.runs")}
