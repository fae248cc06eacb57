"""The output folder: all files of a build appear together, or none of them does."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from knotfab.errors import InputError, KnotfabError, MachineError, SceneError, spelled

__all__ = ["REJECTED", "OutputFolder"]

REJECTED = "rejected"
_PREFIX = ".knotfab-"
_PROBE = 4096  # bytes written at the start, to notice a full disk before the long work
_FULL = (errno.ENOSPC, errno.EDQUOT)

# Files of an earlier build that would contradict a new one that does not write them.
_OWN = re.compile(
    r"part(-\d+)?\.(stl|3mf|glb|png)|part-colours(-\d+)?\.3mf|slicer\.ini|plate(-\d+)+\.3mf"
    r"|knots(-\d+)?\.json|scene-\d+\.toml|sequence\.gif|zoetrope\.(stl|3mf)|coupon\.3mf"
    r"|region\.stl|start\.json|bends(-\d+)*\.csv|(bending-templates|drill-template)-\w+(-\d+)?\.pdf"
    r"|setup(-\d+)?\.(pdf|svg)"
    r"|(shadow|compare|soft)-[\w-]+\.png|picture-[\w-]+\.\w+"
)


class OutputFolder:
    """A folder that a build fills, as a context manager.

    Entering creates DIR (with its parents) and checks that it can be written; the build writes into
    a hidden folder inside DIR; `commit` or `reject` then moves everything at once. Leaving without
    either, by an error or Ctrl-C, removes all traces: what was in DIR stays as it was.

        with OutputFolder("out") as out:
            out.write("knots.json", text)
            mesh.export(out.file("part.stl"))
            out.commit()

    Raises:
        InputError: DIR is a file or may not be written.
        MachineError: the disk is full, at whatever moment.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path).expanduser()
        self._hidden: Path | None = None
        self._created: list[Path] = []

    @property
    def work(self) -> Path:
        """The folder to write into; only inside `with`, and before `commit` or `reject`."""
        if self._hidden is None:
            raise RuntimeError("the output folder is not open")
        return self._hidden / "new"

    def file(self, name: str) -> Path:
        """Where to write the file that becomes DIR/name."""
        return self.work / name

    def write(self, name: str, content: str | bytes) -> Path:
        """Write one file whole (text as UTF-8)."""
        data = spelled(content).encode("utf-8") if isinstance(content, str) else content
        path = self.file(name)
        path.write_bytes(data)
        return path

    def __enter__(self) -> OutputFolder:
        with self._explained(InputError):
            try:
                self._make()
                self._hidden = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=self.path))
                (self._hidden / "new").mkdir()
                (self._hidden / "old").mkdir()
                probe = self._hidden / "probe"
                probe.write_bytes(b"\0" * _PROBE)
                probe.unlink()
            except BaseException:
                self._clear()
                raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        full = isinstance(error, OSError) and error.errno in _FULL
        if isinstance(error, Exception) and not isinstance(error, InputError | SceneError):
            # Libraries in C++ report a full disk in their own words, or as a plain failed write;
            # the process that verifies may have died of it.
            full = full or self._is_full()
        self._clear()
        if full:
            raise self._no_space() from error

    def commit(self) -> None:
        """Move the new files into DIR, over those of an earlier build.

        All are on the disk before the first is moved, each move is atomic, and if one fails those
        before it are undone. An earlier build's own files that this one did not write are removed, and so is
        what an earlier one left in DIR/rejected.
        """
        with self._explained(MachineError):
            names = self._settle()
            stale = []
            if (self.path / "report.json").is_file():
                found = (p.name for p in self.path.iterdir() if p.is_file())
                stale = [n for n in found if _OWN.fullmatch(n) and n not in names]
            self._exchange(names, stale)
            if self._hidden is not None and (self.path / REJECTED / "report.json").is_file():
                os.replace(self.path / REJECTED, self._hidden / "old" / REJECTED)
            _sync(self.path)
        self._clear()

    def reject(self) -> None:
        """Move the new files to DIR/rejected, in place of what an earlier build left there."""
        assert self._hidden is not None
        rejected = self.path / REJECTED
        with self._explained(MachineError):
            self._settle()
            aside = self._hidden / "old" / REJECTED
            if rejected.exists():
                os.replace(rejected, aside)
            try:
                os.replace(self.work, rejected)
            except BaseException:
                if aside.exists():
                    os.replace(aside, rejected)
                raise
            _sync(self.path)
        self._clear()

    def _make(self) -> None:
        """Create DIR and its parents, remembering which of them are new."""
        missing = []
        folder = self.path
        while not folder.exists() and folder != folder.parent:
            missing.append(folder)
            folder = folder.parent
        for new in reversed(missing):
            new.mkdir(exist_ok=True)
            self._created.append(new)
        if not self.path.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(self.path))
        rejected = self.path / REJECTED
        if rejected.exists() and not rejected.is_dir():
            raise InputError(
                str(rejected), "it is a file, but failed builds go there", "Rename or remove it."
            )

    def _settle(self) -> list[str]:
        """Names of the new files, once every byte of them is on the disk."""
        if self._is_full():
            # A library that does not look at its writes may have cut a file short.
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        names = sorted(p.name for p in self.work.iterdir())
        for name in names:
            _sync(self.work / name)
        _sync(self.work)
        return names

    def _exchange(self, names: list[str], stale: list[str]) -> None:
        assert self._hidden is not None
        old = self._hidden / "old"
        done: list[str] = []
        try:
            for name in [*names, *stale]:
                done.append(name)
                if (self.path / name).exists():
                    _keep(self.path / name, old / name)
                if name in stale:
                    (self.path / name).unlink()
                else:
                    os.replace(self.work / name, self.path / name)
        except BaseException:
            for name in reversed(done):
                if (old / name).exists():
                    os.replace(old / name, self.path / name)
                elif not (self.work / name).exists():
                    (self.path / name).unlink(missing_ok=True)
            raise

    def _clear(self) -> None:
        """Remove the hidden folder, and folders made for this build that stayed empty."""
        if self._hidden is not None:
            shutil.rmtree(self._hidden, ignore_errors=True)
            self._hidden = None
        for folder in reversed(self._created):
            with contextlib.suppress(OSError):
                folder.rmdir()
        self._created = []

    def _is_full(self) -> bool:
        try:
            if not hasattr(os, "statvfs"):  # Windows
                return shutil.disk_usage(self.path).free == 0
            state = os.statvfs(self.path)
        except OSError:
            return False
        free = state.f_bfree if os.geteuid() == 0 else state.f_bavail
        return state.f_blocks > 0 and free == 0

    def _no_space(self) -> MachineError:
        return MachineError(
            str(self.path),
            "the disk is full, so the build cannot be written; earlier files there are untouched",
            "Free some space, or choose a folder on another disk with --out.",
        )

    @contextlib.contextmanager
    def _explained(self, kind: type[KnotfabError]) -> Iterator[None]:
        """Turn what the system says into one sentence."""
        try:
            yield
        except OSError as error:
            if error.errno in _FULL:
                raise self._no_space() from error
            if isinstance(error, FileExistsError | NotADirectoryError):
                raise kind(
                    str(self.path),
                    "it is a file" if self.path.is_file() else "a part of this path is a file",
                    "Choose a folder with --out.",
                ) from error
            raise kind(
                str(self.path),
                f"the output folder cannot be written ({error.strerror or error})",
                "Change its permissions, or choose another folder with --out.",
            ) from error


def _sync(path: Path) -> None:
    """Have the system write a file, or a folder's entries, to the disk."""
    folder = path.is_dir()
    try:
        handle = os.open(path, os.O_RDONLY if folder else os.O_RDWR)
    except PermissionError:
        if folder:  # which Windows opens for nobody
            return
        raise
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # folders on some file systems
            raise
    finally:
        os.close(handle)


def _keep(path: Path, aside: Path) -> None:
    """A second name for a file, so that it can be put back; a move where links are unknown."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, f"{path.name} is a directory", str(path))
    try:
        os.link(path, aside)
    except OSError:
        os.replace(path, aside)
