"""A search to look back on: its knots, now and then."""

from __future__ import annotations

from collections.abc import Callable

from knotfab.knots import Knots

__all__ = ["History"]


class History:
    """The kept states of a search, `most` at most, spread evenly over its iterations.

    It is handed to the search as its `watch`. When it is full every other state is dropped, and half as
    many are taken from there on, so that few more are made than are kept.
    """

    def __init__(self, most: int = 24) -> None:
        self.states: list[Knots] = []
        self._most, self._every, self._seen = most, 1, 0

    def __call__(self, knots: Callable[[], Knots], certified: bool) -> None:
        """Take the knots as they stand, where their turn has come."""
        if self._seen % self._every == 0:
            self.states.append(knots())
        self._seen += 1
        if len(self.states) > self._most:
            self.states = self.states[::2]
            self._every *= 2
