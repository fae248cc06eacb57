"""Who stops reading what a command says does not change how it ends."""

from __future__ import annotations

import os
import subprocess
import sys

PROGRAM = """
import sys
from knotfab.cli.console import Console
console = Console()
for number in range(20000):
    console.print(f"line {number}")
sys.exit(7)
"""


def test_a_pipe_that_is_closed_early_changes_no_exit_code() -> None:
    command = [sys.executable, "-c", PROGRAM]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=dict(os.environ)) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"line 0\n"
        process.stdout.close()
        assert process.wait() == 7
