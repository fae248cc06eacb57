"""What is printed larger, because it shrinks: tubes, centre lines, plates, and the pose back."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from reports import report_with
from rings import knots, ring

from knotfab.geometry.tube import sweep
from knotfab.hold.mount import Mounted
from knotfab.part.assemble import Part, _choose_poses
from knotfab.part.write import pose_scene
from knotfab.report.posing import lay_out
from knotfab.scene.camera import camera_of
from knotfab.scene.catalogue import resolve
from knotfab_formats.piece import Material, Printer
from knotfab_formats.scene import ResolvedView, Scene

VIEW = ResolvedView(frame_width_mm=120.0, frame_height_mm=120.0)
CAMERA = camera_of(VIEW, 60, 60)
MASK = np.ones((60, 60), dtype=bool)


def posed(shrinkage: float, room: float = 250.0) -> Part:
    """Two rings of 30 mm."""
    own = knots(*(ring(30.0, z, 60, wave=0.0) for z in (0.0, 12.0)))
    tubes = [sweep(knot.points, 2.0, 12) for knot in own.knots]
    keys: Any = {
        "views": (VIEW,),
        "material": Material(shrinkage_percent=shrinkage),
        "printer": Printer(build_volume_mm=(room, room, room)),
    }
    scene = resolve(Scene(**keys))
    mounted: Any = Mounted(tubes, ["knot 1", "knot 2"], scene, None, None)
    made: Any = SimpleNamespace(scene=scene, knots=own)
    mounted, pose, plates = _choose_poses(made, mounted, True, [CAMERA], [MASK])
    return Part(list(pose.tubes), pose, mounted, plates)


def test_what_is_printed_is_larger_and_the_pose_takes_it_back() -> None:
    as_is, part = posed(0.0), posed(4.0)
    assert part.pose.knots.radius_mm == pytest.approx(2 / 0.96) and as_is.pose.knots.radius_mm == 2
    assert part.pose.size_mm == pytest.approx(as_is.pose.size_mm / 0.96)
    own = part.pose.knots.moved(part.pose.matrix)
    assert own.radius_mm == pytest.approx(2.0)
    assert own.points == pytest.approx(as_is.pose.knots.moved(as_is.pose.matrix).points, abs=1e-9)
    turn = np.array(pose_scene(part).pose.matrix)[:3, :3]  # type: ignore[union-attr]
    assert turn @ turn.T == pytest.approx(0.96**2 * np.eye(3))
    for vertices, _ in part.bodies:
        back = vertices @ turn.T + part.pose.matrix[:3, 3]
        assert np.hypot(back[:, 0], back[:, 1]).max() == pytest.approx(32.0, abs=0.1)
    found, (note,) = lay_out(report_with().print, part, None)
    assert "4.17 % larger" in note
    assert found.pose is not None and found.pose.shrinkage_percent == 4.0


@pytest.mark.slow
def test_the_printer_must_hold_what_is_printed_plates_too() -> None:
    whole, parted = posed(0.0, 61.0), posed(4.0, 61.0)
    assert whole.plates is None and parted.plates is not None
    (first, motion), *_ = [
        (body, motion)
        for plate in parted.plates.plates
        for body, motion in zip(plate.bodies, plate.to_part, strict=True)
    ]
    assert motion[:3, :3] @ motion[:3, :3].T == pytest.approx(np.eye(3), abs=1e-9)
    laid = first[0] @ motion[:3, :3].T + motion[:3, 3]
    there = np.concatenate([vertices for vertices, _ in parted.bodies])
    assert max(np.linalg.norm(there - at, axis=1).min() for at in laid[::9]) < 1e-3
