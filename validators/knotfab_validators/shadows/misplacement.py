"""Measure the loss when lamp, eye, piece or wall are misplaced, and when a part is printed in layers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from knotfab_formats.verdict import Layers, Misplacement, Move, WorstMove
from knotfab_validators.arrays import Array, Ints, Mask, compiled
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.compare import overlap, turn_view
from knotfab_validators.shadows.exact_shadow import Linework, wound_mask
from knotfab_validators.shadows.render import Renderer
from knotfab_validators.shadows.view import ViewGeometry

if TYPE_CHECKING:
    from knotfab_formats.views import Placing, Switches

PARTING_TOLERANCES = 4.0  # in tolerances: a shadow whose parts stay this close has merely moved


@dataclass(frozen=True)
class Likeness:
    """A similarity on the receiver: place + `turn` @ place + `shift`, mm from its pixel (0, 0).

    `left_mm` is the largest residual at the points that it was fitted to.
    """

    turn: Array  # (2, 2): scale and rotation, less the identity
    shift: Array  # (2,)
    left_mm: float

    def move(self, geometry: ViewGeometry) -> ViewGeometry:
        """Return the view whose pixels are those of `geometry`, moved by the similarity."""
        across = np.stack([geometry.du, geometry.dv])
        long = np.linalg.norm(across, axis=1)
        unit = across / long[:, None]
        return replace(
            geometry,
            origin=geometry.origin + self.shift @ unit,
            du=geometry.du + long[0] * self.turn[:, 0] @ unit,
            dv=geometry.dv + long[1] * self.turn[:, 1] @ unit,
        )


def fit_likeness(points: Array, geometry: ViewGeometry, moved: ViewGeometry) -> Likeness:
    """Fit a similarity by least squares to the shadows of points (n, 3) before and after a move.

    Both views have the same pixels on the receiver as seen from the piece.
    """
    size = np.array([np.linalg.norm(geometry.du), np.linalg.norm(geometry.dv)])
    (was, _), (now, _) = geometry.project(points), moved.project(points)
    was, off = was * size, (now - was) * size
    middle, shift = was.mean(axis=0), off.mean(axis=0)
    x, y = was - middle, off - shift
    spread = max(float((x * x).sum()), 1e-12)
    scale = float((x * y).sum()) / spread
    angle = float((x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]).sum()) / spread
    turn = np.array([[scale, -angle], [angle, scale]])
    left = np.linalg.norm(y - x @ turn.T, axis=1)
    return Likeness(turn, shift - turn @ middle, float(left.max()))


def _moved_views(
    middle: Array, geometry: ViewGeometry, placing: Placing, turns: bool
) -> Iterator[tuple[str, str, ViewGeometry]]:
    """Yield each move: its name, its direction, and the resulting view.

    A piece that hangs on the wall (not `turns`) leans with it, as if the light turned the other way.
    """
    axes = {"right": geometry.right, "up": geometry.up, "towards": geometry.axis}
    for way, axis in axes.items() if placing.lamp_mm > 0 else ():
        yield "lamp", way, replace(geometry, light=geometry.light + placing.lamp_mm * axis)
    for way, axis in axes.items() if turns and placing.turn_deg > 0 else ():
        turned = turn_view(geometry, middle, axis, np.radians(placing.turn_deg))
        yield "turn", "axis" if way == "towards" else way, turned
    for way, side in (("right", geometry.du), ("up", geometry.dv)) if placing.tilt_deg > 0 else ():
        axis = side / np.linalg.norm(side)
        turned = turn_view(geometry, geometry.middle, axis, np.radians(placing.tilt_deg))
        one, other = (turned, geometry) if turns else (geometry, turned)
        yield "tilt", way, replace(one, light=other.light)


def parting_px(
    points: Array, middle: Array, geometry: ViewGeometry, placing: Placing, *, turns: bool = True
) -> float:
    """Return how far, px, the worst move takes shadows of points (n, 3) from the nearest similar figure."""
    views = _moved_views(middle, geometry, placing, turns)
    left = [fit_likeness(points, geometry, moved).left_mm for _, _, moved in views]
    return max(left, default=0.0) / geometry.pixel_mm


def simulates_misplacement(effects: Switches, parting: float, tolerance_px: float = 0.25) -> bool:
    """Return whether misplacement is simulated: as the scene asks, else where the shadow visibly distorts."""
    if effects.misplacement is not None:
        return effects.misplacement
    return parting > PARTING_TOLERANCES * tolerance_px


def measure_misplacement(
    renderer: Renderer,
    points: Array,
    middle: Array,
    geometry: ViewGeometry,
    target: Mask,
    placing: Placing,
    *,
    parting: float,
    turns: bool = True,
    within: Mask | None = None,
) -> Misplacement:
    """Measure the IoU after each move of lamp (or eye), piece and wall, as is and fitted.

    As it is, the picture stays where it is on the wall, so that a shadow which merely moves counts
    as lost too. By its likeness the picture is shifted, scaled and turned as the shadow of `points`
    was, which is how a person sees it; the better one of both counts.

    Args:
        renderer: renderer of the part, in the coordinates of `geometry`. points: (n, 3) mm, the
            centre lines.
        middle: (3,) mm, what the piece turns about.
        target: (H, W), the picture's silhouette on the grid of `geometry`.
        turns: whether the piece can turn against the wall, as one that is mounted on it cannot.
        within: (H, W) where shadow counts, for instance not that of a stand below the frame. None:
            everywhere.
        parting: what `parting_px` says.
    """

    def iou(seen: ViewGeometry) -> float:
        shadow = renderer.render(seen)
        return overlap(shadow if within is None else shadow & within, target).iou

    best = iou(geometry)
    ious: dict[str, dict[str, Move]] = {"lamp": {}, "turn": {}, "tilt": {}}
    samples = 1
    for of, way, moved in _moved_views(middle, geometry, placing, turns):
        raw = iou(moved)
        like = fit_likeness(points, geometry, moved).move(moved)
        fitted = max(raw, iou(like))
        ious[of][way] = Move(raw, fitted)
        samples += 2
    each = [
        WorstMove(move.raw, move.fitted, of, way)
        for of, ways in ious.items()
        for way, move in ways.items()
    ]

    tilts = bool(ious["tilt"])
    return Misplacement(
        parting_px=parting,
        lamp_mm=placing.lamp_mm,
        turn_deg=placing.turn_deg,
        iou=best,
        lamp_iou=ious["lamp"],
        worst=min(each, key=lambda move: move.fitted, default=None),
        samples=samples,
        turn_iou=ious["turn"] if turns else None,
        tilt_deg=placing.tilt_deg if tilts else None,
        tilt_iou=ious["tilt"] if tilts else None,
    )


# The shadow of a part as printed: a stack of slices, each as thick as a layer.

BLOCK = 64  # layers processed together
LAYER_TOLERANCES = 2.0  # in tolerances: smaller steps of an outline are ignored


def layer_shift_px(vertices: Array, geometry: ViewGeometry, layer_mm: float) -> float:
    """Measure how far half a layer along z shifts the shadow of any vertex (n, 3) in print pose, px."""
    before = vertices[geometry.project(vertices)[1] < geometry.w_of_receiver]
    if len(before) == 0:
        return 0.0
    step = np.array([0.0, 0.0, 0.5 * layer_mm])
    here = geometry.project(before)[0]
    shifts = [np.linalg.norm(geometry.project(before + s)[0] - here, axis=1) for s in (step, -step)]
    return float(np.max(shifts))


def shows_layers(effects: Switches, shift_px: float, tolerance_px: float = 0.25) -> bool:
    """Return whether to render slices: the scene demands it, or their steps exceed the threshold."""
    if effects.layers is not None:
        return effects.layers
    return shift_px > LAYER_TOLERANCES * tolerance_px


@compiled
def _cut_contours(
    vertices: Array, faces: Ints, first: Ints, begin: int, stop: int, layer_mm: float
) -> tuple[Array, Array, Ints]:
    """Cut faces into slices: edges (k, 3) from and to, matter at their left, and layers (k,).

    A slice is cut in the middle of its layer. On a face that turns anticlockwise about its outward
    normal, the cut runs from the side that leads down through it to the one that leads up. Both
    faces at a side cut it at the same point, to the last bit.

    Args:
        first: for each vertex the lowest layer whose middle is not below it. begin, stop: the range of
            layers.
    """
    low, high = np.empty(len(faces), dtype=np.int64), np.empty(len(faces), dtype=np.int64)
    count = 0
    for k in range(len(faces)):
        a, b, c = first[faces[k, 0]], first[faces[k, 1]], first[faces[k, 2]]
        low[k], high[k] = max(min(a, b, c), begin), min(max(a, b, c), stop)
        count += max(high[k] - low[k], 0)
    start, end = np.zeros((count, 3)), np.zeros((count, 3))
    number = np.empty(count, dtype=np.int64)
    cuts = 0
    for k in range(len(faces)):
        for layer in range(low[k], high[k]):
            number[cuts], height = layer, (layer + 0.5) * layer_mm
            for side in range(3):
                here, ahead = faces[k, side], faces[k, (side + 1) % 3]
                upward = first[ahead] > layer
                if (first[here] > layer) == upward:
                    continue
                one, other = vertices[min(here, ahead)], vertices[max(here, ahead)]
                share = (height - one[2]) / (other[2] - one[2])
                cut = end if upward else start
                cut[cuts, 0] = (1 - share) * one[0] + share * other[0]
                cut[cuts, 1] = (1 - share) * one[1] + share * other[1]
                cut[cuts, 2] = height
            cuts += 1
    return start, end, number


def layered_mask(mesh: Mesh, geometry: ViewGeometry, layer_mm: float) -> Mask:
    """Draw the shadow of a closed mesh's slices, each half a layer thick either way.

    A ray that meets a slice enters by that of its faces which is turned to the light, or by a wall
    that is. The sum of all of these, each turned to positive area in the picture, is not zero
    exactly there; the boundary of a face is its contour. Slices that reach the receiver, or lie
    behind it, throw no shadow.

    Args:
        mesh: in print pose, z up. geometry: the view in the same coordinates.
    """
    # the slices at and above each vertex: slices lie half a layer above whole layers
    first = np.ceil(mesh.vertices[:, 2] / layer_mm - 0.5).astype(np.int64)
    vertices, faces = np.ascontiguousarray(mesh.vertices), np.ascontiguousarray(mesh.faces)
    slices = (
        _cut_contours(vertices, faces, first, begin, begin + BLOCK, layer_mm)
        for begin in range(int(first.min()), int(first.max()), BLOCK)
    )
    lines = (_slice_lines(*found, geometry, layer_mm) for found in slices)
    return wound_mask(lines, geometry.width, geometry.height)


def _slice_lines(
    start: Array, end: Array, layer: Ints, geometry: ViewGeometry, layer_mm: float
) -> Linework:
    """Return the projected boundaries of those sides of the slices that rays enter."""
    # the direction to the face turned to the light
    half = np.where(geometry.light[2] > start[:, 2:], 0.5, -0.5) * [0.0, 0.0, layer_mm]
    number = layer - layer.min(initial=0)
    (a, nearer), (b, _) = geometry.project(start + half), geometry.project(end + half)
    _, farther = geometry.project(start - half)
    behind = np.maximum(nearer, farther) >= geometry.w_of_receiver
    kept = ~(np.bincount(number, behind) > 0)[number] if len(number) else behind
    along = end - start
    to_light = geometry.light - start
    turned = kept & (along[:, 1] * to_light[:, 0] - along[:, 0] * to_light[:, 1] > 0)
    c, d = (geometry.project((x - half)[turned])[0] for x in (end, start))
    p, q = a[turned], b[turned]
    a, b, number = a[kept], b[kept], number[kept]
    face = np.where(np.bincount(number, _cross(a, b)) < 0, -1, 1)[number]
    wall = np.where(_cross(q - p, c - p) + _cross(c - p, d - p) < 0, -1, 1)
    return Linework(
        np.concatenate([a, p, q, c, d]),
        np.concatenate([b, q, c, d, p]),
        np.concatenate([face, wall, wall, wall, wall]),
    )


def _cross(a: Array, b: Array) -> Array:
    """Return the cross products (n,) of vectors (n, 2)."""
    result: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return result


def measure_layers(
    mesh: Mesh,
    geometry: ViewGeometry,
    layer_mm: float,
    target: Mask,
    smooth: Mask,
    shift_px: float,
    within: Mask | None = None,
) -> Layers:
    """Measure how a printed part's steps change its shadow, on the pixels of `target` (H, W).

    Args:
        shift_px: shift of `layer_shift_px`.
        smooth: (H, W) the shadow of the mesh itself.
        within: (H, W) where shadow counts, if the wall ends; None: everywhere.
    """
    layers = int(np.ceil(np.ptp(mesh.vertices[:, 2]) / layer_mm))
    shadow = layered_mask(mesh, geometry, layer_mm)
    return Layers(
        layer_mm=layer_mm,
        shift_px=shift_px,
        iou=overlap(shadow if within is None else shadow & within, target).iou,
        iou_smooth=overlap(smooth, target).iou,
        samples=layers,
    )
