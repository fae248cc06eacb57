"""Hold the magnitudes of effects against brute force, and soft shadows against Mitsuba 3.

`python -m benchmarks.effects_table [--scenes N] [--part DIR] [--px N] [--samples N]`: for each kind of
lamp the share of random scenes in which the magnitude does not bound the truth, and its ratio to it;
milliseconds of deciding all effects; of a built part (--part, else the knight, built for it), where Mitsuba
is installed (pip install mitsuba, and libllvm19 or its scalar variant), IoU at half light and brightness
inside the penumbra under lamps of 5, 20 and 50 mm.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measurement import build_apart, run_study
from knotfab.base.arrays import Array
from knotfab.effects.base import EffectContext, Shadows, World
from knotfab.effects.penumbra import PENUMBRA, blurs_mm
from knotfab.effects.survey import survey
from knotfab.scene.camera import camera_of, view_axes
from knotfab_formats.scene import ResolvedView
from knotfab_formats.views import Placing
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.files.picture import read_mask
from knotfab_validators.files.scene import read_scene
from knotfab_validators.geometry.mesh import move_points
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.frame import padded_mask, working_frame
from knotfab_validators.shadows.lamp import measure_penumbra
from knotfab_validators.shadows.render import SilhouetteRenderer
from knotfab_validators.shadows.view import ViewGeometry, view_geometry
from tests.shared.oracles import bounds_and_truths, cast, shift_bound_and_truth

KINDS = ("ball", "disc", "rectangle", "leds")
KNIGHT = Path(__file__).resolve().parents[1] / "examples" / "knight.png"
UP = np.array([0.0, 1.0, 0.0])  # a printer's z, in the scene
_RIM = 60  # points along the edge of a lamp; of an array fewer a LED
_WORST = 6  # strand points of a scene that are looked at all round
_DECIDED = 60  # times
_ROUNDING = 1e-9  # the error of exact bounds
_ROUND = 60  # points of the tube's surface about each


def random_view(rng: np.random.Generator, kind: str) -> ResolvedView:
    """Return a lamp of this kind before a wall that is tilted by up to 30 degrees."""
    size = rng.uniform(1, 60)
    keys: dict[str, Any] = {"light_shape": kind, "light_diameter_mm": size}
    if kind in ("rectangle", "leds"):
        turn = rng.uniform(0.1, np.pi / 2 - 0.1)
        keys |= {"light_width_mm": size * np.cos(turn), "light_height_mm": size * np.sin(turn)}
    if kind == "leds":
        keys |= {"light_leds": (3, 2), "light_diameter_mm": 0.1 * size}
    return ResolvedView(
        frame_width_mm=180.0,
        frame_height_mm=180.0,
        light_distance_mm=rng.uniform(200, 2000),
        wall_distance_mm=rng.uniform(50, 400),
        wall_tilt_deg=rng.uniform(-30, 30),
        **keys,
    )


def edge_of_lamp(view: ResolvedView, seen_from: Array) -> Array:
    """Return (n, 3) points round the lamp as a point sees it; a ball's edge depends on where from."""
    right, up, back = view_axes(view)
    middle = view.light_distance_mm * back
    count = _RIM // 5 if view.light_shape == "leds" else _RIM
    t = 2 * np.pi * np.arange(count) / count
    half = 0.5 * view.light_diameter_mm
    if view.light_shape == "ball":
        ray = seen_from - middle
        far = np.linalg.norm(ray)
        ray = ray / far
        side = np.cross(ray, [0.3, 0.5, 0.8])
        side /= np.linalg.norm(side)
        rim = np.cos(t)[:, None] * side + np.sin(t)[:, None] * np.cross(ray, side)
        # the circle in which the rays through that point touch the ball
        return middle + half**2 / far * ray + half * np.sqrt(1 - (half / far) ** 2) * rim
    disc = half * (np.cos(t)[:, None] * right + np.sin(t)[:, None] * up)
    if view.light_shape == "disc":
        return middle + disc
    corners = [
        0.5 * (x * view.light_width_mm * right + y * view.light_height_mm * up)
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    if view.light_shape == "rectangle":
        return middle + np.array(corners)
    return middle + np.concatenate([corner + disc for corner in corners])


def true_blur(view: ResolvedView, edge: Array) -> float:
    """Return the longest line in what the lamp throws through one point onto the wall, mm."""
    spots = cast(edge, edge_of_lamp(view, edge), camera_of(view, 1, 1))
    return float(np.linalg.norm(spots[:, None] - spots, axis=2).max())


def bound_and_truth(rng: np.random.Generator, kind: str) -> tuple[float, float]:
    """Return the magnitude of penumbra in a random scene, and the widest blur that was found, px."""
    while True:
        view, radius = random_view(rng, kind), rng.uniform(0.5, 4)
        room = min(0.4 * view.light_distance_mm, 0.8 * view.wall_distance_mm)
        points = rng.uniform(-1, 1, (60, 3)) * [70, 70, room / 2]
        camera = camera_of(view, 1, 1)
        height = points @ camera.receiver[:3] + camera.receiver[3]
        if height.min() > radius:  # before the tilted wall
            break
    magnitude = PENUMBRA.magnitude(EffectContext((view,), points, radius, 0.25))
    worst = points[np.argsort(blurs_mm(Shadows.from_points(view, points), radius))[-_WORST:]]
    way = rng.normal(size=(_ROUND, 3))
    way *= radius / np.linalg.norm(way, axis=1)[:, None]
    truth = max(true_blur(view, middle + step) for middle in worst for step in way)
    return magnitude, truth / view.pixel_mm


def print_bounds(scenes: int) -> None:
    """Print violations and ratios by effect and kind."""
    print("magnitude               scenes  violations  median ratio  largest")

    def tell(kind: str, ratio: Array) -> None:
        print(
            f"{kind:<22}  {scenes:>6}  {(ratio < 1 - _ROUNDING).sum():>10}  {np.median(ratio):>12.4f}  "
            f"{ratio.max():>7.4f}",
            flush=True,
        )

    for kind in KINDS:
        rng = np.random.default_rng(KINDS.index(kind))
        pairs = np.array([bound_and_truth(rng, kind) for _ in range(scenes)])
        tell(f"penumbra, {kind}", pairs[:, 0] / pairs[:, 1])
    rng = np.random.default_rng(0)
    pairs = np.array([bounds_and_truths(rng) for _ in range(scenes)])
    for n, what in enumerate(("lamp", "turn", "tilt")):
        tell(f"misplaced {what}", pairs[:, 0, n] / pairs[:, 1, n])
    rng = np.random.default_rng(1)
    pairs = np.array([bounds_and_truths(rng, turns=False) for _ in range(scenes)])
    tell("misplaced tilt, hung", pairs[:, 0, 2] / pairs[:, 1, 2])
    others: dict[str, Callable[[np.random.Generator], tuple[float, float]]] = {
        "sag": lambda rng: shift_bound_and_truth(rng, "sag"),
        "layers": lambda rng: shift_bound_and_truth(rng, "layers"),
    }
    for what, measure in others.items():
        rng = np.random.default_rng(0)
        tell(what, np.array([np.divide(*measure(rng)) for _ in range(scenes)]))


def print_deciding() -> None:
    """Print the milliseconds of CPU of deciding all effects on a curve of 5000 vertices in each of two views.

    The median of many and the least, under what takes longest each by itself, and under all of it.
    """
    t = 2 * np.pi * np.arange(5000) / 5000
    points = np.column_stack([60 * np.sin(7 * t), 60 * np.sin(8 * t + 1), 30 * np.sin(9 * t + 2)])
    leds: dict[str, Any] = {"light_shape": "leds", "light_leds": (3, 2)}
    leds |= {"light_width_mm": 30.0, "light_height_mm": 20.0}
    for name, keys in {"a disc": {}, "LEDs": leds}.items():
        view = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0, **keys)
        world = World(placing=Placing(tilt_deg=1.0))
        context = EffectContext(
            (view, view), points, 2.0, 0.25, world, moves=0.001 * points, upwards=UP
        )
        spent = []
        for _ in range(_DECIDED):
            begun = time.process_time()
            survey(replace(context), {})  # nothing is kept
            spent.append(time.process_time() - begun)
        print(
            f"deciding all effects, {name:<30} {1000 * float(np.median(spent)):.1f} ms, "
            f"{1000 * min(spent):.1f} at least",
            flush=True,
        )
    print()


def trace_shadow(
    vertices: Array, faces: Array, seen: ViewGeometry, diameter: float, samples: int
) -> NDArray[np.float32]:
    """Return (H, W) the share of a disc's light that a mesh hides, by Mitsuba's rays, weighed by cosines."""
    import drjit as dr
    import mitsuba as mi

    mesh = mi.Mesh("part", len(vertices), len(faces))
    shape = mi.traverse(mesh)
    shape["vertex_positions"] = vertices.astype(np.float32).ravel()
    shape["faces"] = faces.astype(np.uint32).ravel()
    shape.update()
    scene = mi.load_dict({"type": "scene", "part": mesh})
    v, u = np.meshgrid(np.arange(seen.height), np.arange(seen.width), indexing="ij")
    at = seen.on_receiver(np.column_stack([u.ravel(), v.ravel()]).astype(np.float64))
    begin = mi.Point3f(at.T.astype(np.float32))
    # on a sunflower's spiral, of which no ring is one of the validators'
    turns, hidden, every = np.pi * (3 - np.sqrt(5)), np.zeros(len(at)), np.zeros(len(at))
    for number in range(samples):
        reach, angle = 0.5 * diameter * np.sqrt((number + 0.5) / samples), turns * number
        lamp = seen.light + reach * (np.cos(angle) * seen.right + np.sin(angle) * seen.up)
        ray = lamp - at
        far = np.linalg.norm(ray, axis=1)
        weight = (ray @ seen.normal) * (ray @ seen.axis) / far**4
        way = mi.Vector3f((ray / far[:, None]).T.astype(np.float32))
        # from 2 µm before the wall, where matter on it casts nothing
        ray_of = mi.Ray3f(begin, way, mi.Float((far - 1e-3).astype(np.float32)), 0.0, [])
        blocked = np.array(scene.ray_test(ray_of), dtype=bool)
        hidden += weight * blocked
        every += weight
    dr.flush_malloc_cache()
    return (hidden / every).reshape(seen.height, seen.width).astype(np.float32)


def print_traced(folder: Path, px: int, samples: int) -> None:
    """Print the IoU at half light and brightness of a built part, ours and Mitsuba's."""
    setting, mesh = read_scene(folder / "scene.toml"), read_mesh(folder / "part.stl")
    view = setting.views[0]
    picture = read_mask(folder / view.picture)
    frame = working_frame(picture.shape[1], picture.shape[0], px)
    seen = view_geometry(view, picture.shape[1], picture.shape[0]).resample(frame)
    target = padded_mask(picture, frame)
    vertices = move_points(mesh.vertices, np.asarray(setting.pose.matrix))
    print("lamp, mm  points  IoU ours  Mitsuba   RMS  error ours  Mitsuba")
    with SilhouetteRenderer(vertices, mesh.faces) as renderer:
        sharp = renderer.render(seen)
        for diameter in (5.0, 20.0, 50.0):
            lamp: Any = _Lamp(diameter)
            ours = measure_penumbra(renderer, vertices, seen, target, sharp, frame, lamp, 0.25)
            traced = trace_shadow(vertices, mesh.faces, seen, diameter, samples)
            grey = (traced > 0.005) & (traced < 0.995)
            rms = float(np.sqrt(((ours.soft - traced)[grey] ** 2).mean()))
            iou = overlap(traced >= 0.5, target).iou
            error = float(np.abs(traced - target).sum()) / (frame.width * frame.height)
            print(
                f"{diameter:8.0f}  {ours.found.samples:6d}  {ours.found.iou:.4f}    {iou:.4f}  {rms:.3f}  "
                f"{ours.found.brightness_error:.4f}      {error:.4f}",
                flush=True,
            )


class _Lamp:
    """A disc of a diameter, mm."""

    kind, light_shape, light_leds = "shadow", "disc", (1, 1)
    light_width_mm = light_height_mm = 0.0

    def __init__(self, diameter: float) -> None:
        self.light_diameter_mm = diameter


def main(*, scenes: int = 200, part: Path | None = None, px: int = 512, samples: int = 401) -> None:
    """Print all tables."""
    print_bounds(scenes)
    print_deciding()
    with tempfile.TemporaryDirectory() as folder:
        if part is None:
            part = Path(folder) / "knight"
            build_apart(KNIGHT, part)
        if _has_mitsuba():
            print_traced(part, px, samples)


def _has_mitsuba() -> bool:
    """Tell whether Mitsuba can trace rays here; what is lacking is printed."""
    try:
        import mitsuba as mi
    except ImportError as error:
        print(f"soft shadows: skipped, for Mitsuba is not installed ({error})")
        return False
    try:
        mi.set_variant("llvm_ad_rgb")
    except Exception as error:  # drjit raises its own kind where there is no LLVM that it can use
        print(f"soft shadows: skipped, for Mitsuba has no LLVM here ({error})")
        return False
    return True


if __name__ == "__main__":
    run_study(main)
