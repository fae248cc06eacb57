"""How many lines of Python there are, beside the budget that CONTRIBUTING.md gives: `make lines`."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[1]
PRODUCT = ("knotfab", "validators", "formats", "fixtures")


def count_lines() -> dict[str, int]:
    """Return lines of Python in each folder, product first; files that git ignores do not count."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "*.py"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )  # fmt: skip
    found = dict.fromkeys(PRODUCT, 0)
    for name in listed.stdout.split():
        path = ROOT / name
        if path.is_file():
            folder = name.partition("/")[0]
            found[folder] = found.get(folder, 0) + path.read_bytes().count(b"\n")
    return found


def read_budget() -> tuple[int, int]:
    """Read the most lines of the product, and of everything, that CONTRIBUTING.md allows."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    told = re.search(r"at most ([\d,]+) lines of Python in the product and ([\d,]+) in all", text)
    assert told is not None, "CONTRIBUTING.md names no budget of lines"
    product, everything = (int(number.replace(",", "")) for number in told.groups())
    return product, everything


def list_lines(found: Mapping[str, int]) -> Iterator[str]:
    """Yield the table that `make lines` prints."""
    product, everything = read_budget()
    for folder, lines in found.items():
        yield f"{folder:<12} {lines:>8,}"
    yield f"{'product':<12} {sum(found[f] for f in PRODUCT):>8,}  of {product:,}"
    yield f"{'all':<12} {sum(found.values()):>8,}  of {everything:,}"


if __name__ == "__main__":
    print("\n".join(list_lines(count_lines())))
