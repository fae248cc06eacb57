"""Hold the colours that the validators mix against Mitsuba 3, which traces paths through the same scene.

`python -m benchmarks.traced_colours DIR... [--px N] [--samples N] [--grey R] [--out FILE.png]`: each DIR is a
build under several lamps (its part.stl, scene.toml and pictures). Each lamp is an emitter of its colour and
size, the screen is white and diffuse, the part black, or as grey as is said, so that light goes to and fro
between it and the screen. Printed are the RMS of each channel, in linear light, and both shares of pixels in
the right colour; drawn are picture, what the validators mix, and what was traced. Needs the extra
`pathtracer` (pip install mitsuba).
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmarks.measurement import run_study
from knotfab_formats.views import View
from knotfab_validators.files.mesh import read_mesh
from knotfab_validators.files.picture import read_colours, read_mask
from knotfab_validators.files.scene import Scene, read_scene
from knotfab_validators.geometry.mesh import Mesh, move_points
from knotfab_validators.shadows.exact_shadow import ShadowCaster
from knotfab_validators.shadows.frame import WorkingFrame, padded_mask, working_frame
from knotfab_validators.shadows.lamp import Light, colour_error, lamp_points, light_of, to_srgb
from knotfab_validators.shadows.view import ViewGeometry, view_geometry
from tests.corpus.files import encode
from tests.corpus.parts import Body

VARIANT = "scalar_rgb"  # this variant of Mitsuba needs no LLVM
# so near before the screen the camera looks at it: matter nearer than that is not seen
BEFORE_MM = 0.5
RADIANCE = 1e3
BOUNCES = 6  # light is followed so often at most, where the part throws any back
FINER = 4  # pixels of a shadow to each one of the picture, each way
_WIDE = 100.0  # a blur, px, for which all points of a lamp are taken

Picture = NDArray[np.floating[Any]]


def light_and_mix(mesh: Mesh, scene: Scene, seen: Sequence[ViewGeometry]) -> tuple[Light, Picture]:
    """Give the validators' light on the pixels of the views, and what they mix of it, (H, W, 3), white at 1.

    Shadows are cast on finer pixels: a pixel of a camera sees all of its square, not its middle alone.
    """
    caster = ShadowCaster(mesh.vertices, mesh.faces)
    size = (seen[0].height, seen[0].width)
    lit, lamps = [], []
    for view, geometry in zip(scene.views, seen, strict=True):
        spots = lamp_points(view, _WIDE, 0.25) if view.light_diameter_mm > 0 else np.zeros((1, 2))
        places = [geometry.light + x * geometry.right + y * geometry.up for x, y in spots]
        fine = geometry.resample(WorkingFrame(FINER * size[1], FINER * size[0], 0, 0))
        hidden = np.mean([caster.render(replace(fine, light=place)) for place in places], axis=0)
        lit.append(1 - hidden.reshape(size[0], FINER, size[1], FINER).mean(axis=(1, 3)))
        lamps.append((view, np.array(view.lamp_colour), geometry))
    light = light_of(list(lamps), scene.room, size)
    return light, light.mix(np.array(lit))


def trace_colours(
    mesh: Mesh, views: Sequence[View], seen: Sequence[ViewGeometry], samples: int, grey: float = 0.0
) -> Picture:
    """Trace (H, W, 3) the screen as Mitsuba lights it, linear, over the middle of an empty screen.

    Args:
        mesh: in the scene. seen: the views, flat, on one grid of pixels. samples: paths of each pixel.
        grey: what the part throws back of the light.
    """
    import mitsuba as mi

    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2 if grey == 0 else BOUNCES},
        "sensor": _camera(seen[0], samples),
        "screen": _screen(seen[0]),
        **{f"lamp-{v.name}": _lamp(v, g) for v, g in zip(views, seen, strict=True)},
    }
    empty = np.array(mi.render(mi.load_dict(scene)))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "part.ply"
        file.write_bytes(encode(Body(mesh.vertices, mesh.faces), "ply-binary"))
        part = {"type": "ply", "filename": str(file), "face_normals": True, "bsdf": _paint(grey)}
        lit = np.array(mi.render(mi.load_dict({**scene, "part": part})))
    row, column = empty.shape[0] // 2, empty.shape[1] // 2
    white = empty[row - 1 : row + 1, column - 1 : column + 1].mean(axis=(0, 1))
    return np.asarray(np.where(white > 0, lit / np.where(white > 0, white, 1.0), 0.0))


def _paint(reflectance: float) -> dict[str, Any]:
    colour = {"type": "rgb", "value": [reflectance] * 3}
    return {"type": "twosided", "material": {"type": "diffuse", "reflectance": colour}}


def _place(x: NDArray[Any], y: NDArray[Any], z: NDArray[Any], at: NDArray[Any]) -> Any:
    """Return the transform that takes the axes of a shape to vectors, and its middle to a place."""
    import mitsuba as mi

    matrix = np.eye(4)
    matrix[:3] = np.column_stack([x, y, z, at])
    return mi.ScalarTransform4f(matrix)


def _screen(seen: ViewGeometry) -> dict[str, Any]:
    """Return a white rectangle, three times as wide as the frame."""
    right, down = 1.5 * seen.width * seen.du, 1.5 * seen.height * seen.dv
    to_world = _place(right, -down, seen.normal, seen.middle)
    return {"type": "rectangle", "to_world": to_world, "bsdf": _paint(1.0)}


def _camera(seen: ViewGeometry, samples: int) -> dict[str, Any]:
    """Return a camera that looks straight at the screen, from between the part and the screen."""
    import mitsuba as mi

    half = 0.5 * seen.width * float(np.linalg.norm(seen.du))
    at = seen.middle + BEFORE_MM * seen.normal
    looks = mi.ScalarTransform4f().look_at(
        origin=at.tolist(), target=seen.middle.tolist(), up=(-seen.dv).tolist()
    )
    film = {
        "type": "hdrfilm",
        "width": seen.width,
        "height": seen.height,
        "rfilter": {"type": "box"},
    }
    return {
        "type": "orthographic",
        "near_clip": 0.1 * BEFORE_MM,
        "far_clip": 10 * BEFORE_MM,
        "to_world": looks @ mi.ScalarTransform4f().scale([half, half, 1.0]),
        "film": {**film, "pixel_format": "rgb", "component_format": "float32"},
        "sampler": {"type": "multijitter", "sample_count": samples},
    }


def _lamp(view: View, seen: ViewGeometry) -> dict[str, Any]:
    """Model a disc across the view's axis, or a ball, in the lamp's colour; a point is a tiny disc."""
    radius = max(0.5 * view.light_diameter_mm, 1e-2)
    value = [RADIANCE * c / radius**2 for c in view.lamp_colour]
    glow = {"type": "area", "radiance": {"type": "rgb", "value": value}}
    if view.light_shape == "ball":
        return {"type": "sphere", "center": seen.light.tolist(), "radius": radius, "emitter": glow}
    to_world = _place(radius * seen.up, radius * seen.right, -seen.axis, seen.light)
    return {"type": "disk", "to_world": to_world, "emitter": glow}


def use_mitsuba() -> bool:
    """Tell whether Mitsuba can trace paths here; what is lacking is printed."""
    try:
        import mitsuba as mi
    except ImportError as error:
        print(f"skipped, for Mitsuba is not installed ({error}): pip install mitsuba")
        return False
    mi.set_variant(VARIANT)
    return True


def measure_rms(ours: Picture, traced: Picture) -> NDArray[Any]:
    """Measure (3,) the root mean square of what each channel is off."""
    return np.asarray(
        np.sqrt(((np.clip(ours, 0, 1) - np.clip(traced, 0, 1)) ** 2).mean(axis=(0, 1)))
    )


def share_right(shown: Picture, light: Light, masks: NDArray[np.bool_]) -> float:
    """Return the share of pixels nearest to the colour that masks (n, H, W) ask for, under the same light."""
    codes = np.tensordot(2 ** np.arange(len(masks)), masks.astype(np.int64), axes=1).ravel()
    off = []
    for code in range(2 ** len(masks)):
        lit = [np.full(codes.shape, 1.0 - (code >> k & 1)) for k in range(len(masks))]
        wanted = light.mix(np.array(lit).reshape(light.falloff.shape)).reshape(-1, 3)
        off.append(colour_error(to_srgb(shown).reshape(-1, 3), to_srgb(wanted)))
    return float((np.argmin(off, axis=0) == codes).mean())


def trace_build(folder: Path, px: int, samples: int, grey: float) -> Image.Image:
    """Trace one build, print both, and draw the picture, what the validators mix, and what was traced."""
    scene, mesh = read_scene(folder / "scene.toml"), read_mesh(folder / "part.stl")
    pose = np.eye(4) if scene.pose is None else np.asarray(scene.pose.matrix)
    vertices = move_points(scene.material.shrinks_to * mesh.vertices, pose)
    masks = [read_mask(folder / view.picture) for view in scene.views]
    height, width = masks[0].shape
    frame = working_frame(width, height, px)
    size = frame.width, frame.height
    seen = [
        view_geometry(view, width, height).flat.resample(WorkingFrame(*size, 0, 0))
        for view in scene.views
    ]
    mesh = Mesh(vertices, mesh.faces)
    light, ours = light_and_mix(mesh, scene, seen)
    traced = trace_colours(mesh, scene.views, seen, samples, grey)
    asked = np.stack([padded_mask(mask, frame)[frame.window] for mask in masks])
    rms = "  ".join(f"{value:.4f}" for value in measure_rms(ours, traced))
    print(f"{folder.name}, {size[0]} x {size[1]} px, {samples} paths a pixel, part {grey:g} grey")
    print(f"RMS of red, green and blue: {rms}")
    print(f"right colour: ours {share_right(ours, light, asked):.4f}", end=", ")
    print(f"Mitsuba's {share_right(traced, light, asked):.4f}", flush=True)
    picture = read_colours(folder / scene.lamps.picture, size, (width, height))
    row = [picture, to_srgb(ours), to_srgb(traced)]
    return Image.fromarray(np.concatenate(row, axis=1))


def main(
    *folders: Path, px: int = 256, samples: int = 225, grey: float = 0.0, out: Path | None = None
) -> int:
    """Trace builds one after the other, and draw a row of each."""
    if not use_mitsuba():
        return 3
    rows = [trace_build(folder, px, samples, grey) for folder in folders]
    if out is not None:
        sheet = Image.new("RGB", (max(r.width for r in rows), sum(r.height for r in rows)), "white")
        for number, row in enumerate(rows):
            sheet.paste(row, (0, sum(r.height for r in rows[:number])))
        sheet.save(out, optimize=True)
    return 0


if __name__ == "__main__":
    run_study(main)
