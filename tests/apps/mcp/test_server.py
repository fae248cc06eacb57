"""`knotfab mcp` by the SDK's own client: in this process, and as a program on the other end of pipes."""

from __future__ import annotations

import base64
import io
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import anyio
import pytest
from command import refuse
from mcp import Client, StdioServerParameters, stdio_client
from mcp.types import CallToolResult, ImageContent, TextContent
from PIL import Image, ImageDraw

from knotfab.apps.mcp.server import make_server, serve
from knotfab.base.disk import confined

Use = Callable[[Client], Awaitable[Any]]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The one folder that is allowed, with a picture in it; another picture lies beside the folder."""
    inside = tmp_path / "inside"
    inside.mkdir()
    image = Image.new("L", (200, 200), 255)
    ImageDraw.Draw(image).ellipse((40, 30, 160, 170), fill=0)
    for place in (inside / "egg.png", tmp_path / "egg.png"):
        image.save(place)
    monkeypatch.chdir(inside)
    return inside


def _ask(folder: Path, use: Use) -> Any:
    async def run() -> Any:
        async with Client(make_server()) as client:
            return await use(client)

    with confined([folder]):
        return anyio.run(run)


def _call(folder: Path, tool: str, **given: Any) -> CallToolResult:
    found = _ask(folder, lambda client: client.call_tool(tool, given))
    assert isinstance(found, CallToolResult)
    return found


def _words(found: CallToolResult) -> str:
    first = found.content[0]
    assert isinstance(first, TextContent)
    return first.text


def _refused(found: CallToolResult) -> str:
    assert found.is_error and len(found.content) == 1
    return _words(found)


def test_each_tool_says_what_it_takes(folder: Path) -> None:
    tools = {tool.name: tool for tool in _ask(folder, lambda client: client.list_tools()).tools}
    assert list(tools) == ["preview", "build", "validate", "shadow"]
    for tool in tools.values():
        assert tool.description
        for name, kind in tool.input_schema["properties"].items():
            assert kind["description"] and {"type", "enum"} & set(kind), name
    options = tools["build"].input_schema["properties"]
    assert {"mount", "accuracy", "print_", "sequence", "ink"} <= set(options)
    assert "wall" in options["mount"]["enum"] and options["print_"]["type"] == "boolean"
    assert not {"quiet", "verbose", "watch"} & set(options)


def test_a_preview_is_words_figures_and_a_picture(folder: Path) -> None:
    found = _call(folder, "preview", pictures=["egg.png"], out="seen.png", size=120)
    assert not found.is_error and "1 piece" in _words(found)
    assert found.structured_content is not None
    assert found.structured_content["views"][0]["pieces"] == 1
    assert max(found.structured_content["views"][0]["frame_mm"]) == 120
    picture = found.content[1]
    assert isinstance(picture, ImageContent)
    drawn = base64.b64decode(picture.data)
    assert Image.open(io.BytesIO(drawn)).width > 300
    assert (folder / "seen.png").read_bytes() == drawn


def test_no_path_leads_out_of_the_folders(folder: Path) -> None:
    outside = folder.parent
    before = sorted(path.name for path in outside.iterdir())
    (folder / "link.png").symlink_to(outside / "egg.png")
    (folder / "away").symlink_to(outside)
    (folder / "frames").mkdir()
    for number in range(2):
        (folder / "frames" / f"{number}.png").symlink_to(outside / "egg.png")
    (folder / "scene.toml").write_text('schema = 1\n[[views]]\npicture = "../egg.png"\n')
    (folder / "mask.toml").write_text(
        'schema = 1\n[[views]]\npicture = "egg.png"\nsubject_mask = "../egg.png"\n'
    )
    (folder / "mesh.toml").write_text('schema = 1\n[region]\nkind = "mesh"\nfile = "../egg.stl"\n')
    (folder / "part.stl").write_text("")
    for tool, given in (
        ("preview", {"pictures": [str(outside / "egg.png")]}),
        ("preview", {"pictures": ["../egg.png"]}),
        ("preview", {"pictures": ["link.png"]}),
        ("preview", {"pictures": ["away/egg.png"]}),
        ("preview", {"pictures": ["frames"], "sequence": True}),
        ("preview", {"pictures": ["away/*"], "sequence": True}),
        ("preview", {"pictures": ["~/egg.png"]}),
        ("preview", {"scene": "scene.toml"}),
        ("preview", {"scene": "mask.toml"}),
        ("validate", {"part": "part.stl", "scene": "mask.toml"}),
        ("preview", {"scene": "mesh.toml", "pictures": ["egg.png"]}),
        ("preview", {"scene": "../scene.toml", "pictures": ["egg.png"]}),
        ("preview", {"pictures": ["egg.png"], "printer": "../printer.toml"}),
        ("preview", {"pictures": ["text:A"], "font": "/etc/hosts"}),
        ("preview", {"pictures": ["egg.png"], "out": "../seen.png"}),
        ("build", {"pictures": ["egg.png"], "out": "away/out", "accuracy": "sketch"}),
        ("build", {"pictures": ["egg.png"], "start": "../knots.json"}),
        ("validate", {"part": "../part.stl"}),
        ("validate", {"part": "away"}),
        ("validate", {"part": "part.stl", "scene": "scene.toml"}),
        ("shadow", {"part": "part.stl", "scene": "../scene.toml"}),
        ("shadow", {"part": "part.stl", "scene": "scene.toml", "out": "away/s.png"}),
    ):
        said = _refused(_call(folder, tool, **given))
        assert "outside the folders that are allowed" in said and str(folder) in said, (given, said)
    assert sorted(path.name for path in outside.iterdir()) == before


@pytest.mark.slow
def test_moves_that_came_with_a_folder_are_not_done(folder: Path) -> None:
    hidden = folder / ".knotfab-x"
    (hidden / "old").mkdir(parents=True)
    (hidden / "evil").write_text("evil")
    (hidden / "moves.json").write_text(json.dumps([["evil", str(folder.parent / "victim")]]))
    assert not _call(folder, "preview", pictures=["egg.png"], out="seen.png").is_error
    for tool, given in (
        ("validate", {"part": "."}),
        ("build", {"pictures": ["egg.png"], "knots": "9x"}),
    ):
        assert _call(folder, tool, **given, **({"out": "."} if tool == "build" else {})).is_error
    assert (hidden / "evil").exists() and not (folder.parent / "victim").exists()


@pytest.mark.parametrize("name", ["part.stl", "knots.json", "scene.toml"])
def test_links_of_a_folder_lead_nowhere_else(folder: Path, name: str) -> None:
    (folder / "built").mkdir()
    if name != "part.stl":
        (folder / "built" / "part.stl").write_text("solid")
    (folder.parent / name).write_text("of somebody else")
    (folder / "built" / name).symlink_to(folder.parent / name)
    said = _refused(_call(folder, "validate", part="built"))
    assert "outside the folders" in said and "of somebody else" not in said


def test_a_wrong_call_is_told_as_the_command_line_tells_it(folder: Path) -> None:
    def told(*words: str) -> str:
        return refuse(2, *words).removeprefix("knotfab: ").strip()

    given = {"pictures": ["egg.png"], "tube_radius": -1}
    typed = told("build", "egg.png", "--tube-radius=-1")  # a tool's arguments are keywords
    named = re.sub(r"--tube-radius (-?\d+)", r"tube_radius=\1", typed)
    assert _refused(_call(folder, "build", **given)) == named != typed
    assert _refused(_call(folder, "preview", pictures=["no.png"])) == told("preview", "no.png")
    for tool, given, words in (
        ("build", {"pictures": ["egg.png"], "mout": "wall"}, "Did you mean mount?"),
        ("build", {"pictures": ["egg.png"], "progress": 1}, "the option progress"),
        ("build", {"pictures": 7}, "no list of texts"),
        ("preview", {"pictures": ["egg.png"], "mount": "wall"}, "the option mount"),
        ("preview", {"pictures": ["egg.png"], "out": "seen.jpg"}, "a preview is a PNG"),
        ("validate", {}, "there is nothing to validate"),
        ("validate", {"part": "egg.png", "unit": "ft"}, "unit ft"),
        ("validate", {"part": "egg.png", "scale": 2}, "the option scale"),
        ("shadow", {"part": "egg.png"}, "Name the scene.toml too"),
        ("sing", {}, "Known: preview, build"),
    ):
        assert words in _refused(_call(folder, tool, **given)), words
    assert [path.name for path in folder.iterdir()] == ["egg.png"]


def test_invalid_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(Exception, match=r"--allow .*nowhere: there is no such folder"):
        serve([tmp_path / "nowhere"])


_NOISY = """
import os, sys
from knotfab.apps.mcp import jobs
whole = jobs.preview
def noisy(*given):
    os.write(1, b"a library talks\\n")
    print("so does this one")
    return whole(*given)
jobs.preview = noisy
from knotfab.cli.app import main
main(["mcp"])
"""


@pytest.mark.slow
def test_over_pipes_what_libraries_say_breaks_nothing(folder: Path) -> None:
    server = StdioServerParameters(command=sys.executable, args=["-c", _NOISY], cwd=folder)

    async def run() -> CallToolResult:
        with (folder / "said.txt").open("w") as said:
            async with Client(stdio_client(server, errlog=said)) as client:
                return await client.call_tool(
                    "preview", {"pictures": ["egg.png"], "tube_radius": 6}
                )

    assert "1 piece" in _words(anyio.run(run))
    assert "a library talks" in (folder / "said.txt").read_text()


@pytest.mark.build
def test_a_build_reports_progress_and_is_validated(folder: Path) -> None:
    seen: list[tuple[float, float | None, str | None]] = []

    async def hear(done: float, total: float | None, words: str | None) -> None:
        seen.append((done, total, words))

    async def use(client: Client) -> list[CallToolResult]:
        given = {"pictures": ["egg.png"], "accuracy": "sketch", "tube_radius": 6, "out": "egg"}
        built = await client.call_tool("build", given, progress_callback=hear)
        checked = await client.call_tool("validate", {"part": "egg"})
        cast = {"part": "egg/part.stl", "scene": "egg/scene.toml"}
        return [built, checked, await client.call_tool("shadow", cast)]

    built, checked, cast = _ask(folder, use)
    shares = [share for share, _, _ in seen]
    assert shares == sorted(set(shares)) and len(shares) > 5 and shares[-1] == 1
    assert {total for _, total, _ in seen} == {1.0} and any("search" in str(w) for *_, w in seen)
    assert not built.is_error and _words(built).startswith("pass: ") and "IoU 0.9" in _words(built)
    assert built.structured_content["views"][0]["iou"] > 0.97
    assert "part.stl" in built.structured_content["files"] and (folder / "egg/part.stl").is_file()
    assert checked.structured_content["exit_code"] == 0 and "every required" in _words(checked)
    shadow = Image.open(io.BytesIO(base64.b64decode(cast.content[1].data))).convert("L")
    assert 0.1 < sum(shadow.histogram()[:128]) / (shadow.width * shadow.height) < 0.9


@pytest.mark.build
def test_a_build_that_is_cancelled_ends_and_leaves_nothing(folder: Path) -> None:
    async def use(client: Client) -> None:
        with anyio.CancelScope() as scope:

            async def hear(done: float, total: float | None, words: str | None) -> None:
                if "search" in str(words):
                    scope.cancel()

            given = {"pictures": ["egg.png"], "accuracy": "fine", "tube_radius": 5}
            ended = await client.call_tool("build", given, progress_callback=hear)
            assert "interrupted; nothing was changed" in _refused(ended)
        assert scope.cancel_called
        found = await client.call_tool("preview", {"pictures": ["egg.png"]})  # it answers still
        assert not found.is_error

    _ask(folder, use)
    assert not (folder / "knotfab-out").exists()


@pytest.mark.build
@pytest.mark.skipif(sys.platform == "win32", reason="there is no such signal")
def test_a_signal_ends_it_in_a_build_which_leaves_nothing(folder: Path) -> None:
    who = {
        "protocolVersion": "2025-06-18",
        "capabilities": {},
        "clientInfo": {"name": "a", "version": "1"},
    }
    asked = {"pictures": ["egg.png"], "accuracy": "fine", "tube_radius": 5.0}
    calls: list[dict[str, Any]] = [
        {"id": 0, "method": "initialize", "params": who},
        {"method": "notifications/initialized"},
        {"id": 1, "method": "tools/call", "params": {"name": "build", "arguments": asked}},
    ]
    calls[2]["params"]["_meta"] = {"progressToken": 1}
    command = [sys.executable, "-m", "knotfab", "mcp"]
    pipe, env = subprocess.PIPE, {**os.environ, "KNOTFAB_JOBS": "1"}
    with subprocess.Popen(
        command, stdin=pipe, stdout=pipe, stderr=pipe, cwd=folder, env=env
    ) as server:
        assert server.stdin and server.stdout and server.stderr
        for call in calls:
            server.stdin.write(json.dumps({"jsonrpc": "2.0", **call}).encode() + b"\n")
        server.stdin.flush()
        while b"search" not in server.stdout.readline():
            assert server.poll() is None
        server.send_signal(signal.SIGTERM)
        assert server.wait(60) == 130 and b"interrupted" in server.stderr.read()
    assert not (folder / "knotfab-out").exists()


def test_without_the_sdk_a_sentence_says_how_to_get_it(folder: Path) -> None:
    lacks = "import sys; sys.modules['mcp'] = None; from knotfab.cli.app import main; main(['mcp'])"
    done = subprocess.run([sys.executable, "-c", lacks], capture_output=True, text=True)
    assert done.returncode == 3 and done.stderr.count("\n") == 1
    assert "knotfab mcp: it needs mcp" in done.stderr and "'knotfab[mcp]'" in done.stderr
