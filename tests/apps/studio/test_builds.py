"""What a studio keeps: every build with its pictures and settings, through restarts and odd folders."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from command import killed_build, picture, square
from played_runs import write_player

pytest.importorskip("starlette", reason="the studio needs starlette: pip install 'knotfab[studio]'")
from starlette.testclient import TestClient

from knotfab.apps.studio import session
from knotfab.apps.studio.builds import Builds, Record, describe_folder, number
from knotfab.apps.studio.fields import FIELDS, in_page_words
from knotfab.apps.studio.run import make_app
from knotfab.apps.studio.session import Studio

HOST, TOKEN = "127.0.0.1:8000", "the-token-of-the-address"


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Builds and previews are played; the folder that keeps a line a run."""
    script, runs = write_player(tmp_path)
    monkeypatch.setattr("sys.executable", str(script))
    monkeypatch.setattr(session, "preview", lambda *_: ({"lines": [], "panels": []}, []))
    return runs


@contextmanager
def opened(folder: Path) -> Iterator[Callable[..., Any]]:
    """A studio's page: `ask(path, **body)` is the answer, `ask()` the state."""
    app = make_app(Studio(folder, warm=False), TOKEN, (HOST,))
    with TestClient(app, base_url=f"http://{HOST}", headers={"origin": f"http://{HOST}"}) as client:
        client.get(f"/?token={TOKEN}")

        def ask(path: str = "", **body: Any) -> Any:
            if not path:
                return client.get("/api/state").json()
            answer = client.post(f"/api/{path}", json=body)
            assert answer.status_code in (200, 422), answer.text
            return answer.json().get("sentence", "")

        yield ask


def built(
    ask: Callable[..., Any], text: str = "", go_on: bool = False, **settings: Any
) -> dict[str, Any]:
    """Build what is chosen, or a text that says how it goes; the state at its end."""
    if text:
        assert ask("text", text=text) == ""
    assert ask("settings", **settings) == ""
    assert ask("build", go_on=go_on) == ""
    until = time.monotonic() + 120
    while time.monotonic() < until:
        state: dict[str, Any] = ask()
        if state["build"]["phase"] in ("done", "rejected", "stopped", "failed"):
            return state
        time.sleep(0.02)
    raise AssertionError(state["build"])


def test_builds_are_numbered_and_an_old_one_comes_back_whole(runs: Path, tmp_path: Path) -> None:
    with opened(tmp_path / "studio") as ask:
        built(ask, "pass", width=120)
        built(ask, width=150, tube_radius="1,5")
        state = built(ask, "fail")
        assert [b["title"] for b in state["builds"]] == ["fail", "pass 2", "pass"]
        assert state["builds"][0]["phase"] == "rejected" and state["current"] == "fail"
        assert ask("open", name="pass") == ""
        state = ask()
        assert (state["chosen"], state["settings"]["width"]) == (["pass"], 120)
        assert "tube_radius" not in state["settings"] and state["current"] == "pass"
        assert state["build"]["phase"] == "done" and state["build"]["result"]["where"] == "pass"
        assert ask("open", name="pass-2") == "" and ask()["settings"]["tube_radius"] == 1.5
        assert ask("open", name="pass-3").startswith("the build pass-3: there is none")
        built(ask, go_on=True)
    calls = (runs / "text:pass.runs").read_text().split()
    start = tmp_path / "studio" / "starts" / "pass-2.json"
    assert [c for c in calls if c.startswith("--start")] == [f"--start={start}"]


def test_a_restart_finds_everything_again(runs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "studio"
    with opened(folder) as ask:
        ask("text", text="one")
        ask("choose", names=["one"], kind="views")
        built(ask, "pass", lamp_distance="7in", mount="wall")
        before = ask()
    with opened(folder) as ask:
        after = ask()
    for key in ("pictures", "chosen", "kind", "settings", "builds", "current", "can_go_on"):
        assert after[key] == before[key], key
    assert (
        after["can_go_on"]
        and after["build"]["result"]
        and after["settings"]["lamp_distance"] == 177.8
    )
    (folder / "studio.json").write_text('{"pictures": 5}')  # a later or a broken studio wrote it
    with opened(folder) as ask:
        assert ask()["pictures"] == [] and len(ask()["builds"]) == 1


def test_a_build_is_renamed_and_deleted(runs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "studio"
    with opened(folder) as ask:
        built(ask, "pass")
        built(ask)
        assert ask("rename", name="pass", title="  Käthes Katze\n") == ""
        assert "another build has it" in ask("rename", name="pass-2", title="Käthes Katze")
        assert "empty" in ask("rename", name="pass", title=" ")
        assert {b["title"] for b in ask()["builds"]} == {"Käthes Katze", "pass 2"}
        assert "none of that name" in ask("delete", name="../pictures")
        assert ask("delete", name="pass-2") == ""
        state = ask()
        assert [b["name"] for b in state["builds"]] == ["pass"] and state["build"][
            "phase"
        ] == "idle"
        assert built(ask, "pass")["current"] == "pass-2"  # the number is free again
    assert sorted(p.name for p in (folder / "builds").iterdir()) == ["pass", "pass-2"]


def test_nothing_is_built_while_a_field_is_wrong(runs: Path, tmp_path: Path) -> None:
    with opened(tmp_path / "studio") as ask:
        ask("text", text="pass")
        assert ask("settings", tube_radius="thick", width=150).startswith(
            "Tube radius: This is no length"
        )
        state = ask()
        assert (
            state["wrong"]["tube_radius"]["text"] == "thick" and state["settings"]["width"] == 150
        )
        assert (
            ask("build")
            == "Tube radius: this is not right yet. Correct what is marked, then build."
        )
        assert ask("settings", tube_radius="2,5 mm") == "" and ask()["wrong"] == {}
        # each right by itself, but not together
        assert "sls" in ask("settings", printer="sls", material="pla")
        assert list(ask()["wrong"]) == ["material"] and "this is not right" in ask("build")
        assert ask("settings", material="pa12-sls") == "" and ask()["wrong"] == {}
        assert "--" not in "".join(ask("settings", **{name: "?"}) for name in FIELDS)
    assert list(runs.iterdir()) == []


def test_how_a_picture_is_read_goes_with_it(runs: Path, tmp_path: Path) -> None:
    with opened(tmp_path / "studio") as ask:
        ask("text", text="photo")
        ask("settings", specks=200, smooth="2,5", width=90)
        ask("text", text="logo")
        assert ask()["settings"].get("specks") is None and ask()["settings"]["width"] == 90
        ask("choose", names=["photo"])
        assert (ask()["settings"]["specks"], ask()["settings"]["smooth"]) == (200, 2.5)


@pytest.mark.slow
def test_views_and_frames_keep_their_order(runs: Path, tmp_path: Path) -> None:
    with opened(tmp_path / "studio") as ask:
        for text in "abcde":
            ask("text", text=text)
        assert "there are 5" in ask("choose", names=[*"abcde"], kind="views")
        assert ask("choose", names=[*"cab"], kind="views") == "" and ask()["chosen"] == [*"cab"]
        assert ask("remove", name="a") == "" and ask()["chosen"] == ["c", "b"]
        assert ask("choose", names=[*"edcb"], kind="frames") == ""
        ask("text", text="pass")
        state = built(ask)
        assert state["chosen"] == [*"edcb", "pass"] and state["build"]["title"] == "e, moving"
        assert "--sequence" in (runs / "text:e.runs").read_text()
        assert not (tmp_path / "studio" / "pictures" / "a.txt").exists()
        ask("remove", name="b")  # a build was made of it
        assert (tmp_path / "studio" / "pictures" / "b.txt").exists()
        assert ask("open", name="e-frames") == "" and ask()["chosen"] == [*"edcb", "pass"]


def test_one_odd_build_leaves_the_others(runs: Path, tmp_path: Path) -> None:
    odd = [
        "[1]",
        "5",
        '{"views": 7}',
        '{"verdict": "good"}',
        '{"views": [{"iou": "high"}]}',
        "{",
        "[" * 10**5,
    ]
    odd += ['{"print": {"bounding_box_mm": {"a": 1}}}', "\ud800", '{"views": [{"iou": NaN}]}']
    builds = tmp_path / "studio" / "builds"
    for k, text in enumerate(odd):
        (builds / f"odd-{k}").mkdir(parents=True)
        (builds / f"odd-{k}" / "report.json").write_bytes(text.encode(errors="surrogatepass"))
    (builds / "dir" / "report.json").mkdir(parents=True)
    (builds / "file").write_text("")
    (tmp_path / "studio" / "records").mkdir()
    (tmp_path / "studio" / "records" / "odd-1.json").write_text('{"title": []}')
    with opened(tmp_path / "studio") as ask:
        state = built(ask, "pass")
        assert state["builds"][0]["result"]["verdict"] == "good"
        assert {b["name"] for b in state["builds"]} == {
            "pass",
            *(f"odd-{k}" for k in range(len(odd))),
        }
        assert not any(b["result"]["readable"] for b in state["builds"][1:])
        assert ask("open", name="odd-0") == "" and ask()["current"] == "odd-0"


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_only_what_can_be_had_is_listed(tmp_path: Path) -> None:
    (tmp_path / "part.3mf").write_text("")
    (tmp_path / "table-1.3mf").write_text("")
    (tmp_path / "table-9.3mf").symlink_to("/etc/passwd")
    (tmp_path / "setup.pdf").mkdir()
    assert describe_folder(tmp_path, False)["files"] == ["part.3mf", "table-1.3mf"]


def test_a_build_that_ran_when_the_studio_was_killed(tmp_path: Path) -> None:
    builds = Builds(tmp_path)
    names = [builds.begin("cat", Record(title="cat")) for _ in range(3)]
    assert names == ["cat", "cat-2", "cat-3"]
    (tmp_path / "builds" / "cat").mkdir(parents=True)
    (tmp_path / "builds" / "cat" / "report.json").write_text("{}")
    builds.start_path("cat-2").parent.mkdir()
    builds.start_path("cat-2").write_text("knots")
    found = {b["title"]: b["phase"] for b in Builds(tmp_path).listed()}
    assert found == {"cat": "done", "cat 2": "stopped"}  # nothing is left of the third


def test_moves_of_a_killed_build_are_finished_before_a_list(tmp_path: Path) -> None:
    hidden = killed_build(tmp_path / "builds" / "cat", report__json='{"verdict": {"word": "good"}}')
    (listed,) = Builds(tmp_path).listed()
    assert listed["phase"] == "done" and listed["result"]["verdict"] == "good"
    assert not hidden.exists()


def test_moves_that_came_with_a_folder_are_not_done(tmp_path: Path) -> None:
    folder = tmp_path / "builds" / "cat"
    hidden = folder / ".knotfab-x"
    hidden.mkdir(parents=True)
    (folder / "report.json").write_text("{}")
    (hidden / "evil").write_text("evil")
    (hidden / "moves.json").write_text(json.dumps([["evil", "../../victim"]]))
    assert [b["phase"] for b in Builds(tmp_path).listed()] == ["done"]
    assert not (tmp_path / "victim").exists() and (hidden / "evil").exists()


def test_names_are_told_apart_as_disks_do() -> None:
    assert number("Cat", ["cat", "CAT 2"], " ") == "Cat 3" and number("dog", ["cat"], "-") == "dog"


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("so wide (--width 120), or --invert.", "so wide (“Width on the wall”: 120), or “Invert”."),
        ("or --accept unrecognisable.", "or “Build it even if nobody would know it”."),
        ("(--sequence takes them all)", "(“Sequence” takes them all)"),
        ("one of --height and --seed", "one of “Height on the wall” and “Seed”"),
        ("--no-such thing -- stays", "--no-such thing -- stays"),
    ],
)  # fmt: skip
def test_a_sentence_of_the_command_line_in_the_page_s_words(said: str, shown: str) -> None:
    assert in_page_words(said) == shown


def test_a_picture_is_removed_and_dropped_again(runs: Path, tmp_path: Path) -> None:
    data = picture(tmp_path / "white.png", square(64)).read_bytes()
    studio = Studio(tmp_path / "studio", warm=False)
    app = make_app(studio, TOKEN, (HOST,))
    with TestClient(app, base_url=f"http://{HOST}", headers={"origin": f"http://{HOST}"}) as page:
        page.get(f"/?token={TOKEN}")
        page.post("/api/pictures?name=white.png", content=data)
        assert page.get("/pictures/white.png").status_code == 200
        page.post("/api/remove", content=json.dumps({"name": "white"}))
        assert page.get("/pictures/white.png").status_code == 404
        assert not (tmp_path / "studio" / "pictures" / "white.png").exists()
        assert page.post("/api/pictures?name=white.png", content=data).json() == {"name": "white"}


def test_ways_to_read_a_picture_fill_the_fields(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ways = [{"settings": {"ink": "dark", "specks": 40, "smooth": None}, "refused": False}]
    unclear = {"lines": [], "panels": ["it"], "unclear": True}
    monkeypatch.setattr(session, "preview", lambda *_: (dict(unclear), [b"panel"]))
    monkeypatch.setattr(session, "list_ways", lambda *_: (ways, [b"thumbnail"]))
    studio = Studio(tmp_path / "studio", warm=False)
    app = make_app(studio, TOKEN, (HOST,))
    with TestClient(app, base_url=f"http://{HOST}", headers={"origin": f"http://{HOST}"}) as page:
        page.get(f"/?token={TOKEN}")
        page.post("/api/text", content=json.dumps({"text": "photo"}))
        until = time.monotonic() + 120
        while not (shown := page.get("/api/state").json()["preview"]).get("ways"):
            assert time.monotonic() < until
            time.sleep(0.02)
        assert page.get("/preview/0.png").content == b"panel"
        assert page.get("/preview/1.png").content == b"thumbnail"
        assert page.get("/preview/2.png").status_code == 404
        answer = page.post("/api/settings", content=json.dumps(shown["ways"][0]["settings"]))
        assert answer.status_code == 200
        settings = page.get("/api/state").json()["settings"]
        assert (settings["ink"], settings["specks"]) == ("dark", 40) and "smooth" not in settings
