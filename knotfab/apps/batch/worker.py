"""One build of a batch, in a process of its own: what it ends with is a record, whatever happens to it."""

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
from knotfab.base.folder import REJECTED, OutputFolder
from knotfab.base.pool import ONE_THREAD, Crash, Workers, count_jobs
from knotfab.picture.read import TEXT_PREFIX, is_picture, name_picture
from knotfab.pipeline.options import BuildOptions
from knotfab_formats.errors import InputError, shown, spelled

Record = dict[str, Any]  # name, picture, key, exit_code, seconds, iou, verdict, reported, error
_ENDINGS = (0, 1, 2, 3, 130)  # the exit codes of the contract; others are none of a build's own
_ALONE = {**ONE_THREAD, "PYTHONIOENCODING": "utf-8"}  # environment of a build beside others


def open_builders(jobs: int, share: int | None = None) -> Workers:
    """Return `jobs` processes for `build_apart`.

    Args:
        share: the processes that each build may run side by side; by default its share of this machine.
    """
    share = share or max(1, count_jobs() // jobs)
    env = {**os.environ, **_ALONE, "KNOTFAB_JOBS": str(share)}
    return Workers("knotfab.apps.builder", jobs=jobs, env=env)


def build_apart(task: Task, folder: Path, builders: Workers) -> Record:
    """Build one picture into `folder` in a process of its own, one of `open_builders`."""
    begun = time.perf_counter()
    earlier = _stamp(folder / REJECTED / "report.json")
    # words behind "--" are no options, whatever they are called
    arguments = ["build", *task.arguments, f"--out={folder}", "--quiet", "--", task.picture]
    # a killed build runs again once: its memory may have been short beside another
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
        events: told of each event (docs/studio.md), on this thread.

    Returns:
        The exit code, 128 and the signal's number where it was killed, and the sentence that it ended with.
    """
    try:
        answer = builders.answer({"arguments": list(arguments)}, events)
    except Crash as crash:
        return _explain_end(crash.code, crash.said)
    return _explain_end(answer["code"], answer["said"])


def _explain_end(code: int, said: str) -> tuple[int, str]:
    """Give the exit code of a build, 128 and the signal's number if it was killed, and its last sentence."""
    if code not in _ENDINGS:
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        why = f"the build was killed ({how}); was there too little memory?"
        return (128 - code if code < 0 else code), why
    lines = [line for line in said.splitlines() if line.strip()]
    return code, lines[-1].removeprefix("knotfab: ") if code and lines else ""


def record_of(
    task: Task, code: int, seconds: float, error: str, report: dict[str, Any] | None = None
) -> Record:
    """Make the record of a picture for batch.json: how its build ended, and the figures of its report."""
    return {
        "name": task.name,
        "picture": spelled(task.picture),
        "exit_code": code,
        "seconds": round(seconds, 2),
        "iou": None if report is None else _least_iou(report),
        "verdict": ((report or {}).get("verdict") or {}).get("word"),
        "reported": report is not None,  # a report that lies there may be an earlier build's
        "error": error,
        "key": task.key,
    }


def _least_iou(report: dict[str, Any]) -> float | None:
    """Return the least IoU of all views and frames; None where nothing could be measured."""
    return min((v["iou"] for v in report["views"] if v.get("iou") is not None), default=None)


def _stamp(path: Path) -> tuple[int, int] | None:
    """Return a file's inode and time, which tell it from one that was there before."""
    try:
        held = path.stat()
    except OSError:
        return None
    return held.st_ino, held.st_mtime_ns


def read_report(folder: Path) -> dict[str, Any] | None:
    """Read the report.json of a build; None where there is none that can be read."""
    try:
        found: dict[str, Any] = json.loads((folder / "report.json").read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return found


def pack_task(task: Task, shared: Path) -> bytes:
    """Return a task with the content of its files, for a machine that may not see this one's disk.

    Args:
        shared: a hidden folder beside those of the batch: who sees it writes there.
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
    """Build what `pack_task` packed, anywhere; the record, and the folder that came of it, packed.

    On a machine that shares the disk the folder is written where it belongs, from the files' own paths where
    they hold the same there, and nothing is packed.
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
    """Put the folder of a finished build in its place, if it is not there yet: `result` is empty.

    A rejected one leaves an earlier good one there.
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


# List a batch's builds: a task for each picture, with a name of its own and a key that tells it
# apart.


# A batch writes these files beside the folders of its pictures.
RECORDS, INDEX = "batch.json", "index.html"
_FILES = ("scene", "start", "printer", "material", "font")  # options that may name a file
_MOST_READ = 2**30  # bytes of a file; of a larger one size and time tell it apart
_OWN = ("out", "quiet", "verbose")  # options that a batch sets itself


@dataclass(frozen=True)
class Task:
    """One picture to build.

    `arguments`: those of `knotfab build`, besides the picture, --out and --quiet. `files`: files that these
    name. `key` changes with the picture, the options, the files and the version of knotfab.
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
    """List the tasks of pictures and folders of pictures, in their order, for these options.

    Args:
        leave_out: told of each file of a folder that bears a picture's name and cannot be one.

    Raises:
        InputError: nothing is named, two pictures would have one name, or a folder holds none.
    """
    sources = list(pictures)
    if not options.sequence:  # with --sequence each is a folder, or an animation
        sources = [source for named in pictures for source in _expand(named, leave_out)]
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


def _expand(named: str, leave_out: Callable[[str], None]) -> list[str]:
    """Give a picture as it is, a folder as its pictures, each by a path that is taken for nothing else."""
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
    """Return a path of a file that lies here with its "./": `text:a.png` is a text, and `-a.png` options."""
    return str(path) if path.is_absolute() or len(path.parts) > 1 else f".{os.sep}{path}"


def content_of(path: Path) -> bytes:
    """Read the content of a file or a folder of files; the build reports a file that cannot be read."""
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
    """Return the options with every file that they name as a whole path, and those files."""
    whole: dict[str, Any] = {}
    for name in _FILES:
        value = getattr(options, name)
        if value is not None and os.path.isfile(at_home(value)):
            whole[name] = type(value)(at_home(value).resolve())
    return replace(options, **whole), tuple(Path(path) for path in whole.values())


def list_arguments(options: BuildOptions) -> tuple[str, ...]:
    """List the options that are not as by default, as `knotfab build` takes them."""
    plain, found = BuildOptions(), []
    for field in fields(BuildOptions):
        value = getattr(options, field.name)
        if field.name in _OWN or value == getattr(plain, field.name):
            continue
        option = "--" + field.name.strip("_").replace("_", "-")
        if value is True:
            found.append(option)
        else:
            values = value if isinstance(value, tuple) else (value,)
            found += [f"{option}={one}" for one in values]
    return tuple(found)
