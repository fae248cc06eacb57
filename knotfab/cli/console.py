"""The console of the command line's summaries: a reader who stops reading changes no exit code."""

from __future__ import annotations

import os
import sys

from rich.console import Console as RichConsole

__all__ = ["Console"]


class Console(RichConsole):
    """rich's console for standard output, which may be a pipe that is closed early, as `| head -1` does.

    rich leaves the program with 1 then, which here says that a check failed.
    """

    def on_broken_pipe(self) -> None:
        """Say nothing more, and let the command end as it would."""
        self.quiet = True
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, sys.stdout.fileno())
