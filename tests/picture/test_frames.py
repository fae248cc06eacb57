"""Reading sequences: folders in the order of their numbers, animations, and what is no sequence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from knotfab.apps.batch.worker import list_tasks
from knotfab.picture.frames import MOST_FRAMES, count_knots, read_frames, tell_apart
from knotfab.pipeline.options import BuildOptions
from knotfab.render.part_picture import write_gif, write_shadows_gif
from knotfab_formats.errors import InputError
from knotfab_formats.views import Reading


def _bar(at: int, size: tuple[int, int] = (64, 48)) -> Image.Image:
    image = Image.new("L", size, 255)
    ImageDraw.Draw(image).rectangle([at, 10, at + 8, 30], fill=0)
    return image


def _left(mask: np.ndarray) -> int:
    return int(np.flatnonzero(mask.any(0))[0])


def test_a_folder_is_read_in_the_order_of_its_numbers(tmp_path: Path) -> None:
    for number in (10, 2, 1):
        _bar(4 * number).save(tmp_path / f"step{number}.png")
    (tmp_path / "notes.txt").write_text("no picture")
    write_gif(tmp_path / "step0.gif", [_bar(4), _bar(20)], 80)  # moves by itself: no frame
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


def test_an_animation_gives_all_its_frames(tmp_path: Path) -> None:
    path = tmp_path / "walk.gif"
    write_gif(path, [_bar(4), _bar(20), _bar(36)], 80)
    found = read_frames([str(path)])
    assert [_left(t.mask) for t in found] == [4, 20, 36]
    assert all(t.suffix == ".png" for t in found)


def test_frames_invert(tmp_path: Path) -> None:
    path = tmp_path / "walk.gif"
    write_gif(path, [_bar(4), _bar(20)], 80)
    plain, turned = read_frames([str(path)]), read_frames([str(path)], Reading(invert=True))
    assert all((a.mask ^ b.mask).all() for a, b in zip(plain, turned, strict=True))


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("empty", "no picture"),
        ("one", "one picture"),
        ("still", "one picture"),
        ("still.png", "one picture"),
        ("many", "more than"),
        ("damaged", "damaged"),
        ("sizes", "frame 2 is 64 x 64 px"),
        ("blank", "2.png: it is all one colour"),
        ("blank animation", "frame 2: it is all one colour"),
        ("missing", "there is no such file"),
        ("pattern", "no picture"),
    ],
)
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
    elif kind in ("still", "damaged", "blank animation"):
        source = gif
        frames = {"still": [], "damaged": [_bar(20), _bar(30)], "blank animation": [blank]}[kind]
        write_gif(gif, [_bar(4), *frames], 80)
        gif.write_bytes(gif.read_bytes()[: 60 if kind == "damaged" else None])
    elif kind in ("still.png", "missing", "pattern"):
        source = tmp_path / {"still.png": "1.png", "missing": "no.gif", "pattern": "a-*.png"}[kind]
    with pytest.raises(InputError, match=why):
        read_frames([str(source)])


def test_a_gif_repeats_and_runs_back_where_it_does_not_close(tmp_path: Path) -> None:
    files = []
    for number in range(4):
        files.append(tmp_path / f"{number}.png")
        _bar(4 + 10 * number).save(files[-1])
    for cyclic, expected in ((True, [4, 14, 24, 34]), (False, [4, 14, 24, 34, 24, 14])):
        path = tmp_path / "out.gif"
        write_shadows_gif(path, files, cyclic)
        assert [_left(t.mask) for t in read_frames([str(path)])] == expected
        with Image.open(path) as image:
            assert image.info["loop"] == 0


def test_a_gif_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="one size"):
        write_gif(tmp_path / "no.gif", [], 80)
    with pytest.raises(ValueError, match="one size"):
        write_gif(tmp_path / "no.gif", [_bar(1), _bar(1, (20, 20))], 80)


def test_frames_are_cropped_to_one_box(tmp_path: Path) -> None:
    for k in range(3):
        pixels = np.full((90, 120), 255, dtype=np.uint8)
        pixels[30:60, 20 + 20 * k : 40 + 20 * k] = 0
        Image.fromarray(pixels).save(tmp_path / f"{k}.png")
    found = read_frames([str(tmp_path)], Reading(crop_px="auto"))
    boxes = {t.crop_px for t in found}
    ((left, top, width, height),) = [box for box in boxes if box is not None]
    assert len(boxes) == 1 and left <= 20 and left + width >= 80
    assert top <= 30 and top + height >= 60 and (width, height) != (120, 90)
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
