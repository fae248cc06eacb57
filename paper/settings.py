"""The paper's hyper-parameters: its two tables, its network and its optimiser."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class PaperSettings(BaseModel):
    """Every number of the paper's search; lengths in its own unit. The defaults are the preset `paper`.

    The paper's supplement, Tables 1 and 2 and "Hyper-parameters"; the camera's row is the default of
    `paper_camera`. It does not say what `iterations` and `template_middle` are: its released code runs
    25,000, and the eye at the origin must have the template in front of it.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    renderer: Literal["ellipse", "capsule"] = "capsule"
    radius: float = Field(0.05, gt=0)  # r
    samples: int = Field(1000, ge=4)  # N, of each knot
    pairs: int = Field(100_000, ge=1)  # |B_M|
    tau: float = Field(100.0, gt=0)  # per unit of the image plane
    image_weight: float = Field(1.0, ge=0)
    length_weight: float = Field(1e-2, ge=0)
    mobius_weight: float = Field(1e-3, ge=0)
    occupancy_weight: float = Field(1e-2, ge=0)
    bending_weight: float = Field(1e-2, ge=0)
    longest: float | None = Field(None, gt=0)  # L0; none: no budget
    sharpest: float | None = Field(None, ge=0)  # B0, squared curvature; none: no limit
    depth: int = Field(8, ge=1)  # affine coupling layers
    width: int = Field(1024, ge=1)  # hidden units of S and of T
    learning_rate: float = Field(1e-5, gt=0)  # Adam's
    iterations: int = Field(25_000, ge=1)
    resample_every: int = Field(1, ge=1)  # iterations that share a random ring and its winners
    template_middle: tuple[float, float, float] = (0.0, 0.0, 3.0)  # where the network's origin lies
    seed: int = Field(0, ge=0)


PAPER = PaperSettings()
