"""Build the project's own pictures on holders, and print which holds, what it costs, and what fails.

`python -m benchmarks.mount_table [NAME ...] [--only auto|wall|stand|hang ...] [--accuracy NAME ...]
[--slicer] [--promised] [--out DIR]`. Without a NAME: what a default `--print` chooses (auto) for all
pictures at draft and standard, for three of them at sketch and fine, and the knight on each holder at draft,
standard and fine. With NAMEs, those on each holder at each accuracy. A row: exit code, the holder, the word,
IoU of the knots alone and what the holder takes off it in the frame, intrusion, sag, its pegs, posts or feet
with their struts, the angle that a stand can be tipped by, CPU seconds, and what failed. With --out,
pictures that are done are not built again. A NAME such as heart+teapot is one piece of two views. --slicer
asks the slicer too. --promised prints below each row what the lines before the build say of radius, grams,
hours and mount, beside what was built, marked ! where the radius or the mount is another, or the rest is off
by more than a fifth.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Literal

from benchmarks.measurement import build_apart, make_folder, read_report, run_study
from examples.pictures import pictures

Kind = Literal["auto", "wall", "stand", "hang"]
HOLDERS: tuple[Kind, ...] = ("wall", "stand", "hang")
THREE = ("knight", "heart", "teapot")
HEAD = (
    f"{'picture':<10} {'accuracy':<8} {'asked':<5} code  {'holder':<13} {'word':<16} IoU     drop     "
    "intr. %     sag  members    tip  CPU s  failed"
)


@dataclass(frozen=True)
class Row:
    """The figures of one build, from its report.json."""

    holder: str
    word: str
    iou_tube: float  # in the worst view
    drop: float  # in the frame: below it a stand may show
    intrusion: float
    sag_mm: float | None
    members: int
    tip_deg: float | None
    failed: tuple[str, ...]

    @staticmethod
    def of(report: dict[str, Any]) -> Row:
        checks = {c["name"]: c for c in report["checks"]}
        views, mount = report["views"], report["print"].get("mount", {"kind": "none"})
        feet = sum(mount.get("feet_of_knots", ()))
        return Row(
            "-".join(filter(None, [mount["kind"], mount.get("plate") or mount.get("foot")])),
            (report.get("verdict") or {}).get("word", "-"),
            min(view["iou_tube"] for view in views),
            max(view["iou_tube"] - view["iou_frame"] for view in views),
            checks["intrusion"]["measured"] if "intrusion" in checks else 0.0,
            mount.get("sag_mm"),
            feet + mount.get("struts", 0) + mount.get("pegs", mount.get("posts", 0)),
            mount.get("tip_deg"),
            tuple(c["name"] for c in report["checks"] if c["status"] == "fail"),
        )

    def __str__(self) -> str:
        sag, tip = ("-" if x is None else f"{x:.3g}" for x in (self.sag_mm, self.tip_deg))
        return (
            f"{self.holder:<13} {self.word:<16} {self.iou_tube:.4f}  {self.drop:+.4f}  "
            f"{100 * self.intrusion:7.4f}  {sag:>6}  {self.members:>7}  {tip:>5}"
        )


def tell_promise(picture: str, kind: Kind, how: str, report: dict[str, Any], holder: str) -> None:
    """Print what the lines before a build promise beside its report."""
    from knotfab.base.progress import Progress
    from knotfab.pipeline.options import BuildOptions
    from knotfab.pipeline.prepare import prepare_build

    asked = BuildOptions(print_=True, accuracy=how, mount=kind, force=True)
    request = prepare_build((picture,), asked, "", Progress("quiet"))
    said = re.search(r"a guess: ([\d.]+) g(?: and ([\d.]+) h)?", " ".join(request.preview))
    grams, hours = (float(x) if x else None for x in (said.groups() if said else (None, None)))
    mount, printed = request.scene.mount, report["print"]
    place = "wall" if mount.on_feet else mount.kind
    sliced = None if printed.get("time_s") is None else printed["time_s"] / 3600
    pairs = {
        "radius": (request.previewed_radius_mm, report["settings"]["tube_radius_mm"], 0.005),
        "g": (grams, printed["mass_g"], 0.2),
        "h": (hours, sliced, 0.2),
    }
    words = [
        f"{what} {told:.3g} for {made:.3g}{' !' if abs(told / made - 1) > most else ''}"
        for what, (told, made, most) in pairs.items()
        if told and made
    ]
    kept = holder.startswith(place) or place == "auto"
    print(f"  promised: {', '.join(words)}, {place} for {holder}{'' if kept else ' !'}", flush=True)


def list_usual() -> Iterator[tuple[str, Kind, str]]:
    """List what is built where no NAME is given: picture, mount, accuracy."""
    for accuracy in ("draft", "standard"):
        yield from ((name, "auto", accuracy) for name in pictures())
    for accuracy in ("sketch", "fine"):
        yield from ((name, "auto", accuracy) for name in THREE)
    for kind in HOLDERS:
        yield from ((THREE[0], kind, accuracy) for accuracy in ("draft", "standard", "fine"))


def main(
    *names: str,
    only: Sequence[Kind] = (),
    accuracy: Sequence[str] = (),
    slicer: bool = False,
    promised: bool = False,
    out: Path | None = None,
) -> int:
    """Print the table and how many builds have no holder that passes; 1 where there are any."""
    folder, drawn = make_folder(out, "mounts"), pictures()
    options = [] if slicer else ["--skip", "slicer"]
    if names:
        every = product(accuracy or ("standard",), only or HOLDERS, names)
        wanted = [(name, kind, how) for how, kind, name in every]
    else:
        usual = list_usual()
        wanted = [one for one in usual if one[1] in (only or one) and one[2] in (accuracy or one)]
    bad = []
    print(HEAD)
    for name, kind, how in wanted:
        place = folder / f"{name}-{kind}-{how}"
        report, said, cpu = read_report(place), "", ""
        code = 0 if report is not None and report["status"] == "pass" else 1
        if report is None:
            paths = [folder / f"{part}.png" for part in name.split("+")]
            for path in paths:
                drawn[path.stem].save(path)
            mount = [] if kind == "auto" else ["--mount", kind]
            more = [*map(str, paths[1:]), *mount, "--accuracy", how, *options]
            built = build_apart(paths[0], place, *more)
            report, code, said, cpu = built.report, built.code, built.said, f"{built.cpu_s:.0f}"
        row = None if report is None else Row.of(report)
        told = said if row is None else f"{row}  {cpu:>5}  {' '.join(row.failed)}"
        print(f"{name:<10} {how:<8} {kind:<5} {code:>4}  {told}", flush=True)
        if promised and report is not None and row is not None:
            tell_promise(str(folder / f"{name}.png"), kind, how, report, row.holder)
        if code or row is None or row.holder == "none":
            bad.append(f"{name} {kind} {how}")
    print(f"{len(wanted)} builds; without a holder that passes: {', '.join(bad) or 'none'}")
    return int(bool(bad))


if __name__ == "__main__":
    run_study(main)
