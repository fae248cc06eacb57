"""The visual hull's bound, contradictions, and frames of equal height."""

import numpy as np
import pytest
from shapely import MultiPolygon, box

from knotfab.base.arrays import Array, Mask
from knotfab.design.frames import framed_alike, spread_views
from knotfab.design.hull import contradictions, hull_bounds, rays_within
from knotfab.design.room import depth_extent, resolve_region
from knotfab.limits.region import region_excess
from knotfab.picture.read import Target
from knotfab.scene.camera import Camera, camera_of, view_axes, walls_of
from knotfab.scene.load import parse_scene
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Region
from knotfab_formats.scene import ResolvedView, Scene
from knotfab_formats.views import View

SIDE = 120


def seen(azimuth: float, light: float = 500.0, elevation: float = 0.0) -> ResolvedView:
    return ResolvedView(
        frame_width_mm=120.0,
        frame_height_mm=120.0,
        azimuth_deg=azimuth,
        elevation_deg=elevation,
        light_distance_mm=light,
        wall_distance_mm=100.0,
    )


def shot(azimuth: float, mask: Mask, light: float = 500.0, elevation: float = 0.0) -> Camera:
    return camera_of(seen(azimuth, light, elevation), mask.shape[1], mask.shape[0])


def disc(radius: float) -> Mask:
    v, u = np.mgrid[:SIDE, :SIDE] - 0.5 * (SIDE - 1)
    return np.asarray(u * u + v * v < radius * radius)


def block(top: int, bottom: int, left: int = 30, right: int = 90) -> Mask:
    mask = np.zeros((SIDE, SIDE), dtype=bool)
    mask[top:bottom, left:right] = True
    return mask


@pytest.mark.slow
def test_a_ball_contradicts_itself_from_no_side() -> None:
    masks = [disc(40.0)] * 3
    cameras = [shot(a, m) for a, m in zip((0.0, 60.0, 120.0), masks, strict=True)]
    for bound in hull_bounds(cameras, masks, 90.0):
        assert bound.iou > 0.995
        assert (bound.covered <= bound.wanted).all()
        # the hull holds the ball: 40 px of 1 mm at the wall are 33.3 mm at its middle
        assert (bound.low < -32).all() and (bound.high > 32).all()


def test_what_only_one_picture_has_is_lost() -> None:
    """A block twice as high as the other's, far from the light: half of it is left."""
    masks = [block(20, 100), block(40, 80)]
    cameras = [shot(a, m, 50000.0) for a, m in zip((0.0, 90.0), masks, strict=True)]
    tall, low = hull_bounds(cameras, masks, 90.0)
    assert 0.5 <= tall.iou < 0.53  # never less: a bound; a pixel wider on each side at most
    assert low.iou == 1.0
    missing = tall.wanted & ~tall.covered
    rows = np.flatnonzero(missing.any(1)) / len(missing)
    assert rows.min() < 0.2 and rows.max() > 0.8
    assert tall.deepest == pytest.approx(20 / SIDE, abs=2 / SIDE) and low.deepest == 0.0


def inside_hull(points: Array, cameras: list[Camera], masks: list[Mask]) -> Mask:
    """Find which of the points (n, 3), mm, lie in every picture's silhouette."""
    inside = np.ones(len(points), dtype=bool)
    for camera, mask in zip(cameras, masks, strict=True):
        u, v = np.rint(camera.project(points)).astype(int).T
        inside &= (u >= 0) & (u < mask.shape[1]) & (v >= 0) & (v < mask.shape[0])
        inside[inside] = mask[v[inside], u[inside]]
    return inside


@pytest.mark.slow
def test_the_bound_is_that_of_voxels() -> None:
    masks = [disc(45.0) & ~disc(20.0), block(20, 95, 25, 100)]
    cameras = [shot(a, m) for a, m in zip((0.0, 90.0), masks, strict=True)]
    bounds = hull_bounds(cameras, masks, 90.0)
    axis = np.arange(-60.0, 60.0, 1.0)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    hull = grid[inside_hull(grid, cameras, masks)]
    for camera, mask, bound in zip(cameras, masks, bounds, strict=True):
        u, v = np.rint(camera.project(hull)).astype(int).T
        drawn = np.zeros_like(mask)
        drawn[v, u] = True
        # voxel middles 1.2 px apart leave holes: close them by a pixel each way, inside the picture
        for _ in range(2):
            wide = np.pad(drawn, 1)
            drawn = (
                wide[1:-1, 1:-1]
                | wide[2:, 1:-1]
                | wide[:-2, 1:-1]
                | wide[1:-1, 2:]
                | wide[1:-1, :-2]
            ) & mask
        assert bound.iou == pytest.approx((drawn & mask).sum() / mask.sum(), abs=0.03)


def test_a_raised_view_sees_the_extent_in_depth() -> None:
    """A square ring seen from above leaves the front view the whole width: light shines through its sides."""
    ring = block(30, 90) & ~block(45, 75, 45, 75)
    cameras = [shot(0.0, block(30, 90), 50000.0), shot(0.0, ring, 50000.0, 90.0)]
    front, above = hull_bounds(cameras, [block(30, 90), ring], 90.0)
    assert front.iou > 0.99 and above.iou > 0.99
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 22.0]])
    inside = inside_hull(points, cameras, [block(30, 90), ring])
    assert inside.tolist() == [False, True]


def test_nothing_stands_behind_a_wall() -> None:
    """Views 20 degrees apart see alike what stands far behind the middle, where one of them has its wall."""
    masks = [block(10, 110, 5, 115)] * 2
    views = [seen(0.0), seen(20.0)]
    cameras = [camera_of(v, SIDE, SIDE) for v in views]
    bound = hull_bounds(cameras, masks, 120.0, walls=walls_of(views))[0]
    assert hull_bounds(cameras, masks, 120.0)[0].low[2] < -105.0 < -97.001 < bound.low[2]
    on = cameras[0].corner + np.array([[5.0, 60.0], [60.0, 60.0], [115.0, 60.0]]) @ np.stack(
        [cameras[0].du, cameras[0].dv]
    )
    middles, halves = rays_within(cameras[0], on, 120.0, walls_of(views))
    heights = [
        [(middles + end * halves) @ normal + offset for end in (-1.0, 1.0)]
        for *normal, offset in walls_of(views)
    ]
    # each ends at the wall that it meets first
    assert np.array(heights).min((0, 1)) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("azimuth", [90.0, -90.0, 270.0, 450.0])
def test_a_ray_beside_another_views_wall_is_as_long_as_its_neighbours(azimuth: float) -> None:
    """The angle's cosine is a rounding error of either sign there."""
    masks = [block(10, 110)] * 2
    views = [seen(0.0), seen(azimuth)]
    cameras = [camera_of(v, SIDE + 1, SIDE + 1) for v in views]
    for camera in cameras:
        on = camera.corner + np.arange(30.0, 91.0)[:, None] * camera.du + 60.0 * camera.dv
        _, halves = rays_within(camera, on, 90.0, walls_of(views))
        assert np.linalg.norm(halves, axis=1).min() > 80.0
    odd = np.pad(masks[0], ((0, 1), (0, 1)))
    assert min(b.iou for b in hull_bounds(cameras, [odd, odd], 90.0, walls=walls_of(views))) == 1.0


def test_only_low_bounds_are_told_and_where() -> None:
    masks = [block(20, 100), block(60, 100)]
    views = [View(name="tall"), View(name="low", azimuth_deg=90.0)]
    cameras = [shot(v.azimuth_deg, m, 50000.0) for v, m in zip(views, masks, strict=True)]
    lines = contradictions(views, hull_bounds(cameras, masks, 90.0))
    assert len(lines) == 1
    assert "view tall" in lines[0] and "at the top" in lines[0] and "equal" not in lines[0][:20]
    same = hull_bounds(cameras, [masks[1], masks[1]], 90.0)
    assert contradictions(views, same) == []


def target(mask: Mask) -> Target:
    return Target("x", mask)


def test_silhouettes_are_brought_to_one_height() -> None:
    masks = [block(10, 50), np.pad(block(30, 110), ((0, 30), (0, 60)))]
    scene = framed_alike(spread_views(Scene(), "ab"), [target(m) for m in masks])
    spans = []
    for view, mask in zip(scene.views, masks, strict=True):
        camera = camera_of(view, mask.shape[1], mask.shape[0])
        rows = np.flatnonzero(mask.any(1))
        edges = [camera.corner + (v * camera.dv) for v in (rows[0] - 0.5, rows[-1] + 0.5)]
        spans.append([edge[1] for edge in edges])
        assert max(view.frame_width_mm or 0, view.frame_height_mm or 0) <= 180.001
    assert spans[0] == pytest.approx(spans[1], abs=1e-3)
    assert spans[0][0] == pytest.approx(-spans[0][1], abs=1e-3)


def test_frames_that_are_given_are_left_alone() -> None:
    scene = spread_views(Scene(views=(View(frame_width_mm=100.0),)), "ab")
    assert framed_alike(scene, [target(disc(30.0)), target(disc(50.0))]) == scene


def test_views_are_spread_over_half_a_turn() -> None:
    assert [v.azimuth_deg for v in spread_views(Scene(), "ab").views] == [0, 90]
    assert [v.azimuth_deg for v in spread_views(Scene(), "abc").views] == [0, 60, 120]


def test_views_are_named_after_their_pictures() -> None:
    files = ["a/heart.png", "b/Heart.svg", "text:heart", "c/heart-2.png"]
    named = [view.name for view in spread_views(Scene(), files).views]
    assert named == ["heart", "Heart-2", "heart-3", "heart-2-2"]


# The region of one view stands before it however it looks: from the front, from above, from
# below.


SQUARE = MultiPolygon([box(-70, -70, 70, 70)])


def look(azimuth: float, elevation: float) -> ResolvedView:
    return ResolvedView(
        frame_width_mm=180.0, frame_height_mm=180.0, azimuth_deg=azimuth, elevation_deg=elevation
    )


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere"])
@pytest.mark.parametrize("view", [look(0, 40), look(0, -90), look(75, 0), look(-120, 35)])
def test_a_piece_has_the_same_room_in_every_view(kind: str, view: ResolvedView) -> None:
    asked = Region.model_validate({"kind": kind})
    points = np.random.default_rng(0).uniform(-70, 70, (200, 3))
    found = []
    for seen in (look(0, 0), view):
        region = resolve_region(asked, [seen], [], 2.0)
        placed = points @ view_axes(seen)
        found.append(region_excess(placed, region, 2.0)[0])
        ahead = tuple(view_axes(seen)[2])
        assert depth_extent(None, SQUARE, region, 2.0, ahead) == pytest.approx(
            depth_extent(None, SQUARE, resolve_region(asked, [look(0, 0)], [], 2.0), 2.0)
        )
    assert found[1] == pytest.approx(found[0], abs=1e-9)


@pytest.mark.parametrize("kind", ["box", "cylinder", "sphere"])
@pytest.mark.parametrize("view", [look(0, 40), look(0, -90), look(75, 0), look(-120, 35)])
def test_a_given_region_has_the_depth_along_the_view(kind: str, view: ResolvedView) -> None:
    size = (70.0, 70.0, 70.0) if kind == "sphere" else (200.0, 60.0, 200.0)
    region = resolve_region(Region.model_validate({"kind": kind, "size_mm": size}), [view], [], 2.0)
    ahead = view_axes(view)[2]
    depth = depth_extent(None, SQUARE, region, 2.0, tuple(ahead))
    assert depth is not None
    # two radii before and behind that depth the region ends, unless the piece asks for less
    ends = np.outer([-0.5, 0.5], ahead) * (depth + 4 * 2.0)
    beyond = float(region_excess(ends, region, 0.0)[0].max())
    asks = 0.7 * 144
    assert beyond <= 1e-6 and (depth > 0.9 * asks or beyond == pytest.approx(0.0, abs=1e-3))


def test_a_region_of_given_size_stands_as_it_is_given() -> None:
    given = Region(size_mm=(100.0, 50.0, 20.0))
    assert resolve_region(given, [look(0, 40)], [], 2.0).elevation_deg == 0.0


def test_turned_regions_behind_walls_and_meshes_are_refused() -> None:
    def scene(center: str) -> str:
        return (
            f"[region]\nsize_mm = [50.0, 50.0, 50.0]\nelevation_deg = 90.0\ncenter_mm = {center}\n"
            "[[views]]\nelevation_deg = 90.0\n"
        )

    assert parse_scene(scene("[0.0, 0.0, -150.0]")).region.elevation_deg == 90.0
    with pytest.raises(InputError, match="behind the wall"):
        parse_scene(scene("[0.0, -150.0, 0.0]"))
    with pytest.raises(InputError, match="not a mesh"):
        parse_scene('[region]\nkind = "mesh"\nfile = "a.stl"\nelevation_deg = 9.0\n')


@pytest.mark.parametrize("shape", ["ball", "disc", "rectangle"])
def test_the_piece_stays_outside_a_lamp_of_the_largest_size(shape: str) -> None:
    size = {"light_diameter_mm": 960.0}
    if shape == "rectangle":
        size = {"light_width_mm": 768.0, "light_height_mm": 576.0}
    view = look(0, 0).model_copy(update={"light_shape": shape, **size})
    radius, reach = 2.0, view.light_distance_mm - 480.0
    depth = depth_extent(None, SQUARE, resolve_region(Region(), [view], [], radius), radius)
    assert depth is not None and 0 < 0.5 * depth + radius < reach
