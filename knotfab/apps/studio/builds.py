"""The builds of a studio: the folder of each, and the record of its request."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from knotfab.apps.studio.pictures import StudioPicture
from knotfab.base.disk import write_whole
from knotfab.base.moves import REJECTED, mend
from knotfab.report.for_maker import sort_files
from knotfab_formats.errors import InputError

BUILDS = "builds"
_RECORDS = "records"
_UNREADABLE = "its report.json cannot be read; its files are below"


class Record(BaseModel):
    """What a build was asked, and how it ended."""

    model_config = ConfigDict(extra="ignore")

    title: str
    picture: StudioPicture | None = None
    settings: dict[str, str | int | float | bool] = {}
    phase: str = "running"
    sentence: str = ""


class _Verdict(BaseModel):
    word: str | None = None


class _Row(BaseModel):
    name: str
    text: str


class _Report(BaseModel):
    """What the page shows of a report.json."""

    verdict: _Verdict | None = None
    rows: list[_Row] = []


class Builds:
    """All builds below `folder`. A damaged one does not affect the others."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / BUILDS
        self._records = folder / _RECORDS
        self.records: dict[str, Record] = {}
        for held in _children(self.folder):
            mend(held)
        for path in sorted(self._records.glob("[!.]*.json")):
            with contextlib.suppress(OSError, ValueError):
                self.records[path.stem] = Record.model_validate_json(path.read_bytes())
        for name, record in list(self.records.items()):
            if record.phase == "running":  # the studio was killed
                passed = (self.folder / name / "report.json").is_file()
                self.end(
                    name, "done" if passed else "stopped", "The studio ended before this build did."
                )

    def begin(self, base: str, record: Record) -> str:
        """Add a build under a unique name, which is returned, with a unique title.

        Raises:
            InputError: its record cannot be written.
        """
        held = {path.name for path in _children(self.folder)}
        held |= set(self.records)
        name = number(base, held, "-")
        titles = [self.title_of(other) for other in held]
        self.records[name] = record.model_copy(update={"title": number(record.title, titles, " ")})
        self._write(name)
        return name

    def end(self, name: str, phase: str, sentence: str) -> None:
        """Record how a build ended. One that left no result is removed."""
        mend(self.folder / name)
        record = self.records.get(name)
        if record is None:
            return
        self.records[name] = record.model_copy(update={"phase": phase, "sentence": sentence})
        if self._is_listed(name):
            with contextlib.suppress(InputError):  # the disk is full; it stays in memory
                self._write(name)
        else:
            self._forget(name)

    def require(self, name: str) -> str:
        """Return the name if there is such a build.

        Raises:
            InputError: there is none.
        """
        if name not in self.names():
            raise InputError(
                f"the build {name[:80]}", "there is none of that name", "Load the page again."
            )
        return name

    def names(self) -> list[str]:
        """Return the names of the builds that left a result, newest first, 200 at most."""
        found = {path.name for path in _children(self.folder)} | set(self.records)
        listed = [name for name in found if self._is_listed(name)]
        return sorted(listed, key=lambda name: (-self._made(name), name))[:200]

    def listed(self) -> list[dict[str, Any]]:
        """Describe all builds, as the page lists them."""
        return [self.describe(name) for name in self.names()]

    def describe(self, name: str) -> dict[str, Any]:
        """Describe a build for the page."""
        record, folder = self.records.get(name), self.folder / name
        passed = (folder / "report.json").is_file()
        held = passed or (folder / REJECTED / "report.json").is_file()
        phase = "done" if passed else "rejected" if held else record.phase if record else "stopped"
        return {
            "name": name,
            "title": self.title_of(name),
            "phase": phase,
            "picture": record.picture.name if record and record.picture else "",
            "result": describe_folder(folder, not passed) if held else None,
        }

    def title_of(self, name: str) -> str:
        return self.records[name].title if name in self.records else name

    def _is_listed(self, name: str) -> bool:
        folder = self.folder / name
        reports = (folder / "report.json", folder / REJECTED / "report.json")
        return any(path.is_file() for path in reports)

    def _made(self, name: str) -> float:
        folder = self.folder / name
        places = (folder / "report.json", folder / REJECTED / "report.json")
        return max((path.stat().st_mtime for path in places if path.is_file()), default=0.0)

    def _write(self, name: str) -> None:
        text = self.records[name].model_dump_json(indent=1)
        write_whole(self._records / f"{name}.json", text.encode())

    def _forget(self, name: str) -> None:
        self.records.pop(name, None)
        with contextlib.suppress(OSError):
            (self._records / f"{name}.json").unlink(missing_ok=True)


def number(base: str, taken: Iterable[str], joint: str) -> str:
    """Return `base`, with a number from 2 on if it is taken, regardless of case."""
    held, name, count = {one.casefold() for one in taken}, base, 2
    while name.casefold() in held:
        name, count = f"{base}{joint}{count}", count + 1
    return name


def describe_folder(folder: Path, rejected: bool) -> dict[str, Any]:
    """Describe the result in a build's folder: its files and main figures."""
    where = folder / REJECTED if rejected else folder
    held = plain_files(where)
    report = where / "report.json"
    try:
        found = _read_report(report, report.stat().st_mtime_ns)
    except OSError:
        found = None
    piece = _UNREADABLE
    if found is not None:
        piece = next((row.text.split(";")[0] for row in found.rows if row.name == "piece"), "")
    return {
        "where": folder.name + (f"/{REJECTED}" if rejected else ""),
        "verdict": found.verdict.word if found and found.verdict else None,
        "piece": piece,
        "files": [*(name for name, _ in sort_files(held)), *({"report.html"} & held)],
    }


@lru_cache(maxsize=512)
def _read_report(path: Path, changed: int) -> _Report | None:
    """Read a report.json, cached by its time of change; None if it cannot be read."""
    del changed
    try:
        return _Report.model_validate_json(path.read_bytes())
    except (OSError, ValidationError, RecursionError):
        return None


def plain_files(folder: Path) -> set[str]:
    """Return the names of the files in a folder, without links and hidden ones."""
    return {path.name for path in _children(folder) if path.is_file()}


def child_of(folder: Path, name: str) -> Path | None:
    """Return the entry of a folder with that name, unless it is a link, hidden, or a path elsewhere."""
    return next((path for path in _children(folder) if path.name == name), None)


def _children(folder: Path) -> list[Path]:
    try:
        with os.scandir(folder) as found:
            return [
                Path(e.path) for e in found if not e.is_symlink() and not e.name.startswith(".")
            ]
    except (OSError, ValueError):
        return []
