"""List a batch's builds: a task for each picture, with a name of its own and a key that tells it apart."""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from knotfab import __version__
from knotfab.base.disk import at_home, read_file
from knotfab.base.errors import InputError, shown, why_of
from knotfab.options import BuildOptions
from knotfab.picture.read import TEXT_PREFIX, is_picture, name_picture

__all__ = ["INDEX", "RECORDS", "Task", "content_of", "list_arguments", "list_tasks"]

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
    shared = hashlib.sha256(repr((__version__, arguments)).encode("utf-8", "surrogatepass"))
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
