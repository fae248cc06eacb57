"""The places of a limit, an effect, a mount and a check: none is missed, and the page names each."""

import re
from pathlib import Path
from typing import get_args

import pytest

from knotfab.effects.survey import EFFECTS
from knotfab.limits.feasibility import LIMITS
from knotfab_formats import verdict
from knotfab_formats.piece import Mount

ROOT = Path(__file__).parents[1]
MOUNTS = [k for k in get_args(Mount.model_fields["kind"].annotation) if k not in ("auto", "none")]
CHECKS = [
    name
    for group in (
        "KNOTS",
        "MESH",
        "FILES",
        "TUBE",
        "HELD",
        "PRINTING",
        "UPRIGHT",
        "PLATES",
        "TABLE",
    )
    for name in getattr(verdict, group)
]
# by kind: its names, and in each file what must stand there, NAME for a name and CAPS for it in capitals
PLACES: dict[str, tuple[list[str], dict[str, str]]] = {
    "a limit": (
        [limit.name for limit in LIMITS],
        {
            "knotfab/limits/feasibility.py": r'"NAME" in broken',
            "knotfab/search/objective.py": r"^    NAME: float = ",
            "knotfab/design/retries.py": r'"NAME": \(',
        },
    ),
    "an effect": (
        [effect.name for effect in EFFECTS],
        {
            "knotfab/effects/survey.py": r"\bCAPS\b",
            "formats/knotfab_formats/views.py": r"^    NAME: Switch",
            "docs/effects.md": r"`NAME`",
        },
    ),
    "a kind of mount": (
        MOUNTS,
        {
            "knotfab/hold/mount.py": r"knotfab\.hold\.NAME import",
            "validators/knotfab_validators/part_checks.py": r'mount\.kind == "NAME"',
            "docs/report.md": r"NAME",
        },
    ),
    "a check": (CHECKS, {"docs/report.md": r"`NAME`"}),
}
CASES = [
    (kind, name, file, wanted)
    for kind, (names, places) in PLACES.items()
    for name in names
    for file, wanted in places.items()
]


@pytest.mark.parametrize(("kind", "name", "file", "wanted"), CASES)
def test_no_place_is_missed(kind: str, name: str, file: str, wanted: str) -> None:
    pattern = wanted.replace("NAME", re.escape(name)).replace("CAPS", name.upper())
    text = (ROOT / file).read_text("utf-8")
    assert re.search(pattern, text, re.M), f"{kind}, {name}: {file} lacks it (docs/architecture.md)"


@pytest.mark.parametrize("kind", PLACES)
def test_the_page_names_each_place(kind: str) -> None:
    page = (ROOT / "docs/architecture.md").read_text("utf-8")
    (row,) = re.findall(rf"^\| {kind} \|.*$", page, re.M)
    for file in PLACES[kind][1]:
        short = file.removeprefix("knotfab/").removeprefix("validators/knotfab_validators/")
        assert f"`{short}`" in row, f"the row of {kind} lacks {short}"
