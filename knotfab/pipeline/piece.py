"""One piece, or one frame of a sequence, as it was written."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cached_property

from knotfab.design.design import Design
from knotfab.knots import Knots
from knotfab.part.assemble import Part, enlarge_knots
from knotfab.part.orient import Flattening
from knotfab.part.slicer import SlicerQueue
from knotfab.part.slicer_process import NotSliced, Sliced
from knotfab.picture.read import Target
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import Verdict


@dataclass(frozen=True)
class WrittenPiece:
    """One piece as written. `part` is None if none could be made of its knots.

    `scene` has the pose. `suffix` is in the names of its files, such as "-01" for a frame of a sequence.
    `answer` waits for the validators' verdict, and `slicing` for the slicer's result.
    """

    made: Design
    scene: SettledScene
    part: Part | None
    targets: tuple[Target, ...]
    suffix: str
    answer: Callable[[], Verdict]
    slicing: Future[Sliced | NotSliced] | None = None
    flattening: Flattening | None = None
    slicer: SlicerQueue | None = None
    notes: tuple[str, ...] = ()  # sentences for the report

    @property
    def knots(self) -> Knots:
        """The knots as in the file."""
        return enlarge_knots(self.made) if self.part is None else self.part.pose.knots

    @cached_property
    def verdict(self) -> Verdict:
        """The validators' verdict on the files; waits for it."""
        return self.answer()

    @cached_property
    def sliced(self) -> Sliced | NotSliced | None:
        """The slicer's result; waits for it."""
        return None if self.slicing is None else self.slicing.result()


Settled = tuple[Design, Part, Flattening | None]
