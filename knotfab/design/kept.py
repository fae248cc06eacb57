"""Keep the finished frames of a sequence, so that an interrupted build can resume.

They lie in the user's cache, under a digest of all that determines them: the pictures, the resolved scene,
the options, and this program itself. So a frame that is found gives the same part. The files are pickles,
which nobody but their writer should read, so they are not kept in the result's folder.
"""

from __future__ import annotations

import contextlib
import hashlib
import pickle
import platform
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

from knotfab.base.disk import own_folder
from knotfab.picture.read import Target
from knotfab_formats.disk import write_whole
from knotfab_formats.scene import ResolvedScene


class KeptFrames:
    """The kept frames of one sequence; a folder that cannot be written keeps nothing."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __len__(self) -> int:
        return len(list(self.folder.glob("*.frame")))

    def load(self, number: int) -> Any:
        """Return the stored result of a frame (from 0), None if it cannot be read."""
        with contextlib.suppress(Exception):  # a damaged pickle may raise anything
            return pickle.loads(self._file(number).read_bytes())
        return None

    def store(self, number: int, value: Any) -> None:
        """Store the result of a frame (from 0), whole or not at all."""
        # the last three come from values that cannot be pickled
        with contextlib.suppress(OSError, pickle.PicklingError, TypeError, AttributeError):
            self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            write_whole(self._file(number), pickle.dumps(value))

    def discard(self) -> None:
        """Remove all kept frames of this sequence."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _file(self, number: int) -> Path:
        return self.folder / f"{number}.frame"


def keep_for(
    scene: ResolvedScene, targets: Sequence[Target], device: str, time_budget_s: float | None
) -> KeptFrames:
    """Return the kept frames of a sequence, and remove those of sequences not built for 30 days."""
    folder = own_folder("KNOTFAB_CACHE", user_cache_path) / "sequences"
    with contextlib.suppress(OSError):
        for other in folder.iterdir():
            if other.stat().st_mtime < time.time() - 86400 * 30.0:
                shutil.rmtree(other, ignore_errors=True)
    digest = hashlib.sha256()
    for part in _parts(scene, targets, device, time_budget_s):
        digest.update(len(part).to_bytes(8, "little") + part)
    return KeptFrames(folder / digest.hexdigest()[:32])


def _parts(
    scene: ResolvedScene, targets: Sequence[Target], device: str, time_budget_s: float | None
) -> Iterator[bytes]:
    """Yield everything that determines the frames' knots."""
    yield _digest_program()
    yield scene.model_dump_json().encode()
    yield repr((device, time_budget_s)).encode()
    if scene.region.file is not None:
        with contextlib.suppress(OSError):  # the search reports an unreadable mesh
            yield Path(scene.region.file).read_bytes()
    for target in targets:
        yield f"{target.name}{target.suffix}".encode()
        for mask in (target.mask, target.asked):
            yield repr(mask.shape).encode() + mask.tobytes()


@cache
def _digest_program() -> bytes:
    """Digest the program's own files and the versions of the libraries that it computes with."""
    digest = hashlib.sha256(platform.python_version().encode() + platform.machine().encode())
    for name in ("numpy", "scipy", "shapely", "torch", "numba"):
        with suppress(PackageNotFoundError):
            digest.update(f"{name} {version(name)}".encode())
    package = Path(__file__).parents[1]
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.digest()
