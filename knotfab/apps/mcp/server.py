"""`knotfab mcp`: the tools with their schemas, and the server that answers their calls over stdio."""

from __future__ import annotations

import base64
import os
import signal
import sys
import threading
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import anyio
import anyio.from_thread
import anyio.lowlevel
import anyio.to_thread
from docstring_parser import parse_from_object
from mcp.server.lowlevel import Server
from mcp.server.stdio import stdio_server
from mcp.types import CallToolResult, ImageContent, ListToolsResult, TextContent, Tool

from knotfab.apps.mcp import jobs
from knotfab.base.apps import VERSION
from knotfab.base.disk import at_home, confined
from knotfab.base.errors import explain_error, keep_traceback
from knotfab.base.limited import end_copies
from knotfab.base.progress import Event
from knotfab.cli import commands
from knotfab.pipeline.options import HELP, BuildOptions, PictureOptions
from knotfab_formats.errors import InputError

_running: set[threading.Event] = set()  # an event for each running job, which ends it
_GRACE_S = 10.0  # a job that is asked to end has this long: a build tidies up
_LEFT_OUT = {"quiet", "verbose", "json", "failures", "return"}  # they concern a terminal
_TEXT, _LIST = {"type": "string"}, {"type": "array", "items": {"type": "string"}}
_PICTURES = {
    **_LIST,
    "description": "Image files, SVGs, or text:… (a glyph or a word); not needed where the scene names them. "
    "Several are several views of one part.",
}
_OUT = {**_TEXT, "description": "A PNG to write as well."}


@dataclass(frozen=True)
class _Tool:
    job: Callable[[jobs.Given, jobs.Hear, Collection[str]], jobs.Answer]
    does: str
    properties: dict[str, Any]
    known: tuple[str, ...]  # names of the options, or of all arguments if the tool has no options


def _kind(hint: Any) -> dict[str, Any]:
    inner = (
        [one for one in get_args(hint) if one is not NoneType]
        if NoneType in get_args(hint)
        else [hint]
    )
    if get_origin(inner[0]) is Literal:
        return {"enum": list(get_args(inner[0]))}
    if get_origin(inner[0]) is tuple:
        return _LIST
    plain = {bool: {"type": "boolean"}, int: {"type": "integer"}, Path: _TEXT}
    return plain.get(inner[0], {"type": ["string", "number"]})


def _schemas(*sources: Callable[..., Any]) -> dict[str, Any]:
    """Return the JSON schemas of the options that commands, or classes of options, declare and describe."""
    hints = {name: hint for one in sources for name, hint in get_type_hints(one).items()}
    told = HELP | {
        one.arg_name: " ".join(one.description.split())
        for source in sources
        for one in parse_from_object(source).params
        if one.description
    }
    kinds = {name: _kind(hint) for name, hint in hints.items() if name not in _LEFT_OUT}
    return {name: {**kind, "description": told[name]} for name, kind in kinds.items()}


def _tools() -> dict[str, _Tool]:
    options = _schemas(PictureOptions, BuildOptions)
    read = (*get_type_hints(PictureOptions), "sequence")
    seen = {"pictures": _PICTURES, "out": _OUT, **{name: options[name] for name in read}}
    measured, cast = _schemas(commands.validate), {**_schemas(commands.shadow), "out": _OUT}
    return {
        "preview": _Tool(
            jobs.preview,
            "Show in a second what a picture will become: its silhouette, the tube that a build takes, and "
            "what that loses.",
            seen, read,
        ),
        "build": _Tool(
            jobs.build,
            "Turn a picture, or several, into a verified knotted tube whose shadow is that picture. Takes "
            "from seconds to minutes; `print_` also slices it.",
            {"pictures": _PICTURES, **options}, tuple(options),
        ),
        "validate": _Tool(
            jobs.validate,
            "Measure a written part, or any tube, with other code than wrote it.",
            measured, tuple(measured),
        ),
        "shadow": _Tool(
            jobs.shadow, "Render the shadow that a part casts in its scene.", cast, tuple(cast)
        ),
    }  # fmt: skip


def make_server() -> Server[Any]:
    """Make the server with its tools. What they may read and write is set by `confined`."""
    tools, builds = _tools(), anyio.CapacityLimiter(1)  # each build takes all cores

    async def list_tools(ctx: Any, params: Any) -> ListToolsResult:
        return ListToolsResult(
            tools=[
                Tool(
                    name=name,
                    description=tool.does,
                    input_schema={"type": "object", "properties": tool.properties},
                )
                for name, tool in tools.items()
            ]
        )

    async def call_tool(ctx: Any, params: Any) -> CallToolResult:
        tool, stop = tools.get(params.name), threading.Event()
        if tool is None:
            return _refuse(f"{params.name}: there is no such tool. Known: {', '.join(tools)}.")
        hear = partial(
            _report, ctx.session.report_progress, stop, anyio.lowlevel.current_token(), [-1.0]
        )
        call = partial(_run, tool, dict(params.arguments or {}), hear)
        _running.add(stop)
        try:
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(_when_cancelled, stop)
                limiter = builds if tool.job is jobs.build else None
                result = await anyio.to_thread.run_sync(call, limiter=limiter)
                tasks.cancel_scope.cancel()
        finally:
            _running.discard(stop)
        return result

    return Server(
        "knotfab",
        version=VERSION,
        instructions="Lengths are in mm. Show a person the preview's picture before a build.",
        on_list_tools=list_tools,
        on_call_tool=call_tool,
    )


def serve(allow: Sequence[Path] = ()) -> None:
    """Answer calls on standard input until it ends.

    Args:
        allow: folders that may be read and written, by default the current one. Relative paths start from
            the first.

    Raises:
        InputError: one of them is not a folder.
    """
    folders = [at_home(folder).absolute() for folder in allow] or [Path.cwd()]
    for folder in folders:
        if not folder.is_dir():
            raise InputError(
                f"--allow {folder}", "there is no such folder", "Name one that is there."
            )
    os.chdir(folders[0])
    with confined(folders):
        anyio.run(_serve)


async def _serve() -> None:
    server = make_server()
    # `stdio_server` diverts what libraries print to standard error
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(_end_when_asked)
        async with stdio_server() as (came, write):
            send, read = anyio.create_memory_object_stream[Any](0)
            tasks.start_soon(_pass_on, came, send)
            await server.run(read, write, server.create_initialization_options())
        tasks.cancel_scope.cancel()


async def _pass_on(came: Any, send: Any) -> None:
    """Pass on the client's messages; once it has disconnected, end the running jobs."""
    async with send:
        async for message in came:
            await send.send(message)
    await _end_jobs()
    if _running:
        os._exit(0)


async def _end_when_asked() -> None:
    """End all jobs and the process on Ctrl-C. It cannot just return: a thread waits for standard input."""
    with (
        suppress(NotImplementedError),  # Windows has no such signals
        anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as asked,
    ):
        async for _ in asked:
            await _end_jobs()
            print("knotfab: interrupted; nothing was changed", file=sys.stderr, flush=True)
            os._exit(130)


async def _end_jobs() -> None:
    """Ask all jobs to end, and give them time to do so; the next build cleans up what a job still leaves."""
    for stop in list(_running):
        stop.set()
    end_copies()
    with anyio.move_on_after(_GRACE_S):
        while _running:
            await anyio.sleep(0.05)


async def _when_cancelled(stop: threading.Event) -> None:
    """Make the job's next event end it when the call is cancelled; its thread cannot be killed."""
    try:
        await anyio.sleep_forever()
    finally:
        stop.set()


def _report(
    send: Callable[..., Any], stop: threading.Event, token: Any, last: list[float], event: Event
) -> None:
    """Send a build's progress if it has grown; may be called from any thread."""
    if stop.is_set():
        raise KeyboardInterrupt
    if event.name not in ("stage", "progress", "end") or event.share <= last[0]:
        return
    last[0] = event.share
    left = "" if event.left_s is None else f", {event.left_s:.0f} s left"
    words = f"{event.stage}{', longer than usual' if event.late else left}"
    anyio.from_thread.run(send, event.share, 1.0, words, token=token)


def _run(tool: _Tool, given: jobs.Given, hear: jobs.Hear) -> CallToolResult:
    try:
        answer = tool.job(given, hear, tool.known)
    except KeyboardInterrupt:
        return _refuse("interrupted; nothing was changed")
    except Exception as error:
        return _refuse(str(explain_error(error) or keep_traceback(error)))
    pictures = [
        ImageContent(type="image", data=base64.b64encode(png).decode(), mime_type="image/png")
        for png in answer.pictures
    ]
    return CallToolResult(
        content=[TextContent(type="text", text=answer.words), *pictures],
        structured_content=answer.figures,
        is_error=answer.failed,
    )


def _refuse(sentence: str) -> CallToolResult:
    return CallToolResult(content=[TextContent(type="text", text=sentence)], is_error=True)
