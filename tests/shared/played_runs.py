"""Builds that nothing searched for: those of batch and studio, as a script plays them."""

import base64
import sys
from pathlib import Path

import numpy as np

import knotfab_formats
from knotfab.base.arrays import Array
from knotfab.knots import Knot, Knots
from knotfab_formats.scene import ResolvedView

FORMATS = str(Path(knotfab_formats.__file__).parents[1])
PYTHON = sys.executable  # itself, where that which builds run with is played

SCRIPT = """\
#!{python} -S
import runpy, sys
sys.path[:0] = [{folder!r}, {formats!r}]  # -S: no installation
(serve,) = [word for word in sys.argv if word.endswith("serve.py")]
sys.argv = [serve, "played_build"]
runpy.run_path(serve, run_name="__main__")
"""
PLAYED = """\
import contextlib, io, json, os, pathlib, signal, subprocess, sys, time

def answer(request, told):
    said = io.StringIO()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with contextlib.redirect_stderr(said):
            play(request["arguments"], told)
        code = 0
    except KeyboardInterrupt:
        code = 130
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else 1
        said.write("" if isinstance(left.code, int) else left.code)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    return {{"code": code, "said": said.getvalue()}}

def play(words, events):
    here = pathlib.Path({runs!r})
    CURVES = {curves!r}
    out = pathlib.Path(next(a for a in words if a.startswith("--out=")).removeprefix("--out="))
    at = words.index("--" if "--" in words else "build") + 1
    options = [a for a in words[words.index("build") + 1:] if a not in ("--", words[at])]
    picture = pathlib.Path(words[at])
    text = words[at].startswith("text:")
    told = words[at][5:] if text else picture.read_text(errors="replace")
    def tell(event, **data):
        if "--events=-" in words:
            print(json.dumps({{"event": event, **data}}), flush=True, file=events)
    def stop(*_):
        tell("standing", start=START)
        sys.exit(130)
    if "--events=-" in words:
        signal.signal(signal.SIGTERM, stop)
    START = {start!r}
    VIEW = {view!r}
    tell("stage", name="search", seconds=0.1, left_s=9.0)
    tell("scene", views=[VIEW], pictures=[], radius_mm=2.0)
    for k in range(3):
        tell("knots", radius_mm=2.0, curves=CURVES[k:k + 1])
        tell("progress", stage="search", fraction=k / 3, share=k / 3, iou=0.9, left_s=5.0)
    if told == "once" and not (here / "b.parent").exists():
        (here / "b.parent").write_text(str(os.getppid()))
        told = "wait"
    with open(here / (picture.stem + ".runs"), "a") as runs:
        runs.write(" ".join(options) + "\\n")
    if told == "real":
        done = subprocess.run([{python!r}, "-P", "-m", "knotfab", *words], stderr=subprocess.PIPE, text=True)
        print(done.stderr, file=sys.stderr)
        sys.exit(done.returncode)
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
    if told == "crash":
        sys.exit("knotfab: out of ideas")
    place = out / "rejected" if told == "fail" else out
    place.mkdir(parents=True, exist_ok=True)
    (place / "report.json").write_text(json.dumps(
        {{"views": [{{"iou": 0.97}}, {{"iou": 0.95}}], "verdict": {{"word": "good"}},
          "rows": [{{"name": "piece", "status": "info", "text": "9 mm, 5 g; a tube: --plate pegs"}}]}}))
    (place / "compare-front.png").write_bytes(b"")
    (place / "report.html").write_text("report")
    (place / "part.3mf").write_text("a part")
    (place / "evil.html").write_text("<script>")
    tell("standing", start=START)
    tell("end", exit_code=1 if told == "fail" else 0, folder=str(place))
    if told == "fail":
        print("knotfab: shadow failed: see there", file=sys.stderr)
        sys.exit(1)
"""


def write_player(tmp_path: Path) -> tuple[Path, Path]:
    """The script that stands for the interpreter, and the folder in which it keeps a line a run."""
    runs = tmp_path / "runs"
    runs.mkdir()
    script = tmp_path / "played"
    rings = [_ring(radius) for radius in (30.0, 40.0, 50.0)]
    played = {
        "start": Knots((Knot(rings[-1]),), 2.0).dump_start(),
        "curves": [base64.b64encode(ring.astype("<f4").tobytes()).decode() for ring in rings],
        "view": ResolvedView(frame_width_mm=120.0, frame_height_mm=120.0).model_dump(),
    }
    script.write_text(SCRIPT.format(python=PYTHON, folder=str(tmp_path), formats=FORMATS))
    code = PLAYED.format(python=PYTHON, runs=str(runs), **played)
    (tmp_path / "played_build.py").write_text(code)
    script.chmod(0o755)
    return script, runs


def _ring(radius: float) -> Array:
    t = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    return np.stack([radius * np.cos(t), radius * np.sin(t), 4 * np.sin(2 * t)], axis=1)


def draw(folder: Path, **told: str) -> Path:
    folder.mkdir(exist_ok=True)
    for name, text in told.items():
        (folder / f"{name}.png").write_text(text)
    return folder


def count(runs: Path) -> dict[str, int]:
    return {p.stem: len(p.read_text().splitlines()) for p in runs.glob("*.runs")}
