"""The knots of a report: as they will be, once their material has shrunk."""

from types import SimpleNamespace
from typing import Any

import pytest
from reports import verdict_of
from rings import knots, ring

from knotfab.part.assemble import enlarge_knots
from knotfab.problem import CertificateLog
from knotfab.report.of_build import print_of, report_of
from knotfab.request import Request
from knotfab.scene.catalogue import resolve
from knotfab_formats.report import Report
from knotfab_formats.scene import Material, ResolvedView, Scene
from knotfab_formats.search import search_settings

VIEW = ResolvedView(frame_width_mm=120.0, frame_height_mm=120.0, picture="picture-front.png")


def told(tmp_path: Any, percent: float) -> Report:
    """The report of a ring of 30 mm that has no part."""
    keys: Any = {"views": (VIEW,), "material": Material(shrinkage_percent=percent)}
    feasibility = SimpleNamespace(figures={})
    result = SimpleNamespace(effects={}, guards={}, feasibility=feasibility, log=CertificateLog())
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
    found = verdict_of(), (), (), print_of(made, (), ())
    return report_of(request, made, enlarge_knots(made), *found, ())


@pytest.mark.parametrize("percent", [3.0, 12.5])
def test_knots_are_reported_as_they_will_have_shrunk(tmp_path: Any, percent: float) -> None:
    as_is, shrunk = told(tmp_path, 0.0), told(tmp_path, percent)
    assert as_is.settings.tube_radius_mm == shrunk.settings.tube_radius_mm == 2.0
    for key in ("length_mm", "thickness_mm", "min_bend_radius_mm", "curvature_90_radii"):
        one, other = (getattr(found.knots[0], key) for found in (shrunk, as_is))
        assert one == pytest.approx(other, rel=1e-6), key
    thick = [report.settings.thickness_mm for report in (as_is, shrunk)]
    assert thick[0] == pytest.approx(thick[1])
