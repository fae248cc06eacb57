"""Shadows by a table of edges, for light after light: the exact ones, and those that are rendered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from validator_parts import PlainView, needs_rendering, tangle, trefoil, tube

from knotfab_validators.arrays import Array, Mask
from knotfab_validators.shadows.exact_shadow import (
    ShadowCaster,
    ShadowError,
    shadow_lines,
    shadow_mask,
)
from knotfab_validators.shadows.render import SilhouetteRenderer
from knotfab_validators.shadows.view import ViewGeometry, view_geometry


def test_the_exact_shadow_of_every_light_is_cast() -> None:
    vertices, faces = tube(tangle(150, 5, 45.0), 2.5, 12)
    caster = ShadowCaster(vertices, faces)
    for far, tilt in ((40.0, 0.0), (60.0, 25.0), (5.0, -20.0)):
        view = PlainView(wall_distance_mm=far, wall_tilt_deg=tilt)
        g = view_geometry(view, 120, 90)
        for light in (g.light, g.light + [30.0, -20.0, 5.0]):
            moved = replace(g, light=light)
            exact = shadow_mask(shadow_lines(vertices, faces, moved), moved)
            np.testing.assert_array_equal(caster.render(moved), exact)
            assert 200 < exact.sum() < exact.size


@needs_rendering
@pytest.mark.parametrize("behind", [False, True])
def test_it_draws_what_the_renderer_draws(behind: bool) -> None:
    vertices, faces = tube(trefoil(), 3.0, 24)
    g = view_geometry(PlainView(wall_distance_mm=5.0, wall_tilt_deg=20.0), 256, 256)
    with SilhouetteRenderer(vertices, faces) as renderer:
        rendered = renderer.render(g, behind=behind)
    cast = ShadowCaster(vertices, faces).render(g, behind=behind)
    assert (cast != rendered).sum() <= 0.002 * rendered.sum()
    assert behind == (cast.sum() > ShadowCaster(vertices, faces).render(g).sum())


def met_by_rays(g: ViewGeometry, corners: Array) -> Mask:
    """Find which pixels' rays, from the receiver to the light, meet one of the triangles (m, 3, 3): all by
    all."""
    v, u = np.mgrid[: g.height, : g.width]
    at = g.on_receiver(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    met = np.zeros(len(at), dtype=bool)
    for a, b, c in corners:
        way = np.broadcast_to(g.light - at, at.shape)
        system = np.stack([-way, np.broadcast_to(b - a, at.shape), (c - a) + 0 * at], axis=2)
        t, p, q = np.linalg.solve(system, (at - a)[:, :, None])[:, :, 0].T
        met |= (t > 0) & (t < 1) & (p >= 0) & (q >= 0) & (p + q <= 1)
    return met.reshape(g.height, g.width)


def test_faces_across_the_light_and_the_wall_are_cut_there() -> None:
    """Faces that are whole before the wall are sorted once for all lights."""
    rng = np.random.default_rng(3)
    corners = rng.uniform([-40, -40, -90], [40, 40, 60], (12, 3, 3))
    corners[:4, 0, 2], corners[4:8, 0, 2] = 300.0, -150.0  # behind the light; behind the wall
    corners[0, 1, 2] = 250.0
    caster = ShadowCaster(corners.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    g = view_geometry(PlainView(light_distance_mm=200.0), 48, 48)
    with pytest.raises(ShadowError, match="reaches the light"):
        caster.lines(g)
    for light in (g.light, g.light + [15.0, -10.0, 5.0]):
        moved = replace(g, light=light)
        seen, table = caster.render(moved), caster._seen[1]
        expected = met_by_rays(moved, corners)
        np.testing.assert_array_equal(seen, expected)
        assert (expected & ~met_by_rays(moved, corners[4:])).sum() > 50
        assert (expected & ~met_by_rays(moved, np.delete(corners, range(4, 8), 0))).sum() > 50
        caster.render(replace(moved, light=light + 1.0))
        assert caster._seen[1] is table and len(table.faces) == 4


@needs_rendering
@pytest.mark.parametrize(("above", "dark"), [(0.0, False), (0.015, False), (0.1, True)])
def test_a_plate_whose_face_is_the_wall_casts_nothing(above: float, dark: bool) -> None:
    """Cleaning a mesh may leave its face by hundredths of a millimetre before the wall."""
    g = view_geometry(PlainView(wall_distance_mm=40.0), 64, 64)
    pixels = np.array([[8.0, 8.0], [56.0, 10.0], [30.0, 50.0]])
    corners = g.on_receiver(pixels) + above * g.normal
    face = np.array([[0, 1, 2]], dtype=np.int32)
    with SilhouetteRenderer(corners, face) as renderer:
        assert renderer.render(g).any() == dark
    assert ShadowCaster(corners, face).render(g).any() == dark
    assert shadow_mask(shadow_lines(corners, face, g), g).any() == dark
