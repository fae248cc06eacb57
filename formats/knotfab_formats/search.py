"""Every setting of the search that trades accuracy for time, and the presets measured on the frontier."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from knotfab_formats.bounds import MOST_MM
from knotfab_formats.errors import InputError

__all__ = ["OF_NO_PRESET", "PRESETS", "Precision", "Renderer", "SearchSettings", "search_settings"]

Precision = Literal["single", "double"]
Renderer = Literal["ray", "capsule", "ellipse"]


_MOST = 1_000_000  # iterations of a phase


class SearchSettings(BaseModel):
    """One point on the accuracy-time frontier (scene.toml `[search]`)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    seed: int = Field(0, ge=0, lt=2**63)
    start: str = ""  # a file of knots to go on from, beside the scene; "": a template
    method: Literal["flow", "inn", "inn+flow"] = "flow"  # inn: the paper's invertible network
    network_start: Literal["filling", "circle"] = "filling"  # the template that it deforms
    network_depth: int = Field(8, ge=1, le=256)  # coupling layers
    network_width: int = Field(128, ge=1, le=65536)  # hidden units of each S and T
    network_iterations: int = Field(300, ge=1, le=_MOST)
    network_rate_radii: float = Field(
        0.25, ge=1e-6, lt=2
    )  # a vertex's first steps; a circle's: twice
    coarse_px: int = Field(192, ge=32, le=4096)  # longer side of the picture in the first phase
    fine_px: int = Field(640, ge=32, le=4096)  # in the later ones
    coarse_iterations: int = Field(120, ge=0, le=_MOST)
    fine_iterations: int = Field(120, ge=0, le=_MOST)
    settle_iterations: int = Field(60, ge=0, le=_MOST)  # the last phase: feasibility first
    edge_radii: float = Field(0.75, gt=0.05, lt=0.8)  # vertex spacing in tube radii
    settle_edge_radii: float = Field(0.45, gt=0.05, lt=0.8)  # in the last phase, and in the part
    winners_every: int = Field(
        3, ge=1, le=_MOST
    )  # iterations between full searches for the winning capsules
    # sharpness of the picture at last, over the projected radius; never above 5 a pixel
    tau: float = Field(24.0, ge=0.01, le=1000)
    precision: Precision = "single"  # of pictures; all else is in double
    # what a picture's pixels measure: the ray's distance, or that to outlines of capsules, or of ellipses
    # at the vertices, as the paper has it; these by torch, in double precision
    renderer: Renderer = "ray"
    depth_candidates: int = Field(300, ge=1, le=100_000)  # depth profiles tried, by descent
    radius_candidates: int = Field(12, ge=2, le=1000)  # tube radii tried when the radius is "auto"
    # IoU of the template that may be given for a thicker tube, of fewer vertices; of the start: .012 or more
    radius_give: float = Field(0.004, ge=0, lt=0.5)
    # thinnest tube that is tried at once, over the usual one: 1 % of the frame's side
    radius_from: float = Field(1.0, ge=0.01, le=2)
    # unit of the effects' thresholds, px of a picture of 1024 px on its longer side (docs/effects.md)
    tolerance_px: float = Field(0.25, ge=1e-4, le=1024)
    grace: float = Field(
        0.02, ge=0, le=10
    )  # weight of bending and length: how smoothly, and how straight, strands run
    grace_of: Literal["curves", "bends"] = "curves"  # bends: as few as can be, of a wire
    # facets around the tube, at least; of 18 a corner stands out by 1 % of the radius, which is as much
    # as the check of clearance allows for
    mesh_sides: int = Field(20, ge=8, le=360)
    # the outline's limit, where the scene leaves it open
    outline_px: float = Field(0.5, ge=1e-4, le=1024)
    iou_slack: float = Field(0.05, ge=1e-4, lt=1)  # required IoU: the bound less this
    # pose, distances and tube radius of the one view are unknowns too, or the azimuths of several
    free_view: bool = False
    # where they start; 0: as the scene's view has it
    free_light_mm: float = Field(0.0, ge=0, le=MOST_MM)
    free_wall_mm: float = Field(0.0, ge=0, le=MOST_MM)
    free_azimuths_deg: str = ""  # of several views, with spaces between; "": as the scene has them
    free_radius_mm: float = Field(0.0, ge=0, le=MOST_MM)  # 0: a radius that the scene gives stays

    @property
    def iterations(self) -> int:
        """Those of all phases that the method has."""
        network = 0 if self.method == "flow" else self.network_iterations
        flow = self.coarse_iterations + self.fine_iterations + self.settle_iterations
        return network + (0 if self.method == "inn" else flow)

    def floor(self, bound: float) -> float:
        """The IoU that a part must reach where nothing can exceed `bound`."""
        return round(max(0.3, bound - self.iou_slack), 4)

    def scaled(self, factor: float) -> SearchSettings:
        """The same point with `factor` times the iterations (a time budget's answer)."""
        return self.model_copy(
            update={
                "coarse_iterations": max(10, round(self.coarse_iterations * factor)),
                "fine_iterations": max(10, round(self.fine_iterations * factor)),
                "settle_iterations": max(20, round(self.settle_iterations * factor)),
                "network_iterations": max(20, round(self.network_iterations * factor)),
            }
        )


PRESETS: dict[str, SearchSettings] = {
    "sketch": SearchSettings(
        fine_px=256,
        coarse_iterations=30,
        fine_iterations=30,
        settle_iterations=20,
        settle_edge_radii=0.6,
        tau=18.0,
        depth_candidates=60,
        radius_candidates=6,
        radius_give=0.02,
        tolerance_px=0.5,
        mesh_sides=18,
        outline_px=1.5,
        iou_slack=0.12,
    ),
    "draft": SearchSettings(
        fine_px=512,
        coarse_iterations=40,
        fine_iterations=40,
        settle_iterations=20,
        settle_edge_radii=0.6,
        tau=18.0,
        depth_candidates=60,
        radius_candidates=8,
        radius_give=0.008,
        tolerance_px=0.5,
        mesh_sides=18,
        outline_px=1.0,
        iou_slack=0.08,
    ),
    "standard": SearchSettings(),
    "fine": SearchSettings(
        fine_px=1024,
        radius_give=0.002,
        radius_from=0.75,
        tolerance_px=0.1,
        mesh_sides=32,
        iou_slack=0.04,
    ),
}


# what no preset decides: another accuracy keeps what a scene says of these
OF_NO_PRESET = ("seed", "start", "method", "grace", "grace_of", "network_start") + tuple(
    name for name in SearchSettings.model_fields if name.startswith("free_")
)


def search_settings(accuracy: str, overrides: dict[str, Any]) -> SearchSettings:
    """The preset of `accuracy` with the scene's own `[search]` keys over it.

    Raises:
        InputError: for a key that is none, or a value out of its bounds.
    """
    if accuracy not in PRESETS:
        remedy = f"Known: {', '.join(PRESETS)}"
        raise InputError(f"the accuracy {accuracy}", "there is no such preset", remedy)
    known = SearchSettings.model_fields
    for key in overrides:
        if key not in known:
            raise InputError(
                f"scene key [search] {key}",
                "there is no such setting",
                f"The search takes: {', '.join(known)}",
            )
    try:
        return SearchSettings(**{**PRESETS[accuracy].model_dump(), **overrides})
    except ValueError as error:
        first = (
            error.errors()[0] if hasattr(error, "errors") else {"loc": ("?",), "msg": str(error)}
        )
        raise InputError(
            f"scene key [search] {first['loc'][0]}",
            str(first["msg"]).lower(),
            "Correct it, or leave it out for the preset's value",
        ) from error
