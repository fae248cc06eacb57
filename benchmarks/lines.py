"""Lines of Python in each folder, beside what CONTRIBUTING.md says that it may have: `make lines`."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PRODUCT = ("knotfab", "validators", "formats", "fixtures")


def count_lines() -> dict[str, tuple[int, int]]:
    """Count (files, lines) of Python in each folder; files that git ignores do not count."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "*.py"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )  # fmt: skip
    found = dict.fromkeys(PRODUCT, (0, 0))
    for name in listed.stdout.split():
        path = ROOT / name
        if path.is_file():
            folder = name.partition("/")[0]
            files, lines = found.get(folder, (0, 0))
            found[folder] = (files + 1, lines + path.read_bytes().count(b"\n"))
    return found


def read_budgets() -> dict[str, int]:
    """Read the lines that CONTRIBUTING.md allows each folder."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    rows = re.findall(r"^\| `(\w+)/` \|.*\| ([\d,]+) \|$", text, re.M)
    return {folder: int(lines.replace(",", "")) for folder, lines in rows}


def list_lines() -> Iterator[str]:
    """Yield the table that `make lines` prints."""
    found, budgets = count_lines(), read_budgets()
    for folder, (files, lines) in found.items():
        of = f"  of {budgets[folder]:,}" if folder in budgets else ""
        over = "  too many: what could go?" if lines > budgets.get(folder, lines) else ""
        yield f"{folder:<12} {files:>4} files {lines:>8,} lines{of}{over}"
    for name, folders in (("product", PRODUCT), ("all", tuple(found))):
        files, lines = (sum(found[f][k] for f in folders) for k in (0, 1))
        yield f"{name:<12} {files:>4} files {lines:>8,} lines"


if __name__ == "__main__":
    print("\n".join(list_lines()))
