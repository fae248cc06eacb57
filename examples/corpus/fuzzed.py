"""Good files changed at random, the same for the same seed."""

from __future__ import annotations

import io
import random
import struct
import zipfile

from .cube_files import archive, seeds
from .hostile import Hostile

__all__ = ["fuzzed"]

TOKENS = (
    *(b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"-0", b"0", b"-1", b"1e400"),
    *(b"4294967296", b"18446744073709551616", b"9" * 300, b"", b"x", b"1e7", b"0x10", b"[[", b"]]"),
)


def fuzzed(seed: int) -> Hostile:
    """One of the good files, changed at random; the same for the same seed."""
    rng = random.Random(seed)
    name, good = rng.choice(sorted(seeds().items()))
    content = bytearray(good)
    if name.endswith("3mf") and rng.random() < 0.7:  # inside the archive, not the archive
        with zipfile.ZipFile(io.BytesIO(good)) as file:
            entries: dict[str, str | bytes] = {n: file.read(n) for n in file.namelist()}
        inner = rng.choice(["3D/3dmodel.model", "3D/3dmodel.model", *entries])
        before = entries[inner]
        assert isinstance(before, bytes)
        changed = bytearray(before)
        for _ in range(rng.randint(1, 4)):
            _change(changed, rng)
        return Hostile(name, archive({**entries, inner: bytes(changed)}), None)
    for _ in range(rng.randint(1, 4)):
        _change(content, rng)
    return Hostile(name, bytes(content), None)


def _change(content: bytearray, rng: random.Random) -> None:
    """Flip, cut, insert, swap, double, or put another number for one."""
    if not content:
        return
    at = rng.randrange(len(content))
    kind = rng.randrange(8)
    if kind == 0:
        content[at] ^= 1 << rng.randrange(8)
    elif kind == 1:
        content[at] = rng.randrange(256)
    elif kind == 2:
        del content[at:]
    elif kind == 3:
        content[at:at] = rng.randbytes(rng.choice((1, 4, 50)))
    elif kind == 4:
        del content[at : at + rng.choice((1, 4, 50))]
    elif kind == 5:
        other, size = rng.randrange(len(content)), rng.choice((1, 4, 50))
        content[at : at + size] = content[other : other + size]
    elif kind == 6 and len(content) >= 4:
        at = min(at, len(content) - 4)
        content[at : at + 4] = struct.pack("<I", rng.choice((0, 1, 2**31, 2**32 - 1, 0x7FC00000)))
    else:
        words = bytes(content).split()
        if words:
            word = rng.choice(words)
            changed = bytes(content).replace(word, rng.choice(TOKENS), rng.choice((1, 1, -1)))
            content[:] = changed[: 4 * len(content) + 4000]
