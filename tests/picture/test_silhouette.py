"""Masks as polygons and at other resolutions: areas, distances and topology against exact ones."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image, ImageDraw
from shapely import MultiPolygon, Point, Polygon, affinity

from knotfab.apps.batch.worker import list_tasks
from knotfab.base.arrays import Mask
from knotfab.picture.frames import MOST_FRAMES, count_knots, read_frames, tell_apart
from knotfab.picture.read import read_target
from knotfab.picture.silhouette import resample_mask, sample_mask, trace_polygon
from knotfab.pipeline.options import BuildOptions
from knotfab_formats.errors import InputError
from knotfab_formats.views import Reading


def pieces(shape: MultiPolygon) -> list[Polygon]:
    """The largest first."""
    return sorted(shape.geoms, key=lambda p: -p.area)


def disc(side: int, radius: float, u: float, v: float) -> Mask:
    y, x = np.mgrid[:side, :side]
    return np.asarray((x - u) ** 2 + (y - v) ** 2 <= radius**2)


def turning(polygon: Polygon) -> float:
    """Total turning of the outer ring, 2π for a convex one."""
    points = np.asarray(polygon.exterior.coords)
    edges = np.diff(np.vstack([points, points[1]]), axis=0)
    angle = np.diff(np.arctan2(edges[:, 1], edges[:, 0]))
    return float(np.abs((angle + np.pi) % (2 * np.pi) - np.pi).sum())


@pytest.mark.parametrize("radius", [6.0, 20.0, 100.0, 450.0])
def test_discs_have_their_area_place_and_no_stairs(radius: float) -> None:
    side = int(2 * radius + 20)
    u, v = side / 2 + 0.3, side / 2 - 0.2
    mask = disc(side, radius, u, v)
    shape = trace_polygon(mask)
    assert shape.is_valid and len(shape.geoms) == 1
    assert shape.area == pytest.approx(mask.sum(), rel=2e-3)
    exact = Point(u, v).buffer(radius, quad_segs=256)
    assert shapely.hausdorff_distance(shape, exact) < 0.7
    stairs = turning(trace_polygon(mask, 0).geoms[0])
    assert turning(shape.geoms[0]) < 2 * np.pi + 0.1 * (stairs - 2 * np.pi)


@pytest.mark.parametrize("angle", [0, 3, 17, 45])
def test_rectangles_keep_their_sides_and_corners(angle: float) -> None:
    exact = affinity.rotate(shapely.box(60.5, 80.5, 200.5, 160.5), angle)
    y, x = np.mgrid[:256, :256]
    mask = shapely.contains_xy(exact, x, y)
    shape = trace_polygon(mask)
    assert shape.area == pytest.approx(mask.sum(), rel=2e-3)
    assert shapely.hausdorff_distance(shape, trace_polygon(mask, 0)) < 0.7
    assert shape.symmetric_difference(exact).area / exact.area < 0.01


def test_untouched_outline_runs_between_the_pixels() -> None:
    mask = np.zeros((20, 30), dtype=bool)
    mask[5:10, 8:20] = True
    shape = trace_polygon(mask, 0)
    assert shape.bounds == pytest.approx((7.5, 4.5, 19.5, 9.5), abs=2e-3)
    assert shape.area == pytest.approx(60 - 0.5, abs=0.1)


def test_shapes_that_touch_the_frame_end_there() -> None:
    mask = np.zeros((100, 100), dtype=bool)
    mask[:, :50] = True
    shape = trace_polygon(mask)
    assert shape.bounds == pytest.approx((-0.5, -0.5, 49.5, 99.5), abs=0.3)
    assert shape.area == pytest.approx(5000, rel=2e-3)


def test_holes_and_pieces() -> None:
    mask = disc(300, 80, 100, 100) & ~disc(300, 40, 110, 90) | disc(300, 15, 110, 90)
    mask |= disc(300, 30, 240, 240)
    parts = pieces(trace_polygon(mask))
    assert [len(p.interiors) for p in parts] == [1, 0, 0]
    areas = [np.pi * (80**2 - 40**2), np.pi * 30**2, np.pi * 15**2]
    assert [p.area for p in parts] == pytest.approx(areas, rel=5e-3)


def test_specks_and_pinholes_go() -> None:
    mask = disc(100, 30, 50, 50)
    mask[2, 2] = True
    mask[50, 50] = False
    (part,) = pieces(trace_polygon(mask))
    assert len(part.interiors) == 0


def test_thin_strokes_survive() -> None:
    mask = np.zeros((200, 200), dtype=bool)
    mask[20, 20:180] = True  # one pixel wide
    mask[40:180, 60:62] = True
    i = np.arange(40, 160)
    mask[i, i + 30] = True  # connected by corners alone
    mask[i, i + 31] = True
    parts = pieces(trace_polygon(mask))
    assert len(parts) == 3
    assert sum(p.area for p in parts) == pytest.approx(mask.sum(), rel=0.02)


def test_pixels_that_touch_at_corners_are_one_piece() -> None:
    mask = np.zeros((40, 40), dtype=bool)
    mask[10:20, 10:20] = True
    mask[20:30, 20:30] = True
    shape = trace_polygon(mask)
    assert shape.is_valid
    assert shape.area == pytest.approx(200, rel=0.02)


@pytest.mark.slow
def test_large_masks_are_traced_smaller_in_their_own_coordinates() -> None:
    mask = disc(3000, 900, 1400.5, 1600)
    shape = trace_polygon(mask)
    assert shape.area == pytest.approx(mask.sum(), rel=2e-3)
    assert (shape.centroid.x, shape.centroid.y) == pytest.approx((1400.5, 1600), abs=0.1)
    assert shapely.hausdorff_distance(shape, Point(1400.5, 1600).buffer(900, 256)) < 1.5


def test_long_frames() -> None:
    mask = np.zeros((16, 8000), dtype=bool)
    mask[4:12, 100:7900] = True
    shape = trace_polygon(mask)
    assert shape.is_valid
    assert shape.area == pytest.approx(mask.sum(), rel=0.01)


def test_random_blobs_stay_valid() -> None:
    from scipy import ndimage

    rng = np.random.default_rng(5)
    for sigma in (1.0, 3.0, 8.0):
        mask = ndimage.gaussian_filter(rng.random((256, 256)), sigma) > 0.5
        shape = trace_polygon(mask)
        assert shape.is_valid
        assert shape.area == pytest.approx(mask.sum(), rel=0.03)
        outline = shapely.contains_xy(shape, *np.mgrid[:256, :256][::-1])
        inner = ndimage.binary_erosion(mask) | ~ndimage.binary_dilation(mask)
        assert (outline == mask)[inner].mean() > 0.995


def test_nothing_gives_nothing() -> None:
    empty = trace_polygon(np.zeros((20, 20), dtype=bool))
    assert empty.is_empty and pieces(empty) == []


@pytest.mark.slow
@pytest.mark.parametrize("size", [(30, 20), (7, 11), (60, 40), (100, 90), (60, 13), (1, 1)])
def test_coverage_is_exact_against_fine_subpixels(size: tuple[int, int]) -> None:
    mask = np.random.default_rng(1).random((40, 60)) > 0.4
    width, height = size
    coverage = resample_mask(mask, width, height)
    assert coverage.shape == (height, width) and coverage.dtype == np.float32
    fine = np.kron(mask, np.ones((height, width)))  # a common multiple of both grids
    blocks = fine.reshape(height, 40, width, 60).mean(axis=(1, 3))
    assert coverage == pytest.approx(blocks, abs=1e-6)
    assert coverage.mean() == pytest.approx(mask.mean(), abs=1e-6)


def test_a_sampled_mask_is_that_of_the_validators() -> None:
    from knotfab_validators.shadows.frame import padded_mask, working_frame

    rng = np.random.default_rng(4)
    for height, width in ((16, 23), (1024, 700), (1500, 2047), (333, 2048)):
        mask = rng.random((height, width)) > 0.5
        frame = working_frame(width, height)
        padded = padded_mask(mask, frame)
        inner = padded[frame.pad_y : frame.pad_y + frame.height]
        inner = inner[:, frame.pad_x : frame.pad_x + frame.width]
        assert (sample_mask(mask, frame.width, frame.height) == inner).all()


def test_half_a_pixel_is_enough_where_a_mask_is_sampled() -> None:
    mask = np.zeros((300, 2000), dtype=bool)
    mask[31:201, 501:1801] = True
    small = sample_mask(mask, 1000, 150)
    assert small.shape == (150, 1000) and small.sum() == 86 * 651 - 4  # corners: a quarter
    assert (small[::-1, ::-1] == sample_mask(mask[::-1, ::-1], 1000, 150)).all()
    tiny = np.random.default_rng(3).random((16, 8)) > 0.5
    assert (sample_mask(tiny, 512, 1024) == np.kron(tiny, np.ones((64, 64), dtype=bool))).all()


# Reading sequences: folders in the order of their numbers, and what is no sequence.


def _bar(at: int, size: tuple[int, int] = (64, 48)) -> Image.Image:
    image = Image.new("L", size, 255)
    ImageDraw.Draw(image).rectangle([at, 10, at + 8, 30], fill=0)
    return image


def _write_gif(path: Path, *at: int) -> None:
    first, *others = (_bar(k) for k in at)
    first.save(path, save_all=True, append_images=others, duration=80)


def _left(mask: np.ndarray) -> int:
    return int(np.flatnonzero(mask.any(0))[0])


def test_a_folder_is_read_in_the_order_of_its_numbers(tmp_path: Path) -> None:
    for number in (10, 2, 1):
        _bar(4 * number).save(tmp_path / f"step{number}.png")
    (tmp_path / "notes.txt").write_text("no picture")
    _write_gif(tmp_path / "step0.gif", 4, 20)  # the animation that they make
    found = read_frames([str(tmp_path)])
    assert [_left(t.mask) for t in found] == [4, 8, 40]
    assert [t.name for t in found] == ["frame-01", "frame-02", "frame-03"]


def test_a_folder_may_hold_any_suffix_that_can_be_read(tmp_path: Path) -> None:
    for number, suffix in enumerate(("jfif", "jpe", "apng", "dib"), start=1):
        kind = {"apng": "PNG", "dib": "BMP"}.get(suffix, "JPEG")
        _bar(4 * number).save(tmp_path / f"{number}.{suffix}", kind)
    assert [_left(t.mask) for t in read_frames([str(tmp_path)])] == [4, 8, 12, 16]
    assert len(list_tasks([str(tmp_path)], BuildOptions())) == 4


def test_several_pictures_keep_their_order(tmp_path: Path) -> None:
    for number in (1, 2):
        _bar(4 * number).save(tmp_path / f"{number}.png")
    found = read_frames(["2.png", "1.png"], base=tmp_path)
    assert [_left(t.mask) for t in found] == [8, 4]


def test_a_frame_that_claims_a_huge_size_is_told_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "walk.gif"
    _write_gif(path, 4, 20, 36)
    data = path.read_bytes()
    size = data.rindex(b"\x21\xf9\x04") + 13  # where the last frame has its size
    path.write_bytes(data[:size] + b"\xff\xff\xff\xff" + data[size + 4 :])
    assert _left(read_target(path).mask) == 4  # the first of them


def test_frames_invert(tmp_path: Path) -> None:
    for number in (1, 2):
        _bar(16 * number).save(tmp_path / f"{number}.png")
    frames = [str(tmp_path)]
    plain, turned = read_frames(frames), read_frames(frames, Reading(invert=True))
    assert all((a.mask ^ b.mask).all() for a, b in zip(plain, turned, strict=True))


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("empty", "no picture"), ("one", "one picture"), ("moving", "one picture"),
        ("still.png", "one picture"), ("many", "more than"), ("sizes", "frame 2 is 64 x 64 px"),
        ("blank", "2.png: it is all one colour"), ("missing", "there is no such file"),
        ("pattern", "no picture"),
    ],
)  # fmt: skip
def test_what_is_no_sequence_is_refused(tmp_path: Path, kind: str, why: str) -> None:
    source, gif = tmp_path, tmp_path / "film.gif"
    blank = Image.new("L", (64, 48), 255)
    if kind in ("one", "sizes", "blank", "still.png"):
        _bar(4).save(tmp_path / "1.png")
    if kind in ("sizes", "blank"):
        (_bar(4, (64, 64)) if kind == "sizes" else blank).save(tmp_path / "2.png")
    elif kind == "many":
        for number in range(MOST_FRAMES + 1):
            (tmp_path / f"{number}.png").write_bytes(b"")
    elif kind == "moving":
        source = gif
        _write_gif(gif, 4, 20)
    elif kind in ("still.png", "missing", "pattern"):
        source = tmp_path / {"still.png": "1.png", "missing": "no.gif", "pattern": "a-*.png"}[kind]
    with pytest.raises(InputError, match=why):
        read_frames([str(source)])


def test_frames_are_cropped_to_one_box(tmp_path: Path) -> None:
    for k in range(3):
        pixels = np.full((90, 120), 255, dtype=np.uint8)
        pixels[30:60, 20 + 20 * k : 40 + 20 * k] = 0
        Image.fromarray(pixels).save(tmp_path / f"{k}.png")
    found = read_frames([str(tmp_path)], Reading(crop_px="auto"))
    ((height, width),) = {t.mask.shape for t in found}
    assert 60 < width < 90 and 30 < height < 50
    assert [t.mask.sum() for t in found] == [600] * 3


def test_pieces_that_lie_apart_are_told_before_a_search(tmp_path: Path) -> None:
    for number, gap in enumerate((0, 6, 12), start=1):
        image = _bar(8)
        pen = ImageDraw.Draw(image)
        pen.rectangle([17 + gap, 10, 25 + gap, 30], fill=0)
        pen.point((60, 45), fill=0)  # a crumb is no piece
        image.save(tmp_path / f"{number}.png")
    found = read_frames([str(tmp_path)])
    assert [target.pieces for target in found] == [1, 2, 2]
    told = tell_apart(found, 1)
    assert told is not None and told.startswith("In frame 2, 3 pieces lie apart")
    assert "In every frame" in (tell_apart(found[1:], 1) or "")
    assert tell_apart(found[:1], 1) is None and tell_apart(found[1:], 2) is None


def test_there_is_a_knot_for_each_piece_that_all_frames_have(tmp_path: Path) -> None:
    for number, at in enumerate((30, 40, 17), start=1):
        image = _bar(8)
        ImageDraw.Draw(image).rectangle([at, 10, at + 8, 30], fill=0)
        image.save(tmp_path / f"{number}.png")
    frames = read_frames([str(tmp_path)])
    assert count_knots(frames[:2]) == count_knots(frames[:2], 2) == 2
    assert count_knots(frames[:2], 1) == count_knots(frames) == 1
    with pytest.raises(InputError, match=r"frame 3 has another number of pieces \(1\)"):
        count_knots(frames, 2)
