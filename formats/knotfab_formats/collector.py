"""The garbage collector, which looks on more rarely while loops are compiled."""

from __future__ import annotations

import gc

# new objects between its looks meanwhile: with the usual 700 these take a fifth of the time
_AT_ONCE = 50_000
# thresholds to go back to, for each loop that is being compiled: one is compiled within another
_USUAL: list[tuple[int, int, int]] = []


def look_rarely() -> None:
    """Raise the collector's threshold, unless it is as high, until `look_as_usual`."""
    _USUAL.append(gc.get_threshold())
    if 0 < _USUAL[-1][0] < _AT_ONCE:
        gc.set_threshold(_AT_ONCE)


def look_as_usual() -> None:
    """Lower the threshold again, if the `look_rarely` that this call belongs to has raised it."""
    usual = _USUAL.pop()
    if 0 < usual[0] < _AT_ONCE:
        gc.set_threshold(*usual)
