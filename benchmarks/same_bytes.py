"""Whether builds write the same knots.json and part.stl as those of another checkout, byte for byte.

    python -m benchmarks.same_bytes ../before --accuracy sketch --kept before.json

    python -m benchmarks.same_bytes ../before --masks       (are pictures read as there, pixel by pixel?)

Each build is made here and in the checkout, by its own .venv; `--kept` remembers the digests of the checkout.
Where a default has changed since, a build names what it was before.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.brought import WORDS, draw_brought
from benchmarks.lines import ROOT
from benchmarks.measurement import run_study
from examples.pictures import pictures
from knotfab.picture.silhouette import mask_iou

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


_READ = """
import sys, pathlib, numpy
sys.path[:0] = [".", "formats", "validators"]
from knotfab.picture.read import read_target
found = {}
for path in sorted(pathlib.Path(sys.argv[1]).iterdir()):
    try:
        found[path.stem] = read_target(path).asked
    except Exception:
        found[path.stem] = numpy.zeros((0, 0), dtype=bool)
numpy.savez_compressed(sys.argv[2], **found)
"""


def compare_masks(before: Path) -> int:
    """Print which of the 49 pictures, the project's and brought ones, are read otherwise; 1 if any is."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "pictures"
        found: list[dict[str, NDArray[np.bool_]]] = []
        folder.mkdir()
        for name, image in (pictures() | {name: draw_brought(name) for name in WORDS}).items():
            image.save(folder / f"{name}.png")
        for checkout in (before.resolve(), ROOT):
            out = Path(place) / f"{len(found)}.npz"
            python = str(checkout / ".venv/bin/python")
            subprocess.run([python, "-c", _READ, str(folder), str(out)], cwd=checkout, check=True)
            found.append(dict(np.load(out)))
    there, here = found
    unlike = [name for name, mask in there.items() if not np.array_equal(mask, here[name])]
    for name in unlike:
        one, other = there[name], here[name]
        alike = f"{mask_iou(one, other):.3f}" if one.shape == other.shape else "another size"
        print(f"{name}: IoU {alike}")
    print(f"{len(there) - len(unlike)} of {len(there)} are read alike")
    return int(bool(unlike))


def main(
    before: Path,
    *only: str,
    accuracy: str = "standard",
    kept: Path | None = None,
    masks: bool = False,
) -> int:
    """Build all, or only some, and print which differ; 1 if any does."""
    if masks:
        return compare_masks(before)
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
