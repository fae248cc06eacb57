"""What a batch is to build: a task for each picture, with a name of its own and a key that tells it apart."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from knotfab import __version__
from knotfab.errors import InputError
from knotfab.options import BuildOptions
from knotfab.target.read import PICTURE_SUFFIXES, TEXT_PREFIX, name_picture

__all__ = ["INDEX", "RECORDS", "Task", "content_of", "list_arguments", "list_tasks"]

# what a batch writes beside the folders of its pictures
RECORDS, INDEX = "batch.json", "index.html"
_FILES = ("scene", "start", "printer", "material", "font")  # options that may name a file
_OWN = ("out", "quiet", "verbose")  # options that a batch sets itself


@dataclass(frozen=True)
class Task:
    """One picture to build.

    `arguments`: of `knotfab build`, besides the picture, --out and --quiet. `files`: those that the arguments
    name. `key` changes with the picture, the options, the files and the version of knotfab.
    """

    name: str
    picture: str
    arguments: tuple[str, ...]
    files: tuple[Path, ...]
    key: str


def list_tasks(pictures: Sequence[str], options: BuildOptions) -> list[Task]:
    """The tasks of pictures and folders of pictures, in their order, for these options.

    Raises:
        InputError: nothing is named, two pictures would have one name, or a folder holds none.
    """
    sources = list(pictures)
    if not options.sequence:  # of which each is a folder, or an animation
        sources = [source for named in pictures for source in _expand(named)]
    if not sources:
        raise InputError(
            "the call", "no picture is given", "Name some, as in: knotfab batch logos/ --out built"
        )
    options, files = _with_whole_paths(options)
    arguments = list_arguments(options)
    shared = hashlib.sha256(repr((__version__, arguments)).encode())
    for path in files:
        shared.update(content_of(path))
    tasks: dict[str, Task] = {}
    for source in sources:
        name = name_picture(source)
        same = tasks.get(name.casefold())  # as disks have it that take A for a
        if same is not None:
            raise InputError(
                source,
                f"its folder would be {name}, and so would that of {same.picture}",
                "Rename one of them",
            )
        key = shared.copy()
        text = source.startswith(TEXT_PREFIX)
        key.update(source.encode() if text else content_of(Path(source)))
        tasks[name.casefold()] = Task(name, source, arguments, files, key.hexdigest())
    return list(tasks.values())


def _expand(named: str) -> list[str]:
    """A picture as it is, a folder as the pictures in it."""
    folder = Path(named).expanduser()
    if named.startswith(TEXT_PREFIX):
        return [named]
    if not folder.is_dir():
        return [str(folder)]
    found = sorted(str(p) for p in folder.iterdir() if p.suffix.lower() in PICTURE_SUFFIXES)
    if not found:
        raise InputError(named, "this folder holds no pictures", "Name one that does")
    return found


def content_of(path: Path) -> bytes:
    """What a file or a folder of files holds; what cannot be read is the build's to report."""
    try:
        if path.is_dir():
            return b"".join(f.name.encode() + f.read_bytes() for f in sorted(path.glob("*.*")))
        return path.read_bytes()
    except OSError:
        return b""


def _with_whole_paths(options: BuildOptions) -> tuple[BuildOptions, tuple[Path, ...]]:
    """The options with every file that they name as a whole path, and those files."""
    whole: dict[str, Any] = {}
    for name in _FILES:
        value = getattr(options, name)
        if value is not None and Path(value).expanduser().is_file():
            whole[name] = type(value)(Path(value).expanduser().resolve())
    return replace(options, **whole), tuple(Path(path) for path in whole.values())


def list_arguments(options: BuildOptions) -> tuple[str, ...]:
    """The options that are not as by default, as `knotfab build` takes them."""
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
