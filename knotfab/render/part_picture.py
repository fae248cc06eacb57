"""Pictures of a part from several sides, drawn by VTK; and moving pictures made of stills."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from knotfab.base.arrays import Array, Real
from knotfab.scene.camera import camera_of, view_axes
from knotfab_formats.piece import Material
from knotfab_formats.scene import ResolvedView
from knotfab_validators.shadows.render import why_no_rendering

ANGLES_DEG = (0.0, 30.0, 60.0, 90.0)  # turns about the vertical, one panel each
PANEL_PX = 360  # side of a panel
PAPER = (250, 248, 244)  # sRGB
TUBE = "#d0764f"  # terracotta, for a material of the usual colour
USUAL_COLOR = str(Material.model_fields["color"].default)
MARGIN = 1.12  # the frame over the part's extent
CREASE_DEG = 45.0  # between two faces, from which on their edge is drawn sharp
SAME_DEG = 5.0  # directions closer than this count as one
_FAINT, _KEYED = 0.34, 0.8  # share of a panel's light from all sides, and from the upper left

_THREAD_MM, _THREAD_RADIUS_MM = 600.0, 0.3  # as far as a picture shows
# pixels are drawn so many across one: cheaper than samples of its own where VTK draws by software
_FINER = 2
_SMALL_PX = 1_500_000  # of a picture below which it is drawn whole
_LEVELS = 4095  # of linear light, in the table that turns it into sRGB


def why_undrawn() -> str | None:
    """Say why this machine draws no part, or None: VTK would end the process where OpenGL is missing."""
    return why_no_rendering()


@dataclass(frozen=True)
class Eye:
    """A pinhole camera: `place` (3,), its `axes` (right, up, back) as rows, pixels of focal length, size."""

    place: Array
    axes: Array
    focal_px: float
    size: tuple[int, int]
    near: float
    far: float

    @property
    def projection(self) -> Array:
        """(3, 4): scene point -> homogeneous pixel, from the upper left corner; w is the depth."""
        right, up, back = self.axes
        wide, high = self.size
        rows = np.stack(
            [
                self.focal_px * right - 0.5 * wide * back,
                -self.focal_px * up - 0.5 * high * back,
                -back,
            ]
        )
        return np.column_stack([rows, -rows @ self.place])

    @property
    def rays(self) -> Array:
        """(3, 3): homogeneous pixel -> scene direction, one long in depth."""
        wide, high = self.size
        right, up, back = self.axes
        across, down = right / self.focal_px, -up / self.focal_px
        return np.column_stack([across, down, -back - 0.5 * wide * across - 0.5 * high * down])

    def project(self, points: Array) -> tuple[Array, Array]:
        """Return pixels (n, 2) and depths (n,) of points (n, 3)."""
        p = self.projection
        seen = points @ p[:, :3].T + p[:, 3]
        return seen[:, :2] / seen[:, 2:], seen[:, 2]

    def plane_map(self, plane: Array) -> Array:
        """(4, 3): homogeneous pixel -> homogeneous scene point on a plane (4,)."""
        normal, rays = plane[:3], self.rays
        along = normal @ rays
        away = float(normal @ self.place + plane[3])
        return np.vstack([np.outer(self.place, along) - away * rays, along])


def eye_towards(
    place: Array,
    to: Array,
    up: Sequence[float] | Array,
    half_deg: float,
    size: tuple[int, int],
    reach: float,
) -> Eye:
    """Place an eye that looks `to` a point; `half_deg` is half of its height, `reach` the part's radius."""
    back = np.asarray(place - to, dtype=np.float64)
    away = float(np.linalg.norm(back))
    back = back / away
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back])
    focal = 0.5 * size[1] / float(np.tan(np.radians(half_deg)))
    return Eye(place, axes, focal, size, max(away - reach, 0.02 * away), away + reach)


class Light(NamedTuple):
    """A light's place (3,), the share of it in each channel (3,), and whether it moves with the eye."""

    place: Array
    channels: Array
    moves: bool


class PartPainter:
    """One part in an off-screen window of VTK, from which all its pictures are taken.

    Ask `why_undrawn` first. Three lights fill three channels, and colours are mixed afterwards.

    Args:
        vertices: (n, 3) mm in scene coordinates, so that y is up. faces: (m, 3).
        color: the material's, as #rrggbb; the usual one is drawn as `TUBE`.
    """

    def __init__(
        self, vertices: Array, faces: NDArray[np.integer[Any]], color: str = USUAL_COLOR
    ) -> None:
        if sys.platform.startswith("linux"):
            os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        import pyvista as untyped

        self._pv: Any = untyped
        self._hung = False
        self.points = np.asarray(vertices, dtype=np.float64)
        sheet = self._pv.PolyData.from_regular_faces(self.points.astype(np.float32), faces)
        sheet = sheet.compute_normals(
            split_vertices=True, feature_angle=CREASE_DEG, cell_normals=False
        )
        paint = TUBE if color == USUAL_COLOR else color
        self.paint = to_linear(np.array(list(bytes.fromhex(paint[1:]))) / 255)
        self._plotter = self._pv.Plotter(off_screen=True, lighting="none", window_size=(64, 64))
        self._plotter.disable_anti_aliasing()
        self._add(sheet)
        self._plotter.render_window.SetAlphaBitPlanes(True)
        self._plotter.set_background("black")

    def _add(self, sheet: Any) -> None:
        self._plotter.add_mesh(
            sheet,
            color="white",
            smooth_shading=True,
            diffuse=1.0,
            specular=0.2,
            specular_power=22,
            culling="back",
        )

    def hang(self, threads: Array) -> None:
        """Hang the part on threads from places (k, 3); they are seen, and throw shadows."""
        self._hung = True
        for at in threads:
            line = self._pv.Line(at, at + (0.0, _THREAD_MM, 0.0))
            self._add(line.tube(radius=_THREAD_RADIUS_MM, n_sides=8))

    def __enter__(self) -> PartPainter:
        return self

    def __exit__(self, *_: object) -> None:
        self._plotter.close()

    def light(self, *lamps: Light) -> None:
        """Light the part anew."""
        self._plotter.remove_all_lights()
        for lamp in lamps:
            self._plotter.add_light(
                self._pv.Light(
                    position=tuple(lamp.place),
                    focal_point=(0.0, 0.0, 0.0),
                    color=tuple(lamp.channels),
                    light_type="camera light" if lamp.moves else "scene light",
                    positional=not lamp.moves,
                    cone_angle=180,
                )
            )

    def look(self, eye: Eye, colours: bool = True) -> tuple[Real, Real]:
        """Return light in three channels and coverage, (h, w, 4), and depths, (h, w), `far` where bare."""
        window, camera = self._plotter.render_window, self._plotter.camera
        camera.position, camera.focal_point = tuple(eye.place), tuple(eye.place - eye.axes[2])
        camera.up = tuple(eye.axes[1])
        camera.clipping_range = (eye.near, eye.far)
        (left, top), (right, bottom) = self._find_box(eye)
        wide, high, fine = right - left, bottom - top, _FINER if colours else 1
        camera.view_angle = 2 * np.degrees(np.arctan(0.5 * high / eye.focal_px))
        off = np.array([left + right, top + bottom]) - eye.size
        camera.SetWindowCenter(off[0] / wide, -off[1] / high)
        window.SetSize(fine * wide, fine * high)
        window.Render()
        here = slice(top, bottom), slice(left, right)
        z = self._read("SetInputBufferTypeToZBuffer")[::-1, :, 0]
        seen = np.minimum.reduce([z[j::fine, i::fine] for j in range(fine) for i in range(fine)])
        depth = np.full(eye.size[::-1], np.float32(eye.far))
        depth[here] = eye.near * eye.far / (eye.far - seen * (eye.far - eye.near))
        if not colours:
            return np.zeros(0, np.float32), depth
        # not as RGBA, whose light Pillow would divide by its coverage
        drawn = Image.frombuffer(
            "RGBX",
            (fine * wide, fine * high),
            self._read("SetInputBufferTypeToRGBA"),
            "raw",
            "RGBX",
            0,
            -1,
        )
        light = np.zeros((*depth.shape, 4), np.float32)
        light[here] = np.asarray(drawn.reduce(fine))
        return light * np.float32(1 / 255), depth

    def _find_box(self, eye: Eye) -> NDArray[np.int64]:
        """Find the first pixel and one past the last that are drawn, (2, 2): those of a part without threads.

        A small picture is drawn whole: another size of the window takes longer than what is bare.
        """
        size = np.array(eye.size)
        if self._hung or size.prod() < _SMALL_PX:
            return np.array([(0, 0), size])
        seen, _ = eye.project(self.points)
        low = np.clip(np.floor(seen.min(axis=0)) - 1, 0, size - 1)
        return np.stack([low, np.clip(np.ceil(seen.max(axis=0)) + 1, low + 1, size)]).astype(int)

    def _read(self, kind: str) -> Any:
        """Read what was drawn last, without drawing it again; the lowest row comes first."""
        from vtkmodules.util import numpy_support
        from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

        to_numpy: Any = numpy_support.vtk_to_numpy

        read = vtkWindowToImageFilter()
        read.SetInput(self._plotter.render_window)
        read.ShouldRerenderOff()
        read.ReadFrontBufferOff()
        getattr(read, kind)()
        read.Update()
        image = read.GetOutput()
        wide, high, _ = image.GetDimensions()
        return to_numpy(image.GetPointData().GetScalars()).reshape(high, wide, -1)

    def draw_panels(self, eyes: Array, panel_px: int = PANEL_PX) -> Image.Image:
        """Draw the part as a row of panels on paper, one for each eye (k, 3), all at one scale."""
        key, weak = np.eye(3)[:2]
        self.light(
            Light(np.array([-0.5, 0.8, 1.2]), key, True),
            Light(np.array([0.9, -0.4, 0.6]), weak, True),
        )
        middle = (self.points.min(axis=0) + self.points.max(axis=0)) / 2
        points = self.points - middle
        if np.ptp(eyes[:, 1]) > 0 or eyes[0, 1] != 0:
            reach = float(np.linalg.norm(points, axis=1).max())
        else:  # all about the vertical: what is drawn lies in this disc of the horizontal and this height
            reach = float(max(np.hypot(points[:, 0], points[:, 2]).max(), abs(points[:, 1]).max()))
        panels = []
        for look in eyes - middle:
            near = float(np.linalg.norm(look))
            away = max(near, 2 * reach)
            back = look / near
            # share of the way that is vertical, where "up" is no direction any more
            up = (0.0, 0.0, -1.0) if abs(back[1]) > 0.999 else (0.0, 1.0, 0.0)
            half = np.degrees(np.arctan(MARGIN * reach / (away - 0.5 * reach)))
            size = panel_px, panel_px
            eye = eye_towards(middle + away * back, middle, up, half, size, 1.8 * reach)
            light, _ = self.look(eye)
            covered = light[..., 3:]
            gathered = light[..., :1] + 0.3 * light[..., 1:2]
            lit = self.paint * (_FAINT * covered + _KEYED * gathered)
            paper = to_linear(np.array(PAPER) / 255) * (1 - covered)
            panels.append(encode_light(lit + paper))
        return Image.fromarray(np.concatenate(panels, axis=1))


def draw_part(
    vertices: Array,
    faces: NDArray[np.integer[Any]],
    path: Path | IO[bytes],
    eyes: Array,
    panel_px: int = PANEL_PX,
    color: str = USUAL_COLOR,
) -> None:
    """Draw the part as a row of panels into a PNG, `panel_px` high; arguments are as for `PartPainter`."""
    with PartPainter(vertices, faces, color) as painter:
        painter.draw_panels(eyes, panel_px).save(path, "PNG")


def place_eyes(views: Sequence[ResolvedView]) -> Array:
    """Return the eyes: each view's light (or eye), and turns of the first to make up four, (k, 3) mm.

    From a view's light the part shows its picture; the others begin at the first view's.
    """
    own = np.stack([camera_of(view, 1, 1).eye for view in views])
    turned = turn_eye(own[0], ANGLES_DEG)
    level, others = _level(own), _level(turned)
    new = (others @ level.T).max(axis=1) < np.cos(np.deg2rad(SAME_DEG))
    return np.concatenate([own, turned[new][: max(0, len(ANGLES_DEG) - len(own))]])


def look_from(view: ResolvedView, azimuth_deg: float, elevation_deg: float) -> Array:
    """Return the eye that is as far off as a view's light, so much to its right and above it, (3,) mm."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    way = np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])
    return np.asarray(np.linalg.norm(camera_of(view, 1, 1).eye) * way @ view_axes(view))


def turn_eye(eye: Sequence[float] | Array, angles_deg: Sequence[float]) -> Array:
    """Turn `eye` about the vertical by each angle, to the right as the part sees it, (k, 3)."""
    one = np.asarray(eye, dtype=np.float64)
    return np.array([turn_upright(one, angle) for angle in angles_deg])


def turn_upright(points: Array, angle_deg: float) -> Array:
    """Turn points (..., 3) about the vertical through the origin, anticlockwise from above."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.asarray(points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]))


def _level(eyes: Array) -> Array:
    """Return the horizontal unit directions of eyes, (k, 2)."""
    flat = eyes[:, [0, 2]]
    return np.asarray(flat / np.maximum(np.linalg.norm(flat, axis=1), 1e-9)[:, None])


def to_linear(srgb: Array) -> Array:
    return np.asarray(srgb**2.2)


def encode_light(light: Array | Real, exposure: float | None = None) -> NDArray[np.uint8]:
    """Turn linear light into sRGB bytes, by a table; an exposure rolls bright light off."""
    levels = np.linspace(0, 1 if exposure is None else 3, _LEVELS + 1)
    shown = levels if exposure is None else 1 - np.exp(-exposure * levels)
    table = np.rint(255 * shown ** (1 / 2.2)).astype(np.uint8)
    scale = np.float32(_LEVELS / levels[-1])
    return np.asarray(table[np.clip(light * scale, 0, _LEVELS).astype(np.uint16)])
