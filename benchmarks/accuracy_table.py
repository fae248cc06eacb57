"""Build the project's own pictures with default settings and print what they reach.

`python -m benchmarks.accuracy_table [--accuracy NAME] [--unprinted] [--flat] [--skip-slicer]
[--warm] [--out DIR] [NAME ...]`: IoU, the 95th percentile of the outline's error in tube radii (beyond an
IoU of .995 that tells more), radius, depth, how well the piece is read from 45 degrees aside (z, and
legibility, with --flat also that of each picture's own flat build), violations, seconds and peak memory of
whole builds, with --print unless they are `--unprinted`. Each is a process of its own; `--warm`: all in one,
after a build that loads what they need.
"""

from __future__ import annotations

import statistics
from pathlib import Path

from benchmarks.measurement import (
    Built,
    build_apart,
    build_warm,
    failed_checks,
    make_folder,
    mean_bend,
    run_study,
    save_pictures,
)
from examples.pictures import pictures


def main(
    *names: str,
    accuracy: str = "standard",
    unprinted: bool = False,
    flat: bool = False,
    skip_slicer: bool = False,
    warm: bool = False,
    out: Path | None = None,
) -> None:
    """Print the table and its summary."""
    folder = make_folder(out, "table")
    given = {"accuracy": accuracy, **({"skip": "slicer"} if skip_slicer else {})}

    def build(path: Path, name: str, **options: str) -> Built:
        if warm:
            return build_warm(path, folder / name, print_=not unprinted, **given, **options)
        words = [f"--{key}={value}" for key, value in {**given, **options}.items()]
        return build_apart(path, folder / name, *words, printing=not unprinted)

    rows: list[dict[str, float]] = []
    print(
        f"{'picture':<10} code    IoU   p95/r  r/width%  depth  z 45  leg45  flat45   bend  turns  failed  "
        "seconds  peak MB"
    )
    files = save_pictures(pictures(), folder, names)
    if warm:
        build(next(iter(files.values())), "first")
    for name, path in files.items():
        built = build(path, name)
        report = built.report
        if report is None:
            print(f"{name:<10} {built.code:>4}  {built.said}", flush=True)
            rows.append({"iou": 0.0, "seconds": built.wall_s, "failed": 1.0, "code": built.code})
            continue
        view = report["views"][0]
        frame = max(view["width"], view["height"])
        radius = 100 * report["settings"]["tube_radius_mm"] / (180.0 * view["width"] / frame)
        failed = failed_checks(report)
        knots = report["knots"]
        plain = None
        if flat:
            other = build(path, f"{name}-flat", depth="flat").report
            plain = other["views"][0]["legibility"]["45"] if other else None
        row = {
            "iou": view["iou_tube"],
            "outline": report["verdict"]["outline_p95_radii"],
            "radius": radius,
            "depth": report["print"]["depth_ratio"],
            "z": view["recognition"]["45"]["z"],
            "leg": view["legibility"]["45"],
            "bend": mean_bend(report),
            "turns": sum(k["turns"] for k in knots),
            "failed": len(failed),
            "seconds": built.wall_s,
            "peak": built.peak_mb,
            "code": built.code,
        }
        if plain is not None:
            row["drop"] = plain - row["leg"]
        rows.append(row)
        print(
            f"{name:<10} {built.code:>4}  {row['iou']:.4f}  {row['outline']:6.3f}  "
            f"{radius:7.2f}  {row['depth']:.3f}  {row['z']:4.1f}  {row['leg']:.3f}  "
            f"{'' if plain is None else f'{plain:.3f}':>6}  "
            f"{row['bend']:.3f}  {row['turns']:5.0f}  {len(failed):>6}  "
            f"{row['seconds']:7.1f}  {row['peak']:7.0f}  {' '.join(failed)}",
            flush=True,
        )

    def all_of(key: str) -> list[float]:
        return [row[key] for row in rows if key in row]

    print(
        f"\n{len(rows)} pictures: IoU mean {statistics.mean(all_of('iou')):.4f}, "
        f"least {min(all_of('iou')):.4f}; "
        f"outline p95 most {max(all_of('outline'), default=float('nan')):.3f} radii; "
        f"from 45 deg z mean {statistics.mean(all_of('z')):.2f}, "
        f"legibility {statistics.mean(all_of('leg')):.3f}; curvature x radius mean "
        f"{statistics.mean(all_of('bend')):.3f}, most {max(all_of('bend')):.3f}; depth ratio least "
        f"{min(all_of('depth')):.3f}; failed checks {int(sum(all_of('failed')))}; "
        f"exit codes other than 0: {sum(code != 0 for code in all_of('code'))}"
    )
    print(
        f"seconds median {statistics.median(all_of('seconds')):.2f}, worst {max(all_of('seconds')):.1f}; "
        f"peak memory {max(all_of('peak')):.0f} MB"
    )
    if flat:
        print(f"legibility below the flat build's: least {min(all_of('drop')):.3f}")


if __name__ == "__main__":
    run_study(main)
