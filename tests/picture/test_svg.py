"""SVG files as editors and the web write them: drawn as a browser draws them, told, or refused."""

import base64
import gzip
import io
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from knotfab.picture.read import Target, read_target
from knotfab.picture.svg import draw, render
from knotfab_formats.errors import InputError

URI = "http://www.w3.org/2000/svg"
NS = f'xmlns="{URI}"'
LINK = 'xmlns:xlink="http://www.w3.org/1999/xlink" xlink:href'
SQUARE = '<path d="M20 20H80V80H20Z"/>'  # 0.36 of the page
DISC = np.pi * 0.45**2
RED, P3_RED = "#d92020", "color(display-p3 .851 .125 .125)"


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render, "LONGER_SIDE", 400)


def page(body: str, attributes: str = "") -> str:
    return f'<svg {NS} viewBox="0 0 100 100" {attributes}>{body}</svg>'


def read(folder: Path, text: str | bytes, name: str = "drawing.svg") -> Target:
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_target(folder / name)


def image(data: bytes, kind: str) -> str:
    uri = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    return f'<image width="100" height="100" {LINK}="{uri}"/>'


def embedded(kind: str) -> str:
    """A black square, 60 of 100 px wide, on white, as an embedded picture."""
    pixels = Image.new("RGB", (100, 100), "white")
    pixels.paste((0, 0, 0), (20, 20, 80, 80))
    with io.BytesIO() as file:
        pixels.save(file, kind)
        return image(file.getvalue(), kind)


def pierced(disc: str, hole: str, style: str = "") -> str:
    """A disc with a square hole, by the attributes that colour them."""
    square = f'<rect x="35" y="35" width="30" height="30" {hole}/>'
    return page(f'<style>{style}</style><circle cx="50" cy="50" r="45" {disc}/>{square}')


def filled(disc: str, hole: str) -> str:
    return pierced(f'style="fill:{disc}"', f'style="fill:{hole}"')


def bar(style: str, x: float = 30, y: float = 40) -> str:
    return page(f'<rect x="{x}" y="{y}" width="40" height="20" style="{style}"/>')


def unscaled(size: str, shape: str) -> str:
    style = "fill:none;stroke:#000;vector-effect:non-scaling-stroke"
    return f"<svg {NS} {size}><defs><style>.a{{{style}}}</style></defs>{shape}</svg>"


ENTITIES = (
    '<?xml version="1.0" encoding="utf-8"?>\n<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" '
    f'"http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd" [\n<!ENTITY ns "{URI}">'
    '<!ENTITY grey "fill:#333;"><!ENTITY dark "&grey;stroke:none">]>\n'
    f'<svg xmlns="&ns;" viewBox="0 0 100 100"><g style="&dark;">{SQUARE}</g></svg>'
)
FACE = "<style>@font-face{{font-family:Hand;src:url({})}}</style>" + SQUARE
SERVICE = "<style>@import url(https://fonts.example.org/css);</style>"
DARK = "@media (prefers-color-scheme:dark){.a{fill:#fff}}"


def encoded(name: str, note: str) -> bytes:
    text = f'<?xml version="1.0" encoding="{name}"?>{page(SQUARE + f"<title>{note}</title>")}'
    return text.encode(name)


SQUARES: dict[str, str | bytes] = {
    "entities": ENTITIES,
    "names of characters": page(SQUARE + "<desc>a&nbsp;b</desc>"),
    "a font that no text uses": page(FACE.format("https://example.org/a.woff2")),
    "a font in the file": page(FACE.format("data:font/woff2;base64,d09GMg==")),
    "fonts of a service": page(SERVICE + SQUARE),
    "blank lines first": "\n \n<?xml version='1.0'?>\n" + page(SQUARE),
    "byte order mark": b"\xef\xbb\xbf" + page(SQUARE).encode(),
    "UTF-16": encoded("UTF-16", "é"),
    "Latin-1": encoded("ISO-8859-1", "é"),
    "Shift JIS": encoded("Shift_JIS", "日"),
    "compressed": gzip.compress(page(SQUARE).encode()),
    "no namespace": page(SQUARE).replace(NS, ""),
    "another namespace": page(SQUARE).replace(URI, URI + "/"),
    "a prefix": page(SQUARE)
    .replace("<", "<s:")
    .replace("<s:/", "</s:")
    .replace("xmlns", "xmlns:s"),
    "prefixes not declared": page(f'<g i:label="b">{SQUARE}<use xlink:href="#b"/></g>'),
    "a link": page(f'<a {LINK}="https://example.org/">{SQUARE}</a>'),
    "a link to a script": page(f'<a href="javascript:alert(1)">{SQUARE}</a>'),
    **{f"embedded {k}": page(embedded(k)) for k in ("png", "jpeg", "webp", "gif", "bmp")},
    "a drawing in a drawing": page(image(page(embedded("png")).encode(), "svg+xml")),
    "a page's colour": page(
        SQUARE.replace("/>", ' fill="#fff"/>'), 'style="background-color:#000"'
    ),
    "what editors leave": page(
        '<!-- drawn --><metadata about="http://example.org"/>'
        "<style>.a{fill:url(#g)}/* url(http://x) */</style>"
        '<defs><linearGradient id="g"><stop stop-color="red"/></linearGradient>'
        f'<g id="r" class="a">{SQUARE}</g></defs><use {LINK}="#r"/>'
    ),
    "a path in CSS": page("""<path style='d:path("M20 20H80V80H20Z")'/>"""),
}
PIERCED = {
    "display-p3": filled(f"{RED};fill:{P3_RED}", "#fff;fill:color(display-p3 1 1 1)"),
    "oklch and lab": pierced('fill="oklch(60% .2 30deg)"', 'fill="lab(100% 0 0)"'),
    "hwb and rgb": filled("hwb(0 10% 10%)", "rgb(100% 100% 100% / 100%)"),
    "light-dark": filled("light-dark(#c00, #fff)", "light-dark(white, #c00)"),
    "color-mix": filled("color-mix(in srgb, red, #000 9%)", "color-mix(in oklab, white 100%, red)"),
    "currentColor": pierced('color="oklch(60% .2 30)" fill="currentColor"',
     'color="#fff" fill="currentcolor"'),
    "variables": pierced('style="fill:var(--a)"', 'class="b"',
     f":root{{--a:{RED};--b:var(--c, #fff)}} svg .b{{fill:var(--b)}}"),
    "variables in attributes": pierced(f'fill="var(--a, {RED})"', 'fill="var(--b, var(--c, white))"',
     ":root{--b:var(--b)}"),
    "selectors and importance": pierced('class="a"', f'id="i" class="a" style="fill:{RED}"',
     f"circle.a,rect:not(#i){{fill:{RED}}} .a~#i{{fill:#fff!important}}"),
    "media": pierced('class="a"', 'class="b"', f".a{{fill:{RED}}}{DARK}@media screen{{.b{{fill:#fff}}}}"),
    "sums": filled("rgb(calc(100 + 100) 0 0)", "rgb(calc(250 + 5) 255 calc(510 / 2))"),
    "nested rules": pierced('class="a"', 'class="b"', f"svg{{.a{{fill:{RED}}}&amp; .b{{fill:#fff}}}}"),
}  # fmt: skip
PLACED = {
    "geometry in CSS": (page("<style>circle{cx:50px;cy:50px;r:45px}</style><circle/>"), DISC),
    "rem and calc": (
        page('<path d="M0 50H100" style="stroke:#000;stroke-width:calc((1rem + .25in) * 2 - 48px)"/>'), 0.32
    ),
    "translate and rotate": (bar("transform:translate(50px,50px) rotate(30deg)", -20, -10), 0.08),
    "an origin": (bar("transform:rotate(.125turn);transform-origin:50% 50%"), 0.08),
    "the box of a shape": (
        bar("transform:rotate(100grad) scale(150%);transform-origin:center;transform-box:fill-box"), 0.18
    ),
    "the box of a group": (
        page(
            '<g style="rotate:90deg;transform-origin:center;transform-box:fill-box">'
            '<rect x="0" y="40" width="99" height="20"/></g>'
        ), 0.198
    ),
    "single properties": (bar("translate:50% 50%;rotate:1rad;scale:50% 1", 0, 0), 0.04),
    "a transform of the page": (
        page('<rect width="50" height="20"/>', 'style="transform:scale(-1,1)"'), 0.10
    ),
    "units": (bar("transform:translate(-1in,-10mm) scale(2)"), 0.176),
    "a stroke that does not scale": (
        unscaled(
            'width="24" height="24" viewBox="0 0 2400 2400"',
            '<circle cx="1200" cy="1200" r="900" stroke-width="2" class="a"/>',
        ), 2 * np.pi * 9 * 2 / 576
    ),
    "one that is stretched": (
        unscaled(
            'width="100" height="100"',
            '<g transform="scale(10 1)"><path d="M2 0V100M0 50H10" stroke-width="10" class="a"/></g>',
        ), 0.19
    ),
    "one that is repeated": (
        unscaled(
            'viewBox="0 0 100 100"',
            '<defs><path id="a" d="M0 50H10" stroke-width="20" class="a"/></defs>'
            '<use href="#a" transform="scale(10 1)"/>',
        ), 0.20
    ),
}  # fmt: skip
# each drawing covers this share of the page
DRAWN: dict[str, tuple[str | bytes, float]] = {
    **{kind: (text, 0.36) for kind, text in SQUARES.items()},
    **{kind: (text, DISC - 0.09) for kind, text in PIERCED.items()},
    **PLACED,
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", DRAWN)
def test_svg_is_drawn_as_a_browser_draws_it(tmp_path: Path, kind: str) -> None:
    text, share = DRAWN[kind]
    target = read(tmp_path, text)
    assert target.mask.mean() == pytest.approx(share, abs=0.006)
    assert not target.notes


def test_turned_shapes_lie_where_they_should(tmp_path: Path) -> None:
    turned = read(tmp_path, DRAWN["translate and rotate"][0]).mask
    rows, columns = (axis.nonzero()[0] for axis in (turned.any(1), turned.any(0)))
    assert (rows.min() + rows.max(), columns.min() + columns.max()) == pytest.approx(
        (399, 399), abs=4
    )
    a = np.radians(30)
    assert np.ptp(columns) == pytest.approx(4 * (40 * np.cos(a) + 20 * np.sin(a)), abs=4)
    moved = read(tmp_path, DRAWN["single properties"][0]).mask
    assert moved[255, 188] and not moved[:195].any()


TOLD = {
    "script": ("<script>alert(1)</script>", "script is not run"),
    "event": ('<g onload="alert(1)"/>', "script is not run"),
    "animation": ('<g><animate attributeName="x" from="0" to="9"/></g>', "animation is left out"),
    "keyframes": ("<style>@keyframes a{to{opacity:0}}</style>", "animation is left out"),
    "HTML": ('<foreignObject><p xmlns="http://www.w3.org/1999/xhtml">A</p></foreignObject>', "HTML in it"),
    "flowed text": ("<flowRoot><flowPara>Boat</flowPara></flowRoot>", "flowed text"),
    "mesh": ('<defs><meshgradient id="m"/></defs>', "mesh gradients"),
    "shape of a clip": ('<rect width="1" height="1" style="clip-path:circle(9px)"/>',
     r"clip-path: circle\(\)"),
    "colour": ('<rect x="20" y="20" width="9" height="9" fill="device-cmyk(0 1 1 0)"/>', "device-cmyk"),
    "sum": ('<rect width="1" height="1" style="transform:translate(calc(1em - 1px - 9%))"/>', "sum (calc)"),
    "transform": ('<g style="transform:matrix(1)"/>', r"matrix\(1\)"),
    "font": ('<text x="40" y="50" font-family="No Such Font">a</text>',
     "DejaVu Sans instead of No Such Font"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", TOLD)
def test_what_is_left_out_is_told(tmp_path: Path, kind: str) -> None:
    body, words = TOLD[kind]
    target = read(tmp_path, page(SQUARE + body))
    assert target.mask.mean() == pytest.approx(0.36, abs=0.006)
    (note,) = target.notes
    assert words.replace("\\", "") in note.replace("\\", "") and "\n" not in note


def test_what_a_switch_falls_back_to_is_no_loss(tmp_path: Path) -> None:
    body = (
        "<switch><foreignObject/><g systemLanguage='fr'><rect width='9' height='9'/></g>"
        f"<g>{SQUARE}</g></switch>"
    )
    target = read(tmp_path, page(body))
    assert target.mask.mean() == pytest.approx(0.36, abs=0.006) and not target.notes


@pytest.mark.slow
def test_text_is_drawn_in_the_family_that_there_is(tmp_path: Path) -> None:
    def drawn(style: str) -> np.ndarray[Any, Any]:
        return read(tmp_path, page(f'<text x="5" y="60" style="{style}">Boat</text>')).mask

    sans = drawn("font:30px DejaVu Sans")
    assert (drawn("font-family:No Such Font;font-size:30px") == sans).all()
    assert (drawn("font:30px/1.2 No Such Font, cursive") == sans).all()
    bold = drawn("font:bold 30px 'DejaVu Sans'")
    assert bold.sum() > 1.2 * sans.sum()
    assert (drawn("font:30px Nobody, serif") != sans).any()


HUGE = base64.b64encode(b"\x89PNG\r\n\x1a\n" + bytes(9)).decode()
BOMB = "<!DOCTYPE svg [<!ENTITY a 'aaaaaaaaaa'>" + "".join(
    f"<!ENTITY {x} '{f'&{y};' * 10}'>" for x, y in zip("bcdefghi", "abcdefgh", strict=True)
)
SPREAD = f"<!DOCTYPE svg [<!ENTITY a '{'a' * 9999}'>]>" + page("&a;" * 9999)
MULTIPLIED = '<rect id="a0" width="1" height="1"/>' + "".join(
    f'<g id="a{i + 1}">' + f'<use href="#a{i}"/>' * 10 + "</g>" for i in range(8)
)
REFUSED: dict[str, tuple[str, str]] = {
    "http": ('<image href="http://example.org/a.png"/>', "<image>.*http://example.org"),
    "file": ('<image href="file:///etc/passwd"/>', "<image>.*outside"),
    "relative": ('<image href="../secret.png"/>', "<image>"),
    "absolute": ('<use href="/a.svg#x"/>', "<use>"),
    "of no kind": ('<use href="data:image/svg+xml,&lt;svg/&gt;"/>', "<use> embeds image/svg"),
    "damaged": (f'<image href="data:image/png;base64,{HUGE}"/>', "embedded in <image>"),
    "text": ('<image href="data:text/plain,abc"/>', "embedded in <image>"),
    "style": ('<rect style="fill:url(http://example.org/#a)"/>', "<rect>"),
    "quoted": ("<rect fill='url( \"a.svg#b\" )'/>", "<rect>"),
    "escaped": (r'<rect style="fill:u\72l(a.svg)"/>', "<rect>"),
    "variable": ('<rect style="--a:url(a.svg);mask:var(--a)"/>', "<rect>"),
    "import": ("<style>@import 'a.css';</style>", "<style>.*@import"),
    "import-escaped": (r"<style>@\69mport 'a.css';</style>", "<style>.*@import"),
    "a character that no font has": ('<text y="50">\U0001f9ff\u4e00</text>', "no font .* has the character"),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_svg_that_reaches_outside_is_refused(tmp_path: Path, kind: str) -> None:
    body, words = REFUSED[kind]
    with pytest.raises(InputError, match=words):
        read(tmp_path, page(body + SQUARE))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BOMB + "]>" + page("<text>&i;</text>"), "entities that it declares.*bomb"),
        (SPREAD, "bomb"),
        ('<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + page(SQUARE), "outside the file"),
        ('<!DOCTYPE svg [<!ENTITY % p SYSTEM "http://x/d">%p;]>' + page(SQUARE), "outside the file"),
        ('<?xml-stylesheet href="http://x/a.css"?>' + page(SQUARE), "xml-stylesheet"),
        ('<?xml version="1.0" encoding="klingon"?>' + page(SQUARE), "encoding is not known"),
        (page("<rect a='1' a='2'/>"), "not valid XML.*duplicate attribute"),
        (page(MULTIPLIED), "cannot be rendered"),
        *((page("<g>" * n + SQUARE + "</g>" * n), "nested more than 100 deep") for n in (101, 300, 100_000)),
    ],
    ids=lambda value: value[:30],
)  # fmt: skip
def test_svg_of_more_than_a_drawing_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)


def test_drawings_in_drawings_end(tmp_path: Path) -> None:
    text = page(SQUARE)
    for _ in range(5):
        data = base64.b64encode(text.encode()).decode()
        text = page(f'<image width="100" height="100" href="data:image/svg+xml;base64,{data}"/>')
    with pytest.raises(InputError, match="pictures in pictures"):
        read(tmp_path, text)


@pytest.mark.slow
def test_a_filter_without_end_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    endless = page(
        '<filter id="f"><feTurbulence numOctaves="1000000" baseFrequency=".1"/></filter>'
        f'<g filter="url(#f)">{SQUARE}</g>'
    )
    monkeypatch.setattr(draw, "_CHILD", draw._CHILD.replace(f", {draw._SECONDS})", ", 1)"))
    with pytest.raises(InputError, match="drawing it takes more than 20 s"):
        read(tmp_path, endless)


@pytest.mark.slow
def test_layers_without_end_are_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render, "LONGER_SIDE", 4000)
    layers = page("<g opacity='.999'>" * 90 + SQUARE + "</g>" * 90)  # layers of 23 MB each
    with pytest.raises(InputError, match="drawing it takes more than 1 GB"):
        read(tmp_path, layers)


def test_a_process_that_crashes_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def crash(*_: Any, **__: Any) -> Any:
        return subprocess.CompletedProcess([], -11, b"", b"")

    monkeypatch.setattr(subprocess, "run", crash)
    with pytest.raises(InputError, match="the library that draws SVG files fails on it"):
        read(tmp_path, page(SQUARE))


NESTED = 2000
ODD = {
    "laughing variables": "<style>:root{--a0:red red;"
    + "".join(f"--a{i + 1}:{f'var(--a{i}) ' * 10};" for i in range(30))
    + "} rect{fill:var(--a30)}</style>",
    "brackets": f'<rect style="fill:{"(" * NESTED}{")" * NESTED}"/>',
    "selectors": f"<style>{':not(' * NESTED}a{')' * NESTED}{{fill:red}}</style>",
    "no numbers": '<rect style="transform:rotate(1e999deg) scale(1e400);scale:a%" width="5" height="5"/>',
    "no colours": '<rect fill="rgb(1e999 0 0)"/><rect fill="color-mix(in foo, red, blue)"/>'
    '<rect fill="light-dark()"/><rect style="fill:url()"/>',
    "no outline": '<g transform="scale(2 1)"><path d="M1 2 Q" stroke="red" '
    'vector-effect="non-scaling-stroke"/></g>',
    "itself": '<g id="a"><use href="#a"/><rect vector-effect="non-scaling-stroke"/></g>',
    "nothing": '<g transform="scale(0)"><path d="M1 2L3 4" vector-effect="non-scaling-stroke"/></g>',
    "many": "".join(f'<rect fill="x{i}"/>' for i in range(100)),
}


@pytest.mark.parametrize("kind", ODD)
def test_odd_values_end_in_a_drawing_or_a_sentence(tmp_path: Path, kind: str) -> None:
    try:
        target = read(tmp_path, page(ODD[kind] + SQUARE))
    except InputError as refused:
        assert "nested too deep" in str(refused) and kind in ("brackets", "selectors")
    else:
        assert target.mask.mean() == pytest.approx(0.36, abs=0.006)
        assert len(target.notes) < 10 and all("\n" not in note for note in target.notes)
