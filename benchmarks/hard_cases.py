"""The catalogue of hard cases as a table, and as a page of the documentation with a picture of each.

    python -m benchmarks.hard_cases [--only WORD] [--write docs]

Ends with 1 where a case is outside its bounds: 16 machine epsilons times its condition number for values,
1e-3 px for what a scene can ask for, 1e-6 (double) and 1e-3 (single precision) for gradients.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import torch

from benchmarks.hard.measure import (
    FORMS,
    ForwardError,
    double_error,
    forward_error,
    gradient_condition,
    gradient_error,
    image,
    subgradient_excess,
)
from benchmarks.hard.paper_rendering import applies, paper_error, printed_fails
from benchmarks.hard.rendering import RenderCase, render_cases
from benchmarks.hard_groups import Line, groups
from benchmarks.hard_sheets import draw_image, sheet
from benchmarks.measurement import run_study

WELL = 1e-4  # a gradient that a rounding of single precision changes by less is well conditioned


@dataclass(frozen=True)
class Row:
    """One case measured. Errors in px; shares of 16 epsilons times the condition number."""

    case: RenderCase
    ours: ForwardError
    compiled: ForwardError
    double_share: float
    gradient: str
    ellipse: str
    capsule: str
    printed: str
    good: bool


def row_of(case: RenderCase) -> Row:
    """Measure one case with every renderer."""
    torch.autograd.set_detect_anomaly(True)
    double = double_error(case)
    well = case.smooth and gradient_condition(case) < WELL
    good, errors, slopes = double <= 1, [], []
    for render in FORMS.values():
        ours = forward_error(case, render)
        found = gradient_error(case, 3 if well else 0, render)
        good &= ours.finite and found.finite and max(ours.share, ours.image_share) <= 1
        good &= not case.real or ours.error_px <= 1e-3
        errors.append(ours)
        slopes.append(found)
    if well:
        worst = max(f.double for f in slopes), max(f.single for f in slopes)
        gradient = f"{worst[0]:.0e} / {worst[1]:.0e}"
        good &= worst[0] <= 1e-6 and worst[1] <= 1e-3
    elif case.kinks:
        excess = max(
            subgradient_excess(case, dtype, render=render)
            for dtype in (torch.float64, torch.float32)
            for render in FORMS.values()
        )
        gradient = "subgradient" if excess <= 1e-3 else f"outside by {excess:.0e}"
        good &= excess <= 1e-3
    else:
        gradient = "finite"
    papers = ["-", "-"]
    printed = "-"
    if applies(case):
        for k, balls in enumerate((True, False)):
            error, share, finite = paper_error(case, balls)
            papers[k] = f"{error:.0e}" if finite else "not finite"
            good &= finite and share <= 1
        printed = printed_fails(case) or "serves"
    return Row(case, *errors, double, gradient, papers[0], papers[1], printed, good)


def _cells(row: Row) -> tuple[str, ...]:
    return (
        row.case.name,
        f"{row.ours.condition_px:.0e}",
        f"{row.ours.error_px:.0e}",
        f"{row.ours.share:.2f}",
        f"{row.compiled.image_share:.2f}",
        f"{row.double_share:.2f}",
        row.gradient,
        row.ellipse,
        row.capsule,
        row.printed,
    )


HEADS = (
    "case",
    "condition, px",
    "single, px",
    "share",
    "compiled",
    "double, share",
    "gradient",
    "ellipse, px",
    "capsule, px",
    "as printed",
)

OPENING = """# Hard cases

Made by `python -m benchmarks.hard_cases --write docs`. Each case of the renderers goes through knotfab's own
(dense, tiled in torch, and compiled) and the paper's two, in single and double precision, with torch's
anomaly detection on. [hard-cases.csv](hard-cases.csv) has the figures of every case and says why it is hard;
[the worst cases found](worst-cases.md) tell how near to its bound an optimiser brings each. Columns of the
renderers' cases:

- **condition**: the sum over all inputs of |ds/dx| |x|, where s is the signed distance of a pixel to
  the silhouette, in pixels; at the pixel with the worst share.
- **single**: the largest error of single precision, in pixels, against double precision.
- **share**: the largest error over 16 machine epsilons times the pixel's condition number; at most 1.
- **compiled**: the share of the compiled renderer's image, which adds 4 machine epsilons for the sigmoid.
- **double, share**: the share of double precision against 50 digits (mpmath).
- **gradient**: relative error of the double precision gradient against central differences, and of the
  single precision one against it; "subgradient" where the image has a kink and the gradient is one of its
  subgradients; "finite" where a rounding already changes the gradient.
- **ellipse**, **capsule**: the largest error of the paper's two renderers as they are built here.
- **as printed**: whether the closed forms printed in the paper give the corners of the quadrilateral in
  double precision: finite, and within 1e-3 px of the true outline ("serves").
"""

# what each further group measures; the key is the first word of its title
MEASURED = {
    "Large": "The error of the tiled image in single precision, with its gradient, at 4000 pixels, half of "
    "them on edges.",
    "Losses": "The relative condition number sum |df/dx| |x| over |f|, the relative error of single "
    "precision, its share of 16 machine epsilons times that number, and the gradient. Each loss "
    "is drawn with the way it pulls its points.",
    "Network": "The same of the invertible network, drawn with a disc before and after.",
    "Flow": "Adversarial steps, those that the certificate let pass, those found to carry a strand "
    "through another, and those of the latter that it let pass: none.",
    "Geometry": "The swept volume against the exact one, or what an outline gave, with the curves that fill "
    "it.",
    "Light": "Where rays meet a round wall, there and back, against 50 digits; a lamp's blur, and its "
    "share of the bound.",
    "Strokes": "The lines found in a drawing, how far they leave its ink (half widths), and the ink that "
    "none runs along.",
    "Scenes": "Whether the piece keeps every limit, its IoU, the limit that binds, and the IoU without that "
    "limit.",
}

Group = tuple[str, Sequence[str], list[Line]]


def _page(rows: Sequence[Row], others: Sequence[Group], folder: Path) -> None:
    """Write the page with a picture of every case, and the figures of all as CSV beside it."""
    drawn = [
        (row.case.name, partial(draw_image, image=image(row.case, torch.float32))) for row in rows
    ]
    sheet(folder / "hard-cases.png", drawn)
    bad, count = _count_printed(rows)
    lines = [
        OPENING,
        f"{len(rows)} cases of renderers, {sum(not row.good for row in rows)} outside their bounds. The "
        f"closed forms as printed fail in {bad} of the {count} cases they apply to.\n",
        "![a picture of each case](hard-cases.png)\n",
    ]
    table = [("group", *HEADS, "why it is hard")]
    table += [("Renderers", *_cells(row), row.case.why) for row in rows]
    for title, heads, found in others:
        word = title.split()[0]
        picture = f"hard-cases-{word.lower()}.png"
        sheet(folder / picture, [(one.name, one.draw) for one in found])
        outside = sum(not one.good for one in found)
        lines += [f"## {title}\n", f"{MEASURED[word]} {len(found)} cases, {outside} outside.\n"]
        lines += [f"![{title.lower()}]({picture})\n"]
        table += [("group", *heads, "why it is hard")]
        table += [(title, one.name, *one.cells, one.why) for one in found]
    (folder / "hard-cases.md").write_text("\n".join(lines).rstrip() + "\n")
    with (folder / "hard-cases.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(table)


def _count_printed(rows: Sequence[Row]) -> tuple[int, int]:
    told = [row.printed for row in rows if row.printed != "-"]
    return sum(said != "serves" for said in told), len(told)


def main(*, only: str = "", write: Path | None = None) -> int:
    """Print the table; 1 where a case is outside its bounds."""
    widths = (26, 13, 10, 5, 8, 13, 14, 11, 11, 18)
    print("  ".join(head.ljust(n) for head, n in zip(HEADS, widths, strict=True)))
    rows = []
    for case in render_cases():
        if only not in case.name:
            continue
        row = row_of(case)
        rows.append(row)
        text = "  ".join(cell.ljust(n) for cell, n in zip(_cells(row), widths, strict=True))
        print(text + ("" if row.good else "  OUTSIDE"), flush=True)
    outside = sum(not row.good for row in rows)
    bad, count = _count_printed(rows)
    others = list(groups(only))
    outside += sum(not one.good for *_, found in others for one in found)
    total = len(rows) + sum(len(found) for *_, found in others)
    print(f"{total} cases, {outside} outside their bounds; as printed {bad} of {count} fail")
    if write is not None:
        _page(rows, others, write)
    return int(outside > 0)


if __name__ == "__main__":
    run_study(main)
