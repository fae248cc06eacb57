"""A wire of known thickness can or cannot draw bars of known width in their frame."""

import numpy as np
import pytest

from knotfab.design.free_view import start_pose
from knotfab.design.question import ask
from knotfab.picture.read import read_target
from knotfab.scene.catalogue import materials, resolve
from knotfab.torch_forms.forms import TorchForms
from knotfab.wire.plan import ENOUGH_IOU, measure_frame
from knotfab_formats.scene import Material, Piece, ResolvedView, Scene

STEEL = materials()["steel-wire-2mm"]


def bars(thin: int) -> np.ndarray:
    """Two bars of equal area, 100 px and `thin` px wide."""
    mask = np.zeros((1000, 1000), dtype=bool)
    mask[100 : 100 + 8 * thin, 100:200] = True
    mask[100:900, 500 : 500 + thin] = True
    return mask


def view(width: float, wall: float = 0.001) -> ResolvedView:
    return ResolvedView(
        frame_width_mm=width, frame_height_mm=width, light_distance_mm=500.0, wall_distance_mm=wall
    )


def test_what_is_thinner_than_the_wire_is_lost() -> None:
    """A bar of 20 px takes a wire of 2 mm from 100 mm on; the other is as wide as it is high, or wider."""
    small, large = (measure_frame(bars(20), view(w), STEEL) for w in (80.0, 130.0))
    assert small.most_iou == pytest.approx(0.5, abs=0.02)
    assert large.most_iou > ENOUGH_IOU
    assert small.enough_mm == pytest.approx(large.enough_mm, rel=1e-3)
    assert small.enough_mm == pytest.approx(100.0, rel=0.05)
    check = small.check(STEEL)
    assert (check.status, check.required) == ("fail", False)
    assert f"{small.enough_mm:.0f} mm and more would do" in check.detail
    assert large.check(STEEL).status == "pass" and "small" not in large.check(STEEL).detail


def test_a_wall_far_behind_makes_the_wires_shadow_wider() -> None:
    near, far = (measure_frame(bars(20), view(130.0, w), STEEL) for w in (0.001, 250.0))
    assert near.enough_mm is not None and far.enough_mm is not None
    assert far.enough_mm == pytest.approx(1.5 * near.enough_mm, rel=1e-3)


def test_dust_needs_a_frame_that_is_not_sought() -> None:
    mask = np.zeros((1000, 1000), dtype=bool)
    mask[100:900:40, 100:103] = True
    tiny = measure_frame(mask, view(5.0), STEEL)
    assert tiny.enough_mm is None and "would do" not in tiny.check(STEEL).detail


def test_a_wires_tube_is_as_thick_as_the_wire() -> None:
    wire = resolve(Scene(material=Material(name="aluminium-wire-2mm")))
    assert wire.piece.tube_radius_mm == 1.0
    asked = Scene(material=Material(name="aluminium-wire-2mm"), piece=Piece(tube_radius_mm=1.5))
    assert resolve(asked).piece.tube_radius_mm == 1.5
    assert resolve(Scene()).piece.tube_radius_mm is None


@pytest.mark.slow
@pytest.mark.parametrize(("material", "free"), [("steel-wire-2mm", False), ("pla", True)])
def test_a_free_view_leaves_the_wire_as_thick_as_it_is(material: str, free: bool) -> None:
    scene = resolve(Scene(material=Material(name=material), search={"free_view": True}))
    problem = ask(scene, [read_target("text:♥")]).problem
    settings = scene.settings
    pose, settings = start_pose(scene, problem, 1.0, settings, TorchForms())
    assert ("radius" in pose.bounds.free) == free
    assert (settings.free_radius_mm > 0) == free
