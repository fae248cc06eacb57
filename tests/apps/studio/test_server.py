"""The studio's server: its own page may do all, others nothing; a mishap is one sentence and loses nothing.

Builds are played by a script, which does what the picture's text says.
"""

import asyncio
import io
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command import picture, square
from PIL import Image
from played_runs import write_player

pytest.importorskip("starlette", reason="the studio needs starlette: pip install 'knotfab[studio]'")
from starlette.requests import Request
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from knotfab.apps import commands
from knotfab.apps.studio import broadcast, pictures, run, session
from knotfab.apps.studio.pictures import LARGEST_BYTES
from knotfab.apps.studio.run import CALLS, make_app
from knotfab.apps.studio.session import Studio
from knotfab.pipeline.options import options_from
from knotfab.scene.catalogue import resolve
from knotfab_formats.errors import InputError
from knotfab_formats.scene import Scene

HOST, TOKEN = "127.0.0.1:8000", "the-token-of-the-address"
ORIGIN, LIVE = {"origin": f"http://{HOST}"}, f"ws://{HOST}/live"


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Builds and previews are played; the folder that keeps a line a run."""
    script, runs = write_player(tmp_path)
    monkeypatch.setattr("sys.executable", str(script))
    monkeypatch.setattr(
        session, "preview", lambda *_: ({"lines": [], "error": "", "panels": []}, [])
    )
    return runs


@pytest.fixture
def client(runs: Path, tmp_path: Path) -> Iterator[TestClient]:
    """A browser that was let in."""
    studio = Studio(tmp_path / "studio", warm=False)
    app = make_app(studio, TOKEN, 8000)
    with TestClient(app, base_url=f"http://{HOST}", headers=ORIGIN) as client:
        client.get(f"/?token={TOKEN}")
        yield client


def ask(client: TestClient, path: str, **data: Any) -> Any:
    return client.post(path, json=data)


def wait_for(client: TestClient, *phases: str) -> dict[str, Any]:
    until = time.monotonic() + 120
    while time.monotonic() < until:
        state: dict[str, Any] = client.get("/api/state").json()
        if state["build"]["phase"] in phases and state["build"].get("stage") != "start":
            return state
        time.sleep(0.02)
    raise AssertionError(state["build"])


def build(client: TestClient, told: str, *phases: str) -> dict[str, Any]:
    """Build a text that says how it shall go."""
    assert ask(client, "/api/text", text=told).status_code == 200
    assert ask(client, "/api/build").status_code == 200
    return wait_for(client, *(phases or ("done", "rejected", "stopped", "failed")))


def refuse(answer: Any, code: int, why: str) -> None:
    sentence = answer.text if code in (403, 404) else answer.json()["sentence"]
    assert answer.status_code == code and why in sentence, answer.text
    assert "\n" not in sentence and sentence[-1] in ".!"


def test_the_token_becomes_a_cookie_that_only_this_page_sends(tmp_path: Path) -> None:
    app = make_app(Studio(tmp_path, warm=False), TOKEN, 8000)
    stranger = TestClient(app, base_url=f"http://{HOST}")
    for path in ("/", "/?token=guess", "/api/state", "/static/studio.js", "/pictures/a.png"):
        answer = stranger.get(path)
        assert answer.status_code == 403 and "token" in answer.text
    answer = stranger.get(f"/?token={TOKEN}")
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie and "samesite=strict" in cookie
    # the cookie of another page on this machine
    others = {"cookie": f'prefs={{"a":1}}; knotfab-8000={TOKEN}'}
    assert TestClient(app, base_url=f"http://{HOST}").get("/", headers=others).status_code == 200
    page = stranger.get("/")
    assert page.status_code == 200 and TOKEN not in page.text
    policy = page.headers["content-security-policy"]
    assert "script-src 'self';" in policy and "unsafe" not in policy
    assert page.headers["x-content-type-options"] == "nosniff"
    for name, kind in (("studio.js", "text/javascript"), ("studio.css", "text/css")):
        assert stranger.get(f"/static/{name}").headers["content-type"].startswith(kind)


def test_other_hosts_and_origins_reach_nothing(client: TestClient, runs: Path) -> None:
    ask(client, "/api/text", text="pass")
    evil = {"origin": "http://evil.example"}
    for headers in (evil, {"host": "evil.example:8000"}, {"origin": "null"}):
        refuse(client.post("/api/build", json={}, headers=headers), 403, "elsewhere")
        with pytest.raises(WebSocketDisconnect), client.websocket_connect(LIVE, headers=headers):
            pass
    del client.headers["origin"]
    refuse(client.post("/api/build", json={}), 403, "elsewhere")
    with pytest.raises(WebSocketDisconnect), client.websocket_connect(LIVE):
        pass
    assert list(runs.iterdir()) == []


def test_a_tunnel_may_change_the_port(client: TestClient) -> None:
    for host in ("localhost:9000", "127.0.0.1", "[::1]:8000"):
        here = {"host": host, "origin": f"http://{host}"}
        assert client.post("/api/text", json={"text": "pass"}, headers=here).status_code == 200
        other = {"host": host, "origin": "http://localhost:3000"}
        refuse(client.post("/api/build", json={}, headers=other), 403, "elsewhere")


def test_a_new_picture_replaces_the_old_at_once(client: TestClient) -> None:
    studio = client.app.state.studio  # type: ignore[attr-defined]
    ask(client, "/api/text", text="pass")
    studio.preview = {"lines": ["of the old one"], "error": "", "panels": ["old"]}
    ask(client, "/api/text", text="fail")
    preview = client.get("/api/state").json()["preview"]
    assert preview["lines"] == preview["panels"] == []


def test_what_is_no_picture(client: TestClient, tmp_path: Path) -> None:
    def hand_in(data: bytes, name: str) -> Any:
        return client.post(f"/api/pictures?name={name}", content=data)

    refuse(hand_in(b"I am no picture.\n", "words.png"), 422, "words.png: it is not a picture")
    refuse(hand_in(b"", "empty.png"), 422, "empty")
    refuse(hand_in(b"\x1f\x8b" + b"x" * 40, "packed.svgz"), 422, "packed.svgz: it is")
    refuse(hand_in(b"\x89PNG\r\n\x1a\n" + b"x" * LARGEST_BYTES, "huge.png"), 413, "more than 32 MB")
    outside = b'<svg xmlns="http://www.w3.org/2000/svg"><image href="file:///etc/passwd"/></svg>'
    refuse(hand_in(outside, "outside.svg"), 422, "outside the file")
    assert client.get("/api/state").json()["picture"] is None
    assert not (tmp_path / "studio" / "pictures").exists()


@pytest.mark.slow
def test_what_was_uploaded_is_served_as_pixels_alone(client: TestClient, tmp_path: Path) -> None:
    svg = (
        b'<svg xmlns="http://www.w3.org/2000/svg" width="64" height="64">'
        b'<circle cx="32" cy="32" r="20"/></svg>'
    )
    name = client.post("/api/pictures?name=../../drawn.svg", content=svg).json()["name"]
    assert name == "drawn"
    shown = client.get("/pictures/drawn.png")
    assert shown.headers["content-type"] == "image/png"
    assert np.asarray(Image.open(io.BytesIO(shown.content)).getchannel("A")).std() > 10
    kept = tmp_path / "studio" / "pictures"
    assert [p.name for p in kept.glob("[!.]*")] == ["drawn.svg"]
    for path in ("/pictures/drawn.svg", "/files/drawn/drawn.svg", "/files/..%2fpictures/drawn.svg"):
        assert client.get(path).status_code == 404


@pytest.mark.slow
def test_no_two_pictures_share_a_name(client: TestClient, tmp_path: Path) -> None:
    """Uploads and texts, of earlier sessions too, have names that no disk takes for the same."""
    data = [picture(tmp_path / "p.png", square(px)).read_bytes() for px in (64, 96)]
    kept = tmp_path / "studio" / "pictures"
    kept.mkdir(parents=True)
    (kept / "cat.png").write_bytes(b"of an earlier session")

    def hand_in(name: str, number: int = 0) -> str:
        return str(client.post(f"/api/pictures?name={name}", content=data[number]).json()["name"])

    def type_in(text: str) -> str:
        return str(ask(client, "/api/text", text=text).json()["name"])

    assert hand_in("cat.png") == "cat-2" and (kept / "cat.png").read_bytes()[:2] == b"of"
    assert [hand_in("dog.png"), type_in("dog"), hand_in("DOG.png", 1)] == ["dog", "dog-2", "DOG-3"]
    assert [hand_in("dog.png"), type_in("A"), type_in("A!"), type_in("A")] == [
        "dog",
        "A",
        "A-2",
        "A",
    ]
    assert (kept / "dog.png").read_bytes() == data[0]


def test_a_failed_build_is_not_shown_with_an_earlier_report(
    client: TestClient, tmp_path: Path
) -> None:
    earlier = tmp_path / "studio" / "builds" / "crash" / "rejected"
    earlier.mkdir(parents=True)
    (earlier / "report.json").write_text("{}")
    state = build(client, "crash")["build"]
    assert (state["phase"], state["sentence"]) == ("failed", "out of ideas")
    assert "result" not in state and state["name"] != "crash"


def test_a_build_that_cannot_be_started_has_failed(
    client: TestClient, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("sys.executable", str(tmp_path / "nowhere"))
    ask(client, "/api/text", text="pass")
    assert ask(client, "/api/build").status_code == 200
    until = time.monotonic() + 120
    while (state := client.get("/api/state").json()["build"])["phase"] != "failed":
        assert time.monotonic() < until
        time.sleep(0.02)
    assert "cannot be started" in state["sentence"]


def test_a_second_stop_does_not_break_into_the_tidying_up(tmp_path: Path) -> None:
    studio, calls = Studio(tmp_path, warm=False), []
    studio.build = SimpleNamespace(stop=lambda: calls.append("stop"))  # type: ignore[assignment]
    studio.status = {"phase": "running"}
    studio.stop()
    studio.stop()
    assert calls == ["stop"] and studio.status["phase"] == "stopping"


def test_an_upload_that_breaks_off_is_a_sentence() -> None:
    async def receive() -> dict[str, str]:
        return {"type": "http.disconnect"}

    with pytest.raises(InputError, match="it broke off"):
        asyncio.run(
            run._read_body(Request({"type": "http", "headers": []}, receive), 10, "cat.png")
        )


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="a terminal that closes sends no signal")
@pytest.mark.parametrize(("how", "said"), [(signal.SIGHUP, "closed"), (signal.SIGINT, "")])
def test_the_studio_ends_with_its_terminal(how: signal.Signals, said: str, tmp_path: Path) -> None:
    code = (
        "import pathlib, signal, sys; from knotfab.apps.studio import run;"
        "signal.signal(signal.SIGHUP, signal.SIG_DFL);"  # whatever the tests were begun with
        "run.Studio.__init__.__defaults__ = (False,);"  # no worker is started early
        "run.run_studio(0, False, pathlib.Path(sys.argv[1]))"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None and "127.0.0.1" in child.stdout.readline()
        child.send_signal(how)
        assert said in child.stdout.read()
    assert child.returncode == 0


def test_a_build_leaves_its_folder_and_no_other_file_can_be_read(
    client: TestClient, runs: Path, tmp_path: Path
) -> None:
    ask(client, "/api/settings", size=150, mount="wall")
    result = build(client, "pass")["build"]["result"]
    assert [result[key] for key in ("where", "verdict", "piece")] == ["pass", "good", "9 mm, 5 g"]
    call = (runs / "text:pass.runs").read_text()
    assert "--size=150" in call and "--mount=wall" in call and "--print" in call
    assert client.get("/files/pass/part.3mf").text == "a part"
    report = client.get("/files/pass/report.html").headers["content-security-policy"]
    assert report.startswith("sandbox allow-scripts;") and "connect-src" not in report
    evil = client.get("/files/pass/evil.html")
    assert evil.headers["content-type"] == "application/octet-stream"
    assert "attachment" in evil.headers["content-disposition"]
    (tmp_path / "studio" / "builds" / "pass" / "link.png").symlink_to("/etc/passwd")
    secret = tmp_path / "studio" / "secret.png"
    secret.write_text("secret")
    for path in (
        "/files/pass/link.png", "/files/../secret.png", "/files/%2e%2e/secret.png", "/files/./secret.png",
        "/files/pass/..%2f..%2f..%2fsecret.png", "/files/pass/%2fetc%2fpasswd", "/static/..%2fserver.py",
    ):  # fmt: skip
        assert client.get(path).status_code == 404, path


def test_two_tabs_and_a_reload_in_the_middle_see_one_build(client: TestClient) -> None:
    with client.websocket_connect(LIVE) as one:
        assert one.receive_json()["build"]["phase"] == "idle"
        build(client, "wait", "running")
        seen: set[str] = set()
        while not {"scene", "knots"} <= seen:
            seen.add(one.receive_json()["event"])
        refuse(ask(client, "/api/build"), 422, "one runs already")
        with client.websocket_connect(LIVE) as two:  # a second tab, or the first loaded anew
            state, scene, frame = (two.receive_json() for _ in range(3))
            assert (state["build"]["phase"], state["build"]["stage"]) == ("running", "search")
            assert scene["event"] == "scene" and len(frame["curves"]) == 1
            assert state["settings"] == client.get("/api/state").json()["settings"]
            client.post("/api/stop", json={})
            while two.receive_json().get("build", {}).get("phase") != "stopped":
                pass


@pytest.mark.slow
def test_a_build_that_is_killed_fails_or_is_refused(client: TestClient, tmp_path: Path) -> None:
    builds = tmp_path / "studio" / "builds"
    assert build(client, "pass")["build"]["phase"] == "done"
    (builds / "kill").mkdir()
    (builds / "kill" / "part.3mf").write_text("earlier")
    state = build(client, "kill")["build"]
    assert state["phase"] == "failed" and "was killed (signal 9)" in state["sentence"]
    assert (builds / "kill" / "part.3mf").read_text() == "earlier"
    state = build(client, "wrong")["build"]
    assert state["phase"] == "failed" and state["sentence"] == "text:wrong: no picture. Draw one."
    state = build(client, "fail")["build"]
    assert state["phase"] == "rejected" and state["result"]["where"] == "fail/rejected"
    assert client.get("/files/fail/rejected/report.html").status_code == 200
    assert client.get("/files/pass/part.3mf").status_code == 200


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"out": "/tmp/elsewhere"}, "there is none of that name"),
        ({"scene": "/etc/passwd"}, "there is none of that name"),
        ({"printer": "../../etc/passwd"}, "not known"),
        ({"size": -3}, "Longer side on the wall: This is not above 0. Give millimetres from 0.001"),
        ({"plate": "round"}, "Plate: "), ({"smooth": "much"}, "Smooth: This is no number"),
        ({"tube_radius": 2}, "there is none of that name"), ({"size": [1]}, "there is none of that name"),
        ({"size": "abc"}, "no length"), ({"size": 10**50}, "up to 100000, such as 200."),
        ({"size": "9" * 5000}, "no more than 60"), ({"wall_distance": 0}, "Piece to wall"),
        ({"lamp_distance": "3 parsec"}, "There is no unit parsec"),
        ({"crop": "1,2,3"}, "left, top, width and height"), ({"font": "/etc/passwd"}, "not known"),
        ({"print": "perhaps"}, "neither on nor off"), ({"sequence": True}, "there is none of that name"),
    ],
)  # fmt: skip
def test_a_wrong_setting_changes_nothing(
    client: TestClient, given: dict[str, Any], why: str
) -> None:
    before = client.get("/api/state").json()["settings"]
    refuse(ask(client, "/api/settings", **given), 422, why)
    assert client.get("/api/state").json()["settings"] == before


def test_the_page_offers_what_its_options_take(client: TestClient) -> None:
    """Its words are values of the options, and what stands in an empty field is what a build takes."""
    text = (Path(run.__file__).parent / "static" / "fields.js").read_text(encoding="utf-8")
    offered = [
        (name, quoted or word)
        for name, words in re.findall(r'\["(\w+)", "(?:menu|choice)", \{(.*)\}\]', text)
        for quoted, word in re.findall(r'(?:^|, )(?:"([^"]*)"|(\w+)): "', words.strip())
    ]
    assert {"ink", "plate", "accuracy", "lamps"} <= {name for name, _ in offered}
    for name, word in offered:
        if word:
            assert ask(client, "/api/settings", **{name: word}).status_code == 200, (name, word)
    usual = client.get("/api/choices").json()["usual"]
    plain = resolve(Scene()).views[0]
    assert usual["lamp_distance"] == plain.light_distance_mm
    assert usual["wall_distance"] == plain.wall_distance_mm and usual["smooth"] == plain.smooth_px
    assert set(usual) >= set(re.findall(r'\["(\w+)", "range"', text))


def test_what_is_no_call(client: TestClient) -> None:
    refuse(ask(client, "/api/text", text="  "), 422, "0 characters")
    refuse(ask(client, "/api/open", name="nothing"), 422, "none of that name")
    refuse(ask(client, "/api/build"), 422, "no picture is chosen")
    refuse(client.get("/nowhere"), 404, "nothing at this address")
    for body in (
        b"{", b"[]", b"5", b"\xff", b"[" * 60_000, b'{"a":' * 10_000, b'{"text": NaN}', b'{"text": null}',
        b'{"text": "\\ud800"}', b'{"text": 7}', b'{"text": "a", "more": 1}', b"9" * 5000,
    ):  # fmt: skip
        refuse(client.post("/api/text", content=body), 422, "the call: ")
    for body in (
        b'{"name": 5}',
        b'{"name": null}',
        b'{"name": ["\\udfff"]}',
        b'{"name": ' + b"9" * 5000 + b"}",
    ):
        refuse(client.post("/api/open", content=body), 422, "the call: ")
    refuse(client.post("/api/settings", content=b'{"\\ud800": 1}'), 422, "the call: ")
    refuse(client.post("/api/settings", content=b'{"size": NaN}'), 422, "no length")
    refuse(client.post("/api/text", content=b" " * 100_000), 413, "more than 64 kB")
    assert client.get("/api/state").json()["picture"] is None


def test_what_a_tab_sends_through_its_socket_is_let_pass(client: TestClient) -> None:
    with client.websocket_connect(LIVE) as tab:
        tab.receive_json()
        tab.send_bytes(b"\x00\xff")
        tab.send_text("\ud83d\ude00")
        ask(client, "/api/text", text="pass")
        while tab.receive_json()["picture"] is None:
            pass


def test_what_nobody_foresaw_is_a_sentence_and_goes_to_a_file(
    client: TestClient, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("a mistake")

    monkeypatch.setitem(CALLS, "stop", fail)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    refuse(client.post("/api/stop", json={}), 500, "ZeroDivisionError")
    (kept,) = tmp_path.glob("knotfab-*.txt")
    assert "a mistake" in kept.read_text()


def test_the_studio_ends_its_build_with_itself(runs: Path, tmp_path: Path) -> None:
    studio = Studio(tmp_path / "studio", warm=False)
    app = make_app(studio, TOKEN, 8000)
    with TestClient(app, base_url=f"http://{HOST}", headers=ORIGIN) as client:
        client.get(f"/?token={TOKEN}")
        build(client, "wait", "running")
        (child,) = studio.builder.processes
    assert child.poll() is not None


def test_a_slow_tab_gets_the_latest_frame_alone() -> None:
    async def follow() -> list[str]:
        listener = broadcast.Listener()
        for k in range(1000):
            listener.put(f"frame {k}", frame=True)
        listener.put("state")
        return await listener.next()

    assert asyncio.run(follow()) == ["state", "frame 999"]


@pytest.mark.slow
def test_a_preview_says_what_is_lost_and_draws_it() -> None:
    figures, panels = pictures.preview(["text:I"], options_from({"width": 150}))
    assert figures["views"][0]["frame_mm"][0] == 150 and json.dumps(figures)
    assert len(figures["panels"]) == len(panels) == 1
    assert {max(Image.open(io.BytesIO(png)).size) for png in panels} == {720}


@pytest.mark.parametrize("asked", [None, 70_000, 2**40])
def test_a_port_that_is_refused_is_left_out(asked: int | None) -> None:
    usual = signature(commands.studio).parameters["port"].default
    with run._bind(usual) as taken:
        taken.listen()
        with pytest.raises(InputError, match=r"--port .*Leave it out"):
            run._bind(asked or taken.getsockname()[1])
        run._bind(usual).close()
