"""The page of a build that the command line runs (`knotfab build --watch`): it shows, and changes nothing."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from pathlib import Path
from typing import TextIO

from knotfab.studio.broadcast import Broadcast
from knotfab.studio.live_build import Event
from knotfab.studio.run import open_in_browser, serve

__all__ = ["WatchedBuild", "watch"]

# a build that has ended waits so long for a tab: a page that is loaded anew comes back
_GRACE_S = 10
_UNKNOWN = "The build ended without a result; the terminal says why."


class WatchedBuild(Broadcast):
    """A build whose events come from elsewhere; `out` is its folder, all that can be read."""

    watching = True

    def __init__(self, out: Path) -> None:
        super().__init__()
        self.begin(out, out.name)

    async def follow(self, events: TextIO, grace_s: int = _GRACE_S) -> None:
        """Pass the events on until there are no more, and wait until nobody looks any longer."""
        end: Event = {}
        while line := await asyncio.to_thread(events.readline):
            with contextlib.suppress(ValueError):  # it broke off with its build
                event = json.loads(line)
                end = event if event["event"] == "end" else end
                self.hear(event)
        self.end(end.get("exit_code", 2), "" if end else _UNKNOWN)
        self.tell_state()
        alone = 0
        while alone < grace_s:
            await asyncio.sleep(1)
            alone = 0 if self.listeners else alone + 1


def watch(out: Path, events: TextIO, grace_s: int = _GRACE_S) -> None:
    """Show a build in the browser, from its events, until they end and the last tab is closed."""
    studio = WatchedBuild(out)

    def announce(address: str) -> None:
        print(address, flush=True)
        open_in_browser(address)

    serve(studio, 0, announce, lambda: studio.follow(events, grace_s))


if __name__ == "__main__":
    watch(Path(sys.argv[1]), sys.stdin, *(int(grace) for grace in sys.argv[2:]))
