"""What accuracy costs in time: the points of `knotfab tradeoff` on a few of the project's pictures.

`python -m examples.studies.frontier [NAME ...]` prints, for each point, the mean IoU at 1024 px that the
search reached and the median seconds it took, side by side in one run.
"""

from __future__ import annotations

import argparse
import statistics

from examples.measurement import read_question
from examples.pictures import pictures
from knotfab.tradeoff.measure import Study, measure
from knotfab.tradeoff.points import points

NAMES = ("knight", "smiley", "anchor", "ampersand", "cat", "wheel")
RADIUS = 0.0115  # of the frame's width


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=NAMES)
    asked = parser.parse_args()
    studies = []
    for name, image in pictures().items():
        if name in asked.names:
            question = read_question(image)
            radius = RADIUS * question.views[0].frame_width_mm
            problem = question.with_depth(radius).problem
            studies.append(Study(problem, radius))
    print(f"{'point':<40} IoU mean  least   seconds (median)  repairs")
    rows = [measure(study, points()) for study in studies]
    for column in zip(*rows, strict=True):
        point = column[0].point
        print(
            f"{f'{point.knob}: {point.label}':<40} "
            f"{statistics.mean(m.iou for m in column):.4f}    {min(m.iou for m in column):.4f}  "
            f"{statistics.median(m.seconds for m in column):8.1f}  "
            f"{sum(m.repairs for m in column):16}"
        )


if __name__ == "__main__":
    main()
