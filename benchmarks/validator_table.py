"""What the validators can be believed: `make validator-table` prints it all (about 10 minutes).

Thickness against exact values, and its cost; the corpus of broken and good parts; forged and honest pieces
on every holder; and 10,000 hostile files. Ends with 1 if anything is not as it must be.
"""

from __future__ import annotations

import subprocess
import sys

PARTS = ("thickness_table", "corpus_table", "forgery_table", "fuzz_files")


def main() -> int:
    """Print every part of the table; 0 if all of it holds."""
    codes = []
    for part in PARTS:
        print(f"\n== {part.replace('_', ' ')}", flush=True)
        codes.append(subprocess.run([sys.executable, "-m", f"benchmarks.{part}"]).returncode)
    return int(any(codes))


if __name__ == "__main__":
    sys.exit(main())
