"""Join the tubes with the mount that the scene asks for, into the piece that is printed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from knotfab.base.arrays import Mask
from knotfab.geometry.tube import Mesh
from knotfab.hold.beams import Stiffness
from knotfab.hold.foot_plate import plan_foot_plate
from knotfab.hold.hang import hang_bodies, plan_hang
from knotfab.hold.mounted import Mounted
from knotfab.hold.solids import stand_bodies
from knotfab.hold.stand import StandSettings, plan_stand
from knotfab.hold.wall import WallMount, plan_wall, wall_bodies
from knotfab.knots import Knots
from knotfab.scene.camera import Camera, CurvedWall
from knotfab.scene.require import require_mount
from knotfab_formats.scene import ResolvedScene, SettledScene

BASE_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # scene to bed


def mount_piece(
    scene: SettledScene,
    knots: Knots,
    tubes: list[Mesh],
    cameras: Sequence[Camera],
    targets: Sequence[Mask] = (),
    *,
    thoroughly: bool = True,
) -> Mounted:
    """Add the scene's mount to the tubes (one per knot, scene coordinates).

    Where the scene leaves it open, several loose knots of one view before a flat wall get a wall
    mount, others none.

    Args:
        cameras: of the views. targets: their pictures' silhouettes (H, W), which a stand and a
            hanger need, and in which struts hide.
        thoroughly: as for `plan_wall`.

    Raises:
        InputError: a wall mount, and several views.
        NotHeldError: a wall mount does not hold it (`plan_wall`).
        SceneError: there is no such mount for this piece.
        ValueError: a stand or a hanger without the silhouettes.
    """
    require_mount(scene)
    scene = _resolve_mount(scene, knots, cameras)
    asked = scene.mount
    if asked.kind == "none":
        return Mounted(tubes, _name_knots(len(tubes)), scene, None, None)
    if asked.kind in ("stand", "hang"):
        if len(targets) != len(cameras):
            raise ValueError("a stand or an eyelet is placed by the silhouettes of all views")
        hold = _on_a_stand if asked.kind == "stand" else _on_a_thread
        return hold(scene, knots, tubes, cameras, targets)
    mount = (
        _stand_on_wall(scene, knots, tubes, cameras[0])
        if asked.on_feet
        else plan_wall(
            knots,
            cameras[0],
            scene.piece.clearance_mm,
            Stiffness.of(scene, knots),
            asked,
            targets[0] if targets else None,
            thoroughly=thoroughly,
        )
    )
    count = [
        sum(peg.knot == k for peg in mount.pegs) + int((mount.strut_knots[:, 0] == k).sum())
        for k in range(len(tubes))
    ]
    if mount.plate is not None:
        count = list(mount.plate.feet)
    bodies = wall_bodies(tubes, mount, cameras[0])
    return Mounted(
        bodies,
        ["piece with wall plate"] if asked.foot == "plate" else _name_knots(len(bodies)),
        scene.but(mount=asked.but(pegs=tuple(count))),
        cameras[0].wall_axes,  # the wall on the bed, its front up
        mount,
    )


def _stand_on_wall(
    scene: SettledScene, knots: Knots, tubes: list[Mesh], camera: Camera
) -> WallMount:
    found = plan_foot_plate(knots, tubes, camera, Stiffness.of(scene, knots), scene.mount)
    sag, at = found.sag_mm, found.sag_at
    hidden = found.hidden_aside
    return WallMount(
        (), sag, at, sag, scene.mount, moves=found.moves, plate=found.plate, hidden_aside=hidden
    )


def _on_a_stand(
    scene: SettledScene,
    knots: Knots,
    tubes: list[Mesh],
    cameras: Sequence[Camera],
    targets: Sequence[Mask],
) -> Mounted:
    asked = scene.mount
    stand = plan_stand(
        knots,
        cameras,
        targets,
        scene.piece.clearance_mm,
        Stiffness.of(scene, knots),
        StandSettings(asked.base_thickness_mm, asked.min_tip_deg, scene.printer.min_tube_radius_mm),
        [wall for view in scene.views if (wall := CurvedWall.of(view)) is not None],
        scene.screen_ends,
    )
    bodies = stand_bodies(tubes, stand)
    count = [int((stand.holds == k).sum()) for k in range(len(tubes))]
    scene = scene.but(mount=asked.but(pegs=tuple(count)))
    return Mounted(bodies, ["piece on its stand"], scene, BASE_DOWN, None, stand)


def _on_a_thread(
    scene: SettledScene,
    knots: Knots,
    tubes: list[Mesh],
    cameras: Sequence[Camera],
    targets: Sequence[Mask],
) -> Mounted:
    hang = plan_hang(
        knots,
        cameras,
        targets,
        scene.piece.clearance_mm,
        Stiffness.of(scene, knots),
        scene.printer.min_tube_radius_mm,
        scene.screen_ends,
    )
    bodies = hang_bodies(tubes, hang)
    count = tuple(int((hang.holds == k).sum()) for k in range(len(tubes)))
    x, y, z = hang.eyelet.thread.tolist()
    scene = scene.but(mount=scene.mount.but(pegs=count, thread_mm=(x, y, z)))
    return Mounted(bodies, ["piece with its eyelet"], scene, None, None, hang=hang)


def _name_knots(count: int) -> list[str]:
    return [f"knot {i + 1}" for i in range(count)]


def _resolve_mount(scene: SettledScene, knots: Knots, cameras: Sequence[Camera]) -> SettledScene:
    """Choose the mount's kind and foot where the scene leaves them open."""
    kind, foot = scene.mount.kind, scene.mount.foot
    if scene.mount.on_feet:
        kind, foot = "wall", "plate"
    if kind == "auto":
        kind = "wall" if scene.hangs(len(knots.knots)) else "none"
    if foot == "auto":
        foot = choose_foot(scene, knots, cameras[0]) if kind == "wall" else "plate"
    sag = scene.mount.max_sag_mm if kind == "none" else Stiffness.of(scene, knots).max_sag_mm
    return scene.but(mount=scene.mount.but(kind=kind, foot=foot, max_sag_mm=sag))


def choose_foot(scene: ResolvedScene, knots: Knots, camera: Camera) -> Literal["plate", "dowel"]:
    """Choose a plate if the printer holds one as large as frame and distance ask for."""
    asked = scene.mount
    across, along = (side + 2 * asked.plate_margin_mm for side in camera.frame_mm)
    wall = camera.receiver
    high = float((knots.points @ wall[:3]).max() + wall[3]) + knots.radius_mm
    width, depth, height = scene.printer.build_volume_mm
    fits = max(across, along) <= max(width, depth) and min(across, along) <= min(width, depth)
    return "plate" if fits and high + asked.thickness_mm <= height else "dowel"
