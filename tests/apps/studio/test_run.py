"""The end of a studio with its build, and what its page makes of the ways to read a picture."""

from __future__ import annotations

import io
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from benchmarks.studio_times import begin_build, open_studio
from knotfab.apps.studio import pictures
from knotfab.apps.studio.fields import in_page_words, read_field
from knotfab.pipeline.options import BuildOptions
from knotfab_formats.errors import InputError

pytest.importorskip("starlette", reason="the studio needs starlette: pip install 'knotfab[studio]'")


# tests/apps/studio/test_server.py interrupts a studio at rest, tests/cli/test_summary.py a builder's build
@pytest.mark.study
@pytest.mark.skipif(sys.platform == "win32", reason="the signal is that of other systems")
def test_ctrl_c_ends_a_studio_and_its_build(monkeypatch: pytest.MonkeyPatch) -> None:
    """`make studio-times` prints how soon."""
    monkeypatch.setenv("KNOTFAB_JOBS", "1")
    with open_studio() as (studio, page, address):
        begin_build(page, address)
        found = subprocess.run(["pgrep", "-P", str(studio.pid)], capture_output=True, text=True)
        children = [int(line) for line in found.stdout.split()]
        studio.send_signal(signal.SIGINT)
        assert studio.wait(60) == 0 and children
        assert not any(Path(f"/proc/{child}").exists() for child in children)


# What the page makes of readings of a picture.


def test_a_subject_that_is_offered_fills_its_field(monkeypatch: pytest.MonkeyPatch) -> None:
    one: Any = SimpleNamespace(keys={"subject_px": (1, 2, 30, 40)}, refusal=None, thumbnail=bytes)
    monkeypatch.setattr(pictures, "list_readings", lambda *_: [one])
    (way,), _ = pictures.list_ways(["photo.jpg"], BuildOptions(), {})
    assert read_field("subject", way["settings"]["subject"]) == "1,2,30,40"
    told = "Cut it out: --subject LEFT,TOP,WIDTH,HEIGHT, a rectangle about it, and --drop X,Y,R."
    wanted = "Cut it out: “Subject”, a rectangle about it, and “Does not belong”."
    assert in_page_words(told) == wanted


@pytest.mark.slow
def test_the_cut_over_a_photograph_is_in_its_own_px(tmp_path: Path) -> None:
    """A photograph of 1500 px is drawn at 1024: clear on the ball, shaded elsewhere, a hole where dropped."""
    v, u = np.mgrid[:1000, :1500]
    ball = np.hypot(u - 900, v - 500) < 300
    photo = np.random.default_rng(1).normal(0, 9, (1000, 1500, 3)) + np.where(
        ball[..., None], (200, 90, 60), (90, 110, 150)
    )
    Image.fromarray(photo.clip(0, 255).astype(np.uint8)).save(tmp_path / "ball.png")
    asked = BuildOptions(subject="500,100,800,800", drop=("900,500,60",))
    drawn = pictures.draw_cut(str(tmp_path / "ball.png"), asked)
    sheet = np.asarray(Image.open(io.BytesIO(drawn)))
    assert sheet.shape == (683, 1024, 4)
    clear = sheet[..., 3] == 0
    scale = 1024 / 1500
    y, x = np.mgrid[:683, :1024]
    off = np.hypot(x - 900 * scale, y - 500 * scale) / scale
    assert clear[(off > 75) & (off < 290)].all()
    assert not clear[(off < 50) | (off > 310)].any()
    with pytest.raises(InputError, match="no rectangle of at least"):
        pictures.draw_cut(str(tmp_path / "ball.png"), BuildOptions(subject="1400,0,400,400"))


def test_a_reading_that_the_page_has_no_field_for_is_not_offered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def reading(**keys: Any) -> Any:
        return SimpleNamespace(keys=keys, refusal=None, thumbnail=lambda: b"picture")

    found = [reading(ink="dark", speck_px=9), reading(keep_px=((1, 2, 3),))]
    monkeypatch.setattr(pictures, "list_readings", lambda *_: found)
    ways, thumbnails = pictures.list_ways(["photo.jpg"], BuildOptions(), {"smooth": "2"})
    assert len(ways) == len(thumbnails) == 1
    assert ways[0]["settings"]["ink"] == "dark" and ways[0]["settings"]["specks"] == 9
