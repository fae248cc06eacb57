"""Stands: every knot is held, little shows, nothing touches, and the piece neither sags nor tips."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from knotfab.errors import SceneError
from knotfab.geometry.neighbours import segment_distance
from knotfab.geometry.tube import sweep
from knotfab.knots import Knot, Knots
from knotfab.mount.mount import BASE_DOWN, mount_piece
from knotfab.mount.piece_frame import Stiffness, sag_of
from knotfab.mount.plinth import slope_below
from knotfab.mount.shade import ViewShadow
from knotfab.mount.stand import StandMount, StandSettings, plan_stand
from knotfab.mount.stand_solids import stand_bodies
from knotfab.mount.struts import (
    GROUND,
    ROOT_SHARE,
    Candidates,
    Obstacles,
    join,
    nothing,
    sites_of,
    struts,
)
from knotfab.scene.camera import Camera, camera_of
from knotfab.scene.catalogue import resolve
from knotfab.scene.model import Mount, ResolvedView, Scene
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.printing.standing import bodies, footprint, margin
from knotfab_validators.shadows.exact_shadow import shadow_lines, shadow_mask
from knotfab_validators.shadows.frame import working_frame
from knotfab_validators.shadows.view import view_geometry

RADIUS = 2.0
PLA = Stiffness(2300.0, 1.24, 0.04)
ASKED = StandSettings(4.0, 10.0, 0.8)
VIEW = ResolvedView(frame_width_mm=180.0, frame_height_mm=180.0)


def ring(radius: float, z: float = 0.0, n: int = 240, wave: float = 15.0) -> np.ndarray:
    t = 2 * np.pi * np.arange(n) / n
    return np.column_stack([radius * np.cos(t), radius * np.sin(t), z + wave * np.sin(3 * t)])


def knots(*curves: np.ndarray) -> Knots:
    return Knots(tuple(Knot(c) for c in curves), RADIUS)


def camera(**keys: float) -> Camera:
    return camera_of(VIEW.model_copy(update=keys), 90, 90)


EMPTY = np.zeros((90, 90), dtype=bool)
ONE = knots(ring(50.0))
ISLAND = knots(ring(50.0), ring(12.0, 5.0, 80, 4.0))


@cache
def plan(island: bool) -> StandMount:
    return plan_stand(ISLAND if island else ONE, [camera()], [EMPTY], 0.4, PLA, ASKED)


@cache
def part(island: bool) -> tuple[np.ndarray, np.ndarray]:
    tubes = [sweep(k.points, RADIUS, 24) for k in (ISLAND if island else ONE).knots]
    (body,) = stand_bodies(tubes, plan(island))  # it checks the genus
    return body


def one(start: object, end: object, radius: float, ground: bool = False) -> Candidates:
    """A member that belongs to no site but the ground, if at all: its first is site 0."""
    second = GROUND if ground else 0
    ends = (np.array([p], dtype=float) for p in (start, end))
    return Candidates(np.array([0]), np.array([second]), *ends, np.array([radius]))


@pytest.mark.parametrize("island", [False, True])
def test_it_holds_every_knot_and_lets_nothing_sag(island: bool) -> None:
    mount, own = plan(island), ISLAND if island else ONE
    assert set(mount.holds) == set(range(len(own.knots)))
    assert len(mount.holds) == len(mount.members) == len(mount.posts) + len(mount.struts)
    assert 0 < mount.sag_mm <= PLA.max_sag_mm and 0 < mount.sag_again_mm <= PLA.max_sag_mm
    assert mount.sag_again_mm == pytest.approx(mount.sag_mm, rel=0.1)
    assert len(mount.posts) >= 3
    # what joins the knots to the ground does not do
    sites = sites_of(own)
    first = mount.members.of(np.arange(len(mount.members)) < len(own.knots))
    assert sag_of(own, sites, first, PLA)[0] > PLA.max_sag_mm


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
    # at least a post from the frame's edge to the ring, and a bridge to the island; not ten of them
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
    assert inside == pytest.approx(mount.margin_mm, abs=0.3)
    assert body.center[2] == pytest.approx(mount.base.height_mm, abs=0.5)
    tip = np.degrees(np.arctan2(inside, body.center[2]))
    assert mount.tip_deg >= 10.0 - 1e-2 and tip >= mount.tip_deg - 0.3
    # tipped by 5° about any edge of the foot, the centre of mass still has to rise
    foot = footprint(on_bed, body.faces, 0.05) - body.center[:2]
    for direction in np.deg2rad(np.arange(0, 360, 5)):
        unit = np.array([np.cos(direction), np.sin(direction)])
        arm = float((foot @ unit).max())
        assert arm * np.cos(np.deg2rad(5)) - body.center[2] * np.sin(np.deg2rad(5)) > 0


def test_struts_of_one_knot_do_not_show() -> None:
    mount = plan(False)
    shade = ViewShadow(ONE, camera(), EMPTY)
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
            # only about its ends
            ends = np.minimum(t[:, 0], 1 - t[:, 0]) * np.linalg.norm(m.end[i] - m.start[i])
            assert ends[near].max(initial=0.0) < 4 * RADIUS


def test_a_wall_too_near_is_named() -> None:
    """All feet must stand before the wall."""
    with pytest.raises(SceneError, match=r"reaches knot 0|of the wall"):
        plan_stand(ONE, [camera(wall_distance_mm=8.0)], [EMPTY], 0.4, PLA, ASKED)


def test_a_knot_that_nothing_reaches_is_named() -> None:
    with pytest.raises(SceneError, match=r"reaches knot [01]"):
        plan_stand(ISLAND, [camera()], [EMPTY], 45.0, PLA, ASKED)


def test_segments_as_near_as_dense_samples_say() -> None:
    random = np.random.default_rng(3)
    a, b, c, d = random.normal(size=(4, 300, 3))
    d[:20] = c[:20] + (b - a)[:20] * 1.3  # parallel ones
    found = segment_distance(a, b, c, d)
    t = np.linspace(0, 1, 160)[:, None, None]
    p, q = a + t * (b - a), c + t * (d - c)
    dense = np.array(
        [np.linalg.norm(p[:, None, i] - q[None, :, i], axis=2).min() for i in range(300)]
    )
    assert (found <= dense + 1e-12).all() and (dense - found < 0.03).all()
    cross = segment_distance(
        *(np.array([x], dtype=float) for x in ([-1, 0, 0], [1, 0, 0], [0, -1, 2], [0, 1, 2]))
    )
    assert cross == pytest.approx([2.0])


def test_clear_by_exactly_the_clearance() -> None:
    straight = np.column_stack([np.linspace(-60, 60, 121), np.zeros(121), np.zeros(121)])
    back = straight[::-1] + [0.0, 60.0, 0.0]
    own = knots(np.concatenate([straight, back]), ring(8.0, 400.0))
    obstacles = Obstacles(own, sites_of(own), 0.4)
    far = replace(one([-5, 0, 0], [5, 0, 0], 1.0), first=np.array([len(obstacles.sites.knot) - 1]))
    far = replace(far, second=far.first)
    gap = RADIUS + 1.0 + 0.4 + obstacles.slack
    for off, free in ((gap * 1.001, True), (gap * 0.999, False)):
        shift = np.array([[0.0, 0.0, off]])
        moved = replace(far, start=far.start + shift, end=far.end + shift)
        assert obstacles.clear(moved)[0] == free
    # a post's foot is wider
    root = RADIUS + ROOT_SHARE * 1.0 + 0.4 + obstacles.slack
    for off, free in ((root * 1.001, True), (root * 0.999, False)):
        post = one([0.2, -30, off], [0.2, -off, 0], 1.0, ground=True)  # a sample's x
        post = replace(post, first=far.first)
        assert obstacles.clear(post)[0] == free
    # and members keep clear of each other, but for one that is named
    obstacles.add(replace(far, start=far.start + [0, 0, 50], end=far.end + [0, 0, 50]))
    for off, free in ((2.4 * 1.001, True), (2.4 * 0.999, False)):
        shift = np.array([[0.0, 0.0, 50 + off]])
        beside = replace(far, start=far.start + shift, end=far.end + shift)
        assert obstacles.clear(beside)[0] == free
        assert obstacles.clear(beside, but=0)[0]


def test_a_strand_that_runs_along_its_own_strut_is_in_the_way() -> None:
    """By 0.2 mm of air, where 0.4 are wanted, within the joint: it once passed as a part of it."""

    def arc(x: float, y: float, start: float, end: float) -> np.ndarray:
        t = np.linspace(start, end, 20)[1:]
        return np.column_stack([x + 2.2 * np.cos(t), y + 2.2 * np.sin(t)])

    right = np.pi / 2
    beside = np.concatenate([arc(1.0, 2.2, -right, 0.0), arc(5.4, 2.7, 2 * right, right)])
    for way, free in ((beside, False), (np.array([[20.0, 0.0], [60.0, 0.0]]), True)):
        corners = np.concatenate([[[-60.0, 0.0], [0.0, 0.0]], way, [[80.0, 4.9], [80.0, -60.0]]])
        corners = np.concatenate([corners, [[-60.0, -60.0]]])
        steps = np.linalg.norm(np.diff(corners, axis=0, append=corners[:1]), axis=1)
        at = np.concatenate([[0.0], np.cumsum(steps)])
        closed = np.concatenate([corners, corners[:1]])
        even = np.arange(0.0, at[-1], 0.25)
        line = np.column_stack([np.interp(even, at, closed[:, k]) for k in (0, 1)])
        own = knots(np.column_stack([line, np.zeros(len(line))]), ring(8.0, 400.0))
        sites = sites_of(own, also={0: np.array([240])})
        joint = int(np.flatnonzero((sites.knot == 0) & (sites.vertex == 240))[0])
        far = len(sites.knot) - 1
        assert sites.point[joint] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
        strut = replace(
            one([0, 0, 0], [0, 40, 0], 1.0), first=np.array([joint]), second=np.array([far])
        )
        assert Obstacles(own, sites, 0.4).clear(strut)[0] == free


def test_struts_meet_their_tubes_squarely() -> None:
    own = knots(ring(50.0, wave=0.0), ring(30.0, wave=0.0))
    sites = sites_of(own)
    n = len(sites.knot)
    pairs = np.column_stack([np.repeat(np.arange(n), n), np.tile(np.arange(n), n)])
    found = struts(sites, pairs, RADIUS, 1.5)
    along = (found.end - found.start) / found.length_mm[:, None]
    for end in (found.first, found.second):
        cosine = np.abs((along * sites.tangent[end]).sum(axis=1))
        assert len(cosine) and cosine.max() <= np.sqrt(1 - 0.65**2) + 1e-12
    assert found.length_mm.min() >= 2.5 * RADIUS and (found.radius == 1.5).all()


def test_shade_measures_what_shows() -> None:
    """A strip across the empty frame; nothing below it; nothing where the picture is dark."""
    view = camera()
    shade = ViewShadow(knots(ring(5.0, wave=0.0) + [0.0, 60.0, 0.0]), view, EMPTY)
    post = one([10, 30, 0], [10, -70, 0], 2.0)
    pixel = 180 / 1024
    exact = (2 * 2.0 * 1.2 / pixel) * (100 * 1.2 / pixel)
    assert shade.cost(post)[0] == pytest.approx(exact, rel=0.02)
    round_ends = np.pi * (2.0 * 1.2 / pixel) ** 2
    assert shade.darken(post) * 1024**2 == pytest.approx(exact + round_ends, rel=0.015)
    assert shade.cost(one([10, -80, 0], [10, -120, 0], 2.0))[0] == 0.0
    assert not shade.hidden(post)[0]
    shade.add(post)
    assert shade.cost(post)[0] < 0.01 * exact
    full = ViewShadow(knots(ring(5.0, wave=0.0)), view, ~EMPTY)
    assert full.hidden(post)[0] and full.cost(post)[0] == 0 and full.darken(post) == 0
    # a strip that is hidden to a pixel
    half = np.zeros((90, 90), dtype=bool)
    half[:, :45] = True  # the left of the frame
    shade = ViewShadow(knots(ring(5.0, wave=0.0) + [0.0, 60.0, 0.0]), view, half)
    for x, hidden in ((-2.0 - 2 * pixel, True), (-2.0 + pixel, False)):
        assert shade.hidden(one([x, 30, 0], [x, -40, 0], 2.0))[0] == hidden


def test_what_is_behind_the_knots_draws_nothing() -> None:
    """A thin bar along the rays behind a strand, and moved out of its shadow into a dark picture."""
    strand = np.column_stack([np.full(121, 10.0), np.linspace(30, -30, 121), np.zeros(121)])
    shade = ViewShadow(
        knots(np.concatenate([strand, strand[::-1] + [60.0, 0.0, 0.0]])), camera(), ~EMPTY
    )
    seen = 520.0 / 500.0  # from z = 0 to z = -20, from the light
    for aside, behind in ((0.0, True), (0.5, True), (1.5, False), (-1.5, False)):
        x = (10.0 + aside) * seen
        bar = one([x, 25 * seen, -20], [x, -25 * seen, -20], 1.0)
        assert shade.hidden(bar)[0]
        assert shade.behind_knots(bar)[0] == behind


def test_members_can_be_thickened_and_joined() -> None:
    two = join([nothing(), one([0, 0, 0], [3, 4, 0], 1.0), one([0, 0, 0], [0, 0, 2], 1.9)])
    assert two.length_mm == pytest.approx([5.0, 2.0])
    assert two.thicken(1.2, 1.95).radius == pytest.approx([1.2, 1.95])
    assert two.thicken(1.2, 1.5).radius == pytest.approx([1.2, 1.9])  # never thinner
    assert two.with_radius(0, 1.7).radius == pytest.approx([1.7, 1.9])


def test_the_piece_on_its_stand() -> None:
    scene = resolve(Scene(views=(VIEW,), mount=Mount(kind="stand")))
    tubes = [sweep(k.points, RADIUS, 24) for k in ONE.knots]
    mounted = mount_piece(scene, ONE, tubes, [camera()], [EMPTY])
    stand = mounted.stand
    assert stand is not None and mounted.upright is not None and len(mounted.bodies) == 1
    assert mounted.scene.mount.pegs == (len(stand.members),)
    report, sag = mounted.report(), mounted.check_sag()
    assert report["kind"] == "stand" and report["posts"] + report["struts"] == len(stand.members)
    assert sag is not None and sag["status"] == "pass" and sag["measured"] == stand.sag_again_mm
    with pytest.raises(ValueError, match="silhouettes"):
        mount_piece(scene, ONE, tubes, [camera()])
