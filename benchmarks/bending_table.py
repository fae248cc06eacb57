"""How well several pictures agree as they come, moved, and bent: the worst of the hull's bounds, seconds.

`python -m benchmarks.bending_table [--bend SHARE ...] [--out DIR] [SET ...]`: of the sets of
`benchmarks.build_table` (or those named), with no search. For each: the bounds, rms and most by which its
pictures are bent, the largest stretch, CPU seconds; then the means by how many pictures there are. DIR gets a
picture of each set: pictures as they came, as bent, and what all leave of them.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from benchmarks.build_table import NAMED, draw_sets
from benchmarks.measurement import make_folder, run_study, save_pictures
from examples.pictures import pictures
from knotfab.design.agree import agree
from knotfab.design.frames import spread_views
from knotfab.picture.read import Target, read_target
from knotfab.report.pictures import draw_agreement
from knotfab_formats.scene import Scene

Figures = tuple[float, float, float, float, float, float, float]


def measure(targets: list[Target], share: float | None) -> tuple[Figures, list[bytes]]:
    """Measure worst bounds as they come, moved and bent; rms, most, stretch; CPU seconds; and pictures."""

    def least(bend: float | None, azimuths_open: bool) -> float:
        done = agree(_scene(targets, bend), targets, azimuths_open=azimuths_open)
        return min(bound.iou for bound in done.bounds)

    begun = time.process_time()
    done = agree(_scene(targets, share), targets, azimuths_open=True)
    spent = time.process_time() - begun
    bent = [t.bending for t in done.targets if t.bending is not None]
    rms = float(np.sqrt(np.mean([b.rms**2 for b in bent]))) if bent else 0.0
    found = (
        least(0.0, False),
        least(0.0, True),
        min(bound.iou for bound in done.bounds),
        rms,
        max((b.most for b in bent), default=0.0),
        max((b.stretch for b in bent), default=1.0),
        spent,
    )
    drawn = zip(done.targets, done.bounds, strict=True)
    return found, [draw_agreement(target, bound) for target, bound in drawn]


def _scene(targets: list[Target], bend: float | None) -> Scene:
    scene = spread_views(Scene(), [t.name for t in targets])
    return scene.model_copy(update={"piece": scene.piece.model_copy(update={"bend": bend})})


def main(*sets: str, bend: tuple[str, ...] = ("auto",), out: Path | None = None) -> None:
    """Print the table."""
    folder = make_folder(out, "bending")
    files = save_pictures(pictures(), folder)
    drawn = [one for many, some in draw_sets().items() if many > 1 for one in some]
    plain = [name for name in NAMED if "@" not in name]
    for word in bend:
        share = {"auto": None, "off": 0.0}[word] if word in ("auto", "off") else float(word)
        every: dict[int, list[Figures]] = {}
        print(f"--bend {word}: bound, moved, bent, rms, most, stretch, s", flush=True)
        for name in sets or [*plain, *drawn]:
            targets = [read_target(files[one]) for one in name.split("+")]
            found, shown = measure(targets, share)
            every.setdefault(len(targets), []).append(found)
            for target, png in zip(targets, shown, strict=True):
                (folder / f"{name}-{target.name}-{word}.png").write_bytes(png)
            print(f"{name:<36}" + _row(found), flush=True)
        for many, rows in sorted(every.items()):
            mean = [float(x) for x in np.mean(rows, axis=0)]
            print(f"{f'mean of {len(rows)} sets of {many}':<36}" + _row(mean), flush=True)


def _row(found: Figures | list[float]) -> str:
    before, moved, bent, rms, most, stretch, spent = found
    return f"{before:8.3f}{moved:8.3f}{bent:8.4f}{rms:8.1%}{most:8.1%}{stretch:8.2f}{spent:8.1f}"


if __name__ == "__main__":
    run_study(main)
