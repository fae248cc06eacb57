"""List the builds of a batch, and run each in its own process. However a build ends, it leaves a record."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import wait
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from knotfab.base.apps import VERSION
from knotfab.base.disk import at_home, read_file
from knotfab.base.errors import why_of
from knotfab.base.moves import REJECTED
from knotfab.base.pool import ONE_THREAD, Crash, Workers
from knotfab.picture.source import TEXT_PREFIX, is_picture, name_picture
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.values import as_text
from knotfab_formats.errors import InputError, shown, spelled

_ENDINGS = (0, 1, 2, 3, 130)  # exit codes of the contract; with any other the build was killed
_FILES = ("scene", "start", "printer", "material", "font")  # options that may name a file
_MOST_READ = 2**30  # bytes; a larger file is known by size and time alone
_OWN = ("out", "quiet", "verbose")  # options that a batch sets itself


_PRESSING = ("fail", "warn")  # rows of a report that a batch tells, with its likeness

Record = dict[str, Any]  # of a picture's build: keys as docs/contract.md lists them


@dataclass(frozen=True)
class Task:
    """One picture to build.

    `source` is the picture by its whole path, and `arguments` are those of `knotfab build` except picture,
    --out and --quiet. `key` changes with the picture, the options, the files that they name, and the version
    of knotfab.
    """

    name: str
    picture: str
    source: str
    arguments: tuple[str, ...]
    key: str


def build_on_worker(task: Task, folder: Path, share: int) -> Record:
    """Build a task in a process of this Dask worker's, and end it if nobody waits for the result any more.

    Args:
        share: how many processes the build may run in parallel.
    """
    from distributed import get_worker

    worker = get_worker()
    key = worker.get_current_task()
    try:
        pool = _idle.pop()
    except IndexError:
        env = {**os.environ, **ONE_THREAD, "PYTHONIOENCODING": "utf-8", "KNOTFAB_JOBS": str(share)}
        pool = Workers("knotfab.apps.builder", env=env)
    try:
        building = pool.submit(_build_apart, task, folder, pool)
        while not wait([building], 0.5).done:
            held = worker.state.tasks.get(key)
            if held is None or held.state not in ("executing", "long-running"):
                raise RuntimeError("nobody waits for it")
        found = building.result()
    except BaseException:
        pool.__exit__()
        raise
    _idle.append(pool)
    return found


_idle: list[Workers] = []  # this process's builders that wait for a further build of the batch


def end_idle() -> None:
    """End the builders that wait: each holds about a GB."""
    while _idle:
        _idle.pop().__exit__()


def list_missing(paths: Sequence[str]) -> list[str]:
    return [path for path in paths if not os.path.exists(path)]


def _build_apart(task: Task, folder: Path, builder: Workers) -> Record:
    begun, earlier = time.perf_counter(), _stamp(folder / REJECTED / "report.json")
    # behind "--" nothing is taken for an option
    arguments = ["build", *task.arguments, f"--out={folder}", "--quiet", "--", task.source]
    # a killed build is tried once more: another build may have taken its memory
    for _ in range(2):
        code, error = run_apart(builder, arguments)
        if code in _ENDINGS:
            break
    seconds = time.perf_counter() - begun
    anew = code == 1 and _stamp(folder / REJECTED / "report.json") != earlier
    report = _read_report(folder / REJECTED if anew else folder) if code == 0 or anew else None
    return record_of(task, code, seconds, error, report)


def run_apart(
    builder: Workers,
    arguments: Sequence[str],
    events: Callable[[dict[str, Any]], None] | None = None,
) -> tuple[int, str]:
    """Run `knotfab ARGUMENTS` in one of these processes.

    Args:
        events: called with each event (docs/studio.md), on this thread.

    Returns:
        The exit code (128 plus the signal's number if it was killed), and the sentence that it ended with.
    """
    try:
        answer = builder.answer({"arguments": list(arguments)}, events)
        code, said = answer["code"], answer["said"]
    except Crash as crash:
        code, said = crash.code, crash.said
    if code not in _ENDINGS:
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        why = f"the build was killed ({how}); was there too little memory?"
        return (128 - code if code < 0 else code), why
    lines = [line for line in said.splitlines() if line.strip()]
    return code, lines[-1].removeprefix("knotfab: ") if code and lines else ""


def record_of(
    task: Task, code: int, seconds: float, error: str, report: dict[str, Any] | None = None
) -> Record:
    """Return the record of a picture: how its build ended, and what of its report presses."""
    found = report or {}
    views = [view for view in found.get("views", ()) if view.get("iou") is not None]
    rows = [
        row
        for row in found.get("rows") or ()
        if row["status"] in _PRESSING or row["name"] == "likeness"
    ]
    return {
        "name": task.name,
        "picture": spelled(task.picture),
        "exit_code": code,
        "seconds": round(seconds, 2),
        "iou": min((view["iou"] for view in views), default=None),
        "verdict": (found.get("verdict") or {}).get("word"),
        "rows": [{"status": row["status"], "text": row["text"]} for row in rows],
        "reported": report is not None,
        "error": error,
        "key": task.key,
    }


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return a file's inode and time, which tell a new one from an old one."""
    with suppress(OSError):
        held = path.stat()
        return held.st_ino, held.st_mtime_ns
    return None


def _read_report(folder: Path) -> dict[str, Any] | None:
    with suppress(OSError, ValueError):
        found: dict[str, Any] = json.loads((folder / "report.json").read_text("utf-8"))
        return found
    return None


def list_tasks(
    pictures: Sequence[str],
    options: BuildOptions,
    leave_out: Callable[[str], None] = lambda sentence: None,
) -> list[Task]:
    """List the tasks for pictures and folders of pictures, in order.

    Args:
        leave_out: called with a sentence for each entry of a folder named like a picture but not a file.

    Raises:
        InputError: no picture is given, two would have the same name, or a folder holds none.
    """
    sources = list(pictures)
    if not options.sequence:  # where each is a folder of frames
        sources = [source for named in pictures for source in _expand_folder(named, leave_out)]
    if not sources:
        raise InputError(
            "", "no picture is given", "Name some, as in: knotfab batch logos/ --out built"
        )
    given = {name: at_home(getattr(options, name) or "") for name in _FILES}
    named = {n: type(getattr(options, n))(p.resolve()) for n, p in given.items() if p.is_file()}
    arguments = list_arguments(replace(options, **named))
    shared = hashlib.sha256(repr((VERSION, arguments)).encode("utf-8", "surrogatepass"))
    for path in named.values():
        shared.update(_content_of(Path(path)))
    tasks: dict[str, Task] = {}
    for source in sources:
        name = name_picture(source)
        same = tasks.get(name.casefold())  # some disks take A for a
        if same is not None:
            raise InputError(
                source,
                f"its folder would be {name}, and so would that of {same.picture}",
                "Rename one of them",
            )
        key = shared.copy()
        text = source.startswith(TEXT_PREFIX)
        key.update(os.fsencode(source) if text else _content_of(Path(source)))
        whole = source if text else os.path.abspath(source)
        tasks[name.casefold()] = Task(name, source, whole, arguments, key.hexdigest())
    return list(tasks.values())


def _expand_folder(named: str, leave_out: Callable[[str], None]) -> list[str]:
    """Return the pictures in a folder, or the picture itself, by paths that cannot be taken for options."""
    folder = at_home(named)
    if named.startswith(TEXT_PREFIX):
        return [named]
    if not os.path.isdir(folder):
        return [_as_path(folder)]
    try:
        held = sorted(p for p in folder.iterdir() if is_picture(p))
    except OSError as error:
        raise InputError(
            named, f"this folder may not be read ({why_of(error)})", "Change its permissions."
        ) from error
    for path in held:
        if not path.is_file():
            leave_out(f"{shown(path)} is left out: it is no regular file")
    if not any(path.is_file() for path in held):
        raise InputError(named, "this folder holds no pictures", "Name one that does")
    return [_as_path(path) for path in held if path.is_file()]


def _as_path(path: Path) -> str:
    """Prefix a bare file name with "./": `text:a.png` would be a text, and `-a.png` options."""
    return str(path) if path.is_absolute() or len(path.parts) > 1 else f".{os.sep}{path}"


def _content_of(path: Path) -> bytes:
    """Return the content of a file or of a folder's files, to tell whether it changed.

    A file that cannot be read is left to the build to report.
    """
    with suppress(InputError, OSError):
        if path.is_dir():
            files = [p for p in sorted(path.glob("*.*")) if p.is_file()]
            return b"".join(os.fsencode(p.name) + _content_of(p) for p in files)
        return read_file(path, "", most=_MOST_READ)
    with suppress(OSError):
        return repr(path.stat()[6:9:2]).encode()  # size and time
    return b""


def list_arguments(options: BuildOptions) -> tuple[str, ...]:
    """Write the options that differ from their defaults as arguments of `knotfab build`."""
    found, usual = [], BuildOptions()
    for field in fields(BuildOptions):
        value = getattr(options, field.name)
        if field.name in _OWN or value == getattr(usual, field.name):
            continue
        option = "--" + field.name.strip("_").replace("_", "-")
        repeated = isinstance(value, tuple) and not isinstance(value[0], int)
        values = [as_text(one) for one in (value if repeated else (value,))]
        found += [option] if value is True else [f"{option}={one}" for one in values]
    return tuple(found)
