"""Good files changed at random, the same for the same seed."""

import io
import random
import re
import struct
import tempfile
import zipfile
from functools import cache
from pathlib import Path

from .case import make_part, with_scene
from .curves import circle
from .files import archive, seeds, write
from .hostile import Hostile

NUMBER = re.compile(rb"-?\d+\.?\d*(?:e[+-]?\d+)?")

TOKENS = (
    *b"-0 0 -1 1 1e-320 1e-7 0.5 90 180 3000 1e7 -1e7 nan inf -inf 1e308 -1e308 1e400".split(),
    *(b"4294967296", b"18446744073709551616", b"9" * 300, b"", b"x", b"0x10", b"[[", b"]]"),
)


@cache
def company() -> dict[str, bytes]:
    """A good part in four formats, its knots, scene and picture, by the names of the files."""
    files: dict[str, bytes] = {}
    for form in ("stl-text", "obj", "ply", "3mf"):
        part = with_scene(make_part(circle(20.0, 24), sides=8, format=form))
        with tempfile.TemporaryDirectory() as folder:
            write(part, Path(folder))
            files |= {path.name: path.read_bytes() for path in Path(folder).iterdir()}
    return files


def fuzz_file(seed: int) -> Hostile:
    """One good file changed at random, the same for the same seed.

    Seven of eight are small files by themselves, changed in every way. The eighth is one of a part, its
    knots and its scene, and only its numbers are changed: most of these can be read, and meet all
    the checks there are.
    """
    rng = random.Random(seed)
    among = seed % 8 == 0
    files = {n: c for n, c in company().items() if n != "front.png"} if among else seeds()
    name = rng.choice(sorted(files))
    alter = _renumber if among else change
    content = bytearray(files[name])
    # inside the archive, not the archive
    if name.endswith("3mf") and (among or rng.random() < 0.7):
        with zipfile.ZipFile(io.BytesIO(files[name])) as file:
            entries: dict[str, str | bytes] = {n: file.read(n) for n in file.namelist()}
        model = "3D/3dmodel.model"
        inner = model if among else rng.choice([model, model, *entries])
        before = entries[inner]
        assert isinstance(before, bytes)
        changed = bytearray(before)
        for _ in range(rng.randint(1, 4)):
            alter(changed, rng)
        return Hostile(name, archive({**entries, inner: bytes(changed)}), None, among)
    for _ in range(rng.randint(1, 4)):
        alter(content, rng)
    return Hostile(name, bytes(content), None, among)


def _renumber(content: bytearray, rng: random.Random) -> None:
    """Put another number for one, often one from elsewhere in the file; or double a line."""
    found = list(NUMBER.finditer(content))
    if not found:
        return
    one, other = rng.choice(found), rng.choice(found).group()
    kind = rng.randrange(10)
    if kind < 9:
        content[one.start() : one.end()] = rng.choice(TOKENS[:13]) if kind < 6 else other
    else:
        lines = bytes(content).split(b"\n")
        lines[rng.randrange(len(lines))] = rng.choice(lines)
        content[:] = b"\n".join(lines)


def change(content: bytearray, rng: random.Random) -> None:
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
