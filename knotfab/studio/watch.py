"""The page of a build that the command line runs (`knotfab build --watch`): it shows, and changes nothing."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from pathlib import Path
from typing import Any, TextIO

from knotfab.studio.live_build import Event
from knotfab.studio.run import open_in_browser, serve
from knotfab.studio.session import Studio

__all__ = ["WatchedBuild", "watch"]

_GRACE_S = 10  # without a tab, once the build has ended: a page that is loaded anew comes back
_UNKNOWN = "The build ended without a result; the terminal says why."


class WatchedBuild(Studio):
    """A studio of one build, whose events come from elsewhere; `out` is its folder, all that can be read."""

    watching = True

    def __init__(self, out: Path) -> None:
        super().__init__(out.parent, warm=False)
        self.builds, self.out = out.parent, out
        self.status = {
            "phase": "running", "name": out.name, "stage": "start", "share": 0.0, "notes": [],
        }  # fmt: skip

    def folder_of(self, where: str) -> Path | None:
        return self.out if where == self.out.name else None

    def list_builds(self) -> list[dict[str, Any]]:
        return []

    async def follow(self, events: TextIO, grace_s: int = _GRACE_S) -> None:
        """Pass the events on until there are no more, and wait until nobody looks any longer."""
        end: Event = {}
        while line := await asyncio.to_thread(events.readline):
            with contextlib.suppress(ValueError):  # it broke off with its build
                event = json.loads(line)
                end = event if event["event"] == "end" else end
                self._hear(event)
        self._end(end.get("exit_code", 2), "" if end else _UNKNOWN)
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
