"""Shadows by a table of edges, for light after light: the exact ones, and those that are rendered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_views import needs_rendering
from validator_parts import PlainView, tangle, trefoil, tube

from knotfab_validators.shadows.cast import ShadowCaster
from knotfab_validators.shadows.exact_shadow import ShadowError, shadow_lines, shadow_mask
from knotfab_validators.shadows.render import SilhouetteRenderer
from knotfab_validators.shadows.view import view_geometry


def test_it_casts_the_exact_shadow_of_every_light_and_of_what_crosses_the_wall() -> None:
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


def test_what_reaches_the_light_has_no_exact_shadow_and_is_clipped_in_a_picture() -> None:
    vertices, faces = tube(trefoil(), 3.0, 12)
    g = view_geometry(PlainView(light_distance_mm=200.0), 64, 64)
    behind = vertices + [0.0, 0.0, 400.0]
    both = np.concatenate([vertices, behind]), np.concatenate([faces, faces + len(vertices)])
    with pytest.raises(ShadowError, match="reaches the light"):
        ShadowCaster(*both).lines(g)
    seen = ShadowCaster(*both).render(g)
    assert seen.any() and (seen == ShadowCaster(vertices, faces).render(g)).all()
