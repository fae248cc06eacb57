"""SVG files as editors and the web write them: drawn as a browser draws them, told, or refused."""

import base64
import gzip
import io
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from knotfab.picture.read import Target, read_target
from knotfab.picture.svg import render
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
}
PIERCED = {
    "rgb": filled("rgb(217 32 32)", "rgb(100% 100% 100%)"),
    "selectors": pierced('class="a"', f'id="i" class="a" style="fill:{RED}"',
     f"circle.a,g > rect.a{{fill:{RED}}} svg #i{{fill:#fff!important}}"),
}  # fmt: skip
# each drawing covers this share of the page
DRAWN: dict[str, tuple[str | bytes, float]] = {
    **{kind: (text, 0.36) for kind, text in SQUARES.items()},
    **{kind: (text, DISC - 0.09) for kind, text in PIERCED.items()},
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", DRAWN)
def test_svg_is_drawn_as_a_browser_draws_it(tmp_path: Path, kind: str) -> None:
    text, share = DRAWN[kind]
    target = read(tmp_path, text)
    assert target.mask.mean() == pytest.approx(share, abs=0.006)
    assert not target.notes


TOLD = {
    "script": ("<script>alert(1)</script>", "script is not run"),
    "event": ('<g onload="alert(1)"/>', "script is not run"),
    "animation": ('<g><animate attributeName="x" from="0" to="9"/></g>', "animation is left out"),
    "keyframes": ("<style>@keyframes a{to{opacity:0}}</style>", "animation is left out"),
    "HTML": ('<foreignObject><p xmlns="http://www.w3.org/1999/xhtml">A</p></foreignObject>', "HTML in it"),
    "flowed text": ("<flowRoot><flowPara>Boat</flowPara></flowRoot>", "flowed text"),
    "mesh": ('<defs><meshgradient id="m"/></defs>', "mesh gradients"),
    "shape of a clip": ('<rect width="1" height="1" style="clip-path:circle(9px)"/>',
     "shapes in clip-path"),
    "colour": ('<rect x="20" y="20" width="9" height="9" fill="device-cmyk(0 1 1 0)"/>', "newer colours"),
    "newer colour": ('<rect x="20" y="20" width="9" height="9" style="fill:oklch(.5 .1 9)"/>',
     "newer colours"),
    "sum": ('<rect width="1" height="1" style="stroke-width:calc(1em - 1px)"/>', "sums (calc)"),
    "variable of two values": ('<g style="--a:1"/><g style="--a:2;opacity:var(--a)"/>', "variables (var)"),
    "transform": ('<g style="transform:matrix(1)"/>', "transforms in CSS"),
    "single transform": ('<g style="rotate:9deg"/>', "transforms in CSS"),
    "transform of a sheet": ("<style>.a{transform:scale(2)}</style>", "transforms in CSS"),
    "size": ("<style>@media (min-width:9px){path{fill:red}}</style>", "@media"),
    "support": ("<style>@supports (fill:red){path{display:none}}</style>", "@supports"),
    "nested rules": ("<style>svg{.a{fill:red}}</style>", "nested"),
    "selectors": ("<style>a~b{fill:red}</style>", "selectors beyond CSS 2"),
    "geometry": ("<style>circle{r:9px}</style>", "sizes in a style sheet"),
    "stroke": ('<g vector-effect="non-scaling-stroke"/>', "strokes that keep their width"),
    "dashes": ('<path pathLength="9" stroke-dasharray="3 1"/>', "pathLength is not read"),
    "capitals of text": ('<g style="text-transform:uppercase"/>', "letters and blanks of text"),
    "blanks of text": ('<g style="white-space:pre"/>', "letters and blanks of text"),
    "displacement": ('<filter id="f"><feDisplacementMap scale="9"/></filter>', "displaces"),
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
    assert words in note and "\n" not in note


KITE = '<path d="M15 12 L75 30 L62 82 L33 70 Z"/><circle cx="85" cy="78" r="9"/>'
# the share of the page that is drawn, and its centre
PLACED: dict[str, tuple[str, float, tuple[float, float]]] = {
    "a switch": (page(f'<switch><g systemLanguage="de"/><g systemLanguage="en">{KITE}</g></switch>'),
     0.266, (0.501, 0.485)),
    "languages": (page(f'<g systemLanguage="fr">{SQUARE}</g><g systemLanguage="en-US, fr">{KITE}</g>'),
     0.266, (0.501, 0.485)),
    "features": (page(f'<g requiredFeatures="http://x#Shape">{KITE}</g>'), 0.266, (0.501, 0.485)),
    **{f"background {word}": (page(KITE, f'style="background:{word}"'), 0.266, (0.501, 0.485))
     for word in ("none", "inherit", "currentColor", "transparent", "url(#x) no-repeat")},
    "letters turned": (page('<text x="14" y="60" rotate="20" font-weight="bold" font-size="44">LT</text>'),
     0.075, (0.430, 0.487)),
    "a type of nothing": (page('<style type="">circle{fill:none;stroke:#000;stroke-width:12}</style>'
     '<circle cx="50" cy="50" r="30"/>'), 0.226, (0.5, 0.5)),
    "a style of HTML": (page('<h:style xmlns:h="http://www.w3.org/1999/xhtml">.a{display:none}</h:style>'
     f'{KITE}<g class="a">{SQUARE}</g>'), 0.266, (0.501, 0.485)),
}  # fmt: skip


@pytest.mark.parametrize("kind", PLACED)
def test_nothing_is_left_out(tmp_path: Path, kind: str) -> None:
    text, share, centre = PLACED[kind]
    target = read(tmp_path, text)
    rows, columns = target.mask.nonzero()
    assert target.mask.mean() == pytest.approx(share, abs=0.006) and not target.notes
    assert (columns.mean() / 400, rows.mean() / 400) == pytest.approx(centre, abs=0.006)


MASK = '<mask id="m"><rect width="100" height="100" fill="#fff"/><circle cx="50" cy="50" r="20"/></mask>'
# what is drawn otherwise than by a browser: the words of its note
OTHERWISE = {
    "a newer colour behind a plain one": (filled(f"{RED};fill:{P3_RED}", "#fff;fill:oklch(100% 0 0)"),
     "newer colours"),
    "variables": (pierced("", 'class="b"', ":root{--b:#fff} .b{fill:var(--b)}"), "variables"),
    "angles": (filled(RED, "hsl(0deg 0% 100%)"), "angles of colours"),
    "capitals": (pierced(f'color="{RED}" fill="CurrentColor"', 'color="#fff" fill="currentcolor"'),
     "in capitals"),
    "a property in capitals": (pierced("", 'style="FILL:#fff"'), "in capitals"),
    "media": (pierced("", 'class="b"', f"{DARK}@media screen{{.b{{fill:#fff}}}}"), "@media"),
    "a layer": (pierced("", 'class="b"', "@layer x{.b{fill:#fff}}"), "@layer"),
    "rem": (page('<path d="M0 50H100" style="stroke:#000;stroke-width:2rem"/>'), "lengths in rem"),
    "an origin": (bar("transform:rotate(.125turn);transform-origin:50px 50px"), "transforms in CSS"),
    "a transform of the page": (page(KITE, 'transform="scale(-1 1)"'), "transform of the whole page"),
    "a path in CSS": (page(KITE + """<path style='d:path("M20 20H80V80H20Z")'/>"""), "outlines in CSS"),
    "display None": (page(f'<g style="display:None">{SQUARE}</g>{KITE}'), "in capitals"),
    "a filter gone": (page(f'<g filter="url(#gone)">{KITE}</g>{SQUARE}'), "a filter that is missing"),
    "an id with a blank": (page(f'<defs><g id="Form 1">{KITE}</g></defs><use href="#Form 1"/>{SQUARE}'),
     "with blanks or signs"),
    "text in a shape": (page(f'{SQUARE}<text y="9" style="inline-size:9px">a</text>'), "flow in a shape"),
    **{name: (page(f'{MASK}<rect x="10" y="10" width="80" height="80" style="{name}:{value}"/>'), "newer CSS")
     for name, value in (("-webkit-mask", "url(#m)"), ("mask", "url(#m) center / contain no-repeat"))},
}  # fmt: skip


@pytest.mark.parametrize("kind", OTHERWISE)
def test_what_is_drawn_otherwise_is_told(tmp_path: Path, kind: str) -> None:
    text, words = OTHERWISE[kind]
    assert any(words in note and "flatten it" in note for note in read(tmp_path, text).notes)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (page(f'<symbol id="i-boat">{SQUARE}</symbol>', 'style="display:none"'), "symbols .i-boat"),
        (page(f"<style>@keyframes f{{}}g{{opacity:0}}</style><g>{SQUARE}</g>"), "its animation is left out"),
    ],
)  # fmt: skip
def test_where_nothing_is_drawn_the_cause_is_told(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read(tmp_path, text)


LONG = 300_000
LINEAR = {
    "blanks": page(SQUARE) + " " * LONG,
    "blanks first": " " * LONG + page(SQUARE),
    "blanks in a value": page(f'<g style="fill:{" " * LONG}red"/>{SQUARE}'),
    "blanks in a link": page(f'<g style="mask:url({" " * LONG}"/>{SQUARE}'),
    "blanks in a size": page(SQUARE, f'width="{" " * LONG}9"'),
    "digits": page(
        f'<g style="transform:scale({"1" * LONG}x)" stroke-width="{"1" * LONG}rem"/>{SQUARE}'
    ),
    "quotes": page(f"<style>{chr(39) * (LONG + 1)}</style>{SQUARE}"),
    "comments": page(f"<style>{'/*' * LONG}</style>{SQUARE}"),
    "variables": page(f'<g style="--a:{"var(--a)" * 9};fill:{"var(--a)" * 9999}"/>{SQUARE}'),
}


@pytest.mark.parametrize("kind", LINEAR)
def test_no_text_takes_long(tmp_path: Path, kind: str) -> None:
    assert read(tmp_path, LINEAR[kind]).mask.mean() == pytest.approx(0.36, abs=0.006)


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
    "many steps": (f"<style>x{' g' * 30} rect{{fill:red}}</style>", "selector of more than"),
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
@pytest.mark.slow
def test_svg_of_more_than_a_drawing_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)


def _save_plain(text: str, remedy: str) -> str:
    return page(SQUARE)


# what a person does who is told so: to the file's text, by the words of the refusal
DONE = {
    "stands alone": lambda text, _: re.sub(r"<\?xml-s.*?\?>|<image[^>]*>|@import[^;]*;", "", text),
    "attributes in place of styles": lambda text, _: re.sub("<style>.*</style>", "", text),
    "of its own": lambda text, remedy: text.replace(
        "</svg>", re.findall("<use .*?>", remedy)[0] + "</svg>"
    ),
    "Set the size": lambda text, _: text.replace(' width="0"', ' width="9"'),
    "Resize the page": lambda text, _: text.replace("0 0 100 100", "100 100 100 100"),
    "Ungroup": lambda text, _: re.sub("</?g>|<image[^>]*>", "", text),
    "without a document type": lambda text, _: re.sub(r"<!DOCTYPE.*?\]>", "", text).replace(
        "&i;", ""
    ),
    "as UTF-8": lambda text, _: text.replace("klingon", "utf-8"),
    "show the fault": lambda text, _: text.replace("a='2'", ""),
    "check its size": _save_plain,
    "as SVG": lambda text, _: text.replace("html", f"svg {NS} viewBox='0 0 9 9'", 1).replace(
        "/html", "/svg"
    ),
}
MENDED = (
    page('<image href="http://example.org/a.png"/>' + SQUARE),
    page("<style>@import 'a.css';</style>" + SQUARE),
    f'<?xml-stylesheet href="http://x/a.css"?>{page(SQUARE)}', page(REFUSED["many steps"][0] + SQUARE),
    page(f'<symbol id="one">{SQUARE}</symbol>'), page(SQUARE, 'width="0" height="9"'),
    page(SQUARE.replace("M20 20H80V80H20Z", "M120 120H180V180H120Z")),
    page("<g>" * 101 + SQUARE + "</g>" * 101), BOMB + "]>" + page(SQUARE + "<text>&i;</text>"),
    f'<?xml version="1.0" encoding="klingon"?>{page(SQUARE)}',
    page(SQUARE.replace("<path", "<path a='1' a='2'")), page(MULTIPLIED),
    f"<html>{SQUARE.replace('80', '8').replace('20', '2')}</html>",
)  # fmt: skip


@pytest.mark.parametrize("text", MENDED, ids=lambda text: text[-60:])
def test_what_a_refusal_suggests_makes_a_picture(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError) as refused:
        read(tmp_path, text)
    remedy = refused.value.remedy
    (mend,) = (done for words, done in DONE.items() if words in remedy)
    assert read(tmp_path, mend(text, remedy)).mask.mean() > 0.1


def test_drawings_in_drawings_end(tmp_path: Path) -> None:
    text = page(SQUARE)
    for _ in range(5):
        data = base64.b64encode(text.encode()).decode()
        text = page(f'<image width="100" height="100" href="data:image/svg+xml;base64,{data}"/>')
    with pytest.raises(InputError, match="pictures in pictures"):
        read(tmp_path, text)


@pytest.mark.usefixtures("drawn_apart")
@pytest.mark.slow
def test_a_filter_without_end_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    endless = page(
        '<filter id="f"><feTurbulence numOctaves="1000000" baseFrequency=".1"/></filter>'
        f'<g filter="url(#f)">{SQUARE}</g>'
    )
    monkeypatch.setattr(render, "_CHILD", render._CHILD.replace(f", {render._SECONDS})", ", 1)"))
    with pytest.raises(InputError, match="drawing it takes more than 20 s"):
        read(tmp_path, endless)


@pytest.mark.usefixtures("drawn_apart")
@pytest.mark.slow
def test_layers_without_end_are_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render, "LONGER_SIDE", 4000)
    layers = page("<g opacity='.999'>" * 90 + SQUARE + "</g>" * 90)  # layers of 23 MB each
    with pytest.raises(InputError, match="drawing it takes more than 1 GB"):
        read(tmp_path, layers)


@pytest.mark.usefixtures("drawn_apart")
@pytest.mark.parametrize("kind", [next(iter(SQUARES)), "a page's colour", "embedded png"])
def test_a_process_of_its_own_draws_the_same(tmp_path: Path, kind: str) -> None:
    target = read(tmp_path, SQUARES[kind])
    assert target.mask.mean() == pytest.approx(0.36, abs=0.006)


@pytest.mark.usefixtures("drawn_apart")
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
    target = read(tmp_path, page(ODD[kind] + SQUARE))
    assert target.mask.mean() == pytest.approx(0.36, abs=0.006)
    assert len(target.notes) < 10 and all("\n" not in note for note in target.notes)


# a drawing, its page, and what is said of what lies beside it; none: nothing
BESIDE: dict[str, tuple[str, str, str]] = {
    "beside": (f'<g transform="translate(120 0)">{SQUARE}</g>', "", "everything that it draws lies outside"),
    "on a second sheet": (
        f'<g transform="translate(0 -110)">{SQUARE}</g>', "width='90mm'",
        r"everything that it draws lies outside its page \(viewBox 0 0 100 100\). Resize the page",
    ),
    "half off": (f'<g transform="translate(50 0)">{SQUARE}</g>', "", "50% of what it draws lies outside"),
    "on it": (SQUARE, "", ""),
    "a sheet of paper": (f'<rect width="100%" height="100%" fill="white"/>{SQUARE}', "height='50mm'", ""),
    "a corner off": ('<path d="M50 20H105V80H50Z"/>', "", ""),
}  # fmt: skip


@pytest.mark.parametrize("case", BESIDE)
def test_what_lies_beside_the_page_is_told(tmp_path: Path, case: str) -> None:
    body, attributes, said = BESIDE[case]
    if said.startswith("every"):
        with pytest.raises(InputError, match=said):
            read(tmp_path, page(body, attributes))
        return
    notes = read(tmp_path, page(body, attributes)).notes
    assert (said in notes[0]) if said else notes == ()


def test_base64_without_its_padding_is_read(tmp_path: Path) -> None:
    padded = next(p for p in map(page, map(embedded, ("png", "gif", "bmp"))) if '="/>' in p)
    whole, bare = (read(tmp_path, text) for text in (padded, re.sub('=+"/>', '"/>', padded)))
    assert (bare.mask == whole.mask).all()
