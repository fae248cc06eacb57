"""A walk cycle, drawn and built: twelve frames of a figure that walks, one arm swings, the other waves.

`python -m examples.walk_cycle --out DIR` draws the frames into DIR/frames, builds them as a sequence into
DIR/parts, prints how the limbs swing and what each part came to, and draws
DIR/walk.gif. `--draw` stops at the frames.
"""

from __future__ import annotations

from math import cos, dist, pi, sin
from pathlib import Path
from typing import Any

from PIL import Image

import knotfab
from benchmarks.measurement import Stopwatch, run_study
from examples.pictures import Canvas, Point

FRAMES = 12
IOU = 0.97  # to be reached by each part
_WIDTH, _HEIGHT = 0.86, 1.0
_THIGH, _SHANK, _FOOT = 0.18, 0.18, 0.045
_GROUND = 0.925
_STRIDE = 0.56  # rad, the hip's swing to either side


def walk_cycle(frames: int = FRAMES) -> list[Image.Image]:
    """Return the frames of one whole cycle (two steps): mode "L", black on white, all of one size."""
    return [_walker(phase) for phase in _phases(frames)]


def swings(frames: int = FRAMES) -> dict[str, float]:
    """Measure how far the end of each limb swings over the cycle, in parts of the frame's longer side."""
    skeletons = [_skeleton(phase) for phase in _phases(frames)]
    return {
        limb: max(dist(a[limb][-1], b[limb][-1]) for a in skeletons for b in skeletons)
        for limb in ("leg", "other leg", "arm", "other arm")
    }


def _phases(frames: int) -> list[float]:
    """Return the middle of each stretch: in no frame does one leg hide the other."""
    return [2 * pi * (k + 0.5) / frames for k in range(frames)]


def _skeleton(phase: float) -> dict[str, list[Point]]:
    """Return the joints of each limb, from the body outwards, and of the back, at `phase` of the cycle."""
    legs = [_leg(phase), _leg(phase + pi)]
    # the lower sole is on the ground: the hip bobs twice a cycle
    lowest = max(y for leg in legs for _, y in leg)
    hip = (0.40, _GROUND - 0.03 - lowest)
    neck = _add(hip, (0.035, -0.28))
    found = {
        "back": [hip, _add(hip, (0.02, -0.14)), neck],
        "leg": [_add(hip, p) for p in legs[0]],
        "other leg": [_add(hip, p) for p in legs[1]],
    }
    # both arms reach ahead, where they can be seen: the lower one swings, the upper one waves
    for limb, shoulder, raised, bend in (
        ("arm", neck, 0.95 - 0.30 * cos(phase), 0.20),
        ("other arm", _add(neck, (0.02, 0.0)), 1.95 + 0.15 * sin(phase), 0.35 + 0.4 * sin(phase)),
    ):
        elbow = polar_down(shoulder, 0.16, raised)
        found[limb] = [shoulder, elbow, polar_down(elbow, 0.135, raised + bend)]
    return found


def _walker(phase: float) -> Image.Image:
    """Return the figure at `phase` of its cycle; it walks to the right."""
    sheet, body = Canvas(_WIDTH, _HEIGHT), _skeleton(phase)
    for limb in ("leg", "other leg"):
        hip, knee, ankle, toe = body[limb]
        sheet.stroke([hip, knee], 0.10, 0.08)
        sheet.stroke([knee, ankle], 0.08, 0.07)
        sheet.stroke([ankle, toe], 0.07, 0.065)
    hip, waist, neck = body["back"]
    sheet.stroke([hip, waist, _add(neck, (0.0, 0.02))], 0.13, 0.15)
    sheet.disc(*_add(neck, (0.02, -0.125)), 0.082, 0.092)
    for limb in ("arm", "other arm"):
        shoulder, elbow, hand = body[limb]
        sheet.stroke([shoulder, elbow], 0.085, 0.075)
        sheet.stroke([elbow, hand], 0.075, 0.07)
    return sheet.finish()


def _leg(phase: float) -> list[Point]:
    """Return hip, knee, ankle and toe from the hip: the leg swings forward where its knee bends."""
    hip = _STRIDE * cos(phase)
    bend = 0.10 + 0.20 * max(0.0, -sin(phase))
    knee = polar_down((0.0, 0.0), _THIGH, hip + 0.5 * bend)
    ankle = polar_down(knee, _SHANK, hip - 0.5 * bend)
    toe = polar_down(ankle, _FOOT, 0.5 * pi + 0.5 * (hip - bend) * (hip < bend))
    return [(0.0, 0.0), knee, ankle, toe]


def polar_down(at: Point, length: float, angle: float) -> Point:
    """Return `length` away from `at`, `angle` from straight down, towards the right."""
    return at[0] + length * sin(angle), at[1] + length * cos(angle)


def _add(at: Point, by: Point) -> Point:
    return at[0] + by[0], at[1] + by[1]


def print_frames(report: dict[str, Any]) -> None:
    """Print a line a frame of a sequence's report, its closing, and the checks that are not passed."""
    print("frame   IoU    word        vertices go   at most   began as   steps certified")
    for view in report["views"]:
        moved = view["motion"] or {"largest_mm": 0.0, "limit_mm": 0.0}
        origin = "template" if view["began_as"] is None else f"frame {view['began_as']}"
        word = view.get("verdict", {}).get("word", "")
        print(
            f"{view['frame']:5d}  {view['iou']:.4f}  {word:10s}  {moved['largest_mm']:8.2f} mm"
            f"{moved['limit_mm']:8.2f} mm  {origin:9s}  {view['certificate']['accepted']:6d}"
            f"{'' if view['certificate']['certified'] else '  NOT CERTIFIED'}  {view['failed'] or ''}"
        )
    closing = report["settings"]["sequence"]["closing"]
    print(f"closing        {closing['largest_mm']:8.2f} mm{closing['limit_mm']:8.2f} mm")
    for check in report["checks"]:
        if check["required"] and check["status"] != "pass":
            print(f"{check['name']}: {check['status']}, {check['detail']}")


def main(*, out: Path = Path("walk-cycle"), draw: bool = False) -> int:
    """Draw, build, print; return 1 where a figure is missed."""
    frames = out / "frames"
    frames.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(walk_cycle(), start=1):
        image.save(frames / f"frame-{number:02d}.png", optimize=True)
    swung = swings()
    print("swing, of the frame: " + ", ".join(f"{k} {v:.2f}" for k, v in swung.items()))
    if draw:
        return 0
    watch = Stopwatch()
    # the slicer takes longer than all frames together
    built = knotfab.build(str(frames), out / "parts", sequence=True, print_=True, skip=("slicer",))
    code, report = built.exit_code, built.report
    print_frames(report)
    stages = ("radius", "template", "search")
    searched = sum(report["timings"].get(k, 0.0) for k in stages)
    print(
        f"{watch.wall_s:.0f} s in all: search {searched:.0f} s, beside it verification; CPU seconds: "
        f"{watch.cpu_s:.0f} of the search and the parts, "
        f"{watch.children_s:.0f} of the verification"
    )
    if code == 0:
        from examples.side_view import write_gif
        from examples.walk_film import walk_film

        write_gif(out / "walk.gif", walk_film(out / "parts"), 100)
    reached = min(view["iou"] for view in report["views"]) >= IOU and min(swung.values()) >= 0.1
    return int(code != 0 or not reached)


if __name__ == "__main__":
    run_study(main)
