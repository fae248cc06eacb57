"""The bar that shows a build's progress on a terminal, with a picture of its knots below it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    import rich.progress


def make_bar(
    stream: TextIO, remaining: Callable[[], str], picture: Callable[[], str]
) -> rich.progress.Progress:
    from rich.console import Console, RenderableType
    from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TextColumn
    from rich.text import Text

    class Remaining(ProgressColumn):
        max_refresh = 0.5

        def render(self, task: Task) -> Text:
            return Text(remaining(), style="progress.remaining")

    class Below(Progress):
        """The bar, and a picture below it."""

        def get_renderables(self) -> Iterator[RenderableType]:
            yield from super().get_renderables()
            if drawn := picture():
                yield Text(drawn, no_wrap=True, overflow="crop")

    return Below(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=32),
        Remaining(),
        TextColumn("{task.fields[iou]}"),
        console=Console(file=stream),
        transient=True,
    )
