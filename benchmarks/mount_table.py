"""Build the project's own pictures on a wall and on a stand, and print what the mounts cost them.

`python -m benchmarks.mount_table [--only wall|stand] [--skip-slicer] [--out DIR] [NAME ...]`: exit
code, IoU of the knots alone and what the mount takes off it in the frame, intrusion, sag, pegs or posts
with their struts, the angle that a stand can be tipped by, seconds of the mount stage, and what the
slicer warns of (of that unexplained). With --out, pictures that are done are not built again. A NAME
such as heart+teapot is one piece of two views, which only a stand holds.
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from benchmarks.measurement import build_apart, make_folder, read_report, run_study
from examples.pictures import pictures


def row_of(report: dict[str, Any]) -> dict[str, float]:
    """Return the figures of one build, from its report.json."""
    checks = {c["name"]: c for c in report["checks"]}
    views, mount = report["views"], report["print"]["mount"]
    members = mount.get("struts", 0) + mount["pegs" if mount["kind"] == "wall" else "posts"]
    row = {
        # the view that fares worst
        "iou_tube": min(view["iou_tube"] for view in views),
        # in the frame: below it a stand may show
        "drop": max(view["iou_tube"] - view["iou_frame"] for view in views),
        "intrusion": checks["intrusion"]["measured"],
        "sag": checks["sag"]["measured"],
        "members": members,
        "seconds": report["timings"]["mount"],
        "failed": sum(c["status"] == "fail" for c in report["checks"]),
    }
    if "tip_deg" in mount:
        row["tip"] = mount["tip_deg"]
    if "slicer" in report:
        warnings = report["slicer"]["warnings"]
        row["warnings"] = len(warnings)
        row["unexplained"] = sum(not w["explanation"] for w in warnings)
    return row


def _line(name: str, kind: str, code: int, row: dict[str, float]) -> str:
    tip = f"{row['tip']:5.1f}" if "tip" in row else "    -"
    slicer = f"{row['warnings']:.0f}/{row['unexplained']:.0f}" if "warnings" in row else "-"
    return (
        f"{name:<10} {kind:<6} {code:>4}  {row['iou_tube']:.4f}  {row['drop']:+.4f}  "
        f"{100 * row['intrusion']:8.4f}  {row['sag']:6.3f}  {row['members']:>7.0f}  {tip}  "
        f"{row['seconds']:7.1f}  {slicer:>8}  {row['failed']:>6.0f}"
    )


def _summary(kind: str, rows: Sequence[dict[str, float]]) -> str:
    def worst(key: str) -> float:
        return max(abs(row[key]) for row in rows)

    text = (
        f"{kind}: {len(rows)} pictures, intrusion at most {100 * worst('intrusion'):.4f} % of the frame, "
        f"IoU changed by at most {worst('drop'):.4f}, sag at most {worst('sag'):.3f} mm, mount stage "
        f"median {statistics.median(row['seconds'] for row in rows):.1f} s, "
        f"worst {worst('seconds'):.1f} s, failed checks {sum(row['failed'] for row in rows):.0f}"
    )
    if all("tip" in row for row in rows):
        text += f", tips over at no less than {min(row['tip'] for row in rows):.1f} degrees"
    if any("warnings" in row for row in rows):
        text += (
            f", slicer warnings {sum(row.get('warnings', 0) for row in rows):.0f}, "
            f"of them unexplained {sum(row.get('unexplained', 0) for row in rows):.0f}"
        )
    return text


def main(
    *names: str,
    only: Literal["wall", "stand"] | None = None,
    skip_slicer: bool = False,
    out: Path | None = None,
) -> None:
    """Print the table and its summaries."""
    folder = make_folder(out, "mounts")
    options = ["--skip", "slicer"] if skip_slicer else []
    drawn = pictures()
    for kind in [only] if only else ["wall", "stand"]:
        rows = []
        print(
            "picture    mount  code  IoU     drop     intr. %      sag  members    tip  "
            "seconds  warnings  failed"
        )
        for name in names or drawn:
            parts = name.split("+")
            if len(parts) > 1 and kind == "wall":
                continue
            place = folder / f"{name}-{kind}"
            report, error = read_report(place), ""
            if report is None:
                paths = [folder / f"{part}.png" for part in parts]
                for part, path in zip(parts, paths, strict=True):
                    drawn[part].save(path)
                more = [str(path) for path in paths[1:]]
                built = build_apart(paths[0], place, *more, "--mount", kind, *options)
                report, code, error = built.report, built.code, built.said
            else:
                code = 0 if report["status"] == "pass" else 1
            if report is None or "mount" not in report["print"]:
                print(f"{name:<10} {kind:<6} {code:>4}  {error}", flush=True)
                continue
            rows.append(row_of(report))
            failed = [c["name"] for c in report["checks"] if c["status"] == "fail"]
            print(_line(name, kind, code, rows[-1]), *failed, flush=True)
        if rows:
            print(_summary(kind, rows), "\n", flush=True)


if __name__ == "__main__":
    run_study(main)
