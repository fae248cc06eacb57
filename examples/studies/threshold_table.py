"""Whether what an effect does in a design grows from nothing: builds just below and just above its threshold.

`python -m examples.studies.threshold_table [--accuracy NAME] [--seeds N] [PICTURE ...]`: for the effects
that shape a piece, a lamp's diameter and a wall's radius at 0.99 and at 1.01 of the threshold, with several
seeds each; IoU on both sides, the difference of the means and the spread over the seeds. The other effects
are asked by no design, and change no piece.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
from pathlib import Path
from typing import Any

from examples.measurement import build_apart, save_pictures
from examples.pictures import pictures
from knotfab.scene.settings import PRESETS

NAMES = ("heart", "anchor")
SIDES = (0.99, 1.01)  # of the threshold
# the key of a view, a first value, and the power of it that the magnitude goes by
KEYS = {"penumbra": ("light_diameter_mm", 1.0, 1), "wall": ("wall_radius_mm", 3000.0, -1)}


def build(picture: Path, folder: Path, accuracy: str, seed: int, key: str, value: float) -> Any:
    """The report of a build with one key of its view set."""
    scene = folder / "scene.toml"
    scene.write_text(f'[[views]]\npicture = "{picture.name}"\n{key} = {value!r}\n')
    out = folder / "out"
    options = ("--scene", str(scene), "--accuracy", accuracy, "--seed", str(seed))
    built = build_apart(picture, out, *options, "--skip", "slicer", printing=False)
    if built.report is None:
        raise SystemExit(f"{picture.stem}: {built.said}")
    return built.report


def effect_of(report: Any, name: str) -> Any:
    """An effect's line."""
    return next(line for line in report["effects"] if line["name"] == name)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=NAMES)
    parser.add_argument("--accuracy", default="standard", choices=list(PRESETS))
    parser.add_argument("--seeds", type=int, default=3)
    asked = parser.parse_args()
    print("effect     picture      value  of threshold  simulated  IoU by seed")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = save_pictures(pictures(), folder, asked.names)
        for effect, (key, first, power) in KEYS.items():
            for picture in files.values():
                ious: list[list[float]] = [[], []]
                for seed in range(asked.seeds):
                    value = first
                    for number in range(1 + len(SIDES)):  # first to see where it stands
                        report = build(picture, folder, asked.accuracy, seed, key, value)
                        line = effect_of(report, effect)
                        share = line["magnitude"] / line["threshold"]
                        if number:
                            ious[number - 1].append(report["views"][0]["iou"])
                            print(
                                f"{effect:<9}  {picture.stem:<8}  {value:8.4g}  {share:12.3f}  "
                                f"{line['simulated']!s:>9}  {ious[number - 1][-1]:.4f}",
                                flush=True,
                            )
                        value *= (SIDES[min(number, 1)] / share) ** power
                off = statistics.mean(ious[1]) - statistics.mean(ious[0])
                spread = max(max(side) - min(side) for side in ious)
                print(f"{effect:<9}  {picture.stem:<8}  differs by {off:+.4f}, spread {spread:.4f}")


if __name__ == "__main__":
    main()
