"""The stages one by one, by the public API alone: from a glyph to a verified part.

`python -m examples.stages [PICTURE] [FOLDER]`
"""

from __future__ import annotations

import sys

import knotfab


def main(picture: str = "text:♥", out: str = "stages-out", accuracy: str = "draft") -> float:
    """Build `picture` into `out`, printing what each stage gives; returns the verified IoU."""
    target = knotfab.read_picture(picture)
    question = knotfab.pose_question(knotfab.Scene(), [target])
    question, radius, start = knotfab.choose_tube(question, accuracy)
    print(f"{len(start.curves)} knot(s), tube radius {radius:.2f} mm: {start.why}")
    found = knotfab.search_knots(question, start, radius, accuracy)
    print(f"search: IoU {found.iou_estimate:.4f}, {found.log.accepted} certified steps")
    design = knotfab.settle_design(question, found, accuracy)
    part = knotfab.assemble_part(design, [target])
    folder = knotfab.write_files(part, [target], out)
    verdict = knotfab.validate_part(folder)
    for check in verdict["checks"]:
        print(f"  {check['status']:<7} {check['name']}: {check['measured']} {check['unit']}")
    return float(verdict["views"][0]["iou"])


if __name__ == "__main__":
    main(*sys.argv[1:3])
