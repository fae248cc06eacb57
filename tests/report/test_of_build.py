"""The knots of a report: as they will be, once their material has shrunk."""

from types import SimpleNamespace
from typing import Any

import pytest
from rings import knots, ring

from knotfab.base.progress import Progress
from knotfab.part.assemble import enlarge_knots
from knotfab.report.of_build import report_of
from knotfab.request import Request
from knotfab.scene.catalogue import resolve
from knotfab_formats.scene import Material, ResolvedView, Scene
from knotfab_formats.search import search_settings

VIEW = ResolvedView(frame_width_mm=120.0, frame_height_mm=120.0, picture="picture-front.png")


def told(tmp_path: Any, percent: float) -> dict[str, Any]:
    """The report of a ring of 30 mm that has no part."""
    keys: Any = {"views": (VIEW,), "material": Material(shrinkage_percent=percent)}
    feasibility = SimpleNamespace(figures={})
    result = SimpleNamespace(effects={}, guards={}, feasibility=feasibility, log=SimpleNamespace())
    made: Any = SimpleNamespace(
        scene=resolve(Scene(**keys)),
        knots=knots(ring(30.0, n=80, wave=0.0)),
        result=result,
        radius=None,
        opening_iou=1.0,
        settings=search_settings("draft", {}),
        bounds=(),
        binding=(),
        unmet=None,
    )
    request = Request(made.scene, ("heart.png",), tmp_path)
    verdict: dict[str, Any] = {"views": [], "checks": [], "seconds": {}}
    return report_of(request, made, enlarge_knots(made), [], verdict, (), Progress("quiet"))


@pytest.mark.parametrize("percent", [3.0, 12.5])
def test_knots_are_reported_as_they_will_have_shrunk(tmp_path: Any, percent: float) -> None:
    as_is, shrunk = told(tmp_path, 0.0), told(tmp_path, percent)
    assert as_is["settings"]["tube_radius_mm"] == shrunk["settings"]["tube_radius_mm"] == 2.0
    for key in ("length_mm", "thickness_mm", "min_bend_radius_mm", "curvature_90_radii"):
        assert shrunk["knots"][0][key] == pytest.approx(as_is["knots"][0][key], rel=1e-6), key
    thick = [report["settings"]["thickness_mm"] for report in (as_is, shrunk)]
    assert thick[0] == pytest.approx(thick[1])
