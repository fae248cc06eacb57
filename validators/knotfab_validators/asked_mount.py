"""What a scene asks of its mount, as solids in the part's coordinates."""

from __future__ import annotations

import numpy as np

from knotfab_formats.piece import Mount
from knotfab_validators.arrays import Array
from knotfab_validators.files.scene import Scene
from knotfab_validators.shadows.view import ViewGeometry, view_geometry
from knotfab_validators.tube.mount_members import Asked
from knotfab_validators.tube.solid_matter import (
    HalfSpaces,
    Hole,
    Solid,
    hull_of,
    prism,
    round_outline,
)

THINNEST = 0.7  # least thickness of a sloping base at its thinnest, as a share of its nominal one
# depth of the notches in a plate's edges, and of the arrow in its face
MARK_MM, ARROW_MM = 1.5, 0.6


def asked_of_mount(scene: Scene) -> Asked | str:
    """Return what the scene requires of its mount, in the part's coordinates, or why that is unknown."""
    mount, back = scene.mount, None
    if scene.pose is not None:
        back = np.linalg.inv(np.array(scene.pose.matrix, dtype=np.float64))
    if mount.on_feet:
        frame = np.empty((0, 3))
        if mount.plate == "full" and back is not None and scene.views[0].frame_width_mm is not None:
            seen = view_geometry(scene.views[0], 2, 2)
            ends = [seen.middle + a * seen.du + b * seen.dv for a in (-1, 1) for b in (-1, 1)]
            frame = np.array(ends) @ back[:3, :3].T + back[:3, 3]
        size = mount.hole_diameter_mm, mount.thickness_mm
        return Asked(on_feet=True, frame=frame, plate_mm=size, taped=mount.plate == "roots")
    if mount.kind == "stand":
        return Asked(mount.pegs, hulls=("base", THINNEST * mount.base_thickness_mm))
    if mount.kind == "wall" and mount.foot == "dowel":
        return Asked(mount.pegs, hulls=("dowel", mount.dowel_depth_mm))
    if back is None:
        return "the scene has no pose, so that nothing says where its mount is"
    if mount.kind == "hang":
        if mount.thread_mm is None:
            return "the scene does not say where the thread is"
        return Asked(mount.pegs, threads=threads_of(mount, back))
    view = scene.views[0]
    if view.frame_width_mm is None or view.frame_height_mm is None:
        return "the scene does not say how large its frame is, which its plate follows"
    plate, holes = _plate_of(mount, view_geometry(view, 2, 2), back)
    return Asked(mount.pegs, solids=(plate,), holes=holes)


def threads_of(mount: Mount, back: Array) -> Array:
    """Return where threads carry a hung piece (1 or 2, 3); `back` (4, 4) leads from scene to part."""
    places = [place for place in (mount.thread_mm, mount.second_thread_mm) if place is not None]
    return np.asarray(np.array(places) @ back[:3, :3].T + back[:3, 3])


def _plate_of(mount: Mount, view: ViewGeometry, back: Array) -> tuple[Solid, tuple[Hole, ...]]:
    """Return the wall plate with its openings (screw holes, notches, an arrow in its face), and the holes.

    Its face lies on the wall, and is a margin wider than the frame on every side (docs/contract.md).
    """
    margin, thick = mount.plate_margin_mm, mount.thickness_mm
    x, y = (float(np.linalg.norm(2 * step)) / 2 + margin for step in (view.du, view.dv))
    right = view.du / np.linalg.norm(view.du)
    turn = np.column_stack([right, np.cross(view.normal, right), view.normal])
    motion = np.column_stack([back[:3, :3] @ turn, back[:3, :3] @ view.middle + back[:3, 3]])
    hole, inset = mount.hole_diameter_mm / 2, margin / 2 + mount.hole_diameter_mm / 4
    deep = min(MARK_MM, margin / 5, (inset - hole) / 2)
    deep = deep if deep >= 0.5 else 0.0

    def hull(outline: Array, low: float = -thick - 1.0, high: float = 1.0) -> HalfSpaces:
        return hull_of(prism(outline, low, high, motion))

    middles = [(side * (x - inset), 0.0) for side in (-1, 1)]
    openings = [hull(round_outline(middle, hole)) for middle in middles]
    if deep:
        w = 2 * deep
        notches = [
            [(-w, s * (y + deep)), (w, s * (y + deep)), (0.0, s * (y - deep))] for s in (-1, 1)
        ]
        notches += [
            [(s * (x + deep), -w), (s * (x + deep), w), (s * (x - deep), 0.0)] for s in (-1, 1)
        ]
        openings += [hull(np.array(notch)) for notch in notches]
        arrow = np.array([(0.0, y - w), (-w, y - 2 * w), (w, y - 2 * w)])
        openings.append(hull(arrow, -min(ARROW_MM, thick / 4)))
    r = min(6.0, margin, 0.95 * (x - 4 * deep), 0.95 * (y - deep))  # beside arrow and notches
    corners = [
        round_outline((a * (x - r), b * (y - r)), r) if r > 0 else np.array([(a * x, b * y)])
        for a in (-1, 1)
        for b in (-1, 1)
    ]
    outline = np.clip(np.concatenate(corners), [-x, -y], [x, y])
    mouths = np.array([[*middle, 0.0] for middle in middles]) @ motion[:, :3].T + motion[:, 3]
    holes = tuple(Hole(mouth, motion[:, 2], hole, thick) for mouth in mouths)
    return Solid("plate", prism(outline, -thick, 0.0, motion), tuple(openings)), holes
