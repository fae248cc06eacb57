"""Tie knots of the table into one picture, build each, and print what the written files are found to be.

`python -m benchmarks.tied_knots [--picture PICTURE] [--accuracy NAME] [--out DIR] [NAME ...]`: the
verified type, and the IoU against that of the unknot, which is built first and whose tube all others
share. Ends with 1 if a build fails, a type is not verified, or the IoU drops by more than 0.005.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

from benchmarks.measurement import Stopwatch, make_folder, run_study
from knotfab.pipeline.build import build
from knotfab.request import Request
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import load_scene
from knotfab_formats.piece import Accuracy, Piece
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS

KNOTS = ("3_1", "left 3_1", "4_1", "5_1", "5_2", "6_1", "6_2", "6_3", "7_1", "7_4", "8_18", "8_19")
MOST_DROP = 0.005  # the largest drop of the IoU
HEADER = (
    f"{'knot':10} {'verified':28} {'check':6} {'IoU':>7} {'drop':>8} {'length':>8} {'CPU s':>6}"
)


@dataclass(frozen=True)
class Row:
    """One build: what the checks say of its files."""

    knot: str
    measured: str
    status: str  # the status of the check knot_type
    iou: float
    length_mm: float
    cpu_s: float  # this process's: the validators run in another
    exit_code: int
    radius_mm: float


def measure(picture: str, piece: Piece, accuracy: str, out: Path) -> Row:
    """Build one piece and read its report."""
    watch = Stopwatch()
    preset = cast(Literal["sketch", "draft", "standard", "fine"], accuracy)
    outcome = build(
        Request(resolve(Scene(piece=piece, accuracy=Accuracy(name=preset))), (picture,), out)
    )
    report = outcome.report
    check = next(c for c in report["checks"] if c["name"] == "knot_type")
    radius = load_scene(outcome.folder / "scene.toml").piece.tube_radius_mm
    return Row(
        piece.knot,
        str(check["measured"]),
        str(check["status"]),
        float(report["views"][0]["iou"]),
        sum(float(k["length_mm"]) for k in report["knots"]),
        watch.cpu_s,
        outcome.exit_code,
        float(radius),
    )


def main(
    *names: str,
    picture: str = "text:♞",
    accuracy: Literal[*PRESETS] = "standard",
    tube_radius: float | None = None,
    out: Path | None = None,
) -> int:
    """Print a row a knot."""
    out = make_folder(out, "tied-knots")
    piece = Piece() if tube_radius is None else Piece(tube_radius_mm=tube_radius)
    print(HEADER)
    plain: Row | None = None
    fine = True
    for name in ("unknot", *(names or KNOTS)):
        piece = piece.model_copy(update={"knot": name})
        folder = out / name.replace(" ", "-").replace("#", "+")
        row = measure(picture, piece, accuracy, folder)
        if plain is None:
            plain = row
            piece = piece.model_copy(update={"tube_radius_mm": row.radius_mm})
        drop = plain.iou - row.iou
        fine = fine and row.exit_code == 0 and row.status == "pass" and drop <= MOST_DROP
        print(
            f"{name:10} {row.measured:28} {row.status:6} {row.iou:7.4f} {drop:+8.4f} "
            f"{row.length_mm:8.0f} {row.cpu_s:6.1f}",
            flush=True,
        )
    print(f"tube radius {plain.radius_mm:g} mm; files in {out}" if plain else "")
    return 0 if fine else 1


if __name__ == "__main__":
    run_study(main)
