"""Hold the verdict's word against a person's on a hundred shadows, harmed as builds harm them.

`python -m tests.corpus.harmed_shadows [--out SHEET.png]`: sixty shadows of pictures of all kinds, to which
the rules were fitted, and forty of pictures of 3 to 12 parts. A person looked at each beside its picture
and gave it a word before the verdict on it was read.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import distance_transform_edt, gaussian_filter

from benchmarks.measurement import run_study
from examples.pictures import BOLD, pictures
from knotfab_formats.scene import View
from knotfab_formats.verdict import WORDS
from knotfab_validators.shadows.compare import overlap
from knotfab_validators.shadows.frame import padded_mask, working_frame
from knotfab_validators.shadows.recognition import recognise
from knotfab_validators.shadows.view import view_geometry

Mask = NDArray[np.bool_]
Pen = ImageDraw.ImageDraw

SIZE = 512  # px of a side, 180 mm on the wall
RADIUS_PX = 7.0  # of the tube's shadow: 2.5 mm
LAMP_MM = 1.0  # the penumbra of the default lamp on the default wall


class Part(NamedTuple):
    """A disc, box, triangle, star or letter of a picture, dark or light, with half its extents."""

    kind: str
    x: float
    y: float
    a: float
    b: float
    angle: float = 0.0
    dark: bool = True


def _paint(parts: Sequence[Part]) -> Mask:
    sheet = Image.new("L", (SIZE, SIZE))
    for kind, x, y, a, b, angle, dark in parts:
        stamp = Image.new("L", (SIZE, SIZE))
        pen = ImageDraw.Draw(stamp)
        box = (x - a, y - b, x + a, y + b)
        if kind == "disc":
            pen.ellipse(box, fill=255)
        elif kind == "box":
            pen.rectangle(box, fill=255)
        elif kind in ("triangle", "star"):
            radii = (1.0, 0.42) if kind == "star" else (1.0,)
            turns = np.arange(10) * np.pi / 5
            tips = [
                (x + a * r * np.sin(t), y - b * r * np.cos(t))
                for t, r in zip(turns, radii * 5, strict=False)
            ]
            pen.polygon(
                tips if kind == "star" else [(x - a, y + b), (x, y - b), (x + a, y + b)], fill=255
            )
        else:
            font = ImageFont.truetype(str(BOLD), int(2 * a))
            pen.text((x, y), kind, font=font, fill=255, anchor="mm")
        sheet.paste(255 * dark, (0, 0), stamp.rotate(angle, center=(x, y)) if angle else stamp)
    return np.asarray(sheet) > 127


def _round(kind: str, radius: float, a: float, b: float, turns: Sequence[float]) -> list[Part]:
    """Return parts around the middle, each turned with its place."""
    return [
        Part(kind, 256 + radius * np.sin(t), 256 - radius * np.cos(t), a, b, -np.degrees(t))
        for t in turns
    ]


def _lit(kind: str, a: float, b: float, *places: tuple[float, float]) -> list[Part]:
    return [Part(kind, x, y, a, b, dark=False) for x, y in places]


def _dark(kind: str, a: float, b: float, *places: tuple[float, float]) -> list[Part]:
    return [Part(kind, x, y, a, b) for x, y in places]


# fmt: off
PARTS: dict[str, list[Part]] = {
    "paw": [Part("disc", 256, 350, 110, 85), Part("disc", 110, 230, 42, 58, 20),
        Part("disc", 205, 140, 45, 62, 5), Part("disc", 307, 140, 45, 62, -5), Part("disc", 402, 230, 42, 58,
        -20)],
    "die": [Part("box", 256, 256, 200, 200), *_lit("disc", 38, 38, (150, 150), (362, 150), (256, 256),
        (150, 362), (362, 362))],
    "button": [Part("disc", 256, 256, 220, 220), *_lit("disc", 26, 26, (200, 200), (312, 200), (200, 312),
        (312, 312))],
    "panda": [*_dark("disc", 65, 65, (120, 130), (392, 130)), Part("disc", 256, 270, 200, 190),
        Part("disc", 256, 275, 180, 170, dark=False), Part("disc", 180, 240, 50, 65, 30),
        Part("disc", 332, 240, 50, 65, -30), *_lit("disc", 16, 16, (190, 245), (322, 245)),
        Part("disc", 256, 330, 34, 24), Part("box", 256, 385, 60, 10)],
    "love": [Part(c, x, 256, 75, 0) for c, x in zip("LOVE", (90, 205, 320, 430), strict=True)],
    "balloons": [*_dark("disc", 75, 95, (130, 190), (270, 130), (400, 210)), Part("box", 130, 380, 7, 100),
        Part("box", 270, 350, 7, 130), Part("box", 400, 390, 7, 90)],
    "house": [Part("triangle", 256, 120, 230, 80), Part("box", 256, 340, 190, 145), *_lit("box", 40, 40,
        (150, 290), (362, 290)), Part("box", 256, 410, 38, 76, dark=False),
        Part("box", 256, 250, 14, 30, dark=False)],
    "grapes": [*(Part("disc", 156 + 33 * row + 66 * k, 170 + 68 * row, 30, 30) for row in range(4) for k in
        range(4 - row)), Part("box", 255, 100, 8, 36)],
    "owl": [Part("disc", 256, 290, 170, 200), *_dark("triangle", 40, 60, (130, 110), (382, 110)),
        *_lit("disc", 62, 62, (185, 220), (327, 220)), *_dark("disc", 28, 28, (185, 220), (327, 220)),
        Part("triangle", 256, 290, 24, 30, 180, dark=False)],
    "traffic": [Part("box", 256, 230, 110, 210), *_lit("disc", 55, 55, (256, 100), (256, 230), (256, 360)),
        Part("box", 256, 475, 30, 36)],
    "flag": [Part("box", 60, 270, 16, 230), Part("box", 270, 180, 190, 130),
        Part("star", 170, 180, 70, 70, dark=False),
        *_lit("star", 30, 30, (300, 110), (370, 180), (300, 250))],
    "sun": [Part("disc", 256, 256, 100, 100), *_round("box", 180, 12, 46, [k * np.pi / 4 for k in range(8)])],
    "clock": [Part("disc", 256, 256, 220, 220), Part("disc", 256, 256, 185, 185, dark=False),
        Part("box", 256, 190, 14, 80), Part("box", 310, 256, 70, 12), Part("disc", 256, 256, 26, 26),
        *_round("box", 155, 10, 16, [k * np.pi / 2 for k in range(4)])],
}
# fmt: on


def _draw(paint: Callable[[Pen], object]) -> Mask:
    image = Image.new("1", (SIZE, SIZE))
    paint(ImageDraw.Draw(image))
    return np.asarray(image).astype(bool)


def _skyline() -> Mask:
    parts = []
    for n, top in enumerate((260, 190, 300, 150, 230, 200, 280)):
        left = 30 + 65 * n
        parts.append(Part("box", left + 32, (top + 460) / 2, 32, (460 - top) / 2))
        if n in (1, 3, 5):
            parts.append(Part("box", left + 31.5, top - 35, 2.5, 35))
        places = [(left + x, y + 9) for y in range(top + 20, 430, 40) for x in (19, 45)]
        parts += _lit("box", 7, 9, *places)
    return _paint(parts)


def _glasses() -> Mask:
    def paint(pen: Pen) -> None:
        pen.ellipse((90, 60, 420, 470), fill=1)
        pen.polygon([(400, 230), (470, 310), (400, 320)], fill=1)
        pen.rectangle((180, 420, 330, 511), fill=1)
        for x in (190, 320):
            pen.ellipse((x - 55, 170, x + 55, 280), fill=0)
            pen.ellipse((x - 40, 185, x + 40, 265), fill=1)
        pen.line((130, 385, 400, 385), fill=0, width=16)

    return _draw(paint)


def _ragged() -> Mask:
    rng = np.random.default_rng(5)
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    tips = 150 + 90 * np.cos(5 * angle) + rng.normal(0, 5, 720)
    points = np.stack([256 + tips * np.sin(angle), 256 - tips * np.cos(angle)], axis=1)
    return _draw(lambda pen: pen.polygon([tuple(p) for p in points.tolist()], fill=1))


def _card() -> Mask:
    def paint(pen: Pen) -> None:
        pen.ellipse((160, 40, 350, 230), fill=1)
        for k in range(14):
            pen.ellipse((60 + 28 * k, 300, 78 + 28 * k, 322), fill=1)
            pen.ellipse((65 + 28 * k, 306, 72 + 28 * k, 315), fill=0)

    return _draw(paint)


@cache
def _silhouettes() -> dict[str, Mask]:
    found = {"skyline": _skyline(), "face": _glasses(), "star": _ragged(), "card": _card()}
    for name, image in pictures().items():
        small = image.convert("L")
        small.thumbnail((SIZE, SIZE))
        sheet = Image.new("L", (SIZE, SIZE), 255)
        sheet.paste(small, ((SIZE - small.width) // 2, (SIZE - small.height) // 2))
        found.setdefault(name, np.asarray(sheet) < 128)
    return found | {name: _paint(parts) for name, parts in PARTS.items()}


# Harms to a shadow.


def _grown(mask: Mask, px: float) -> Mask:
    return distance_transform_edt(~mask) <= px if px > 0 else ~(distance_transform_edt(mask) <= -px)


def opened(mask: Mask, radii: float = 1.0) -> Mask:
    """Return what a tube so many times as thick draws of it."""
    return _grown(_grown(mask, -radii * RADIUS_PX), radii * RADIUS_PX)


def specks(mask: Mask, count: int, px: float, seed: int = 0) -> Mask:
    """Return it with round specks of light of this radius."""
    rng = np.random.default_rng(seed)
    inner = np.argwhere(distance_transform_edt(mask) > px + 6)
    at = inner[rng.choice(len(inner), count, replace=False)]
    spots = np.zeros_like(mask)
    spots[at[:, 0], at[:, 1]] = True
    return mask & ~_grown(spots, px)


def slits(mask: Mask, count: int, length: int, px: int) -> Mask:
    """Return it with slits of light between strands."""
    rng = np.random.default_rng(1)
    deep = distance_transform_edt(mask)
    inner, harmed = np.argwhere(deep > 12), mask
    for y, x in inner[rng.choice(len(inner), count, replace=False)]:
        a = rng.uniform(0, np.pi)
        line = (x, y, x + length * np.cos(a), y + length * np.sin(a))
        slit = _draw(lambda pen, line=line: pen.line(line, fill=1, width=px))  # type: ignore[misc]
        harmed = harmed & ~(slit & (deep > 6))
    return harmed


def strand(mask: Mask, *points: tuple[int, int]) -> Mask:
    """Return it with a strand that strays along these points."""
    return mask | _draw(lambda pen: pen.line(points, fill=1, width=14, joint="curve"))


def cut(mask: Mask, *boxes: tuple[int, int, int, int]) -> Mask:
    """Return it without what lies in boxes (left, top, right, bottom)."""
    harmed = mask.copy()
    for left, top, right, bottom in boxes:
        harmed[top:bottom, left:right] = False
    return harmed


def filled(mask: Mask, *boxes: tuple[int, int, int, int]) -> Mask:
    """Return it with what lies in boxes dark."""
    return ~cut(~mask, *boxes)


Change = Literal["gone", "scaled", "moved", "turned"]


def parts(mask: Mask, *changes: tuple[int, Change, float, float], of: str) -> Mask:
    """Return the picture painted anew with parts changed: by number, how, and by how much in x and y."""
    found: list[Part | None] = list(PARTS[of])
    for n, how, x, y in changes:
        part = PARTS[of][n]
        found[n] = {
            "gone": None,
            "scaled": part._replace(a=part.a * x, b=part.b * y),
            "moved": part._replace(x=part.x + x, y=part.y + y),
            "turned": part._replace(angle=part.angle + x),
        }[how]
    return _paint([part for part in found if part is not None])


Harm = Callable[[Mask], Mask]


def _same(mask: Mask) -> Mask:
    return mask


# Picture, a person's word (faithful, good, coarse, unknown), the harm.
# fmt: off
SIXTY: tuple[tuple[str, str, Harm], ...] = (
    ("cat", "F", _same),
    ("cat", "F", opened),
    ("cat", "F", lambda m: np.roll(m, 1, axis=1)),
    ("cat", "F", partial(specks, count=1, px=2)),
    ("cat", "F", partial(specks, count=5, px=1.5)),
    ("cat", "G", partial(specks, count=25, px=2.2)),
    ("cat", "G", partial(specks, count=50, px=1.5)),
    ("cat", "C", partial(specks, count=100, px=2.5)),
    ("cat", "C", partial(specks, count=250, px=3)),
    ("cat", "F", partial(specks, count=50, px=0.5)),
    ("knight", "G", partial(specks, count=36, px=2)),
    ("knight", "F", partial(specks, count=3, px=2)),
    ("knight", "G", partial(slits, count=12, length=30, px=2)),
    ("knight", "F", partial(slits, count=2, length=20, px=1)),
    ("knight", "C", partial(slits, count=50, length=40, px=3)),
    ("knight", "C", lambda m: strand(m, (300, 450), (470, 470), (500, 380))),
    ("heart", "F", _same),
    ("heart", "C", lambda m: strand(m, (250, 250), (400, 60), (500, 30))),
    ("heart", "C", lambda m: strand(m, (250, 350), (60, 480))),
    ("heart", "G", partial(specks, count=60, px=2.5)),
    ("heart", "U", lambda m: cut(m, (256, 0, 512, 512))),
    ("teapot", "C", lambda m: strand(m, (200, 200), (300, 40))),
    ("teapot", "F", opened),
    ("teapot", "U", partial(opened, radii=3)),
    ("teapot", "U", lambda m: cut(m, (0, 0, 512, 250))),
    ("bicycle", "F", _same),
    ("bicycle", "U", partial(opened, radii=1.5)),
    ("bicycle", "C", lambda m: cut(m, (100, 150, 130, 400), (300, 150, 330, 400))),
    ("skyline", "C", opened),
    ("skyline", "G", lambda m: cut(m, (120, 100, 140, 190), (250, 60, 270, 150), (380, 100, 400, 200))),
    ("skyline", "C", lambda m: filled(m, (30, 200, 90, 440))),
    ("skyline", "U", lambda m: filled(m, (0, 130, 512, 460)) & _grown(m, 60)),
    ("skyline", "G", lambda m: filled(m, (105, 205, 128, 232))),
    ("face", "F", _same),
    ("face", "C", lambda m: filled(filled(m, (133, 218, 152, 230), (184, 168, 196, 187),
        (228, 218, 247, 230)), *((263, 218, 282, 230), (314, 263, 326, 282)))),
    ("face", "C", lambda m: filled(m, (130, 160, 250, 290))),
    ("face", "C", lambda m: filled(m, (100, 150, 400, 300))),
    ("face", "G", partial(specks, count=40, px=2.5)),
    ("star", "G", opened),
    ("star, 14 pinholes", "G", opened),
    ("star, 40 pinholes", "G", opened),
    ("star", "G", partial(opened, radii=4)),
    ("tree", "F", _same),
    ("tree", "C", opened),
    ("tree", "U", partial(opened, radii=2.5)),
    ("anchor", "F", opened),
    ("anchor", "C", lambda m: cut(m, (0, 0, 512, 130))),
    ("notes", "C", lambda m: cut(m, (200, 0, 512, 150))),
    ("smiley", "F", _same),
    ("smiley", "C", lambda m: filled(m, (180, 120, 240, 230))),
    ("smiley", "C", partial(_grown, px=14)),
    ("pieces", "G", opened),
    ("wheel", "F", opened),
    ("wheel", "G", lambda m: cut(m, (250, 80, 262, 110))),
    ("card", "F", _same),
    ("card", "C", lambda m: filled(m, (60, 298, 460, 324))),
    ("card", "C", lambda m: cut(m, (0, 260, 512, 400))),
    ("stickman", "C", lambda m: cut(m, (0, 300, 256, 512))),
    ("cat", "U", lambda m: _silhouettes()["teapot"]),
    ("spiral", "C", partial(_grown, px=12)),
)
FORTY: tuple[tuple[str, str, Harm | tuple[tuple[int, Change, float, float], ...]], ...] = (
    ("die", "G", ((3, "scaled", 0.86, 0.86),)), ("die", "G", ((1, "scaled", 0.6, 0.6),)),
    ("die", "C", ((5, "gone", 0, 0),)), ("die", "G", ((2, "moved", 22, 14),)),
    ("paw", "G", ((1, "scaled", 0.85, 1.0),)), ("paw", "C", ((4, "gone", 0, 0),)),
    ("paw", "G", ((2, "scaled", 0.6, 0.6),)), ("paw", "F", opened),
    ("button", "G", ((2, "scaled", 0.8, 0.8),)), ("button", "C", ((3, "gone", 0, 0),)),
    ("button", "G", tuple((k, "scaled", 0.75, 0.75) for k in (1, 2, 3, 4))),
    ("panda", "C", ((6, "gone", 0, 0),)), ("panda", "G", ((8, "scaled", 0.7, 0.9),)),
    ("panda", "C", ((9, "gone", 0, 0),)), ("panda", "G", ((8, "moved", 18, 0),)),
    ("love", "C", ((1, "gone", 0, 0),)), ("love", "G", ((2, "turned", 12, 0),)),
    ("love", "G", ((3, "scaled", 0.85, 0.85),)), ("love", "C", lambda m: filled(m, (180, 230, 232, 282))),
    ("balloons", "G", ((1, "scaled", 0.9, 0.85),)), ("balloons", "C", ((4, "gone", 0, 0),)),
    ("balloons", "C", tuple((k, "gone", 0, 0) for k in (3, 4, 5))),
    ("house", "C", ((5, "gone", 0, 0),)), ("house", "F", ((5, "scaled", 0.8, 0.85),)),
    ("house", "G", tuple((k, "scaled", 0.75, 1.0) for k in (2, 3))),
    ("grapes", "C", ((9, "gone", 0, 0),)), ("grapes", "G", ((5, "scaled", 0.8, 0.8),)),
    ("grapes", "G", lambda m: strand(m, (186, 238), (222, 238))),
    ("owl", "G", ((5, "moved", 26, 0),)), ("owl", "C", ((7, "gone", 0, 0),)),
    ("owl", "G", ((5, "scaled", 0.75, 0.75),)),
    ("traffic", "G", ((2, "scaled", 1.0, 0.8),)),
    ("traffic", "G", lambda m: strand(m, (256, 150), (256, 310))),
    ("flag", "G", ((3, "turned", 36, 0),)), ("flag", "C", ((4, "gone", 0, 0),)),
    ("flag", "G", partial(opened, radii=1.6)),
    ("sun", "C", ((3, "gone", 0, 0),)), ("sun", "G", ((2, "scaled", 1.0, 0.6),)),
    ("clock", "F", ((3, "scaled", 0.8, 1.0),)), ("clock", "C", ((5, "gone", 0, 0),)),
)
# fmt: on
PINHOLES = {"star, 14 pinholes": (14, 3.0), "star, 40 pinholes": (40, 2.0)}


def harmed() -> list[tuple[str, str, Mask, Mask]]:
    """Return all hundred: name, the person's word, silhouette, shadow."""
    own, found = _silhouettes(), []
    for name, word, harm in (*SIXTY, *FORTY):
        mask = own[name.partition(",")[0]]
        wanted = specks(mask, *PINHOLES[name], seed=2) if name in PINHOLES else mask
        shadow = harm(mask) if callable(harm) else parts(mask, *harm, of=name)
        found.append((name, WORDS["FGCU".index(word)], wanted, shadow))
    return found


def judge(wanted: Mask, shadow: Mask) -> tuple[str, str]:
    """Return the verdict's word on a shadow, and its reasons."""
    frame = working_frame(SIZE, SIZE)
    seen, picture = padded_mask(shadow, frame), padded_mask(wanted, frame)
    scale = frame.width / SIZE
    geometry = view_geometry(View(frame_width_mm=180.0, frame_height_mm=180.0), SIZE, SIZE)
    found = recognise(
        seen,
        picture,
        overlap(seen, picture).iou,
        RADIUS_PX * scale,
        frame,
        geometry,
        blur_px=LAMP_MM * frame.width / 180.0,
    )
    return found.word, "; ".join(found.reasons)


def main(*, out: Path | None = None) -> None:
    """Print both words of every shadow and how many are alike, and draw all of them into `out`."""
    alike, far, frames = [], 0, []
    for n, (name, person, wanted, shadow) in enumerate(harmed()):
        word, why = judge(wanted, shadow)
        off = abs(WORDS.index(word) - WORDS.index(person))
        alike, far = [*alike, not off], max(far, off)
        print(f"{'!' * off:<3}{n:>3} {name:<18} {person:<17} {word:<17} {why}")
        frames.append((f"{n} {name}: {person}" + (f" / {word}" if off else ""), shadow))
    many = len(SIXTY)
    print(f"\n{sum(alike[:many])} of {many} alike, and {sum(alike[many:])} of {len(FORTY)}")
    print(f"off by {far} words at most")
    if out is not None:
        _draw_sheet(frames).save(out, optimize=True)


def _draw_sheet(frames: Sequence[tuple[str, Mask]], across: int = 10, px: int = 150) -> Image.Image:
    """Return all shadows, as soft as the lamp makes them, in rows, with their words."""
    sheet = Image.new("L", (across * px, -(-len(frames) // across) * (px + 16)), 255)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(9)
    for n, (said, shadow) in enumerate(frames):
        left, top = n % across * px, n // across * (px + 16)
        soft = gaussian_filter(shadow.astype(np.float64), LAMP_MM * SIZE / 180.0 / 4)
        tile = Image.fromarray((255 - 215 * soft).astype(np.uint8)).resize((px - 8, px - 8))
        sheet.paste(tile, (left + 4, top + 16))
        words = said.replace("not recognisable", "unknown")
        pen.text((left + 4, top + 3), words, fill=0, font=font)
    return sheet.quantize(16)


if __name__ == "__main__":
    run_study(main)
