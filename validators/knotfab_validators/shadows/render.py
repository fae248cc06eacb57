"""The silhouette of a mesh, rendered off-screen by VTK with a real camera at the light."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import sys
from dataclasses import replace
from typing import Any

import numpy as np

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.shadows.view import ON_RECEIVER_MM, ViewGeometry

__all__ = ["CannotRender", "SilhouetteRenderer", "why_no_rendering"]

FINER = 4  # pixels of the flat receiver to one of a curved one, each way
REMEDY = "Install it: apt-get install libegl1 libgl1"
EGL_PLATFORM_DEVICE = 0x313F


class CannotRender(RuntimeError):
    """This machine cannot render off-screen; `reason` says why, `remedy` what to do about it."""

    def __init__(self, reason: str, remedy: str = REMEDY) -> None:
        self.reason, self.remedy = reason, remedy
        super().__init__(f"{reason}. {remedy}")


def why_no_rendering() -> str | None:
    """Why VTK could not render here, or None if it can; loads nothing of VTK.

    VTK ends the process with a segmentation fault where OpenGL is missing, so the question is put
    to the system's EGL itself: it must have a display (a device, or the default one) that starts.
    `KNOTFAB_NO_RENDERING=1` in the environment answers for it.
    """
    if os.environ.get("KNOTFAB_NO_RENDERING", "0") not in ("", "0"):
        return "rendering is switched off by KNOTFAB_NO_RENDERING"
    if not sys.platform.startswith("linux"):
        return None  # the window system's own OpenGL is part of the system
    try:
        ctypes.CDLL("libGL.so.1")
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError as error:
        return f"OpenGL for off-screen rendering is missing ({error})"
    return None if _egl_starts(egl) else "EGL is installed, but has no display that starts"


def _egl_starts(egl: ctypes.CDLL) -> bool:
    pointer = ctypes.c_void_p
    egl.eglGetProcAddress.restype = pointer
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    egl.eglGetDisplay.restype = pointer
    egl.eglGetDisplay.argtypes = [pointer]
    egl.eglInitialize.restype = ctypes.c_uint
    egl.eglInitialize.argtypes = [pointer, pointer, pointer]
    displays: list[int | None] = []
    query = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    platform = egl.eglGetProcAddress(b"eglGetPlatformDisplayEXT")
    if query and platform:
        devices, count = (pointer * 16)(), ctypes.c_int()
        query_devices = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, pointer, pointer)(query)
        get_display = ctypes.CFUNCTYPE(pointer, ctypes.c_uint, pointer, pointer)(platform)
        if query_devices(16, ctypes.addressof(devices), ctypes.addressof(count)):
            displays = [get_display(EGL_PLATFORM_DEVICE, d, None) for d in devices[: count.value]]
    displays.append(egl.eglGetDisplay(None))
    return any(display and egl.eglInitialize(display, None, None) for display in displays)


class SilhouetteRenderer:
    """One mesh in one off-screen window, for as many views of it as wanted.

    Flat white on black, both sides of every face, no lights, no anti-aliasing: a pixel is white
    exactly when the ray through its centre meets the mesh.

    Args:
        vertices: (n, 3) mm. faces: (m, 3).

    Raises:
        CannotRender: where VTK would crash.
    """

    def __init__(self, vertices: Array, faces: Ints) -> None:
        reason = why_no_rendering()
        if reason is not None:
            raise CannotRender(reason)
        if sys.platform.startswith("linux"):
            # an X server is neither needed nor looked for
            os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        import pyvista
        import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers the OpenGL classes)
        from vtkmodules.vtkRenderingCore import (
            vtkActor,
            vtkPolyDataMapper,
            vtkRenderer,
            vtkRenderWindow,
        )

        self._known: tuple[Any, Array, Array] | None = None
        self._vertices = np.asarray(vertices, dtype=np.float64)
        # the card works in single precision: keep its numbers small
        self._middle = (self._vertices.min(axis=0) + self._vertices.max(axis=0)) / 2
        points = (self._vertices - self._middle).astype(np.float32)
        mapper = vtkPolyDataMapper()
        triangles: Any = faces
        mapper.SetInputData(pyvista.PolyData.from_regular_faces(points, triangles))
        mapper.ScalarVisibilityOff()
        actor = vtkActor()
        actor.SetMapper(mapper)
        actor.GetProperty().LightingOff()
        actor.GetProperty().SetColor(1.0, 1.0, 1.0)
        self._camera: Any = pyvista.Camera()  # type: ignore[no-untyped-call]
        renderer = vtkRenderer()
        renderer.SetBackground(0.0, 0.0, 0.0)
        renderer.AutomaticLightCreationOff()
        renderer.AddActor(actor)
        renderer.SetActiveCamera(self._camera)
        self._renderer: Any = renderer
        self._window: Any = vtkRenderWindow()
        self._window.SetOffScreenRendering(1)
        self._window.SetMultiSamples(0)
        self._window.AddRenderer(renderer)

    def render(self, geometry: ViewGeometry, *, behind: bool = False, finer: int = FINER) -> Mask:
        """The silhouette (height, width) on the pixels of `geometry`, in the mesh's coordinates.

        The camera stands at the light and looks straight at the receiver plane, whatever its
        tilt; its frustum is shifted and shaped to the frame. Matter on or behind the receiver
        plane is clipped away unless `behind`. Before a cylinder that is done for the flat receiver, on
        pixels so many times `finer`; each of the curved one's is dark where the ray to it is.
        """
        if geometry.cylinder is not None:
            return self._render_bent(geometry, behind, finer)
        self._place(geometry, behind)
        self._window.SetSize(geometry.width, geometry.height)
        self._window.Render()
        return self._read(geometry.width, geometry.height)

    def _render_bent(self, geometry: ViewGeometry, behind: bool, finer: int) -> Mask:
        at, normal = self._places(geometry)
        lit = ((geometry.light - at) * normal).sum(axis=1) > 0
        flat = geometry.flat
        pixels, w = flat.project(at)
        cast = flat.project(self._vertices)[0]
        low, high = np.floor(cast.min(axis=0)) - 1, np.ceil(cast.max(axis=0)) + 1
        lit &= (w > 0) & (pixels >= low).all(axis=1) & (pixels <= high).all(axis=1)
        shadow = np.zeros(len(at), dtype=bool)
        if lit.any():
            low, high = np.floor(pixels[lit].min(axis=0)), np.ceil(pixels[lit].max(axis=0))
            wide, tall = (finer * (high - low + 1)).astype(int)
            first = low - 0.5 + 0.5 / finer
            origin = flat.origin + first[0] * flat.du + first[1] * flat.dv
            du, dv = flat.du / finer, flat.dv / finer
            window = replace(flat, origin=origin, du=du, dv=dv, width=int(wide), height=int(tall))
            column, row = np.rint(finer * (pixels[lit] - first)).astype(np.int64).T
            mask = self.render(window, behind=behind)
            shadow[lit] = mask[np.clip(row, 0, tall - 1), np.clip(column, 0, wide - 1)]
        return shadow.reshape(geometry.height, geometry.width)

    def _places(self, geometry: ViewGeometry) -> tuple[Array, Array]:
        """The points of the receiver under all pixels, and its normals; kept, for many lamps see the same."""
        wall = geometry.cylinder
        assert wall is not None
        lattice = (
            geometry.origin,
            geometry.du,
            geometry.dv,
            geometry.normal,
            wall.foot,
            wall.along,
        )
        key = (geometry.width, geometry.height, wall.radius, *(x.tobytes() for x in lattice))
        if self._known is None or self._known[0] != key:
            v, u = np.mgrid[: geometry.height, : geometry.width]
            pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
            self._known = key, *geometry.touching(pixels)
        return self._known[1:]

    def _place(self, geometry: ViewGeometry, behind: bool) -> None:
        normal, height = geometry.normal, geometry.light_height
        foot = geometry.light - height * normal
        light = geometry.light - self._middle
        size_u = geometry.width * np.linalg.norm(geometry.du)
        size_v = geometry.height * np.linalg.norm(geometry.dv)
        off = geometry.middle - foot
        u, v = geometry.du / np.linalg.norm(geometry.du), geometry.dv / np.linalg.norm(geometry.dv)
        depth = (geometry.light - self._vertices) @ normal
        near = max(0.9 * float(depth.min()), 1e-3 * height)
        far = 1.01 * float(depth.max()) if behind else height - ON_RECEIVER_MM
        camera = self._camera
        camera.SetPosition(*light)
        camera.SetFocalPoint(*(light - height * normal))
        camera.SetViewUp(*-v)
        camera.SetViewAngle(2 * np.degrees(np.arctan(size_v / 2 / height)))
        camera.SetWindowCenter(2 * float(off @ u) / size_u, -2 * float(off @ v) / size_v)
        camera.SetExplicitAspectRatio(size_u / size_v)
        camera.UseExplicitAspectRatioOn()
        camera.SetClippingRange(near, max(far, near * 1.001))

    def _read(self, width: int, height: int) -> Mask:
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        data: Any = vtkUnsignedCharArray()
        self._window.GetPixelData(0, 0, width - 1, height - 1, 0, data, 0)
        pixels = np.frombuffer(data, dtype=np.uint8).reshape(height, width, 3)
        return np.ascontiguousarray(pixels[::-1, :, 0] > 127)

    def close(self) -> None:
        """Give the window's memory back; the renderer is of no use afterwards."""
        self._window.Finalize()
        self._renderer.SetActiveCamera(None)

    def __enter__(self) -> SilhouetteRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
