"""The parts of knots.json that say what holds the knots."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, Strict

from knotfab_formats.bounds import Vector

__all__ = ["Member"]

_Radius = Annotated[float, Strict(), Field(gt=0, le=1e7)]


class Member(BaseModel):
    """A member of a mount, from a centre line to its foot or to another centre line; lengths in mm.

    `radius_mm` are those of its ends, `foot` the unit normal of the plate, wall or base that it stands on.
    """

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    start: Annotated[Vector, Field(alias="from")]
    end: Annotated[Vector, Field(alias="to")]
    radius_mm: tuple[_Radius, _Radius]
    foot: Vector | None = None
