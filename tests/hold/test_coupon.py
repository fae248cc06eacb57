"""The coupon of a mount: closed bodies on the bed, holes as wide as they say, a pin that fits them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

from knotfab.hold.coupon import PLAYS_MM, Coupon, plan_coupon
from knotfab.hold.struts import Candidates, nothing
from knotfab_fixtures.holders import DOT_MM, fit_pin, fit_strip
from knotfab_formats.piece import Mount
from knotfab_formats.scene import Scene

COUPON = Coupon(4.0, 10.0, 3.0, 15.0, 2.0, 2.4)


def mounted(kind: str, **parts: Any) -> Any:
    scene = Scene(mount=Mount(kind=kind, plate_thickness_mm=2.5, dowel_depth_mm=8.0))
    return SimpleNamespace(**{"scene": scene, "wall": None, "stand": None, **parts})


def test_a_strip_has_the_volume_of_its_formula() -> None:
    holes, dots, thick, room = (3.1, 3.3), (1, 3), 4.0, 7.0
    vertices, faces = fit_strip(holes, dots, thick, room_mm=room, tolerance_mm=0.005)
    part = trimesh.Trimesh(vertices, faces, process=False)
    assert part.is_watertight and part.euler_number == 2 - 2 * len(holes)
    size = np.ptp(vertices, axis=0)
    lost = sum(np.pi * d**2 / 4 for d in holes) * thick
    lost += sum(dots) * np.pi * DOT_MM**2 / 4 * DOT_MM / 2
    assert part.volume == pytest.approx(size.prod() - lost, rel=1e-3)
    # every hole's own diameter, about an axis that is found where its rim is
    for hole in holes:
        rim = [
            ring
            for ring in part.section([0, 0, 1], [0, 0, thick / 2]).discrete
            if abs(np.ptp(ring[:, 0]) - hole) < 0.02
        ]
        assert len(rim) == 1


def test_a_pin_has_its_sizes() -> None:
    vertices, faces = fit_pin(4.0, 9.0, 3.0)
    part = trimesh.Trimesh(vertices, faces, process=False)
    assert part.is_watertight and part.volume > 0
    assert vertices[:, 2].max() == pytest.approx(12.0) and vertices[:, 2].min() == 0.0
    above = vertices[vertices[:, 2] > 3.0 + 1e-6]
    assert np.hypot(above[:, 0], above[:, 1]).max() == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize("bad", [{"diameters_mm": ()}, {"thickness_mm": 0.0}, {"dots": (1, 2, 3)}])
def test_what_is_no_strip_is_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError):
        fit_strip(**{"diameters_mm": (3.0, 4.0), "dots": (1, 2), "thickness_mm": 3.0, **bad})


def test_a_coupon_lies_on_the_bed_in_two_bodies() -> None:
    strip, pin = COUPON.make_bodies()
    low = np.min([strip[0].min(axis=0), pin[0].min(axis=0)], axis=0)
    assert low == pytest.approx(0.0) and strip[0][:, 2].min() == pin[0][:, 2].min() == 0.0
    for vertices, faces in (strip, pin):
        part = trimesh.Trimesh(vertices, faces, process=False)
        assert part.is_watertight and part.volume > 0 and part.body_count == 1
    assert strip[0][:, 2].max() == pytest.approx(3.0 + 15.0)
    assert pin[0][:, 1].min() > strip[0][:, 1].max() + 1.0
    assert COUPON.holes_mm == tuple(4.0 + play for play in PLAYS_MM)
    assert COUPON.figures.dots == (1, 2, 3, 4, 5) and "pin of 4.0 mm" in COUPON.tell()


def test_it_follows_its_mount() -> None:
    assert plan_coupon(mounted("none")) is None
    pegs = [
        SimpleNamespace(top_radius_mm=t, foot_radius_mm=1.2, root_radius_mm=r, length_mm=60.0)
        for t, r in ((1.0, 1.3), (0.8, 1.4))
    ]
    wall = plan_coupon(mounted("wall", wall=SimpleNamespace(pegs=pegs)))
    assert wall is not None
    assert (wall.pin_mm, wall.peg_top_mm, wall.depth_mm) == (2.8, 1.6, 8.0)
    assert wall.thickness_mm == 3.0 and wall.peg_length_mm == 20.0
    none, starts = np.zeros(2, dtype=np.int64), np.zeros((2, 3))
    ends = np.array([[12.0, 0.0, 0.0], [0.0, 8.0, 0.0]])
    members = Candidates(none, none, starts, ends, np.array([0.9, 1.5]))
    assert plan_coupon(mounted("stand", stand=SimpleNamespace(members=nothing()))) is None
    stand = plan_coupon(mounted("stand", stand=SimpleNamespace(members=members)))
    assert stand is not None
    assert (stand.pin_mm, stand.peg_top_mm, stand.peg_length_mm) == (3.0, 1.8, 12.0)
