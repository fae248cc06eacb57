"""Whether builds write the same knots.json and part.stl as those of another checkout, byte for byte.

    python -m benchmarks.same_bytes ../before --accuracy sketch --kept before.json

Each build is made here and in the checkout, by its own .venv; `--kept` remembers the digests of the checkout.
Where a default has changed since, a build names what it was before.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import tempfile
from pathlib import Path

from benchmarks.lines import ROOT
from benchmarks.measurement import run_study

BUILDS = {
    **{
        name: f"examples/{name}.png --print --mount wall --plate outline"
        for name in ("knight", "cat", "heart", "teapot")
    },
    "two views": "examples/heart.png examples/teapot.png",
    "trefoil": "examples/heart.png --knot trefoil",
    "stand": "examples/heart.png --mount stand",
    "hung": "examples/heart.png --mount hang",
    "lamps": "examples/badge.png --lamps rgb",
    "free view": "examples/heart.png --free view",
    "network": "examples/heart.png --search inn",
}
FILES = ("knots.json", "part.stl")


def digest(checkout: Path, call: str) -> dict[str, str]:
    """Build in a checkout; return the digest of each file, and the exit code."""
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "out"
        command = [str(checkout / ".venv/bin/python"), "-m", "knotfab", "build", *call.split()]
        command += ["--skip", "slicer", "--quiet", "--out", str(out)]
        done = subprocess.run(command, cwd=checkout, capture_output=True)
        folder = out if done.returncode == 0 else out / "rejected"
        found = {"exit code": str(done.returncode)}
        for name in FILES:
            path = folder / name
            found[name] = (
                hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "none"
            )
        return found


def main(before: Path, *only: str, accuracy: str = "standard", kept: Path | None = None) -> int:
    """Build all, or only some, and print which differ; 1 if any does."""
    known = json.loads(kept.read_text("utf-8")) if kept and kept.is_file() else {}
    unlike = 0
    for name, call in BUILDS.items():
        if only and name not in only:
            continue
        asked = f"{call} --accuracy {accuracy}"
        if asked not in known:
            known[asked] = digest(before.resolve(), asked)
            if kept:
                kept.write_text(json.dumps(known, indent=1))
        here = digest(ROOT, asked)
        differ = [key for key, value in here.items() if value != known[asked][key]]
        unlike += bool(differ)
        print(f"{name:<10} {'differs: ' + ', '.join(differ) if differ else 'same'}", flush=True)
    return int(unlike > 0)


if __name__ == "__main__":
    run_study(main)
