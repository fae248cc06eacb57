"""The output folder: all files of a build appear together, or none of them does."""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import hmac
import json
import os
import re
import secrets
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from knotfab.base.disk import at_home, hold, locked, own_folder, require_within
from knotfab.base.errors import MachineError, SceneError, why_of
from knotfab_formats.errors import InputError, KnotfabError, spelled

_PROBE = 4096  # bytes written at the start, to notice a full disk before the long work
_FULL = (errno.ENOSPC, errno.EDQUOT)
_OF_WRITING = (*_FULL, errno.EFBIG, errno.EROFS)  # whatever file a library was writing

# Files of an earlier build that would contradict a new one that does not write them.
_OWN = re.compile(
    r"part(-\d+)?\.(stl|3mf|glb|png|step|gcode)|part-colours(-\d+)?\.3mf|slicer\.ini|plate(-\d+)+\.(3mf|gcode)"
    r"|knots(-\d+)?\.json|scene-\d+\.toml|sequence\.gif|zoetrope\.(stl|3mf)|coupon\.3mf"
    r"|region\.stl|start\.json|bends(-[\w-]+)?\.\w+|(bending-templates|drill-template)-\w+(-\d+)?\.pdf"
    r"|setup(-\d+)?\.(pdf|svg)|table-\d+\.3mf|colours\.png"
    r"|centre-lines(-\d+)?\.(svg|dxf|step)|shadow-[^./\\:\0-\x1f]+\.svg"
    r"|(shadow|compare|soft|drawn|subject)-[^./\\:\0-\x1f]+\.png|picture-[^./\\:\0-\x1f]+\.\w+"
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
        require_within(self.path)
        with self._explained(InputError):
            try:
                self._make()
                with locked(self.path):
                    mend_locked(self.path)
                    self._hidden = Path(tempfile.mkdtemp(prefix=HIDDEN, dir=self.path))
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

        All are on the disk before the first is moved, each move is atomic, and if one fails those
        before it are undone; of a process that is killed, whoever uses DIR next finishes them (`mend`).
        An earlier build's own files that this one did not write are removed, and so is what an earlier one
        left in DIR/rejected.
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
        """Carry out these moves, with DIR locked."""
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
        """Return the new files' names, once all their bytes are on the disk."""
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


# Moving new files into their folder, all or none, even if the process is killed in between.


REJECTED = "rejected"
HIDDEN = ".knotfab-"
_DO, _UNDO, _SEAL = "moves.json", "undo.json", "seal"
_PLAIN = re.compile(r"[^./\\:\0-\x1f][^/\\:\0-\x1f]*")  # a name of this folder, on every system
_DEVICES = re.compile(
    r"(?i)(con|prn|aux|nul|com\d|lpt\d)\s*(\.|\Z)"
)  # files that Windows has everywhere
_PASSING = secrets.token_bytes(32)  # the secret of a process whose user can keep none

# from a place in the hidden folder (None: nothing comes) to one in DIR
Step = tuple[str | None, str]


def move_all(folder: Path, hidden: Path, steps: Sequence[Step]) -> None:
    """Move files from `hidden`, a folder in `folder`, to their places, and what they replace to hidden/old.

    Raises:
        OSError: one cannot be moved; those before it were undone.
    """
    if not all(map(_is_plain, steps)):
        raise ValueError(f"no plain names: {steps}")
    draft = hidden / "draft"
    text = json.dumps(steps)
    draft.write_text(json.dumps([_sign(hidden, text), text]), encoding="utf-8")
    sync(draft)
    os.replace(draft, hidden / _DO)
    sync(hidden)
    try:
        for step in steps:
            _do(folder, hidden, step)
        sync(folder)
    except BaseException:
        _undo(folder, hidden, steps)
        raise
    (hidden / _DO).unlink()


def is_moving(hidden: Path) -> bool:
    """Return whether a hidden folder is still needed: its moves could be neither finished nor undone."""
    return (hidden / _DO).exists() or (hidden / _UNDO).exists()


def mend(folder: Path) -> None:
    """Finish moves into `folder` by killed processes, and remove what else they left there."""
    with contextlib.suppress(OSError):
        if any(name.startswith(HIDDEN) for name in os.listdir(folder)):
            with locked(folder):
                mend_locked(folder)


def mend_locked(folder: Path) -> None:
    """Do the same where the caller has locked `folder`."""
    for hidden in sorted(folder.glob(f"{HIDDEN}*")):
        with contextlib.suppress(OSError):  # another's who still lives, or nobody's to change
            if not stat.S_ISDIR(hidden.lstat().st_mode):
                continue
            handle = hold(hidden)
            if handle is None:
                continue
            try:
                if _is_sealed(hidden):
                    _mend_one(folder, hidden)
                    remove(hidden)
                else:
                    hidden.rmdir()  # where nothing is in it: its process was killed as it made it
            finally:
                os.close(handle)


def seal(hidden: Path) -> None:
    """Mark a hidden folder, just made, as this user's own."""
    (hidden / _SEAL).write_text(_sign(hidden, ""), encoding="ascii")


def remove(hidden: Path) -> None:
    """Remove a hidden folder, its seal last, so that leftovers of a killed process are recognised."""
    for path in hidden.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif path.name != _SEAL:
            path.unlink()
    shutil.rmtree(hidden)


def _is_sealed(hidden: Path) -> bool:
    """Return whether this user's build made a hidden folder that contains no link."""
    for name, kind in ((_SEAL, stat.S_ISREG), ("new", stat.S_ISDIR), ("old", stat.S_ISDIR)):
        path = hidden / name
        if os.path.lexists(path) and not kind(path.lstat().st_mode):
            return False
    if not (hidden / _SEAL).is_file():
        return False
    with (hidden / _SEAL).open("rb") as file:
        return hmac.compare_digest(file.read(200), _sign(hidden, "").encode())


def _sign(hidden: Path, text: str) -> str:
    """Return a signature of a text, which only this user can make, for this very folder."""
    where = [os.path.realpath(hidden), hidden.stat().st_ino, text]
    return hmac.new(_secret(), json.dumps(where).encode(), hashlib.sha256).hexdigest()


def _secret() -> bytes:
    from platformdirs import user_state_path

    return _kept_secret(own_folder("KNOTFAB_STATE", user_state_path) / "moves.key")


@functools.cache
def _kept_secret(place: Path) -> bytes:
    """Return the secret kept in a file, created if missing; this process's if none can be kept."""
    with contextlib.suppress(OSError):
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            draft = place.with_name(f"moves-{secrets.token_hex(8)}.key")
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
            with os.fdopen(os.open(draft, flags, 0o600), "wb") as out:
                out.write(_PASSING)
            with contextlib.suppress(FileExistsError):  # another process was faster
                os.link(draft, place)
            draft.unlink()
        found = place.read_bytes()
        if len(found) == len(_PASSING):
            return found
    return _PASSING


def _read_steps(hidden: Path, name: str) -> list[Step]:
    """Read the moves recorded by this user's build; none where anything else is written."""
    with contextlib.suppress(ValueError, TypeError, RecursionError):
        said, text = json.loads((hidden / name).read_text("utf-8"))
        if hmac.compare_digest(said, _sign(hidden, text)):
            steps = json.loads(text)
            if all(map(_is_plain, steps)):
                return [(source, name) for source, name in steps]
    return []


def _is_plain(step: Any) -> bool:
    """Return whether a step leads from a hidden folder's new files to a name in its own folder."""
    source, name = step
    if not isinstance(name, str) or not _PLAIN.fullmatch(name) or _DEVICES.match(name):
        return False
    return source is None or source == (f"new/{name}" if name != REJECTED else "new")


def _mend_one(folder: Path, hidden: Path) -> None:
    if (hidden / _DO).is_file():
        steps = _read_steps(hidden, _DO)
        try:
            for step in steps:
                _do(folder, hidden, step)
            sync(folder)
        except OSError:
            _undo(folder, hidden, steps)
        (hidden / _DO).unlink(missing_ok=True)
    elif (hidden / _UNDO).is_file():
        _undo(folder, hidden, _read_steps(hidden, _UNDO))


def _do(folder: Path, hidden: Path, step: Step) -> None:
    source, name = step
    kept = hidden / "old" / name
    if source is not None and not os.path.lexists(hidden / source):
        return  # it was moved before
    if os.path.lexists(folder / name) and not os.path.lexists(kept):
        _keep(folder / name, kept)
    if source is not None:
        os.replace(hidden / source, folder / name)
    elif name != REJECTED:
        (folder / name).unlink(missing_ok=True)


def _undo(folder: Path, hidden: Path, steps: Sequence[Step]) -> None:
    """Put earlier files back, and new ones into the hidden folder."""
    if (hidden / _DO).is_file():
        os.replace(hidden / _DO, hidden / _UNDO)
    for source, name in reversed(steps):
        if source is not None and not os.path.lexists(hidden / source):
            with contextlib.suppress(FileNotFoundError):
                os.replace(folder / name, hidden / source)
        if os.path.lexists(hidden / "old" / name):
            os.replace(hidden / "old" / name, folder / name)
    sync(folder)
    (hidden / _UNDO).unlink()


def _keep(path: Path, aside: Path) -> None:
    """Keep a file under a second name to restore it; it is moved where links are unsupported."""
    if path.name == REJECTED:
        os.replace(path, aside)
        return
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, f"{path.name} is a directory", str(path))
    try:
        os.link(path, aside, follow_symlinks=False)
    except (OSError, NotImplementedError):
        os.replace(path, aside)


def sync(path: Path) -> None:
    """Flush a file, or a folder's entries, to the disk."""
    folder = path.is_dir()
    try:
        handle = os.open(path, os.O_RDONLY if folder else os.O_RDWR)
    except PermissionError:
        if folder:  # Windows opens no folder
            return
        raise
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # folders on some file systems
            raise
    finally:
        os.close(handle)
