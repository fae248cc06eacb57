"""Silhouettes of picture files: every kind gives the same mask, and bad ones are refused."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw
from rings import RADIUS, ring
from shown_pieces import bodies_of, view_of

from knotfab.knots import Knot, Knots
from knotfab_formats.views import Reading
from knotfab_validators.files.picture import PictureError, read_silhouette, widen_strokes
from knotfab_validators.shadows.part_shadows import shadow_checks
from knotfab_validators.shadows.verify_view import VerifiedView, verify_view
from knotfab_validators.shadows.view import view_geometry

SHAPE = np.zeros((40, 60), dtype=bool)
SHAPE[8:30, 10:50] = True
SHAPE[15:20, 20:30] = False


def pictures(folder: Path) -> dict[str, Path]:
    """One file of each kind, all of the same shape."""
    grey = np.where(SHAPE, 30, 240).astype(np.uint8)
    rgb = np.where(SHAPE[..., None], [200, 30, 40], [250, 250, 230]).astype(np.uint8)
    rgba = np.dstack([np.full((*SHAPE.shape, 3), 90, np.uint8), SHAPE.astype(np.uint8) * 255])
    palette = Image.fromarray(grey).convert("P")
    clear = Image.fromarray(SHAPE.astype(np.uint8), mode=None).convert("L").convert("P")
    images = {
        "grey.png": Image.fromarray(grey),
        "grey.bmp": Image.fromarray(grey),
        "rgb.png": Image.fromarray(rgb),
        "rgb.webp": Image.fromarray(rgb),
        "rgb.jpg": Image.fromarray(rgb),
        "rgba.png": Image.fromarray(rgba),
        "la.png": Image.fromarray(rgba).convert("LA"),
        "opaque-rgba.png": Image.fromarray(rgb).convert("RGBA"),
        "palette.png": palette,
        "deep.png": Image.fromarray(np.where(SHAPE, 100, 700).astype(np.uint16)),
        "bilevel.png": Image.fromarray(grey > 127),
    }
    for name, image in images.items():
        image.save(folder / name, quality=100, lossless=True)
    clear.save(folder / "clear-palette.png", transparency=0)
    return {name: folder / name for name in [*images, "clear-palette.png"]}


def test_every_kind_of_file_gives_the_same_silhouette(tmp_path: Path) -> None:
    for name, path in pictures(tmp_path).items():
        np.testing.assert_array_equal(read_silhouette(path), SHAPE, err_msg=name)
        np.testing.assert_array_equal(
            read_silhouette(path, Reading(invert=True)), ~SHAPE, err_msg=name
        )


def test_alpha_counts_from_one_half(tmp_path: Path) -> None:
    rgba = np.zeros((1, 4, 4), dtype=np.uint8)
    rgba[0, :, 3] = [0, 127, 128, 255]
    Image.fromarray(rgba).save(tmp_path / "a.png")
    assert read_silhouette(tmp_path / "a.png").tolist() == [[False, False, True, True]]


def test_half_contrast_is_that_of_the_largest_difference(tmp_path: Path) -> None:
    grey = np.full((5, 5), 200, dtype=np.uint8)
    grey[2, 1:4] = [100, 149, 151]  # the largest difference is 100: more than 50 counts
    Image.fromarray(grey).save(tmp_path / "g.png")
    assert read_silhouette(tmp_path / "g.png")[2].tolist() == [False, True, True, False, False]


def test_a_plain_picture_has_no_silhouette(tmp_path: Path) -> None:
    Image.fromarray(np.full((9, 9), 255, dtype=np.uint8)).save(tmp_path / "white.png")
    assert not read_silhouette(tmp_path / "white.png").any()


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    good = tmp_path / "good.png"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64), np.uint8)).save(good)
    (tmp_path / "cut.png").write_bytes(good.read_bytes()[:900])
    (tmp_path / "text.png").write_text("not a picture")
    for name in ("none.png", "cut.png", "text.png", "."):
        with pytest.raises(PictureError):
            read_silhouette(tmp_path / name)


def test_a_pipe_is_no_picture(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "front.png")
    for path in (tmp_path / "front.png", Path("/dev/zero"), tmp_path):
        with pytest.raises(PictureError, match="not a plain file"):
            read_silhouette(path)


# A shadow of strokes that were widened is judged by them; `iou` stays that with the picture
# itself.


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
