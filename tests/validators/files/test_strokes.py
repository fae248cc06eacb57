"""A shadow of strokes that were widened is judged by them; `iou` stays that with the picture itself."""

import numpy as np
import pytest
from PIL import Image, ImageDraw
from rings import RADIUS, ring
from shown_pieces import bodies_of, view_of

from knotfab.knots import Knot, Knots
from knotfab_validators.files.strokes import widen_strokes
from knotfab_validators.shadows.shadow_checks import shadow_checks
from knotfab_validators.shadows.verify_view import VerifiedView, verify_view
from knotfab_validators.shadows.view import view_geometry

WIDE, HIGH = 500, 400
VIEW = view_of()


def judge(width_mm: float | None, radius: float = RADIUS) -> VerifiedView:
    """A ring whose picture is a line of 3 px, widened to so many mm on the wall."""
    knots = Knots((Knot(ring(42.0)),), radius)
    geometry = view_geometry(VIEW, WIDE, HIGH)
    seen = geometry.project(knots.knots[0].points)[0]
    image = Image.new("1", (WIDE, HIGH))
    ImageDraw.Draw(image).line([(float(u), float(v)) for u, v in [*seen, seen[0]]], 1, 3)
    line = np.asarray(image).copy()
    ((vertices, faces),) = bodies_of(knots)
    drawn = None if width_mm is None else widen_strokes(line, width_mm / geometry.pixel_mm)
    return verify_view(
        vertices,
        faces,
        line,
        geometry,
        polygons=[knots.knots[0].points],
        radius=radius,
        drawn=drawn,
    )


def status(view: VerifiedView, width_mm: float | None) -> tuple[str, str]:
    """The status of the check of the shadow, and its sentence."""
    checks = shadow_checks(
        {"front": view},
        np.zeros((9999, 3)),
        iou_floor=0.9,
        max_outline_px=0.5,
        no_rendering="there is no need to",
        polygons_decide=True,
        changed={}
        if width_mm is None
        else {"front": f"its strokes widened to {width_mm:g} mm as they are drawn"},
    )
    (shadow,) = (c for c in checks if c.name == "shadow")
    return shadow.status, shadow.detail


def test_a_line_is_judged_as_wide_as_it_is_drawn() -> None:
    width = 2 * RADIUS * VIEW.magnification
    alone, wide = judge(None), judge(width)
    assert alone.judged.iou == alone.whole.iou == wide.whole.iou < 0.5
    assert wide.judged.iou > 0.9
    assert status(alone, None)[0] == "fail"
    found, said = status(wide, width)
    assert found == "pass"
    assert f"widened to {width:g} mm" in said and f"{alone.whole.iou:.4f}" in said


@pytest.mark.parametrize("times", [0.7, 1.4])
def test_a_tube_of_another_width_than_the_strokes_is_rejected(times: float) -> None:
    width = 2 * RADIUS * VIEW.magnification
    assert status(judge(width, times * RADIUS), width)[0] == "fail"
