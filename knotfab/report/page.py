"""report.html: the report for a reader, one file that opens offline."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil, floor, isfinite, log10
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup
from PIL import Image

from knotfab.picture.raster import data_uri, flatten, hash_script, image_uri
from knotfab.picture.read import read_image
from knotfab.report.summary import mark_of, tally_checks, tell_colours, tell_share
from knotfab_formats.errors import plain
from knotfab_formats.report import Report
from knotfab_formats.verdict import POOR, list_unmet

VIEWER = Path(__file__).parent / "viewer" / "viewer.js"
# So the page says a person's judgement of the shadow (docs/verdict.md), in a word and in a sentence.
VERDICTS = {
    "faithful": ("A faithful likeness.", "The shadow is the picture."),
    "good": ("A good likeness.", "The shadow is the picture; who looks closely finds differences."),
    "coarse": ("Warning: coarse.", "The shadow can be known again; what it lacks is named below."),
    "not recognisable": (
        "Warning: not recognisable.",
        "A person would hardly know the picture by its shadow.",
    ),
}
_NOTHING = "Nobody would miss anything of the picture in its shadow."
_GIVEN_PX = 640  # longer side of a picture as it came
_QUALITY = 85  # the quality of WebP, of 100
MEDIA = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".gif": "image/gif"}


def _verdicts(report: Report) -> dict[str, tuple[str, str]]:
    """Choose the words of each verdict; "faithful" says more if nothing at all is lost."""
    verdict, made = report.verdict, report.settings
    # accuracies that leave a shadow as clean as this says
    clean = made.accuracy in ("standard", "fine") and not made.time_budget_s
    if not clean or (verdict and (verdict.lost or verdict.specks or verdict.cut_tips)):
        return VERDICTS
    return {**VERDICTS, "faithful": (VERDICTS["faithful"][0], _NOTHING)}


@dataclass(frozen=True)
class Picture:
    """A picture to embed. `role` places it: "compare", "bent", "alone", "shadow", "given" with the view
    named `view`, "part" with the pictures of the part."""

    path: Path
    role: str
    caption: str = ""
    view: str = ""

    @property
    def data_uri(self) -> str:
        """The file as a data URI; a large one that does not move as WebP, so that the page stays small."""
        if self.role == "given":
            small = flatten(read_image(self.path), _GIVEN_PX)
            return image_uri(small, "webp", quality=_QUALITY, method=2)
        data = self.path.read_bytes()
        # a picture of more bytes is embedded as WebP
        if len(data) > 100_000 and self.path.suffix != ".gif":
            return image_uri(Image.open(self.path), "webp", quality=_QUALITY, method=2)
        return data_uri(data, MEDIA[self.path.suffix.lower()])


def make_environment(folder: Path) -> Environment:
    """Make the environment of a folder's pages: every text is escaped, a missing one is an error."""
    return Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


@cache
def load_template() -> Template:
    """Load and compile the page's template; a build does so while its part is verified."""
    environment = make_environment(Path(__file__).parent)
    environment.filters |= {
        "number": _number,
        "fixed": _format_fixed,
        "percent": _percent,
        "duration": _duration,
        "share": _share,
        "glow": _glow,
        "colours": tell_colours,
        "flat": lambda record: _flatten(plain(record)),
        "mark": mark_of,
        "tally": tally_checks,
    }
    return environment.get_template("template.html.j2")


def render_html(
    report: Report,
    pictures: Sequence[Picture] = (),
    title: str = "knotfab",
    *,
    shown: Mapping[str, Any] | None = None,
    drawings: Sequence[str] = (),
    files: Sequence[tuple[str, str]] = (),
    profile: Mapping[str, str] | None = None,
) -> str:
    """Render the page for `report`.

    Nothing is loaded from elsewhere: styles, pictures and the one script are inside, and no other script
    may run. Every text of the report is escaped.

    Args:
        shown: the viewer's data; None: the page has no script at all.
        drawings: how to set the piece up, data URIs, two at most.
        files: beside the page, each with what it is for.
        profile: the settings of slicer.ini.
    """
    script = VIEWER.read_text(encoding="utf-8") if shown is not None else ""
    return load_template().render(
        report=report,
        pictures=pictures,
        title=title,
        failed=list_unmet(report.checks),
        stages=[(k, v) for k, v in report.timings.items() if k != "total"],
        drawings=drawings,
        files=files,
        profile=profile or {},
        shown=None if shown is None else Markup(encode_for_script(shown)),
        script=Markup(script),
        digest=hash_script(script),
        verdicts=_verdicts(report),
        poor=POOR,
    )


def encode_for_script(data: Mapping[str, Any]) -> str:
    """Encode as JSON in which no text can end a <script> or begin a comment."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _number(value: object, digits: int = 4) -> str:
    """Write a value with `digits` significant digits, or all of its whole part; a dash for none."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        between = " " if any(isinstance(item, str) for item in value) else " × "
        return between.join(_number(item, digits) for item in value)
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f")
    if not isinstance(value, float):
        return str(value)
    if not isfinite(value):
        return "–"
    if value == 0:
        return "0"
    places = digits - 1 - floor(log10(abs(value)))
    if places > 8:
        return f"{value:.2e}".replace("-", "−")
    text = f"{value:,.{max(places, 0)}f}".replace(",", "\u202f").replace("-", "−")
    return text.rstrip("0").rstrip(".") if "." in text else text


def _format_fixed(value: object, places: int) -> str:
    """Write a number with `places` decimals, for columns that are compared."""
    return f"{value:.{places}f}" if isinstance(value, float | int) and isfinite(value) else "–"


def _share(value: object) -> str:
    """Write a fraction in percent, as `tell_share` does, with a space that does not break."""
    if not isinstance(value, float | int) or not isfinite(value):
        return "–"
    return tell_share(value).replace("%", "\u00a0%")


def _glow(colour: Sequence[float]) -> str:
    """Convert a lamp's linear red, green and blue to a CSS colour."""
    most = max(*colour, 1e-9)
    return f"rgb({' '.join(str(round(255 * (c / most) ** (1 / 2.2))) for c in colour)})"


def _percent(value: object) -> float:
    """Convert a fraction to a width in percent, clipped to 0 and 100."""
    ok = isinstance(value, int | float) and isfinite(value)
    return round(100 * min(max(float(value), 0.0), 1.0), 2) if ok else 0.0  # type: ignore[arg-type]


def _duration(seconds: object) -> str:
    """Write hours and minutes, rounded up to the next minute."""
    if not isinstance(seconds, int | float) or not isfinite(seconds):
        return "–"
    hours, minutes = divmod(ceil(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def _flatten(value: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Flatten nested tables to rows of dotted key and value, the items of lists numbered from 1."""
    rows: list[tuple[str, Any]] = []
    for key, item in value.items():
        if isinstance(item, list) and item and all(isinstance(one, Mapping) for one in item):
            item = {str(number): one for number, one in enumerate(item, start=1)}
        if isinstance(item, Mapping):
            rows += _flatten(item, f"{prefix}{key}.")
        elif item is not None:
            rows.append((f"{prefix}{key}", item))
    return rows
