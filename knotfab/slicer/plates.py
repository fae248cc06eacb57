"""Slice a piece that is printed on several plates: each by itself, and what they come to together."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from knotfab.scene.model import Scene
from knotfab.slicer.result import NotSliced, Sliced
from knotfab.slicer.run import slice_part

__all__ = ["PlateSlicing", "together"]


class PlateSlicing:
    """As `Slicing`, of several files one after the other."""

    def __init__(self, plates: Sequence[Path], scene: Scene, work: Path) -> None:
        self._plates, self._scene, self._work = plates, scene, work
        self._stop = False
        self._pool = ThreadPoolExecutor(1)
        self._found = self._pool.submit(self._slice)

    def __enter__(self) -> PlateSlicing:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop = True  # after the plate that is being sliced
        self._pool.shutdown(cancel_futures=True)

    def result(self) -> Sliced | NotSliced:
        """Wait for all plates; the first that could not be sliced is the result."""
        return self._found.result()

    def _slice(self) -> Sliced | NotSliced:
        found = []
        for path in self._plates:
            if self._stop:
                return NotSliced("stopped", "the build ended")
            one = slice_part(path, self._scene, self._work)
            if isinstance(one, NotSliced):
                known = one.kind in ("refused", "crashed")
                return replace(one, reason=f"{path.name}: {one.reason}") if known else one
            found.append(one)
        return together(found, [path.name for path in self._plates])


def together(plates: Sequence[Sliced], names: Sequence[str]) -> Sliced:
    """Times, filament, layers and objects of all plates summed; checks and warnings say of which."""
    first = plates[0]
    return replace(
        first,
        time_s=sum(p.time_s for p in plates),
        filament_m=sum(p.filament_m for p in plates),
        filament_g=sum(p.filament_g for p in plates),
        support_m=sum(p.support_m for p in plates),
        layers=sum(p.layers for p in plates),
        objects=sum(p.objects for p in plates),
        seconds=sum(p.seconds for p in plates),
        command=first.command.replace("part.3mf", "plate-N.3mf"),
        warnings=tuple(
            replace(w, text=f"{name}: {w.text}")
            for p, name in zip(plates, names, strict=True)
            for w in p.warnings
        ),
        checks=tuple(
            replace(c, detail=f"{name}: {c.detail}")
            for p, name in zip(plates, names, strict=True)
            for c in p.checks
        ),
    )
