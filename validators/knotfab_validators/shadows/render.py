"""Render silhouettes of a mesh off-screen with VTK, by a camera at the light."""

from __future__ import annotations

import ctypes
import ctypes.util
import importlib
import os
import sys
from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from knotfab_formats.libraries import took_part
from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.shadows.view import ON_RECEIVER_MM, ViewGeometry

# Draw silhouettes of a mesh for each place of the light.


class Renderer(ABC):
    """Renders one mesh in many views: a pixel is dark if the ray through its centre meets the mesh.

    Args:
        vertices: (n, 3) mm, of the mesh.
    """

    def __init__(self, vertices: Array) -> None:
        self._vertices = np.asarray(vertices, dtype=np.float64)

    @abstractmethod
    def render(self, geometry: ViewGeometry) -> Mask:
        """Render the silhouette (height, width) on the pixels of `geometry`, in the mesh's coordinates.

        Matter on or behind the receiver plane is clipped.
        """


REMEDY = "Install it: apt-get install libegl1 libgl1"
EGL_PLATFORM_DEVICE = 0x313F


class CannotRender(RuntimeError):
    """This machine cannot render off-screen; `reason` says why, `remedy` what to do about it."""

    def __init__(self, reason: str, remedy: str = REMEDY) -> None:
        self.reason, self.remedy = reason, remedy
        super().__init__(f"{reason}. {remedy}")


def why_no_rendering() -> str | None:
    """Say why VTK could not render here, or None if it can; loads nothing of VTK.

    VTK ends the process with a segmentation fault where OpenGL is missing, so the question is put
    to the system's EGL itself: it must have a display (a device, or the default one) that starts.
    `KNOTFAB_NO_RENDERING=1` in the environment answers for it.
    """
    if os.environ.get("KNOTFAB_NO_RENDERING", "0") not in ("", "0"):
        return "rendering is switched off by KNOTFAB_NO_RENDERING"
    if not sys.platform.startswith("linux"):
        return None  # the window system's own OpenGL belongs to the system
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


# VTK's own modules: pyvista, which wraps them, loads half a CPU second of what is not used here.


def open_window() -> tuple[Any, Any]:
    """Open a window off-screen, without anti-aliasing; return it with its black scene (vtkRenderer)."""
    if sys.platform.startswith("linux"):
        # use no X server, and look for none
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    vtk: Any = importlib.import_module("vtkmodules.vtkRenderingCore")
    importlib.import_module("vtkmodules.vtkRenderingOpenGL2")  # without it windows draw nothing
    window, scene = vtk.vtkRenderWindow(), vtk.vtkRenderer()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)
    window.AddRenderer(scene)
    return window, scene


def build_surface(points: NDArray[np.floating[Any]], faces: NDArray[np.integer[Any]]) -> Any:
    """Build VTK's surface (vtkPolyData) of points (n, 3) and faces (m, 3)."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    vtk: Any = numpy_support
    places, polygons, surface = vtkPoints(), vtkCellArray(), vtkPolyData()
    places.SetData(vtk.numpy_to_vtk(np.ascontiguousarray(points), deep=True))
    corners = np.ascontiguousarray(faces, dtype=np.int64).ravel()
    polygons.SetData(3, vtk.numpy_to_vtkIdTypeArray(corners, deep=True))
    surface.SetPoints(places)
    surface.SetPolys(polygons)
    return surface


def add_surface(scene: Any, surface: Any) -> Any:
    """Add a surface to a scene, in white; return how it looks (vtkProperty)."""
    from vtkmodules import vtkRenderingCore

    vtk: Any = vtkRenderingCore
    mapper, actor = vtk.vtkPolyDataMapper(), vtk.vtkActor()
    mapper.SetInputData(surface)
    actor.SetMapper(mapper)
    scene.AddActor(actor)
    return actor.GetProperty()


def read_window(window: Any, kind: str) -> NDArray[Any]:
    """Read what a window drew last: "RGB", "RGBA" or "ZBuffer", (height, width, channels)."""
    from vtkmodules.util import numpy_support
    from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter

    to_numpy: Any = numpy_support.vtk_to_numpy
    read = vtkWindowToImageFilter()
    read.SetInput(window)
    read.ShouldRerenderOff()
    read.ReadFrontBufferOff()
    getattr(read, f"SetInputBufferTypeTo{kind}")()
    read.Update()
    image = read.GetOutput()
    wide, high, _ = image.GetDimensions()
    found: NDArray[Any] = to_numpy(image.GetPointData().GetScalars())
    return found.reshape(high, wide, -1)[::-1]


class SilhouetteRenderer(Renderer):
    """Renders one mesh in one off-screen window, in as many views as needed.

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
        took_part("vtk", "rendered the shadow of the final mesh")
        super().__init__(vertices)
        # the card computes in single precision: keep its numbers small
        self._middle = (self._vertices.min(axis=0) + self._vertices.max(axis=0)) / 2
        window, scene = open_window()
        points = (self._vertices - self._middle).astype(np.float32)
        add_surface(scene, build_surface(points, faces)).LightingOff()
        self._window, self._camera = window, scene.GetActiveCamera()

    def render(self, geometry: ViewGeometry) -> Mask:
        """Render by a camera at the light that looks straight at the receiver plane, whatever its tilt.

        Its frustum is shifted and shaped to the frame.
        """
        self._aim(geometry)
        self._window.SetSize(geometry.width, geometry.height)
        self._window.Render()
        seen = read_window(self._window, "RGB")
        return np.ascontiguousarray(seen[..., 0] > 127)

    def _aim(self, geometry: ViewGeometry) -> None:
        normal, height = geometry.normal, geometry.light_height
        foot = geometry.light - height * normal
        light = geometry.light - self._middle
        size_u = geometry.width * np.linalg.norm(geometry.du)
        size_v = geometry.height * np.linalg.norm(geometry.dv)
        off = geometry.middle - foot
        u, v = geometry.du / np.linalg.norm(geometry.du), geometry.dv / np.linalg.norm(geometry.dv)
        depth = (geometry.light - self._vertices) @ normal
        near = max(0.9 * float(depth.min()), 1e-3 * height)
        camera = self._camera
        camera.SetPosition(*light)
        camera.SetFocalPoint(*(light - height * normal))
        camera.SetViewUp(*-v)
        camera.SetViewAngle(2 * np.degrees(np.arctan(size_v / 2 / height)))
        camera.SetWindowCenter(2 * float(off @ u) / size_u, -2 * float(off @ v) / size_v)
        camera.SetExplicitAspectRatio(size_u / size_v)
        camera.UseExplicitAspectRatioOn()
        camera.SetClippingRange(near, max(height - ON_RECEIVER_MM, near * 1.001))

    def close(self) -> None:
        """Free the window's memory; the renderer cannot be used afterwards."""
        self._window.Finalize()

    def __enter__(self) -> SilhouetteRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
