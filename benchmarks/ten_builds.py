"""Ten builds, one for each kind of scene: digests of their parts, to hold one version against another.

    python -m benchmarks.ten_builds --out before.json        # on one commit
    python -m benchmarks.ten_builds --out after.json --beside before.json

Unmounted knots are to be the same to the bit, mounted parts of one volume to a millionth; the verdict too.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.lines import ROOT
from benchmarks.measurement import run_study

BUILDS = {
    "one view": "examples/knight.png",
    "several views": "examples/heart.png examples/teapot.png --accuracy sketch",
    "lamps": "examples/badge.png --lamps rgb --accuracy sketch",
    "sequence": "--sequence examples/walk --accuracy sketch",
    "wall": "examples/cat.png --mount wall --skip slicer --accuracy sketch",
    "stand": "examples/heart.png --mount stand --skip slicer --accuracy sketch",
    "thread": "examples/heart.png --mount hang --skip slicer --accuracy sketch",
    "wire": "text:O --material steel-wire-2mm --size 120 --accuracy sketch",
    "free view": "examples/heart.png --free view --accuracy sketch",
    "network": "examples/heart.png --search inn --accuracy sketch",
}


def build(call: str) -> dict[str, object]:
    """Build in a process of its own; return exit code, digest, volume and verdict of the part."""
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "out"
        command = [sys.executable, "-m", "knotfab", "build", *call.split(), "--quiet"]
        done = subprocess.run([*command, "--out", str(out)], cwd=ROOT, capture_output=True)
        folder = out if done.returncode == 0 else out / "rejected"
        parts = sorted(folder.glob("part*.stl"))
        found: dict[str, object] = {"exit_code": done.returncode}
        found["parts"] = [hashlib.sha256(p.read_bytes()).hexdigest() for p in parts]
        knots = [
            json.loads(p.read_text("utf-8"))["knots"] for p in sorted(folder.glob("knots*.json"))
        ]
        found["knots"] = hashlib.sha256(json.dumps(knots).encode()).hexdigest()
        if (report := folder / "report.json").exists():
            said = json.loads(report.read_text("utf-8"))
            found["volume_mm3"] = said["print"].get("volume_mm3")
            found["verdict"] = (said.get("verdict") or {}).get("word")
        return found


def differs(name: str, one: dict[str, object], other: dict[str, object]) -> str:
    """Say how two builds of a name differ; empty where they agree as they must."""
    held = name in ("wall", "stand", "thread")
    if not held and one["knots"] != other["knots"]:
        return "other knots"
    volumes = [float(str(build.get("volume_mm3") or 0)) for build in (one, other)]
    if abs(volumes[0] - volumes[1]) > 1e-6 * max(volumes):
        return f"volume {volumes[0]:.2f} and {volumes[1]:.2f} mm3"
    if one.get("verdict") != other.get("verdict"):
        return f"verdict {one.get('verdict')} and {other.get('verdict')}"
    return "" if held or one["parts"] == other["parts"] else "the same knots, meshed otherwise"


def main(out: Path = Path("ten-builds.json"), beside: Path | None = None) -> None:
    """Build all ten, write what each gave to `out`, and say how it differs from `beside`."""
    known = {} if beside is None else json.loads(beside.read_text("utf-8"))
    found = {}
    for name, call in BUILDS.items():
        found[name] = build(call)
        out.write_text(json.dumps(found, indent=1))
        told = differs(name, known[name], found[name]) or "same" if name in known else ""
        print(f"{name:<14} exit {found[name]['exit_code']}  {told}", flush=True)


if __name__ == "__main__":
    run_study(main)
