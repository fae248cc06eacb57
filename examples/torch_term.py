"""A term of one's own, in torch: the search also brings the piece's middle onto the thread it hangs from.

`python -m examples.torch_term [PICTURE] [ACCURACY]`
"""

from __future__ import annotations

import sys

import torch

import knotfab

WEIGHT = 2.0  # per mm², beside the picture's own term


def hang_straight(points: torch.Tensor) -> torch.Tensor:
    """Measure how far the middle of the vertices [N, 3], mm, lies beside x = 0, squared."""
    return WEIGHT * points[:, 0].mean() ** 2


def main(picture: str = "text:f", accuracy: str = "draft") -> tuple[float, float]:
    """Search with and without the term; returns how far the middle lies aside, mm."""
    question = knotfab.pose_question(knotfab.Scene(), [knotfab.read_picture(picture)])
    question, radius, start = knotfab.choose_tube(question, accuracy)
    aside = []
    for terms in ((), (hang_straight,)):
        found = knotfab.search_knots(question, start, radius, accuracy, terms=terms)
        points = torch.cat([torch.as_tensor(knot.points) for knot in found.knots.knots])
        aside.append(abs(float(points[:, 0].mean())))
        print(f"{len(terms)} term(s): IoU {found.iou_estimate:.4f}, {aside[-1]:.2f} mm aside")
    return aside[0], aside[1]


if __name__ == "__main__":
    main(*sys.argv[1:3])
