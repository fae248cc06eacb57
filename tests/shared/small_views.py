"""A small view for the tests of shadows, and what skips those that render where nothing can."""

import pytest
from validator_parts import PlainView

from knotfab_validators.shadows.render import why_no_rendering
from knotfab_validators.shadows.view import ViewGeometry, view_geometry

needs_rendering = pytest.mark.skipif(
    why_no_rendering() is not None, reason=f"no rendering here: {why_no_rendering()}"
)
PIXELS = 240  # pixels of a frame of 120 mm, on a wall 100 mm behind; the light is 500 mm before the piece


def geometry() -> ViewGeometry:
    return view_geometry(PlainView(frame_width_mm=120.0, frame_height_mm=120.0), PIXELS, PIXELS)
