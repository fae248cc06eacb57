"""The soft silhouette of capsules and its squared error, by compiled loops, with gradients in closed form.

`render.device` has the same for tensors, on any device; tests hold it against the torch form
(`device.render_torch`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from knotfab.base.arrays import Array, Mask, Real
from knotfab.base.compiled import compiled
from knotfab.geometry.polylines import Polylines
from knotfab.render.kernels import Places, are_within, evaluate, find_winners
from knotfab.scene.camera import Camera

# The view of one light: points become (x, y, depth) in the receiver's own axes.


Number: TypeAlias = Any  # a float, or a tensor [] where it has a gradient


def number(value: Number) -> float:
    """Return the value as a float, without its gradient."""
    return float(value if isinstance(value, float | int) else value.detach())


@compiled
def _turn_to(points: Real, axes: Real, eye: Real) -> Real:
    """Return points relative to `eye` in these axes (3, 3), (n, 3), rounded as `Frame.local` explains."""
    out = np.empty_like(points)
    for n in range(len(points)):
        x, y, z = points[n, 0] - eye[0], points[n, 1] - eye[1], points[n, 2] - eye[2]
        for k in range(3):
            out[n, k] = x * axes[k, 0] + y * axes[k, 1] + z * axes[k, 2]
    return out


@dataclass(frozen=True)
class Frame:
    """A pinhole whose axes are those of its receiver plane: x right, y down, z away from the light.

    A pixel (u, v) has the ray direction ((u + u0) * step, (v + v0) * step, 1); `focal_px` turns
    a length at depth 1 into pixels. Pixels are square. A frame of arrays takes arrays of points,
    one of tensors (`render.capsules.tensor_frame`) takes tensors; only there may the numbers be
    tensors [] with a gradient, where the view itself is an unknown.
    """

    axes: Any  # (3, 3) rows x, y, z
    eye: Any  # (3,)
    u0: Number
    v0: Number
    step: Number
    width: int
    height: int

    @property
    def focal_px(self) -> Number:
        """Pixels per unit of x/z."""
        return 1.0 / self.step

    def local(self, points: Any) -> Any:
        """Map (..., 3) scene mm -> (..., 3) receiver axes, mm from the light."""
        if isinstance(points, np.ndarray) and points.ndim == 2 and points.dtype == self.axes.dtype:
            return _turn_to(points, self.axes, self.eye)
        away = points - self.eye
        x, y, z = (away[..., k : k + 1] for k in range(3))
        across, along, deep = self.axes.T
        # no product of matrices: every library rounds that in its own way
        return x * across + y * along + z * deep

    def pixels(self, local: Any) -> Any:
        """Map (..., 3) receiver axes -> (..., 2) pixel coordinates."""
        uv = local[..., :2] / local[..., 2:] * self.focal_px
        corner = [number(self.u0), number(self.v0)]
        if isinstance(uv, np.ndarray):
            return uv - np.array(corner, dtype=uv.dtype)
        return uv - uv.new_tensor(corner)

    def arrays(self) -> Frame:
        """Return the same view with arrays and floats, without gradients."""
        if isinstance(self.axes, np.ndarray):
            return self
        axes, eye = (x.detach().cpu().numpy() for x in (self.axes, self.eye))
        u0, v0, step = (number(n) for n in (self.u0, self.v0, self.step))
        return Frame(axes, eye, u0, v0, step, self.width, self.height)


@dataclass(frozen=True)
class Sheet:
    """The fixed part of a view: the raster on the receiver, and the receiver's tilt."""

    width: int
    height: int
    pixel_mm: float  # the side of the (square) pixels, on the receiver
    wall_tilt_deg: float = 0.0


def frame_of(
    camera: Camera, dtype: type[np.floating[Any]] = np.float64, *, stretched: bool = False
) -> Frame:
    """Return the frame, of arrays, of a camera with square pixels.

    Args:
        stretched: whether to stretch the axis that points down until pixels that are not quite square are so.
            Points then keep their pixels; a tube is distorted as the pixels were.

    Raises:
        ValueError: the camera's pixels are not square (to a part in a million), and not `stretched`.
    """
    pitch, pitch_v = np.linalg.norm(camera.du), np.linalg.norm(camera.dv)
    square = abs(pitch / pitch_v - 1) <= 1e-6
    if not (square or stretched):
        raise ValueError(f"pixels must be square, got {pitch} x {pitch_v} mm")
    right, down = camera.du / pitch, camera.dv / pitch_v
    axes = np.stack([right, down, np.cross(right, down)])
    if not square:
        axes[1] *= pitch / pitch_v
    corner = axes @ (camera.corner - camera.eye)
    distance = float(corner[2])
    return Frame(
        axes.astype(dtype),
        np.asarray(camera.eye, dtype=dtype),
        float(corner[0] / pitch),
        float(corner[1] / pitch),
        float(pitch / distance),
        camera.width,
        camera.height,
    )


CUTOFF = 40.0  # pixels with tau * s below minus this are empty: sigmoid(-40) is 4e-18
NEAREST_RADII = 2.5  # centre lines are cut at this depth before the light's plane, in tube radii
_LEAST_MM = 1e-9

Winners = tuple[Places, Places]  # flat indices of pixels, and the capsule that colours each


@dataclass(frozen=True)
class _Cut:
    """Segments a-b (n, 3) in receiver axes, cut before the light's plane; `seen`: which have a part left.

    `ends`: the segments before the cut; `near` (2, n): which end of each was cut; None if none was.
    `swapped`: which had their ends swapped; None if none had.
    """

    a: Real
    b: Real
    seen: NDArray[np.bool_]
    ends: tuple[Real, Real] | None = None
    near: NDArray[np.bool_] | None = None
    swapped: NDArray[np.bool_] | None = None

    def pull(self, slopes: Array, least: float) -> tuple[Array, Array]:
        """Convert a gradient (n, 6) in a and b into gradients (n, 3) in the original ends."""
        one, two = slopes[:, :3], slopes[:, 3:]
        if self.swapped is not None:
            other = self.swapped[:, None]
            one, two = np.where(other, two, one), np.where(other, one, two)
        if self.ends is None or self.near is None:
            return one, two
        a, b = (end.astype(np.float64) for end in self.ends)
        change = np.where(self.near.any(axis=0), (b - a)[:, 2], 1.0)
        t = (least - a[:, 2]) / change
        found = [one.copy(), two.copy()]
        for end, slope in enumerate((one, two)):
            # a cut end lies at (1 - t) a + t b, whose depth is known
            here = self.near[end]
            aside = slope[:, :2]
            along = (aside * (b - a)[:, :2]).sum(axis=1) / change
            to_a = np.column_stack([(1.0 - t)[:, None] * aside, (t - 1.0) * along])
            to_b = np.column_stack([t[:, None] * aside, -t * along])
            found[end][here] = 0.0
            found[0][here] += to_a[here]
            found[1][here] += to_b[here]
        return found[0], found[1]


@np.errstate(all="ignore")  # NaN is left out by comparisons
def _place_segments(starts: Real, ends: Real, frame: Frame, radius: float) -> _Cut:
    """Place segments in receiver axes, cut as `render.capsules.cut_before_light` does it, which says why."""
    a, b = frame.local(starts), frame.local(ends)
    least = least_depth(radius)
    low = min(a[:, 2].min(initial=np.inf), b[:, 2].min(initial=np.inf))
    high = max(a[:, 2].max(initial=-np.inf), b[:, 2].max(initial=-np.inf))
    if low >= least and high <= 2 * low:
        return _Cut(a, b, np.ones(len(a), dtype=bool))
    near_a, near_b = a[:, 2] < least, b[:, 2] < least
    seen = ~(near_a & near_b)
    before: tuple[Real, Real] | None = None
    near: NDArray[np.bool_] | None = None
    if (near_a | near_b).any():
        before, crossing = (a, b), near_a ^ near_b
        t = (a.dtype.type(least) - a[:, 2]) / np.where(crossing, b[:, 2] - a[:, 2], 1)
        at = np.empty_like(a)
        at[:, :2] = a[:, :2] + t[:, None] * (b - a)[:, :2]
        # its depth is known: interpolated, it would be off by a rounding of a far end's
        at[:, 2] = least
        near = np.stack([near_a & crossing, near_b & crossing])
        a, b = (np.where(n[:, None], at, p) for n, p in zip(near, (a, b), strict=True))
    uneven = (b[:, 2] < 0.5 * a[:, 2]) | (a[:, 2] < 0.5 * b[:, 2])
    # across and along count alike: an end near the light may lie far to the side
    size_a, size_b = (np.abs(p[:, :2]).max(axis=1) * p[:, 2] for p in (a, b))
    swapped = seen & uneven & (size_b < size_a)
    if not swapped.any():
        return _Cut(a, b, seen, before, near)
    other = swapped[:, None]
    return _Cut(np.where(other, b, a), np.where(other, a, b), seen, before, near, swapped)


def least_depth(radius: float) -> float:
    """Return the least depth that casts a shadow, mm; anything nearer to the light's plane is cut away."""
    return max(NEAREST_RADII * radius, _LEAST_MM)


def winners(
    starts: Real,  # (n, 3) scene mm
    ends: Real,  # (n, 3)
    frame: Frame,
    radius: float,
    reach_px: float,
) -> Winners:
    """Return (pixel, capsule): flat indices of pixels with s > -reach_px, and the capsule of largest s."""
    return _find_winners(_place_segments(starts, ends, frame, radius), frame, radius, reach_px)


def cast(starts: Array, ends: Array, frame: Frame, radius: float) -> Mask:
    """Return the hard shadow: pixels whose rays meet a capsule of `radius` mm, (height, width).

    Args:
        starts, ends: (n, 3) mm in the scene.
    """
    dark = np.zeros(frame.height * frame.width, dtype=bool)
    dtype = frame.axes.dtype
    dark[winners(starts.astype(dtype), ends.astype(dtype), frame, radius, 0.0)[0]] = True
    return dark.reshape(frame.height, frame.width)


def _find_winners(cut: _Cut, frame: Frame, radius: float, reach_px: float) -> Winners:
    size = (frame.width, frame.height)
    return find_winners(cut.a, cut.b, cut.seen, _numbers(frame, radius), *size, reach_px)


def render(
    starts: Real,  # (n, 3) scene mm
    ends: Real,  # (n, 3)
    frame: Frame,
    radius: float,
    tau: float,
    cutoff: float = CUTOFF,
    won: Winners | None = None,
) -> Real:
    """Render the image (height, width) of sigmoid(tau * max over capsules of the signed distance in px).

    It is exact up to sigmoid(-cutoff). `won` takes the winners of an earlier call: a
    lower bound of the image, exact for small motions wherever the winner did not change.
    """
    image = Capsules.render(starts, ends, frame, radius, tau, cutoff, won).image()
    return image.reshape(frame.height, frame.width)


def squared_error(
    starts: Real,
    ends: Real,
    frame: Frame,
    radius: float,
    tau: float,
    target: Real,  # (height, width)
    cutoff: float = CUTOFF,
    won: Winners | None = None,
) -> tuple[float, Array, Array]:
    """Return the squared difference of `render` and the target, summed over the pixels.

    Returns:
        The sum, and its gradients (n, 3) in `starts` and `ends`.
    """
    # (g - f)^2 is g^2 - 2 g f where a pixel is coloured, and f^2 everywhere
    field = np.ascontiguousarray(target).ravel()
    seen = Capsules.render(starts, ends, frame, radius, tau, cutoff, won)
    total, one, two = seen.evaluate(field, 2.0, -2.0)
    return total + float(field @ field), one, two


def _numbers(frame: Frame, radius: float) -> Array:
    """Return the numbers that the kernels take: u0, v0, step, radius."""
    return np.array([number(frame.u0), number(frame.v0), number(frame.step), radius])


@dataclass(frozen=True)
class Capsules:
    """Rendered capsules: segments in receiver axes, each pixel's winner, radius and sharpness."""

    cut: _Cut
    won: Winners
    frame: Frame
    radius: float
    tau: float

    @classmethod
    def render(
        cls,
        starts: Real,
        ends: Real,
        frame: Frame,
        radius: float,
        tau: float,
        cutoff: float = CUTOFF,
        won: Winners | None = None,
    ) -> Capsules:
        """Render segments (n, 3) to (n, 3) of the scene.

        Raises:
            IndexError: the winners belong to other segments, or to another frame.
        """
        cut = _place_segments(starts, ends, frame, radius)
        if won is None:
            won = _find_winners(cut, frame, radius, cutoff / tau)
        # the kernels look up what they are told to
        for found, count in zip(won, (frame.width * frame.height, len(starts)), strict=True):
            if not are_within(found, count) or len(found) != len(won[0]):
                span = f"{found.min()} to {found.max()}" if len(found) else "none"
                raise IndexError(f"winners of another scene: {span} of {count}")
        return cls(cut, won, frame, radius, tau)

    def image(self) -> Real:
        """Return the silhouette, (height * width,)."""
        image = np.zeros(self.frame.width * self.frame.height, self.cut.a.dtype)
        self._evaluate(image, 0.0, 0.0, image)
        return image

    def evaluate(self, field: Real, own: float, other: float) -> tuple[float, Array, Array]:
        """Return the sum of `kernels.evaluate`, and its gradients (n, 3) in starts and ends, in the scene."""
        total, slopes = self._evaluate(field, own, other, np.empty(0, self.cut.a.dtype))
        one, two = self.cut.pull(slopes, least_depth(self.radius))
        axes = self.frame.axes.astype(np.float64)
        return total, one @ axes, two @ axes

    def _evaluate(self, field: Real, own: float, other: float, image: Real) -> tuple[float, Array]:
        a, b = (np.ascontiguousarray(p) for p in (self.cut.a, self.cut.b))
        slopes = np.zeros((len(a), 6))
        numbers = _numbers(self.frame, self.radius)
        places = (*self.won, numbers, self.frame.width, self.tau)
        return evaluate(a, b, *places, field, own, other, slopes, image), slopes


class DrawnImage(Protocol):
    """A view's picture drawn by something other than the compiled loops; arrays in, arrays out."""

    def from_frame(self, frame: Frame) -> DrawnImage:
        """Return the same picture, seen from another frame."""

    def squared_error(
        self, points: Real, rings: Polylines, radius: float, tau: float, cutoff: float, won: Any
    ) -> tuple[float, Array]:
        """Return the squared difference of tube and picture, and its gradient in the vertices (N, 3)."""

    def find_winners(self, points: Real, rings: Polylines, radius: float, reach_px: float) -> Any:
        """Find the capsule that colours each pixel, for calls of `squared_error` after small motions."""

    def render(
        self, points: Real, rings: Polylines, radius: float, tau: float, cutoff: float
    ) -> Real:
        """Render the image (H, W) of the tube about vertices (N, 3)."""
