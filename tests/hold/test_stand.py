"""Stands: every knot is held, little shows, nothing touches, and the piece neither sags nor tips."""

from functools import cache

import numpy as np
import pytest
from pieces import EMPTY, RADIUS, VIEW, camera, knots, ring

from knotfab.base.errors import SceneError
from knotfab.geometry.measures import segment_distance
from knotfab.geometry.tube import sweep
from knotfab.hold.beams import Stiffness, sag_moves, worst_of
from knotfab.hold.mount import BASE_DOWN
from knotfab.hold.plinth import slope_below
from knotfab.hold.shade import MountShadow
from knotfab.hold.solids import stand_bodies
from knotfab.hold.stand import StandMount, StandSettings, plan_stand
from knotfab.hold.struts import sites_of
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.standing import bodies, footprint, margin
from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.frame import working_frame
from knotfab_validators.shadows.view import view_geometry

pytestmark = pytest.mark.slow

PLA = Stiffness(2300.0, 1.24, 0.04)
ASKED = StandSettings(4.0, 10.0, 0.8)


ONE = knots(ring(50.0, n=240, wave=15.0))
ISLAND = knots(*(k.points for k in ONE.knots), ring(12.0, 5.0, 80, 4.0))


@cache
def plan(island: bool) -> StandMount:
    return plan_stand(ISLAND if island else ONE, [camera()], [EMPTY], 0.4, PLA, ASKED)


@cache
def part(island: bool) -> tuple[np.ndarray, np.ndarray]:
    tubes = [sweep(k.points, RADIUS, 24) for k in (ISLAND if island else ONE).knots]
    (body,) = stand_bodies(tubes, plan(island))  # it checks the genus
    return body


@pytest.mark.parametrize("island", [False, True])
def test_it_holds_every_knot_and_lets_nothing_sag(island: bool) -> None:
    mount, own = plan(island), ISLAND if island else ONE
    assert set(mount.holds) == set(range(len(own.knots)))
    assert len(mount.holds) == len(mount.members) == len(mount.posts) + len(mount.struts)
    assert 0 < mount.sag_mm <= PLA.max_sag_mm and len(mount.posts) >= 3
    sites = sites_of(own)
    coarse = worst_of(sag_moves(own, sites, mount.members, PLA), own.points)[0]
    assert mount.sag_mm == pytest.approx(coarse, rel=0.1)
    # a frame that joins the knots to the ground does not do
    first = mount.members.take(np.arange(len(mount.members)) < len(own.knots))
    assert worst_of(sag_moves(own, sites, first, PLA), own.points)[0] > PLA.max_sag_mm


@pytest.mark.parametrize("island", [False, True])
def test_what_it_darkens_is_what_was_predicted(island: bool) -> None:
    vertices, faces = part(island)
    frame = working_frame(90, 90)
    geometry = view_geometry(VIEW, 90, 90).resample(frame)  # type: ignore[arg-type]
    dark = shadow_mask(shadow_lines(vertices, faces.astype(np.int64), geometry), geometry)
    bare = np.zeros_like(dark)
    for k in (ISLAND if island else ONE).knots:
        tube, triangles = sweep(k.points, RADIUS, 48)
        lines = shadow_lines(tube, triangles.astype(np.int64), geometry)
        bare |= shadow_mask(lines, geometry)
    inside = np.s_[frame.pad_y : -frame.pad_y, frame.pad_x : -frame.pad_x]
    more = float((dark & ~bare)[inside].mean())
    assert more == pytest.approx(float(plan(island).predicted_intrusion[0]), rel=0.1)
    # there is a post from the frame's edge to the ring and a bridge to the island, but not ten of them
    pixel = 180 / 1024
    width = 2 * 0.6 * RADIUS * 1.2 / pixel
    least = width * ((90 - 63) + island * (34 - 5) * 1.2) / pixel / 1024**2
    assert 0.8 * least < more < 10 * least


@pytest.mark.parametrize("island", [False, True])
def test_the_base_lies_below_the_frame_and_before_the_wall(island: bool) -> None:
    vertices, _ = part(island)
    base = plan(island).base
    view = camera()
    low = vertices[vertices[:, 1] <= base.bottom + base.size_mm[2]]
    low = low[base.slope.above(low) <= 1e-6]
    assert len(low) and (view.project(low)[:, 1] > view.height - 0.5).all()
    assert (vertices @ view.receiver[:3] + view.receiver[3] > 0).all()
    # the plane of its top goes through the light but for the drop
    edge = slope_below([view])
    assert edge.above(view.eye[None]) == pytest.approx([0.0], abs=1e-9)
    corner = view.corner + (view.height - 0.5) * view.dv
    assert edge.above(corner[None]) == pytest.approx([0.0], abs=1e-9)
    assert edge.height_mm - base.slope.height_mm >= 4.0 and base.slope.rise == pytest.approx(
        edge.rise
    )


@pytest.mark.parametrize("island", [False, True])
def test_it_stands_as_firmly_as_it_says(island: bool) -> None:
    vertices, faces = part(island)
    on_bed = vertices @ BASE_DOWN.T
    on_bed = on_bed - on_bed.min(axis=0)
    (body,) = bodies(Mesh(on_bed, faces.astype(np.int64)))
    inside = margin(body.center, footprint(on_bed, body.faces, 0.05))
    mount = plan(island)
    assert inside == pytest.approx(mount.base.margin_mm, abs=0.3)
    assert body.center[2] == pytest.approx(mount.base.height_mm, abs=0.5)
    tip = np.degrees(np.arctan2(inside, body.center[2]))
    assert mount.base.tip_deg >= 10.0 - 1e-2 and tip >= mount.base.tip_deg - 0.3
    # tipped by 5° about any edge of the foot, the centre of mass still has to rise
    foot = footprint(on_bed, body.faces, 0.05) - body.center[:2]
    for direction in np.deg2rad(np.arange(0, 360, 5)):
        unit = np.array([np.cos(direction), np.sin(direction)])
        arm = float((foot @ unit).max())
        assert arm * np.cos(np.deg2rad(5)) - body.center[2] * np.sin(np.deg2rad(5)) > 0


def test_struts_of_one_knot_do_not_show() -> None:
    mount = plan(False)
    shade = MountShadow(ONE, camera(), EMPTY)
    assert shade.darken(mount.struts) < 1e-4 < shade.darken(mount.posts)


def test_members_touch_nothing_but_their_ends() -> None:
    mount = plan(True)
    m = mount.members
    for i in range(len(m)):
        t = np.linspace(0, 1, 400)[:, None]
        line = m.start[i] + t * (m.end[i] - m.start[i])
        for j in range(i):
            gap = segment_distance(m.start[[i]], m.end[[i]], m.start[[j]], m.end[[j]])[0]
            assert gap >= m.radius[i] + m.radius[j] + 0.4 - 1e-9
        for curve in ISLAND.knots:
            away = np.linalg.norm(line[:, None] - curve.points[None], axis=2).min(axis=1)
            near = away < RADIUS + m.radius[i] + 0.35
            # they are near only about its ends
            ends = np.minimum(t[:, 0], 1 - t[:, 0]) * np.linalg.norm(m.end[i] - m.start[i])
            assert ends[near].max(initial=0.0) < 4 * RADIUS


def test_a_wall_too_near_is_named() -> None:
    """All feet must stand before the wall."""
    with pytest.raises(SceneError, match=r"reaches knot 0|of the wall") as refused:
        plan_stand(ONE, [camera(wall_distance_mm=8.0)], [EMPTY], 0.4, PLA, ASKED)
    assert "--knots" not in refused.value.remedy  # it is one


@pytest.mark.parametrize(("room_mm", "lost"), [(4.0, 1), (45.0, 0)])
def test_a_knot_that_nothing_reaches_is_named_and_one_knot_stands(
    room_mm: float, lost: int
) -> None:
    """One knot is suggested where some of several stands, and a bridge to it holds the others."""
    with pytest.raises(SceneError, match=f"reaches knot {lost}") as refused:
        plan_stand(ISLAND, [camera()], [EMPTY], room_mm, PLA, ASKED)
    assert ("--knots 1" in refused.value.remedy) == (lost > 0)
    if lost:
        joined = knots(np.vstack([k.points for k in ISLAND.knots]))
        assert set(plan_stand(joined, [camera()], [EMPTY], room_mm, PLA, ASKED).holds) == {0}
