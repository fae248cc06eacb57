"""All settings of the search that trade accuracy for time, and the measured presets."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import ConfigDict, Field

from knotfab_formats.bounds import MOST_MM, option
from knotfab_formats.errors import InputError
from knotfab_formats.piece import Table

Precision = Literal["single", "double"]
Renderer = Literal["ray", "capsule", "ellipse"]


_MOST = 1_000_000  # iterations of a phase


class SearchSettings(Table):
    """One point on the accuracy-time frontier (scene.toml `[search]`)."""

    model_config = ConfigDict(strict=True)

    seed: int = option(0, "Search --seed", ge=0, lt=2**63)
    """Seed of the random depth profiles: another one gives another piece."""
    start: str = ""
    """A file of knots to go on from, beside the scene; "": a template."""
    method: Literal["flow", "inn", "inn+flow"] = option("flow", "Search --search")
    """flow (default: the certified flow), inn (an invertible network), or inn+flow, one after the
    other."""
    network_start: Literal["filling", "circle"] = "filling"
    """The template that the network deforms."""
    network_depth: int = Field(8, ge=1, le=256)
    """The number of coupling layers."""
    network_width: int = Field(128, ge=1, le=65536)
    """Hidden units of each S and T."""
    network_iterations: int = Field(300, ge=1, le=_MOST)
    """Iterations of the network."""
    network_rate_radii: float = Field(0.25, ge=1e-6, lt=2)
    """Length of a vertex's first steps, in tube radii; from a circle, twice that."""
    coarse_px: int = Field(192, ge=32, le=4096)
    """The picture's longer side in the first phase."""
    fine_px: int = Field(640, ge=32, le=4096)
    """The picture's longer side in the later phases."""
    coarse_iterations: int = Field(120, ge=0, le=_MOST)
    """Iterations of the first phase."""
    fine_iterations: int = Field(120, ge=0, le=_MOST)
    """Iterations of the second phase."""
    settle_iterations: int = Field(60, ge=0, le=_MOST)
    """Iterations of the last phase, in which feasibility comes first."""
    edge_radii: float = Field(0.75, gt=0.05, lt=0.8)
    """Vertex spacing in tube radii."""
    settle_edge_radii: float = Field(0.45, gt=0.05, lt=0.8)
    """Vertex spacing in the last phase, and in the part."""
    winners_every: int = Field(3, ge=1, le=_MOST)
    """Iterations between full searches for the winning capsules."""
    tau: float = Field(24.0, ge=0.01, le=1000)
    """Final sharpness of the rendered edge, per projected radius; never above 5 per pixel."""
    precision: Precision = "single"
    """Precision in which pictures are rendered; all else is in double precision."""
    renderer: Renderer = "ray"
    """What a picture's pixels measure: the ray's distance, or that to outlines of capsules, or of
    ellipses at the vertices, as the paper has it; these by torch, in double precision."""
    depth_candidates: int = Field(300, ge=1, le=100_000)
    """How many depth profiles the descent tries."""
    radius_candidates: int = Field(12, ge=2, le=1000)
    """How many tube radii are tried when the radius is "auto"."""
    radius_give: float = Field(0.004, ge=0, lt=0.5)
    """IoU of the template that may be given up for a thicker tube, which has fewer vertices; of the
    start, 0.012 or more."""
    radius_from: float = Field(1.0, ge=0.01, le=2)
    """The thinnest tube that is tried first, as a ratio to the usual one, 1 % of the frame's
    side."""
    tolerance_px: float = Field(0.25, ge=1e-4, le=1024)
    """Unit of the effects' thresholds, px of a picture of 1024 px on its longer side
    (docs/effects.md)."""
    grace: float = Field(0.02, ge=0, le=10)
    """Weight of bending energy and length in the objective: how smooth and straight strands run."""
    mesh_sides: int = Field(20, ge=8, le=360)
    """The least number of facets around the tube; with 18, a corner stands out by 1 % of the
    radius, as much as the check of clearance allows for."""
    outline_px: float = Field(0.5, ge=1e-4, le=1024)
    """Limit of the outline's error, in px, where the scene leaves it open."""
    iou_slack: float = Field(0.05, ge=1e-4, lt=1)
    """The required IoU is the bound less this."""
    free_view: bool = False
    """true: the search also finds the pose, the distances and the tube's radius of a single view,
    or the directions of several; [[views]] then holds what was found."""
    free_light_mm: float = Field(0.0, ge=0, le=MOST_MM)
    """Distance of the lamp at which the search began; 0: as the scene has it."""
    free_wall_mm: float = Field(0.0, ge=0, le=MOST_MM)
    """The same for the wall."""
    free_azimuths_deg: str = ""
    """Azimuths at which several views start, separated by spaces; "": as the scene has them."""
    free_elevations_deg: str = ""
    """The same for elevations; "": they stay."""
    free_radius_mm: float = Field(0.0, ge=0, le=MOST_MM)
    """Tube radius at which the search began; 0: a radius that the scene gives stays."""

    @property
    def iterations(self) -> int:
        """The sum of iterations over all phases that the method has."""
        network = 0 if self.method == "flow" else self.network_iterations
        flow = self.coarse_iterations + self.fine_iterations + self.settle_iterations
        return network + (0 if self.method == "inn" else flow)

    def floor(self, bound: float) -> float:
        """Return the IoU that a part must reach if nothing can exceed `bound`."""
        return round(max(0.3, bound - self.iou_slack), 4)

    def scaled(self, factor: float) -> SearchSettings:
        """Scale the iterations by `factor`, to meet a time budget."""
        return self.but(
            coarse_iterations=max(10, round(self.coarse_iterations * factor)),
            fine_iterations=max(10, round(self.fine_iterations * factor)),
            settle_iterations=max(20, round(self.settle_iterations * factor)),
            network_iterations=max(20, round(self.network_iterations * factor)),
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


# keys that no preset sets: they survive a change of accuracy
OF_NO_PRESET = ("seed", "start", "method", "grace", "network_start") + tuple(
    name for name in SearchSettings.model_fields if name.startswith("free_")
)


def search_settings(accuracy: str, overrides: dict[str, Any]) -> SearchSettings:
    """Return the preset of `accuracy`, overridden by the scene's own `[search]` keys.

    Raises:
        InputError: an unknown key, or a value out of its bounds.
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
