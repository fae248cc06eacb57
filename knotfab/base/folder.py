"""The output folder: all files of a build appear together, or none of them does."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType

from knotfab.base.disk import at_home, hold, locked
from knotfab.base.errors import MachineError, SceneError, why_of
from knotfab.base.moves import (
    HIDDEN,
    REJECTED,
    Step,
    is_moving,
    mend_locked,
    move_all,
    remove,
    seal,
    sync,
)
from knotfab_formats.errors import InputError, KnotfabError, spelled

_PROBE = 4096  # bytes written at the start, to notice a full disk before the long work
_FULL = (errno.ENOSPC, errno.EDQUOT)
_OF_WRITING = (*_FULL, errno.EFBIG, errno.EROFS)  # whatever file a library was writing

# Files of an earlier build that would contradict a new one that does not write them.
_OWN = re.compile(
    r"part(-\d+)?\.(stl|3mf|glb|png|step|gcode)|(piece|unlit)\.png|part-colours(-\d+)?\.3mf|slicer\.ini|plate(-\d+)+\.(3mf|gcode)"
    r"|knots(-\d+)?\.json|scene-\d+\.toml|sequence\.gif|zoetrope\.(stl|3mf)|coupon\.3mf"
    r"|region\.stl|start\.json|bends(-[\w-]+)?\.\w+|bending-templates-\w+(-\d+)?\.pdf|drill-template(-\w+)*\.pdf"
    r"|setup(-\d+)?\.(pdf|svg)|table-\d+\.3mf|colours\.png"
    r"|centre-lines(-\d+)?\.(svg|dxf|step)|shadow-[^./\\:\0-\x1f]+\.svg"
    r"|(shadow|compare|soft|drawn|subject)-[^./\\:\0-\x1f]+\.png|(picture|given)-[^./\\:\0-\x1f]+\.\w+"
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
        MachineError: the disk fills up, at any moment.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = at_home(path)
        self._hidden: Path | None = None
        # the lock that tells a living build's folder from a killed one's
        self._held: int | None = None
        self._created: list[Path] = []

    @property
    def work(self) -> Path:
        """The folder to write into; valid inside `with`, before `commit` or `reject`."""
        if self._hidden is None:
            raise RuntimeError("the output folder is not open")
        return self._hidden / "new"

    def file(self, name: str) -> Path:
        """Return the path to write so that it becomes DIR/name."""
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
                with locked(self.path):
                    mend_locked(self.path)
                    # named before it is there: it goes too where a signal comes in between
                    self._hidden = self.path / f"{HIDDEN}{secrets.token_hex(8)}"
                    self._hidden.mkdir(0o700)
                    self._held = hold(self._hidden)
                    seal(self._hidden)
                (self._hidden / "new").mkdir()
                (self._hidden / "old").mkdir()
                self._probe()
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
        why = self._why_unwritten(error) if isinstance(error, Exception) else None
        self._clear()
        if why is not None:
            raise why from error

    def commit(self) -> None:
        """Move the new files into DIR, over those of an earlier build.

        All are on the disk before the first is moved. Each move is atomic, and if one fails, those before it
        are undone; if the process is killed, the next to use DIR completes them (`mend`). Files of an earlier
        build that this one did not write are removed, and so is DIR/rejected.
        """

        def steps(names: Sequence[str]) -> list[Step]:
            stale: list[str] = []
            if (self.path / "report.json").is_file():
                found = (p.name for p in self.path.iterdir() if p.is_file())
                stale = [n for n in found if _OWN.fullmatch(n) and n not in names]
            if (self.path / REJECTED / "report.json").is_file():
                stale.append(REJECTED)
            return [*((f"new/{name}", name) for name in names), *((None, name) for name in stale)]

        self._move(steps)

    def reject(self) -> None:
        """Move the new files to DIR/rejected, replacing those of an earlier build."""
        self._move(lambda _: [("new", REJECTED)])

    def _move(self, steps: Callable[[Sequence[str]], list[Step]]) -> None:
        """Carry out the moves that `steps` lists for the new files, with DIR locked."""
        assert self._hidden is not None
        with self._explained(MachineError):
            names = self._settle()
            with locked(self.path):
                mend_locked(self.path)
                move_all(self.path, self._hidden, steps(names))
        self._clear()

    def _make(self) -> None:
        """Create DIR and its parents, remembering which of them are new."""
        missing = []
        folder = self.path
        while not folder.exists() and folder != folder.parent:
            missing.append(folder)
            folder = folder.parent
        for new in reversed(missing):
            self._created.append(new)  # first: it goes too where a signal comes in between
            new.mkdir(exist_ok=True)
        if not self.path.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(self.path))
        rejected = self.path / REJECTED
        if rejected.exists() and not rejected.is_dir():
            raise InputError(
                str(rejected), "it is a file, but failed builds go there", "Rename or remove it."
            )

    def _settle(self) -> list[str]:
        """Flush the new files to the disk; return their names."""
        if self._is_full():
            # A library that does not look at its writes may have cut a file short.
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        names = sorted(p.name for p in self.work.iterdir())
        for name in names:
            sync(self.work / name)
        sync(self.work)
        return names

    def _clear(self) -> None:
        """Remove the hidden folder, and empty folders that this build created."""
        if self._hidden is not None and not is_moving(self._hidden):
            with contextlib.suppress(OSError):
                remove(self._hidden)
        self._hidden = None
        if self._held is not None:
            os.close(self._held)
            self._held = None
        for folder in reversed(self._created):
            with contextlib.suppress(OSError):
                folder.rmdir()
        self._created = []

    def _probe(self) -> None:
        """Write a few bytes, so that an unwritable disk is noticed early."""
        assert self._hidden is not None
        probe = self._hidden / "probe"
        probe.write_bytes(b"\0" * _PROBE)
        probe.unlink()

    def _why_unwritten(self, error: Exception) -> KnotfabError | None:
        """Return the disk's fault, if it made a build fail, else None.

        Libraries in C++ report it in their own words, or as a plain failed write; the process that verifies
        may have died of it.
        """
        if self._hidden is None:  # it was moved to its place
            return None
        if not self._hidden.is_dir():
            return self._no_folder()
        if isinstance(error, InputError | SceneError):
            return None
        if isinstance(error, OSError) and (
            error.errno in _OF_WRITING or str(self._hidden) in str(error.filename)
        ):
            return self._explain(error, MachineError)
        if self._is_full():
            return self._no_space()
        try:
            self._probe()
        except OSError as found:
            return self._explain(found, MachineError)
        return None

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

    def _no_folder(self) -> MachineError:
        return MachineError(
            str(self.path), "it was removed while the build wrote into it", "Build again."
        )

    @contextlib.contextmanager
    def _explained(self, kind: type[KnotfabError]) -> Iterator[None]:
        """Turn the system's error into one sentence."""
        try:
            yield
        except OSError as error:
            raise self._explain(error, kind) from error

    def _explain(self, error: OSError, kind: type[KnotfabError]) -> KnotfabError:
        if error.errno in _FULL:
            return self._no_space()
        if self._hidden is not None and not self._hidden.is_dir():
            return self._no_folder()
        if isinstance(error, FileExistsError | NotADirectoryError):
            return kind(
                str(self.path),
                "it is a file" if self.path.is_file() else "a part of this path is a file",
                "Choose a folder with --out.",
            )
        remedy = "Change its permissions, or choose another folder with --out."
        if error.errno == errno.EFBIG:
            remedy = "Raise the limit on the size of files (ulimit -f)."
        return kind(
            str(self.path), f"the output folder cannot be written ({why_of(error)})", remedy
        )
