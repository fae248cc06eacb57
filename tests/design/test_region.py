"""The region of one view stands before it however it looks: from the front, from above, from below."""

import numpy as np
import pytest
from shapely import MultiPolygon, box

from knotfab.base.errors import InputError
from knotfab.design.region import depth_extent, resolve_region
from knotfab.limits.region import outside
from knotfab.scene.camera import view_axes
from knotfab.scene.load import parse_scene
from knotfab_formats.scene import Region, ResolvedView

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
        found.append(outside(placed, region, 2.0)[0])
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
    beyond = float(outside(ends, region, 0.0)[0].max())
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
