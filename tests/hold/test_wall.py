"""Wall mounts: pegs stay in the tube's shadow, touch nothing else, hold what they must, and none idles."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from pieces import DOWEL, PLA, PLATE, RADIUS, camera, knots, ring, setup
from tables import some

from knotfab.base.errors import SceneError
from knotfab.geometry.tube import mesh_volume, sweep
from knotfab.hold.beams import Stiffness, piece_frame, sag_moves, springs_of, worst_of
from knotfab.hold.mount import Mounted
from knotfab.hold.pegs import choose_pegs, pegs_on, sites_with
from knotfab.hold.shade import Rays, free_rays
from knotfab.hold.struts import Candidates, join_members
from knotfab.hold.wall import Peg, plan_wall, sag_on_pegs, wall_bodies
from knotfab.knots import Knots
from knotfab.part.assemble import clean_body
from knotfab_formats.piece import Mount

ONE = knots(ring(50.0))
TWO = knots(ring(50.0), ring(25.0, 10.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "tilt"), some([(PLATE, 15.0), (PLATE, 0.0), (DOWEL, 0.0), (DOWEL, 15.0)], 2)
)
def test_the_bodies_are_what_the_pegs_predict(settings: Mount, tilt: float) -> None:
    from manifold3d import Manifold, Mesh64

    view = camera(wall_tilt_deg=tilt)
    tubes = [sweep(k.points, RADIUS, 16) for k in TWO.knots]
    mount = plan_wall(TWO, view, 0.4, PLA, settings)
    assert {peg.knot for peg in mount.pegs} == {0, 1}
    bodies = wall_bodies(tubes, mount, view)
    assert len(bodies) == (1 if settings is PLATE else 2)
    for vertices, faces in bodies:
        solid = Manifold(Mesh64(np.ascontiguousarray(vertices), faces.astype(np.uint64)))
        assert solid.genus() == (len(mount.pegs) + 2 if settings is PLATE else 1)
        assert mesh_volume(vertices, faces) > sum(mesh_volume(*t) for t in tubes) * 0.3
        height = vertices @ view.receiver[:3] + view.receiver[3]
        deepest = 3.0 if settings is PLATE else 10.0
        assert height.min() == pytest.approx(-deepest, abs=1e-6)


@pytest.mark.slow
def test_pegs_lie_in_the_shadow_of_their_tube() -> None:
    """Every corner of a mount in front of the wall is on a ray through the tube."""
    view = camera()
    mount = plan_wall(ONE, view, 0.4, PLA, DOWEL)
    vertices = wall_bodies([sweep(ONE.points, RADIUS, 64)], mount, view)[0][0]
    before = vertices[vertices[:, 2] > -100 + 1e-3]
    unit = before - view.eye
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    dense = np.concatenate([ONE.points + s * (np.roll(ONE.points, -1, 0) - ONE.points) for s in
                            np.linspace(0, 1, 12, endpoint=False)])  # fmt: skip
    from_eye = dense - view.eye
    for chunk in np.array_split(unit, 20):
        along = chunk @ from_eye.T
        square = (from_eye**2).sum(1)[None] - along**2
        assert np.sqrt(np.maximum(square, 0)).min(axis=1).max() <= RADIUS * 1.003


def test_a_piece_without_a_free_ray_is_refused() -> None:
    """Two knots behind each other, and more room asked for than there is between any of their strands."""
    view = camera()
    t = 2 * np.pi * np.arange(1200) / 1200
    spread = 40.0 + 12 * np.cos(40 * t)
    coil = np.column_stack([spread * np.cos(t), spread * np.sin(t), -30 + 0 * t])
    front = ring(38.0, 20.0, wave=0.0)
    with pytest.raises(SceneError, match="no light ray from any knot"):
        plan_wall(knots(coil, front), view, 6.0, PLA, PLATE)


def bar_rays() -> Knots:
    """A ring in whose shadow another lies, that leaves few rays to the wall free."""
    t = 2 * np.pi * np.arange(240) / 240
    front = np.column_stack([45 * np.cos(t), 45 * np.sin(t), np.full(240, 10.0)])
    wide = 45 * (520 / 490) * (1 - 0.35 * np.exp(-(((t - np.pi / 2) / 0.35) ** 2)))
    rear = np.column_stack([wide * np.cos(t), wide * np.sin(t), np.full(240, -20.0)])
    return knots(front, rear)


@pytest.mark.slow
def test_where_rays_are_barred_struts_hold_the_piece() -> None:
    """Struts take what pegs cannot, in the shadow of the tubes alone, and touch nothing else."""
    piece, view = bar_rays(), camera()
    firm = Stiffness(2300.0, 1.24, 0.08)
    mount = plan_wall(piece, view, 0.4, firm, PLATE)
    assert sag_on_pegs(piece, view, 0.4, firm) > firm.max_sag_mm >= mount.sag_mm
    members = mount.struts
    assert len(members) >= 1 and len(mount.strut_knots) == len(members)
    tubes = [sweep(k.points, RADIUS, 24) for k in piece.knots]
    ((vertices, faces),) = wall_bodies(tubes, mount, view)
    assert mesh_volume(vertices, faces) > 0
    strands = np.concatenate([dense(k.points) for k in piece.knots]) - view.eye
    far = np.linalg.norm(strands, axis=1)
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    for a, b, r in zip(members.start, members.end, members.radius, strict=True):
        u = np.linalg.svd((b - a)[None])[2][1:]
        rim = r * (np.cos(turn)[:, None] * u[0] + np.sin(turn)[:, None] * u[1])
        skin = a + np.linspace(0, 1, 9)[:, None, None] * (b - a) + rim - view.eye
        unit = skin.reshape(-1, 3) / np.linalg.norm(skin, axis=2).reshape(-1, 1)
        off = np.arccos(np.clip(unit @ (strands / far[:, None]).T, -1, 1))
        assert (off <= np.arcsin(RADIUS / far)).any(axis=1).all()


def dense(points: np.ndarray) -> np.ndarray:
    """A closed polyline with twenty points an edge."""
    t = np.arange(20)[:, None] / 20
    edges = np.roll(points, -1, axis=0) - points
    return (points[:, None] + t * edges[:, None]).reshape(-1, 3)


@pytest.mark.slow
def test_a_united_body_survives_single_precision() -> None:
    from igl import predicates

    view = camera()
    mount = plan_wall(ONE, view, 0.4, PLA, PLATE)
    vertices, faces = wall_bodies([sweep(ONE.points, RADIUS, 24)], mount, view)[0]
    body = clean_body((vertices - vertices.min(axis=0), faces))
    assert (body[0].astype(np.float32).astype(np.float64) == body[0]).all()
    _, pairs, _ = predicates.find_self_intersections(body[0], body[1].astype(np.int64))
    assert len(pairs) == 0
    assert mesh_volume(*body) == pytest.approx(mesh_volume(vertices, faces), rel=1e-4)


@pytest.mark.slow
def test_a_knot_barred_from_the_wall_hangs_on_another() -> None:
    """A hidden strut holds the dot of an i by its stem; it needs a plate."""
    before, behind = 20.0, -10.0
    small, view = ring(12.0, before, wave=0.0), camera()
    shaded = small * (500.0 - behind) / (500.0 - before)
    shaded[:, 2] = behind
    piece = knots(shaded, small)
    mount = plan_wall(piece, view, 0.4, PLA, PLATE)
    assert {peg.knot for peg in mount.pegs} == {0}
    assert mount.strut_knots[0].tolist() == [1, 0] and mount.sag_mm <= PLA.max_sag_mm
    tubes = [sweep(k.points, RADIUS, 24) for k in piece.knots]
    # one body, of as many handles as predicted
    ((vertices, faces),) = wall_bodies(tubes, mount, view)
    assert mesh_volume(vertices, faces) > 0
    scene = setup("plate")[1]
    told = Mounted(tubes, ["piece with wall plate"], scene, None, mount).figures
    assert told.knots_joined == ((1, 0),)
    with pytest.raises(SceneError, match="no light ray from knot 1") as refused:
        plan_wall(piece, view, 0.4, PLA, DOWEL)
    # a plate is suggested, as holds it above, and one knot on dowels
    assert re.findall(r'--knots 1|mount.foot = "plate"', refused.value.remedy)[::-1] == [
        'mount.foot = "plate"',
        "--knots 1",
    ]
    one = knots(np.vstack([k.points for k in piece.knots]))
    assert plan_wall(one, view, 0.4, PLA, DOWEL).sag_mm <= PLA.max_sag_mm
    # a place for the piece is estimated by the same rule
    assert sag_on_pegs(piece, view, 0.4, PLA, "plate") <= PLA.max_sag_mm
    with pytest.raises(ValueError, match="no light ray from knot 1"):
        sag_on_pegs(piece, view, 0.4, PLA, "dowel")


def test_a_peg_knows_its_length() -> None:
    peg = Peg(0, np.array([0.0, 3.0, 0.0]), np.array([4.0, 0.0, 0.0]), 1.0, 1.2, 1.3)
    assert peg.length_mm == 5.0


@pytest.mark.slow
def test_a_bead_that_bars_thick_pegs_gets_a_thinner_one() -> None:
    """A dot is a ring hardly larger than its tube, and in the way of a peg as thick as that."""
    dot = ring(1.1 * RADIUS * 1.25, n=24, wave=0.3)
    piece = knots(ring(50.0), dot)
    tubes = [sweep(k.points, RADIUS, 24) for k in piece.knots]
    view = camera(wall_distance_mm=60.0)
    mount = plan_wall(piece, view, 0.4, PLA, PLATE)
    thick = {k: {peg.top_radius_mm / RADIUS for peg in mount.pegs if peg.knot == k} for k in (0, 1)}
    assert thick[0] == {0.95} and max(thick[1]) < 0.95
    ((vertices, faces),) = wall_bodies(tubes, mount, view)  # as many handles as pegs predict
    assert mesh_volume(vertices, faces) > 0


def sag_on(
    rays: Rays, chosen: np.ndarray, top: np.ndarray, foot: np.ndarray, stiffness: Stiffness
) -> tuple[float, np.ndarray]:
    """What `ONE` sags on the pegs of some rays."""
    sites = sites_with(ONE, rays, chosen)
    members = pegs_on(sites, rays, chosen, top, foot)
    return worst_of(sag_moves(ONE, sites, members, stiffness), ONE.points)


@pytest.mark.slow
def test_pegs_are_added_until_the_sag_is_small_and_none_is_idle() -> None:
    view = camera()
    rays = free_rays(ONE, view, 0.9, 0.4)
    top = np.full(len(rays.top), 0.9 * RADIUS)
    foot = 1.2 * top
    soft = Stiffness(400.0, 1.24, 0.2)
    chosen = choose_pegs(ONE, rays, top, foot, soft)
    assert chosen.sag_mm <= 0.2 and len(chosen.rays) > 1
    again, _ = sag_on(rays, chosen.rays, top, foot, soft)
    assert again == pytest.approx(chosen.sag_mm, rel=0.02)  # other joints, same frame
    for peg in chosen.rays[1:]:
        left = chosen.rays[chosen.rays != peg]
        assert sag_on(rays, left, top, foot, soft)[0] > 0.19
    stiff = choose_pegs(ONE, rays, top, foot, PLA)
    assert len(stiff.rays) <= len(chosen.rays)


@pytest.mark.parametrize("tapers", [False, True])
def test_members_held_on_a_solved_frame_are_members_of_a_frame_solved_anew(tapers: bool) -> None:
    view = camera()
    rays = free_rays(ONE, view, 0.9, 0.4)
    top = np.full(len(rays.top), 0.9 * RADIUS)
    chosen = np.flatnonzero(rays.free)[:: rays.free.sum() // 5]
    sites = sites_with(ONE, rays, chosen)
    pegs = pegs_on(sites, rays, chosen, top, 1.2 * top)
    far = len(sites.knot) // 2
    ends = sites.point[[0]], sites.point[[far]]
    strut = Candidates(np.array([0]), np.array([far]), *ends, top[:1])
    members = join_members([pegs if tapers else replace(pegs, end_radius=None), strut])
    given, rest = members.take([0]), members.take(np.arange(1, len(members)))
    held = piece_frame(ONE, sites, given, PLA)
    n = len(sites.knot)
    for number in range(len(rest)):
        some, one = rest.take(np.arange(number)), rest.take([number])
        held.hold(some, *springs_of(some, np.zeros(number), PLA))
        more = held.displacements_with_each(one, *springs_of(one, np.zeros(1), PLA))[0, :n]
        anew = piece_frame(ONE, sites, join_members([given, some, one]), PLA).frame.displacements()[
            :n
        ]
        assert more == pytest.approx(anew, abs=1e-7 * np.abs(anew).max())
        force = np.random.default_rng(number).normal(size=(held.joints, 6))
        force[n:] = 0
        other = piece_frame(ONE, sites, join_members([given, some]), PLA).frame
        load = np.zeros((other.joints, 6))
        load[:n] = force[:n]
        want = other.response(load)[:n]
        assert held.response(force)[:n] == pytest.approx(want, abs=1e-7 * np.abs(want).max())


def test_more_pegs_sag_less_and_a_softer_material_more() -> None:
    view = camera()
    rays = free_rays(ONE, view, 0.9, 0.4)
    top, foot = np.full(len(rays.top), 1.8), np.full(len(rays.top), 2.0)
    free = np.flatnonzero(rays.free)
    some = free[:: len(free) // 4][:4]
    sags = [sag_on(rays, some[: n + 1], top, foot, PLA)[0] for n in range(4)]
    assert all(b <= a + 1e-12 for a, b in pairwise(sags))
    soft, _ = sag_on(rays, some, top, foot, Stiffness(1150.0, 1.24, 0.2))
    assert soft == pytest.approx(2 * sags[-1], rel=1e-6)
