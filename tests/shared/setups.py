"""Small pieces on each mount, put together by hand: what the drawings are tested with."""

from typing import Literal

import numpy as np

from knotfab.geometry.tube import sweep
from knotfab.hold.mount import Mounted
from knotfab.hold.plinth import Base, slope_below
from knotfab.hold.stand import StandMount
from knotfab.hold.struts import no_members
from knotfab.hold.wall import Peg, WallMount
from knotfab.scene.camera import Camera, camera_of
from knotfab_formats.piece import Mount
from knotfab_formats.scene import ResolvedView, Scene
from knotfab_formats.verdict import Misplacement

Kind = Literal["none", "plate", "dowel", "stand"]
OFF = Misplacement(
    parting_px=2.0,
    lamp_mm=5.0,
    turn_deg=1.0,
    iou=0.99,
    lamp_iou={},
    worst=None,
    samples=7,
    lamp_iou_per_mm={"right": 0.0142, "up": 0.0087, "towards": 0.0001},
    turn_iou_per_deg={"right": 0.5, "up": 0.25, "axis": 0.04},
)


def setup(kind: Kind, margin_mm: float = 8.0, **view: float) -> tuple[Mounted, Scene, Camera]:
    """A ring of 100 mm on a mount of its kind, its frame 160 x 120 mm."""
    keys = {"frame_width_mm": 160.0, "frame_height_mm": 120.0, **view}
    seen = ResolvedView(**keys)  # type: ignore[arg-type]
    camera = camera_of(seen, 80, 60)
    t = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = np.stack([50 * np.cos(t), 50 * np.sin(t), 5 * np.sin(2 * t)], axis=1)
    bodies = [sweep(ring, 2.0, 12)]
    mount = Mount(kind="wall" if kind in ("plate", "dowel") else kind)
    scene = Scene(views=(seen,), mount=mount)
    if kind == "none":
        return Mounted(bodies, ["knot 1"], scene, None, None), scene, camera
    if kind == "stand":
        base = Base(slope_below([camera]), -30.0, 32.0, -20.0, 25.0, -75.0, 9.0, 20.0, 15.0)
        none = np.empty(0, dtype=np.int64)
        stand = StandMount(no_members(), none, base, 0.1, np.zeros(3), 0.1, np.zeros(1))
        return Mounted(bodies, ["piece"], scene, None, None, stand), scene, camera
    normal = camera.receiver[:3]
    pegs = []
    for number, angle in enumerate((0.3, 2.0, 4.5)):
        top = np.array([50 * np.cos(angle), 50 * np.sin(angle), 0.0])
        ray = top - camera.eye
        reach = -float(camera.receiver @ np.append(top, 1.0)) / float(normal @ ray)
        pegs.append(Peg(0, top, top + reach * ray, 1.0, 1.2 + 0.1 * number, 1.6))
    settings = Mount(foot=kind, plate_margin_mm=margin_mm)
    wall = WallMount(tuple(pegs), 0.1, np.zeros(3), 0.1, settings)
    return Mounted(bodies, ["piece"], scene, np.eye(3), wall), scene, camera
