"""What one iteration of the search costs against vertices, pixels, knots and views: exponents, in one run.

    python -m benchmarks.scaling [--write docs/scaling.md]

An iteration is one step of the certified flow: the image term of every view forward and backward, the
limits, and the certificate. Each point runs in a process of its own: CPU seconds of an iteration (the
difference between a long and a short walk), and how far its resident memory grows. Last the large case: a
picture for a 2 m wall, drawn by a tube of 0.2 % of the frame.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.measurement import run_study
from knotfab.base.arrays import Array
from knotfab.design.question import Question, ask
from knotfab.picture.read import Target, read_target
from knotfab.problem import Start
from knotfab.search.flow import FlowSettings
from knotfab.search.phases import SETTLE, Phase
from knotfab.search.state import begin, run_phase
from knotfab_formats.scene import Scene, View
from knotfab_formats.search import PRESETS

FRAME_MM = 180.0
SPACING = 0.45  # of vertices, in tube radii, as in a finished part
PITCH = 2.4  # of the windings, in tube radii
FILLED = 0.64  # of the frame's side
SHORT, LONG = 3, 33  # iterations, with one and eleven searches for the winners
TAU = (6.0, 6.0)
MARK = "<!-- written by make scaling -->"


@dataclass(frozen=True)
class Load:
    """What one iteration is asked."""

    vertices: int = 1000
    pixels: int = 384
    knots: int = 1
    views: int = 1
    frame_mm: float = FRAME_MM


AXES: dict[str, tuple[int, ...]] = {
    "vertices": (250, 500, 1000, 2000, 4000, 8000, 16000),
    "pixels": (64, 128, 256, 512, 1024, 2048, 4096),
    "knots": (1, 2, 4, 8, 16, 32, 64),
    "views": (1, 2, 3, 4, 5, 6),
}
BESIDE = {"knots": Load(vertices=6400), "pixels": Load(vertices=1000)}  # else `Load()`
WALL = Load(vertices=60_000, pixels=1024, frame_mm=2000.0)


@dataclass(frozen=True)
class Cost:
    """CPU seconds of one iteration, and by how much memory grew while some ran, MB."""

    seconds: float
    memory_mb: float


def wind(knots: int, vertices: int, side_mm: float) -> tuple[tuple[Array, ...], float]:
    """Closed double spirals in the cells of a square, `vertices` in all, and the tube's radius, mm.

    Each winds inwards and out again between its own windings, so that strands lie side by side everywhere.
    """
    across = int(np.ceil(np.sqrt(knots)))
    cell, each = side_mm / across, vertices // knots
    outer = 0.45 * cell
    # a disc covered by windings one pitch apart, with vertices one spacing apart
    radius = outer * float(np.sqrt(np.pi / (PITCH * SPACING * each)))
    pitch = PITCH * radius
    turns = outer / (2.0 * pitch)
    t = np.linspace(0.0, 1.0, 8 * each + 1)
    a = 2.0 * np.pi * turns * np.sqrt(t)  # even steps along the arm
    inwards = np.stack([a * np.cos(a), a * np.sin(a)], 1) * (pitch / np.pi)
    both = np.concatenate([inwards[::-1], -inwards[1:]])
    bend = np.linspace(0.0, np.pi, 64)[1:-1]
    end = inwards[-1]
    aside = 1.1 * np.array([-end[1], end[0]])  # around the outside, back to where it began
    around = np.sin(bend)[:, None] * aside - np.cos(bend)[:, None] * end
    closed = np.concatenate([both, around])
    closed = np.column_stack(
        [closed, 4.0 * radius * np.sin(np.linspace(0, 12 * np.pi, len(closed)))]
    )
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0.0, arc[-1], each, endpoint=False)
    ring = np.stack([np.interp(at, arc, column) for column in closed.T], 1)
    middles = (np.arange(across) + 0.5 - 0.5 * across) * cell
    places = [(x, y) for y in middles for x in middles][:knots]
    return tuple(ring + (x, y, 0.0) for x, y in places), radius


def _question(load: Load, target: Target) -> Question:
    views = tuple(
        View(name=f"view-{n}", azimuth_deg=180.0 * n / load.views, frame_width_mm=load.frame_mm)
        for n in range(load.views)
    )
    scale = load.frame_mm / FRAME_MM
    far = {"light_distance_mm": 500.0 * scale, "wall_distance_mm": 150.0 * scale}
    scene = Scene(views=tuple(view.model_copy(update=far) for view in views))
    return ask(scene, [target] * load.views)


def _measure(load: Load, question: Question) -> Cost:
    curves, radius = wind(load.knots, load.vertices, FILLED * load.frame_mm)
    settings = PRESETS["standard"]

    def walk(iterations: int) -> float:
        state = begin(question.problem, Start(curves, "a winding"), radius, settings)
        steps = FlowSettings(iterations=iterations, rate=0.01, rate_end=0.01)
        begun = time.process_time()
        run_phase(state, Phase(load.pixels, steps, SETTLE, TAU))
        return time.process_time() - begun

    before = _resident_mb("VmRSS")
    walk(1)
    seconds = min(walk(LONG) for _ in range(2)) - min(walk(SHORT) for _ in range(2))
    return Cost(max(seconds, 1e-6) / (LONG - SHORT), _resident_mb("VmHWM") - before)


def measure_apart(load: Load, target: Target) -> Cost:
    """The cost of a load, measured in a process of its own, whose memory is its own."""
    context = multiprocessing.get_context("fork")  # everything is loaded and compiled already
    with context.Pool(1) as pool:
        return pool.apply(_measure, (load, _question(load, target)))


def _resident_mb(key: str) -> float:
    """`VmRSS`, what is resident now, or `VmHWM`, the most that ever was."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{key}:"):
            return float(line.split()[1]) / 1024.0
    raise OSError(f"/proc/self/status has no {key}")


def fit_exponent(sizes: list[float], values: list[float]) -> float:
    """b of the power law a size^b, least squares in logarithms over the upper half of the sizes."""
    upper = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[upper:]), np.log(np.maximum(values[upper:], 1e-9)), 1)[0])


def tabulate(target: Target) -> list[str]:
    """The page's tables, as lines."""
    lines = [
        "| against | from | to | seconds, least to most | exponent | memory, MB, most | exponent |",
        "|---|---|---|---|---|---|---|",
    ]
    rows = ["| load | s an iteration | MB |", "|---|---|---|"]
    for axis, sizes in AXES.items():
        loads = [replace(BESIDE.get(axis, Load()), **{axis: size}) for size in sizes]
        costs = [measure_apart(load, target) for load in loads]
        for size, cost in zip(sizes, costs, strict=True):
            rows.append(f"| {size} {axis} | {cost.seconds:.4f} | {cost.memory_mb:.0f} |")
            print(rows[-1], flush=True)
        # pixels stand for the side of a square of them
        counts = [float(size) ** (2 if axis == "pixels" else 1) for size in sizes]
        unit = " of the side" if axis == "pixels" else ""
        lines.append(
            f"| {axis}{unit} | {sizes[0]} | {sizes[-1]} | {costs[0].seconds:.4f} to "
            f"{costs[-1].seconds:.4f} | {fit_exponent(counts, [c.seconds for c in costs]):.2f} | "
            f"{costs[-1].memory_mb:.0f} | {fit_exponent(counts, [c.memory_mb for c in costs]):.2f} |"
        )
    wall = measure_apart(WALL, target)
    last = (
        f"The large case, {WALL.vertices} vertices of a tube of 0.2 % of a frame of 2 m at {WALL.pixels} px: "
        f"{wall.seconds:.2f} CPU s an iteration, {wall.memory_mb:.0f} MB."
    )
    return [*lines, "", last, "", *rows]


def main(*, write: Path | None = None) -> None:
    """Print the tables, and write them into a page."""
    v, u = np.mgrid[:1024, :1024]
    disc = np.where(np.hypot(u - 511.5, v - 511.5) < 0.45 * FILLED * 1024, 0, 255)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "disc.png"
        Image.fromarray(disc.astype(np.uint8)).save(path)
        target = read_target(path)
    _measure(Load(vertices=500, pixels=128), _question(Load(), target))  # compiled, from here on
    table = tabulate(target)
    print("\n".join(table))
    if write is not None:
        head = write.read_text("utf-8").split(MARK)[0] if write.is_file() else ""
        write.write_text("\n".join([head + MARK, "", *table, ""]), encoding="utf-8")


if __name__ == "__main__":
    run_study(main)
