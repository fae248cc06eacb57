"""What a studio keeps: every build with its pictures and settings, through restarts and odd folders."""

import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from command import killed_build
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
    app = make_app(Studio(folder, warm=False), TOKEN, 8000)
    with TestClient(app, base_url=f"http://{HOST}", headers={"origin": f"http://{HOST}"}) as client:
        client.get(f"/?token={TOKEN}")

        def ask(path: str = "", **body: Any) -> Any:
            if not path:
                return client.get("/api/state").json()
            answer = client.post(f"/api/{path}", json=body)
            assert answer.status_code in (200, 422), answer.text
            return answer.json().get("sentence", "")

        yield ask


def built(ask: Callable[..., Any], text: str = "", **settings: Any) -> dict[str, Any]:
    """Build what is chosen, or a text that says how it goes; the state at its end."""
    if text:
        assert ask("text", text=text) == ""
    assert ask("settings", **settings) == ""
    assert ask("build") == ""
    until = time.monotonic() + 120
    while time.monotonic() < until:
        state: dict[str, Any] = ask()
        if state["build"]["phase"] in ("done", "rejected", "stopped", "failed"):
            return state
        time.sleep(0.02)
    raise AssertionError(state["build"])


def test_builds_are_numbered_and_an_old_one_comes_back_whole(runs: Path, tmp_path: Path) -> None:
    with opened(tmp_path / "studio") as ask:
        built(ask, "pass", size=120)
        built(ask, size=150, smooth="1,5")
        state = built(ask, "fail")
        assert [b["title"] for b in state["builds"]] == ["fail", "pass 2", "pass"]
        assert state["builds"][0]["phase"] == "rejected" and state["current"] == "fail"
        assert ask("open", name="pass") == ""
        state = ask()
        assert (state["picture"]["name"], state["settings"]["size"]) == ("pass", 120)
        assert "smooth" not in state["settings"] and state["current"] == "pass"
        assert state["build"]["phase"] == "done" and state["build"]["result"]["where"] == "pass"
        assert ask("open", name="pass-2") == "" and ask()["settings"]["smooth"] == 1.5
        assert ask("open", name="pass-3").startswith("the build pass-3: there is none")
    assert "--smooth=1.5" in (runs / "text:pass.runs").read_text().splitlines()[1]


def test_a_restart_finds_everything_again(runs: Path, tmp_path: Path) -> None:
    folder = tmp_path / "studio"
    with opened(folder) as ask:
        ask("text", text="one")
        built(ask, "pass", lamp_distance="7in", mount="wall")
        before = ask()
    with opened(folder) as ask:
        after = ask()
    for key in ("picture", "settings", "builds", "current"):
        assert after[key] == before[key], key
    assert after["build"]["result"] and after["settings"]["lamp_distance"] == pytest.approx(177.8)
    (folder / "studio.json").write_text('{"picture": 5}')  # a later or a broken studio wrote it
    with opened(folder) as ask:
        assert ask()["picture"] is None and len(ask()["builds"]) == 1


def test_nothing_is_built_while_a_field_is_wrong(runs: Path, tmp_path: Path) -> None:
    with opened(tmp_path / "studio") as ask:
        ask("text", text="pass")
        assert ask("settings", smooth="much", size=150).startswith("Smooth: This is no number")
        state = ask()
        assert state["wrong"]["smooth"]["text"] == "much" and state["settings"]["size"] == 150
        assert ask("build") == "Smooth: this is not right yet. Correct what is marked, then build."
        assert ask("settings", smooth="2,5 px") == "" and ask()["wrong"] == {}
        assert "--" not in "".join(ask("settings", **{name: "?"}) for name in FIELDS)
    assert list(runs.iterdir()) == []


def test_how_a_picture_is_read_ends_with_it(runs: Path, tmp_path: Path) -> None:
    with opened(tmp_path / "studio") as ask:
        ask("text", text="photo")
        ask("settings", ink="dark", smooth="2,5", size=90)
        ask("text", text="logo")
        assert ask()["settings"].get("ink") is None and ask()["settings"]["size"] == 90
        assert "smooth" not in ask()["settings"]


def test_one_odd_build_leaves_the_others(runs: Path, tmp_path: Path) -> None:
    odd = [
        "[1]", "5", '{"rows": 7}', '{"verdict": "good"}', '{"rows": [{"text": 3}]}', "{", "[" * 10**5,
    ]  # fmt: skip
    odd += ['{"verdict": {"word": 1}}', "\ud800", '{"rows": [{"name": NaN}]}']
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
        for odd_one in state["builds"][1:]:
            assert "cannot be read" in odd_one["result"]["piece"]
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
    names = [builds.begin("cat", Record(title="cat")) for _ in range(2)]
    assert names == ["cat", "cat-2"]
    (tmp_path / "builds" / "cat").mkdir(parents=True)
    (tmp_path / "builds" / "cat" / "report.json").write_text("{}")
    found = {b["title"]: b["phase"] for b in Builds(tmp_path).listed()}
    assert found == {"cat": "done"}  # nothing is left of the other


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
        ("so wide (--size 120), or --ink.", "so wide (“Longer side on the wall”: 120), or “What is drawn”."),
        ("or --accept unrecognisable.", "or “Build it even if nobody would know it”."),
        ("or --depth flat.", "or --depth flat of the command line."),
        ("--no-such thing -- stays", "--no-such thing -- stays"),
    ],
)  # fmt: skip
def test_a_sentence_of_the_command_line_in_the_page_s_words(said: str, shown: str) -> None:
    assert in_page_words(said) == shown
