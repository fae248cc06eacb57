"""Render silhouettes of a mesh off-screen with pyvista, by a camera at the light."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import sys
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

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
        if sys.platform.startswith("linux"):
            # use no X server, and look for none
            os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        import pyvista as untyped

        took_part("pyvista", "rendered the shadow of the final mesh")
        pyvista: Any = untyped
        super().__init__(vertices)
        # the card computes in single precision: keep its numbers small
        self._middle = (self._vertices.min(axis=0) + self._vertices.max(axis=0)) / 2
        points = (self._vertices - self._middle).astype(np.float32)
        surface = pyvista.PolyData.from_regular_faces(points, faces)
        self._plotter = pyvista.Plotter(off_screen=True, lighting="none")
        self._plotter.disable_anti_aliasing()
        self._plotter.set_background("black")
        self._plotter.add_mesh(surface, color="white", lighting=False, reset_camera=False)

    def render(self, geometry: ViewGeometry) -> Mask:
        """Render by a camera at the light that looks straight at the receiver plane, whatever its tilt.

        Its frustum is shifted and shaped to the frame.
        """
        self._aim(geometry)
        self._plotter.window_size = geometry.width, geometry.height
        return np.ascontiguousarray(self._plotter.screenshot(return_img=True)[..., 0] > 127)

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
        camera = self._plotter.camera
        camera.position = light
        camera.focal_point = light - height * normal
        camera.up = -v
        camera.view_angle = 2 * np.degrees(np.arctan(size_v / 2 / height))
        camera.SetWindowCenter(2 * float(off @ u) / size_u, -2 * float(off @ v) / size_v)
        camera.SetExplicitAspectRatio(size_u / size_v)
        camera.UseExplicitAspectRatioOn()
        camera.clipping_range = near, max(height - ON_RECEIVER_MM, near * 1.001)

    def close(self) -> None:
        """Free the window's memory; the renderer cannot be used afterwards."""
        self._plotter.close()

    def __enter__(self) -> SilhouetteRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
