"""The attempts of a build: plans yield them one by one, and one loop makes, times, tells and records them.

A plan is a generator: it yields an attempt, gets what came of it, and decides on the next. Its last word is
the best that was made. `design.design` plans searches, `pipeline.plan` supports, places and holders, and
`pipeline.film` the frames of a sequence.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress, cpu_seconds
from knotfab_formats.report import AttemptFigures

if TYPE_CHECKING:
    from knotfab.problem import Problem, Start
    from knotfab.search.state import SearchResult
    from knotfab_formats.search import SearchSettings

Found = TypeVar("Found")


class Attempt(Protocol):
    """Something that a plan has made: `what`, and `why` it follows on the one before; the first has none."""

    @property
    def what(self) -> str: ...
    @property
    def why(self) -> str: ...
    def make(self) -> Any:
        """Make it; what is made may say how it `ended`. Raises SceneError where it cannot be made."""

    def judge(self, made: Any) -> str:
        """Tell in a few words what came of it."""


Steps = Generator[Attempt, Any, Found]


@dataclass(frozen=True)
class Try:
    """An attempt in two calls: one makes it, and one tells what came of it."""

    what: str
    make: Callable[[], Any]
    judge: Callable[[Any], str]
    why: str = ""


@dataclass(frozen=True)
class Search:
    """A search; `more` are further arguments of `search.search`."""

    what: str
    problem: Problem
    start: Start
    radius: float
    settings: SearchSettings
    why: str = ""
    more: Mapping[str, Any] = field(default_factory=dict)

    def make(self) -> SearchResult:
        """Run it; the only place in a build that does."""
        from knotfab.search.search import search  # only now, since it compiles

        return search(self.problem, self.start, self.radius, self.settings, **self.more)

    def judge(self, made: SearchResult) -> str:
        """Tell the IoU of the worst view, and the limits that it breaks."""
        broken = ", ".join(made.feasibility.broken)
        return f"IoU {made.iou_estimate:.3f}, " + (
            f"breaks {broken}" if broken else "within limits"
        )


@dataclass
class Attempts:
    """All attempts of one build, in order."""

    progress: Progress
    made: list[AttemptFigures] = field(default_factory=list)

    def carry_out(self, plan: Steps[Found]) -> Found:
        """Make what a plan yields until it is done; return its last word."""
        answer: Any = None
        failed: SceneError | None = None
        while True:
            try:
                attempt = plan.send(answer) if failed is None else plan.throw(failed)
            except StopIteration as done:
                best: Found = done.value
                return best
            answer, failed = self._make(attempt)

    def _make(self, attempt: Attempt) -> tuple[Any, SceneError | None]:
        if why := attempt.why:
            self.made[-1:] = [replace(last, why_next=why) for last in self.made[-1:]]
            self.progress.say(f"{why[0].upper()}{why[1:]}: {attempt.what}")
        answer, failed, ended = None, None, None
        begun, cpu = time.perf_counter(), cpu_seconds()
        try:
            answer = attempt.make()
            outcome, ended = attempt.judge(answer), getattr(answer, "ended", None)
        except SceneError as error:
            failed, outcome = error, f"{error.what}: {error.why}"
        self.made.append(
            AttemptFigures(
                what=attempt.what,
                seconds=round(time.perf_counter() - begun, 2),
                cpu_s=round(cpu_seconds() - cpu, 2),
                outcome=outcome,
                ended=ended,
            )
        )
        return answer, failed
