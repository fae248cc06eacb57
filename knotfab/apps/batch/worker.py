"""List the builds of a batch, and run each in its own process. However a build ends, it leaves a record."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import time
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from knotfab.base.apps import VERSION
from knotfab.base.disk import at_home, read_file, temporary_folder
from knotfab.base.errors import why_of
from knotfab.base.folder import OutputFolder
from knotfab.base.moves import REJECTED
from knotfab.base.pool import ONE_THREAD, Crash, Workers, count_jobs
from knotfab.picture.source import TEXT_PREFIX, is_picture, name_picture
from knotfab.pipeline.options import BuildOptions
from knotfab.pipeline.values import as_text
from knotfab.report.summary import told_iou
from knotfab_formats.errors import InputError, shown, spelled

Record = dict[str, Any]  # keys as docs/contract.md lists them
_ENDINGS = (0, 1, 2, 3, 130)  # exit codes of the contract; with any other the build was killed


def open_builders(jobs: int, share: int | None = None) -> Workers:
    """Start `jobs` processes for `build_apart`.

    Args:
        share: how many processes each build may run in parallel; by default its share of this machine.
    """
    share = share or max(1, count_jobs() // jobs)
    env = {**os.environ, **ONE_THREAD, "PYTHONIOENCODING": "utf-8", "KNOTFAB_JOBS": str(share)}
    return Workers("knotfab.apps.builder", jobs=jobs, env=env)


def build_apart(task: Task, folder: Path, builders: Workers) -> Record:
    """Build one picture into `folder` in one of the processes of `open_builders`."""
    begun = time.perf_counter()
    earlier = _stamp(folder / REJECTED / "report.json")
    # behind "--" nothing is taken for an option
    arguments = ["build", *task.arguments, f"--out={folder}", "--quiet", "--", task.picture]
    # a killed build is tried once more: another build may have taken its memory
    for _ in range(2):
        code, error = run_apart(builders, arguments)
        if code in _ENDINGS:
            break
    seconds = time.perf_counter() - begun
    report = read_report(folder) if code == 0 else None
    if code == 1 and _stamp(folder / REJECTED / "report.json") != earlier:
        report = read_report(folder / REJECTED)
    return record_of(task, code, seconds, error, report)


def run_apart(
    builders: Workers, arguments: Sequence[str], events: Callable[[Record], None] | None = None
) -> tuple[int, str]:
    """Run `knotfab ARGUMENTS` in one of these processes.

    Args:
        events: called with each event (docs/studio.md), on this thread.

    Returns:
        The exit code (128 plus the signal's number if it was killed), and the sentence that it ended with.
    """
    try:
        answer = builders.answer({"arguments": list(arguments)}, events)
    except Crash as crash:
        return _explain_end(crash.code, crash.said)
    return _explain_end(answer["code"], answer["said"])


def _explain_end(code: int, said: str) -> tuple[int, str]:
    if code not in _ENDINGS:
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        why = f"the build was killed ({how}); was there too little memory?"
        return (128 - code if code < 0 else code), why
    lines = [line for line in said.splitlines() if line.strip()]
    return code, lines[-1].removeprefix("knotfab: ") if code and lines else ""


def record_of(
    task: Task, code: int, seconds: float, error: str, report: dict[str, Any] | None = None
) -> Record:
    """Return the record of a picture for batch.json: how its build ended, and figures of its report."""
    views = [] if report is None else report["views"]
    mount = ((report or {}).get("print") or {}).get("mount") or {}
    alike = [
        told_iou(v["iou"], v.get("iou_frame"), mount.get("kind") == "stand")
        for v in views
        if v.get("iou") is not None
    ]
    return {
        "name": task.name,
        "picture": spelled(task.picture),
        "exit_code": code,
        "seconds": round(seconds, 2),
        "iou": min((v["iou"] for v in views if v.get("iou") is not None), default=None),
        "verdict": ((report or {}).get("verdict") or {}).get("word"),
        "alike": min(alike, default=None),
        "warnings": list((report or {}).get("warnings") or ()),
        "reported": report is not None,  # otherwise a report in the folder is an earlier build's
        "error": error,
        "key": task.key,
    }


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return a file's inode and time, which tell a new one from an old one."""
    try:
        held = path.stat()
    except OSError:
        return None
    return held.st_ino, held.st_mtime_ns


def read_report(folder: Path) -> dict[str, Any] | None:
    """Read the report.json of a build; None if it is missing or damaged."""
    try:
        found: dict[str, Any] = json.loads((folder / "report.json").read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return found


def pack_task(task: Task, shared: Path) -> bytes:
    """Pack a task with the content of its files, for a machine that may not share this one's disk.

    Args:
        shared: a hidden folder among the batch's. A machine that sees it writes the build beside it.
    """
    picture = at_home(task.picture)
    source = str(picture.absolute()) if os.path.exists(picture) else task.picture
    held = [path.absolute() for path in (picture, *task.files) if os.path.exists(path)]
    places = {str(path): f"{number}/{spelled(path.name)}" for number, path in enumerate(held)}
    named = [task.name, task.picture, source, list(task.arguments), task.key, places]
    parcel = io.BytesIO()
    with zipfile.ZipFile(parcel, "w") as whole:
        whole.writestr("task.json", json.dumps([*named, str(shared.absolute())]))
        for path in held:
            for file in sorted(path.glob("*.*")) if path.is_dir() else [path]:
                inner = file.relative_to(path) if path.is_dir() else ""
                whole.writestr(str(Path(places[str(path)]) / inner), file.read_bytes())
    return parcel.getvalue()


def build_parcel(parcel: bytes, builders: Workers) -> tuple[Record, bytes]:
    """Build what `pack_task` packed, on any machine. Returns the record, and the built folder packed.

    If the machine shares the disk, the folder is written where it belongs, and nothing is packed. Files are
    read from their own paths if these hold the same content here.
    """
    with temporary_folder("knotfab-parcel-") as here:
        with zipfile.ZipFile(io.BytesIO(parcel)) as whole:
            whole.extractall(here)
        told = json.loads((here / "task.json").read_text("utf-8"))
        name, picture, source, arguments, key, places, shared = told
        seen = Path(shared).exists()
        out = Path(shared).parent / name if seen else here / "out"
        if not all(content_of(Path(path)) == content_of(here / places[path]) for path in places):
            for path, held in places.items():
                arguments = [one.replace(f"={path}", f"={here / held}") for one in arguments]
                source = str(here / held) if source == path else source
        record = build_apart(Task(name, source, tuple(arguments), (), key), out, builders)
        error = record["error"].replace(source, picture).replace(f"{here / 'out'}{os.sep}", "")
        record |= {"picture": picture, "error": error}
        result = io.BytesIO()
        with zipfile.ZipFile(result, "w", zipfile.ZIP_DEFLATED) as whole:
            for file in sorted((here / "out").rglob("*")):
                if file.is_file():
                    whole.write(file, file.relative_to(here / "out"))
        return record, b"" if seen else result.getvalue()


def unpack_result(record: Record, result: bytes, folder: Path) -> None:
    """Unpack the folder of a finished build into its place; with an empty `result` it is there already.

    A rejected build does not replace an earlier good one.
    """
    if not result or record["exit_code"] not in (0, 1):
        return
    with zipfile.ZipFile(io.BytesIO(result)) as whole, OutputFolder(folder) as out:
        rejected = record["exit_code"] == 1
        for name in whole.namelist():
            inner = name.removeprefix(f"{REJECTED}/")
            if "/" not in inner and (inner != name) == rejected:
                out.write(inner, whole.read(name))
        if rejected:
            out.reject()
        else:
            out.commit()


# listing the builds of a batch

RECORDS, INDEX = "batch.json", "index.html"  # files beside the folders of the pictures
_FILES = ("scene", "start", "printer", "material", "font")  # options that may name a file
_MOST_READ = 2**30  # bytes; a larger file is known by size and time alone
_OWN = ("out", "quiet", "verbose")  # options that a batch sets itself


@dataclass(frozen=True)
class Task:
    """One picture to build.

    `arguments` are those of `knotfab build` except the picture, --out and --quiet, and `files` the files
    that they name. `key` changes with the picture, the options, the files and the version of knotfab.
    """

    name: str
    picture: str
    arguments: tuple[str, ...]
    files: tuple[Path, ...]
    key: str


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
    options, files = _with_whole_paths(options)
    arguments = list_arguments(options)
    shared = hashlib.sha256(repr((VERSION, arguments)).encode("utf-8", "surrogatepass"))
    for path in files:
        shared.update(content_of(path))
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
        key.update(os.fsencode(source) if text else content_of(Path(source)))
        tasks[name.casefold()] = Task(name, source, arguments, files, key.hexdigest())
    return list(tasks.values())


def _expand_folder(named: str, leave_out: Callable[[str], None]) -> list[str]:
    """Return the pictures in a folder, or the picture itself, by paths that cannot be taken for options."""
    if named.startswith(TEXT_PREFIX):
        return [named]
    folder = at_home(named)
    if not os.path.isdir(folder):
        return [_as_path(folder)]
    found = []
    try:
        held = sorted(p for p in folder.iterdir() if is_picture(p))
    except OSError as error:
        raise InputError(
            named, f"this folder may not be read ({why_of(error)})", "Change its permissions."
        ) from error
    for path in held:
        if path.is_file():
            found.append(_as_path(path))
        else:
            leave_out(f"{shown(path)} is left out: it is no regular file")
    if not found:
        raise InputError(named, "this folder holds no pictures", "Name one that does")
    return found


def _as_path(path: Path) -> str:
    """Prefix a bare file name with "./": `text:a.png` would be a text, and `-a.png` options."""
    return str(path) if path.is_absolute() or len(path.parts) > 1 else f".{os.sep}{path}"


def content_of(path: Path) -> bytes:
    """Return the content of a file or of a folder's files, to tell whether it changed.

    A file that cannot be read is left to the build to report.
    """
    try:
        if path.is_dir():
            files = [p for p in sorted(path.glob("*.*")) if p.is_file()]
            return b"".join(os.fsencode(p.name) + content_of(p) for p in files)
        return read_file(path, "", most=_MOST_READ)
    except (InputError, OSError):
        with contextlib.suppress(OSError):
            return repr(path.stat()[6:9:2]).encode()  # size and time
        return b""


def _with_whole_paths(options: BuildOptions) -> tuple[BuildOptions, tuple[Path, ...]]:
    """Make the paths of all files that the options name absolute. Returns also those files."""
    whole: dict[str, Any] = {}
    for name in _FILES:
        value = getattr(options, name)
        if value is not None and os.path.isfile(at_home(value)):
            whole[name] = type(value)(at_home(value).resolve())
    return replace(options, **whole), tuple(Path(path) for path in whole.values())


def list_arguments(options: BuildOptions) -> tuple[str, ...]:
    """Write the options that differ from their defaults as arguments of `knotfab build`."""
    plain, found = BuildOptions(), []
    for field in fields(BuildOptions):
        value = getattr(options, field.name)
        if field.name in _OWN or value == getattr(plain, field.name):
            continue
        option = "--" + field.name.strip("_").replace("_", "-")
        if value is True:
            found.append(option)
        else:
            repeated = isinstance(value, tuple) and not isinstance(value[0], int)
            found += [f"{option}={as_text(one)}" for one in (value if repeated else (value,))]
    return tuple(found)
