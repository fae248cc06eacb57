"""Meshes: joining corners, numbering bodies, what they enclose, distances and crossings of triangles."""

import igl
import numpy as np
import pytest
from solids import box, inward, move, together
from validator_parts import Array, ring, tangle, trefoil, tube, two

from knotfab_validators.geometry.curves import (
    Curves,
    cut_edges,
    halve_sides,
    near_segments,
    nearest_on_two,
    number_runs,
    point_segment,
    quarter_triangles,
    segment_blocks,
    segment_segment,
)
from knotfab_validators.geometry.mesh import (
    Mesh,
    enclosed_volume,
    merge_equal,
    number_bodies,
    surface_distance,
    winding_numbers,
)
from knotfab_validators.geometry.rays import count_above
from knotfab_validators.geometry.surface import survey
from knotfab_validators.geometry.triangles import (
    _from_segment,
    _nearest_parameters,
    point_triangle,
    triangle_triangle,
    triangles_cross,
)


def test_only_exactly_equal_corners_are_joined() -> None:
    a = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    b = a + [0, 0, 1e-12]
    assert len(merge_equal(np.stack([a, a, -0.0 * a + a])).vertices) == 3
    assert len(merge_equal(np.stack([a, b])).vertices) == 6
    signed = merge_equal(np.stack([a, np.where(a == 0, -0.0, a)]))
    assert len(signed.vertices) == 3


def two_boxes() -> Mesh:
    """The larger box's faces first; the other has the smaller coordinates."""
    return together(box((5, 0, 0), (7, 3, 4)), box((0, 0, 0), (1, 1, 1)))


def test_bodies_are_numbered_in_the_order_of_their_first_faces() -> None:
    mesh = two_boxes()
    spare = Mesh(np.vstack([[[9.0, 9, 9]], mesh.vertices]), mesh.faces + 1)
    label, count = number_bodies(spare)
    assert count == 2 and label[0] == -1
    assert (label[1:] == (mesh.vertices[:, 0] < 2)).all()


def test_what_a_mesh_encloses() -> None:
    mesh = two_boxes()
    assert enclosed_volume(mesh) == pytest.approx(24 + 1)
    assert enclosed_volume(Mesh(mesh.vertices, mesh.faces[:, ::-1])) == pytest.approx(-25)


def test_a_mesh_without_faces_or_with_nan_is_not_usable() -> None:
    mesh = two_boxes()
    assert mesh.usable and not Mesh(mesh.vertices, mesh.faces[:0]).usable
    assert not Mesh(np.where(mesh.vertices == 7, np.nan, mesh.vertices), mesh.faces).usable


# Points lie inside or outside of closed and open surfaces.


BLOCK = together(box((0, 0, 0), (10, 10, 10)), inward(box((3, 3, 3), (7, 7, 7))))
POINTS = np.array([[1.0, 5, 5], [5, 5, 5], [-2, 5, 5]])


@pytest.mark.parametrize("exact", [True, False])
def test_a_hollow_is_outside(exact: bool) -> None:
    winding = winding_numbers(POINTS, BLOCK, exact=exact)
    assert winding == pytest.approx([1, 0, 0], abs=1e-9 if exact else 0.01)
    assert winding_numbers(POINTS[:0], BLOCK, exact=exact).shape == (0,)


def test_distance_is_that_of_the_nearest_face() -> None:
    assert surface_distance(POINTS, BLOCK) == pytest.approx([1, 2, 2])


# Edges and lengths of curves, closed and open.


SQUARE = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])


def test_a_closed_curve_alone_has_the_edge_back() -> None:
    curves = Curves((SQUARE, SQUARE + 5), ("unknot", "open"), (True, False), None)
    assert curves.edges.curve.tolist() == [0] * 4 + [1] * 3
    assert curves.edges.end[3].tolist() == [0, 0, 0] and curves.edges.end[-1].tolist() == [5, 7, 5]
    assert curves.lengths_mm == (8.0, 6.0) and curves.length_mm == 14.0


# Runs are numbered, and edges cut, as their definitions say.


def test_entries_are_numbered_run_by_run() -> None:
    which, number = number_runs(np.array([2, 0, 3]))
    assert which.tolist() == [0, 0, 2, 2, 2] and number.tolist() == [0, 1, 0, 1, 2]


@pytest.mark.parametrize("step", [0.3, 1.0, 100.0])
def test_pieces_cover_each_edge_and_none_is_longer_than_the_step(step: float) -> None:
    start, end = np.random.default_rng(0).normal(size=(2, 20, 3))
    end[7] = start[7]  # an edge of no length is one piece
    which, begin, share = cut_edges(start, end, step)
    length = np.linalg.norm(end - start, axis=1)
    assert (share * length[which] <= step * (1 + 1e-12)).all()
    assert np.bincount(which, share) == pytest.approx(np.ones(20))
    for edge in range(20):
        own = begin[which == edge]
        assert own == pytest.approx(np.arange(len(own)) / len(own))
        assert len(own) == max(1, np.ceil(length[edge] / step))


def test_quarters_cover_a_triangle() -> None:
    corner = np.random.default_rng(1).normal(size=(5, 3, 3))
    small = quarter_triangles(corner, halve_sides(corner))
    area = np.linalg.norm(
        np.cross(*(np.moveaxis(small, 1, 0)[k] - small[:, 0] for k in (1, 2))), axis=1
    )
    whole = np.linalg.norm(
        np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1
    )
    assert area.reshape(4, 5) == pytest.approx(np.tile(whole / 4, (4, 1)))
    height = quarter_triangles(corner[..., 2], halve_sides(corner)[..., 2])
    assert np.array_equal(height, small[..., 2])  # what is known at corners follows them


# Distances of points and segments: against fine samples, in degenerate places, and nearly
# parallel.


def rows(*points: tuple[float, ...]) -> list[Array]:
    return [np.array([point], dtype=np.float64) for point in points]


@pytest.mark.parametrize("seed", range(4))
def test_distances_agree_with_sampled_ones(seed: int) -> None:
    a, b, c, d = np.random.default_rng(seed).normal(size=(4, 30, 3))
    t = np.linspace(0, 1, 201)[:, None, None]
    one, other = a + t * (b - a), c + t * (d - c)
    to_point = np.linalg.norm(one - c, axis=2).min(axis=0)
    between = np.linalg.norm(one[:, None] - other[None], axis=3).min(axis=(0, 1))
    assert point_segment(c, a, b) == pytest.approx(to_point, abs=1e-3)
    found = segment_segment(a, b, c, d)
    assert (found <= between + 1e-12).all() and found == pytest.approx(between, abs=0.02)
    p, q = nearest_on_two(a, b, c, d)
    assert np.linalg.norm(p - q, axis=1) == pytest.approx(found, abs=1e-12)


def test_parallel_and_pointlike_segments() -> None:
    a, b, c, d = rows((0, 0, 0), (4, 0, 0), (1, 3, 0), (9, 3, 0))
    assert segment_segment(a, b, c, d)[0] == 3.0
    assert segment_segment(a, b, *rows((7, 4, 0), (9, 4, 0)))[0] == 5.0
    assert segment_segment(a, b, c, c)[0] == 3.0 and segment_segment(c, c, a, a)[0] == 10**0.5
    assert point_segment(c, a, a)[0] == 10**0.5


@pytest.mark.parametrize("angle", [1e-3, 1e-5, 1e-6])
def test_segments_that_cross_at_a_small_angle_meet(angle: float) -> None:
    a, b = rows((-1, 0, 0), (1, 0, 0))
    c, d = rows((-0.9, -0.9 * angle, 0), (0.8, 0.8 * angle, 0))
    assert segment_segment(a, b, c, d)[0] < 1e-15 / angle
    above = [p + [0, 0, 0.5] for p in (c, d)]
    assert segment_segment(a, b, *above)[0] == pytest.approx(0.5, rel=1e-12)


def test_the_compiled_loops_of_triangles_have_the_same_distances() -> None:
    points = np.random.default_rng(4).normal(size=(4, 200, 3))
    points[1, :20], points[3, 10:30] = points[0, :20], points[2, 10:30]  # without length
    a, b, c, d = points
    p, q = nearest_on_two(a, b, c, d)
    far = point_segment(c, a, b)
    for k, (u, v, w) in enumerate(zip(b - a, d - c, c - a, strict=True)):
        s, t = _nearest_parameters(tuple(u), tuple(v), tuple(w))
        np.testing.assert_allclose([a[k] + s * u, c[k] + t * v], [p[k], q[k]], atol=1e-12)
        found = _from_segment(tuple(c[k]), tuple(a[k]), tuple(b[k]))
        assert found == pytest.approx(far[k], abs=1e-12)


# Near segments: none that is near is left out.


def test_near_segments_leaves_out_no_near_one() -> None:
    rng = np.random.default_rng(0)
    start = rng.normal(size=(60, 3))
    end = start + rng.normal(size=(60, 3)) * rng.choice([0.0, 0.1, 1.0, 5.0], (60, 1))
    end[:20] = start[:20] + [4.0, 0, 0]  # parallel
    blocks = segment_blocks(start, end, np.arange(0, 60, 8))
    i, j = np.triu_indices(8)
    t = np.linspace(0, 1, 40)[:, None]
    points = [a + t * (b - a) for a, b in zip(start, end, strict=True)]
    for limit in (0.05, 0.3):
        one, other = near_segments(blocks, i, j, limit)
        assert (one < other).all() and len(one) < 60 * 59 / 2
        found = set(zip(one.tolist(), other.tolist(), strict=True))
        assert len(found) == len(one)
        for a in range(60):
            for b in range(a + 1, 60):
                apart = np.linalg.norm(points[a][:, None] - points[b], axis=2).min()
                assert apart > limit or (a, b) in found


# What a mesh is made of: bodies, genera and volumes of known solids.


def test_survey_finds_genus_and_volume_of_each_body() -> None:
    axes = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    ball = Mesh(
        np.concatenate([axes, -axes]) + 100,
        np.array(
            [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
        ),
    )
    found = survey(two(ring(), ball))
    assert found.closed and found.manifold
    assert found.genus.tolist() == [1, 0]
    assert found.volumes_mm3[1] == pytest.approx(4 / 3)
    assert np.bincount(found.body).tolist() == [len(ring().faces), 8]


def test_distances_of_triangles_agree_with_sampled_ones() -> None:
    rng = np.random.default_rng(3)
    first = rng.normal(size=(40, 3, 3))
    second = rng.normal(size=(40, 3, 3)) + np.array([4.0, 0, 0])
    d, p, q = triangle_triangle(first, second)
    assert np.linalg.norm(p - q, axis=1) == pytest.approx(d, abs=1e-12)
    i = np.linspace(0, 1, 25)
    u, v = (g[np.add.outer(i, i) <= 1 + 1e-9] for g in np.meshgrid(i, i))
    weight = np.column_stack([1 - u - v, u, v])
    for k in range(len(first)):
        a, b = weight @ first[k], weight @ second[k]
        sampled = np.linalg.norm(a[:, None] - b[None], axis=2)
        assert d[k] <= sampled.min() + 1e-9 and d[k] > sampled.min() - 0.15
        to, near = point_triangle(second[k][:1], first[k][None])
        assert np.linalg.norm(near[0] - second[k][0]) == pytest.approx(to[0])
        assert to[0] <= np.linalg.norm(a - second[k][0], axis=1).min() + 1e-9


def test_touching_and_parallel_triangles() -> None:
    one = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    assert triangle_triangle(one, one + [0, 0, 0.25])[0][0] == pytest.approx(0.25, rel=1e-14)
    assert triangle_triangle(one, one + [1.0, 0, 0])[0][0] == 0.0
    tangled = Mesh(*tube(tangle(60), 1.0, 6))
    corner = tangled.vertices[tangled.faces]
    assert triangle_triangle(corner[:1], corner[:1])[0][0] == 0.0


@pytest.mark.parametrize("seed", range(20))
def test_triangles_cross_as_the_points_of_an_edge_say(seed: int) -> None:
    """A point of an edge of one that lies on the other, found by barycentric coordinates."""
    rng = np.random.default_rng(seed)
    first, second = rng.normal(size=(2, 50, 3, 3))
    expected = np.zeros(50, dtype=bool)
    for n in range(50):
        for one, other in ((first[n], second[n]), (second[n], first[n])):
            for k in range(3):
                p, q = one[k], one[(k + 1) % 3]
                matrix = np.column_stack([q - p, other[0] - other[1], other[0] - other[2]])
                t, u, v = np.linalg.solve(matrix, other[0] - p)
                expected[n] |= 0 <= t <= 1 and u >= 0 and v >= 0 and u + v <= 1
    assert (triangles_cross(first, second) == expected).all()


# Winding numbers by rays are those of the exact sum of solid angles, on every kind of surface.


BOX = box((0.0, 0, 0), (4, 4, 4))
TUBE = Mesh(*tube(trefoil(60, 4.0), 1.5, 12))
OVERLAPPING = Mesh(*tube(trefoil(60, 4.0), 4.0, 12))  # the tube meets itself: 2 and more inside
SURFACES = {
    "box": BOX, "hollow": together(box((0, 0, 0), (10, 10, 10)), inward(box((3, 3, 3), (7, 7, 7)))),
    "tube": TUBE, "overlapping": OVERLAPPING, "inside out": inward(TUBE), "doubled": together(BOX, BOX),
    "touching in a face": together(BOX, box((4, 0, 0), (8, 4, 4))),
    "touching in an edge": together(BOX, box((4, 4, 0), (8, 8, 4))),
    "a hair apart": together(BOX, box((4 + 1e-9, 0, 0), (8, 4, 4))),
    "far from the origin": move(TUBE, shift=(5e4, -3e4, 7e4)),
    "open": Mesh(TUBE.vertices, TUBE.faces[3:]),
    "one face turned": Mesh(TUBE.vertices, np.concatenate([TUBE.faces[1:], TUBE.faces[:1, ::-1]])),
    "one face twice": Mesh(TUBE.vertices, np.concatenate([TUBE.faces, TUBE.faces[:1]])),
    "flat faces": Mesh(BOX.vertices, np.concatenate([BOX.faces, [[0, 1, 0], [1, 0, 1]]])),
    "slivers": together(BOX, box((1, 1, 1), (3, 3, 1 + 1e-7))),
}  # fmt: skip


def _exact(points: Array, mesh: Mesh) -> Array:
    arrays = (mesh.vertices, mesh.faces, points)
    return np.asarray(igl.winding_number(*map(np.ascontiguousarray, arrays))).ravel()


def _points(mesh: Mesh, seed: int, count: int) -> Array:
    """Points all about, above and below corners, middles of edges and faces, and on all of these."""
    rng = np.random.default_rng(seed)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    about = rng.uniform(low - 0.2 * (high - low), high + 0.2 * (high - low), (count, 3))
    corner = mesh.vertices[mesh.faces]
    special = np.concatenate([corner[:, 0], corner[:, :2].mean(axis=1), corner.mean(axis=1)])
    special = special[rng.choice(len(special), min(len(special), count // 10), replace=False)]
    moved = [special + step * (high - low) for step in (0, [0, 0, 0.3], [0, 0, -0.3], [0.2, 0, 0])]
    return np.concatenate([about, *moved])


@pytest.mark.parametrize("name", SURFACES)
def test_they_agree_with_the_exact_sum(name: str) -> None:
    mesh = SURFACES[name]
    points = _points(mesh, 7, 10_000 if len(mesh.faces) < 2000 else 3000)
    found, summed = winding_numbers(points, mesh), _exact(points, mesh)
    # on a face the sum is what it is: rays leave such points to it
    assert np.abs(found - summed).max() < 1e-9
    assert ((found > 0.5) == (summed > 0.5)).all()


def test_rays_decide_what_is_not_near_a_face() -> None:
    points = np.random.default_rng(3).uniform(-12, 12, (5000, 3))
    _, unsure = count_above(points, TUBE.vertices, TUBE.faces)
    assert unsure.mean() < 1e-3
    for on in (TUBE.vertices[:50], TUBE.vertices[TUBE.faces[:50]].mean(axis=1)):
        assert count_above(on, TUBE.vertices, TUBE.faces)[1].all()


@pytest.mark.parametrize(
    ("name", "closed"),
    {n: n not in ("open", "one face turned", "one face twice") for n in SURFACES}.items(),
)
def test_a_rim_is_found(name: str, closed: bool) -> None:
    assert SURFACES[name].balanced == closed
