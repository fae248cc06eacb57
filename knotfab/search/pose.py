"""A view that is an unknown of the search: what the flow asks of it."""

from __future__ import annotations

from typing import Protocol

from knotfab.base.arrays import Array
from knotfab.geometry.neighbours import Neighbours
from knotfab.problem import Problem, ViewNumbers
from knotfab.search.objective import Objective

__all__ = ["Pose"]


class Pose(Protocol):
    """The pose of one view (`torch_forms.pose.FreePose`), or directions of several (`FreeDirections`)."""

    @property
    def radius_mm(self) -> float:
        """The tube's radius now."""

    def keep(self, points: Array) -> None:
        """Go back into the bounds, which the points (N, 3) may set."""

    def show(self, objective: Objective, problem: Problem) -> None:
        """Let the objective see its views from here."""

    def descend(
        self,
        objective: Objective,
        problem: Problem,
        points: Array,
        near: Neighbours,
        progress: float,
    ) -> None:
        """Move one step against the objective at vertices (N, 3), and let it see from there."""

    def settle(self, problem: Problem, points: Array) -> tuple[Problem, Array, ViewNumbers | None]:
        """Return the problem with its views here, and the points (N, 3) in their axes."""
