"""What the maker reads, changed at random: pictures, photographs, scenes, starts, reports."""

import gzip
import io
import json
import random
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

from PIL import Image, ImageDraw

from examples.api_page import KEYS
from knotfab.apps.compare.compare import read_photo
from knotfab.apps.studio.builds import describe_folder
from knotfab.knots import read_start
from knotfab.picture.frames import read_frames
from knotfab.picture.read import read_target
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import load_scene

from .curves import circle
from .fuzzed import change
from .hostile import Hostile

READERS: Mapping[str, Callable[[Path], object]] = {
    "picture": read_target, "photo": read_photo, "frames": lambda path: read_frames([str(path)]),
    "scene": lambda path: resolve(load_scene(path)), "start": read_start,
    "report": lambda path: describe_folder(path.parent, False),
}  # fmt: skip

SVG = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="120mm"
 height="90mm" viewBox="0 0 120 90"><style>g > .ink:not(#a) { fill: black; stroke-width: 2px }
 @media print { .ink { fill: red } }</style><defs><linearGradient id="g"><stop offset="0" stop-color="#000"/>
 <stop offset="1" stop-color="#fff" stop-opacity=".5"/></linearGradient><clipPath id="c"><rect width="60"
 height="90"/></clipPath><filter id="f"><feGaussianBlur stdDeviation="2"/></filter><symbol id="s"
 viewBox="0 0 10 10"><circle cx="5" cy="5" r="4"/></symbol></defs><g transform="translate(10 10) scale(.8)">
 <path class="ink" d="M10 10h40v30l-20 15-20-15zM20 20a5 5 0 1 0 10 0 5 5 0 1 0-10 0z" fill-rule="evenodd"/>
 <use xlink:href="#s" x="60" y="10" width="30" height="30" clip-path="url(#c)"/>
 <text x="5" y="80" font-size="18">Ki</text><rect x="70" y="50" width="20" height="20" fill="url(#g)"
 filter="url(#f)"/></g></svg>"""


@cache
def seeds() -> dict[tuple[str, str], bytes]:
    """Good files by their reader and name."""
    drawn = Image.new("L", (90, 70), 255)
    ImageDraw.Draw(drawn).ellipse((15, 10, 70, 60), fill=0)
    coloured = Image.merge("RGBA", (drawn, drawn, drawn, drawn.point(lambda v: 255 - v // 2)))
    found: dict[tuple[str, str], bytes] = {}
    for name in ("a.png", "a.jpg", "a.bmp", "a.webp", "a.tiff", "a.gif", "rgba.png", "palette.png"):
        image = {"rgba.png": coloured, "palette.png": drawn.convert("P")}.get(name, drawn)
        buffer = io.BytesIO()
        image.save(buffer, format={"jpg": "jpeg"}.get(end := name.rpartition(".")[2], end))
        found["picture", name] = buffer.getvalue()
    found["photo", "a.jpg"] = found["picture", "a.jpg"]
    buffer = io.BytesIO()
    drawn.save(
        buffer, format="GIF", save_all=True, append_images=[drawn.rotate(30 * k) for k in (1, 2)]
    )
    found["frames", "a.gif"] = buffer.getvalue()
    found["picture", "a.svg"] = SVG.encode()
    found["picture", "a.svgz"] = gzip.compress(SVG.encode())
    found["scene", "scene.toml"] = KEYS.read_bytes()
    points = circle(20.0, 24).tolist()
    start = {"schema": 1, "radius_mm": 2.0, "coordinates": "scene", "knots": [{"points": points}]}
    found["start", "start.json"] = json.dumps(start).encode()
    report = {"verdict": {"word": "good", "reasons": []}, "views": [{"iou": 0.9}], "print": {}}
    found["report", "report.json"] = json.dumps(report).encode()
    return found


def fuzz_stranger(seed: int) -> Hostile:
    """One good file changed at random, the same for the same seed; drawings are taken more often."""
    rng = random.Random(seed)
    readers = [*READERS, "picture", "picture", "picture", "scene"]
    reader = rng.choice(readers)
    names = sorted(name for of, name in seeds() if of == reader)
    name = rng.choice([*names, *(n for n in names if ".svg" in n)])
    content = bytearray(seeds()[reader, name])
    packed = name.endswith(".svgz") and rng.random() < 0.7
    if packed:
        content = bytearray(gzip.decompress(bytes(content)))
    for _ in range(rng.randint(1, 4)):
        change(content, rng)
    return Hostile(
        name, gzip.compress(bytes(content)) if packed else bytes(content), None, reader=reader
    )


def read_stranger(file: Hostile, folder: Path) -> None:
    """Read a file as a command would."""
    path = folder / file.name
    path.write_bytes(file.content)
    READERS[file.reader](path)
