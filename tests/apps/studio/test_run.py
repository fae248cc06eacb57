"""`knotfab build --watch`: the page of one build, which shows it and nothing else, and ends by itself."""

from __future__ import annotations

import asyncio
import io
import json
import signal
import subprocess
import sys
import time
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
from starlette.testclient import TestClient

from knotfab.apps.studio.run import WatchedBuild, make_app
from knotfab.cli.commands import open_page

HOST, TOKEN = "127.0.0.1:8000", "the-token-of-the-address"


def write_built(tmp_path: Path) -> Path:
    out = tmp_path / "cat"
    (out / "rejected").mkdir(parents=True)
    (tmp_path / "beside").mkdir()
    for folder in (out, out / "rejected", tmp_path / "beside"):
        (folder / "report.html").write_text(f"report of {folder.name}")
        (folder / "report.json").write_text('{"verdict": {"word": "good"}}')
    return out


def lines(*events: dict[str, object]) -> io.StringIO:
    return io.StringIO("".join(json.dumps(event) + "\n" for event in events))


def follow(out: Path, *events: dict[str, object], broken: str = "") -> WatchedBuild:
    studio = WatchedBuild(out)
    told = io.StringIO(lines(*events).getvalue() + broken)
    asyncio.run(studio.follow(told, grace_s=0))
    return studio


def test_it_shows_its_build_and_can_change_nothing(tmp_path: Path) -> None:
    out = write_built(tmp_path)
    app = make_app(WatchedBuild(out), TOKEN, (HOST,))
    with TestClient(app, base_url=f"http://{HOST}", headers={"origin": f"http://{HOST}"}) as page:
        page.get(f"/?token={TOKEN}")
        state = page.get("/api/state").json()
        assert state["watching"] and state["build"]["phase"] == "running" and "builds" not in state
        assert page.get("/files/cat/report.html").text == "report of cat"
        assert page.get("/files/cat/rejected/report.html").text == "report of rejected"
        for path in ("beside/report.html", "cat/../beside/report.html", "cat/rejected/../x"):
            assert page.get(f"/files/{path}").status_code == 404
        for path in ("pictures", "text", "settings", "build", "stop", "choose"):
            assert page.post(f"/api/{path}", json={}).status_code == 404
    assert not (tmp_path / "pictures").exists()


def test_how_the_build_ended_is_shown(tmp_path: Path) -> None:
    out = write_built(tmp_path)
    begun = {"event": "stage", "name": "search", "seconds": 1.0, "left_s": 9.0}
    for code, phase, where in ((0, "done", "cat"), (1, "rejected", "cat/rejected")):
        studio = follow(out, begun, {"event": "end", "exit_code": code, "folder": str(out)})
        assert studio.status["phase"] == phase and studio.status["result"]["where"] == where
    for broken in ("", '{"event": "sta'):  # killed
        studio = follow(out, begun, broken=broken)
        assert studio.status["phase"] == "failed" and "result" not in studio.status
        assert "terminal says why" in studio.status["sentence"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the browser is played by a script")
def test_it_ends_with_its_build_where_nobody_looks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    browser = tmp_path / "browser"
    browser.write_text(f"#!/bin/sh\necho \"$1\" > '{tmp_path}/address'\n")
    browser.chmod(0o755)
    monkeypatch.setenv("BROWSER", str(browser))
    said: list[str] = []
    with open_page(tmp_path / "out", said.append, grace_s=0) as (events, child):
        events.write('{"event": "say", "text": "a remark"}\n')
        until = time.monotonic() + 60
        while not (said and (tmp_path / "address").exists()) and time.monotonic() < until:
            time.sleep(0.05)
    assert said[0].removeprefix("Watch it at ") == (tmp_path / "address").read_text().strip()
    assert child.wait(30) == 0


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
