"""A stand's own shadow is no fault, since the outline is the tube's; a wrong tube's still is."""

from functools import cache

import manifold3d
import numpy as np
import pytest
from pieces import EMPTY, RADIUS, VIEW, camera
from tables import some

from knotfab.geometry.tube import sweep
from knotfab.hold.solids import stand_bodies
from knotfab.hold.stand import StandSettings, plan_stand
from knotfab.knots import Knot, Knots
from knotfab_validators.arrays import Mask
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.part_shadows import shadow_checks
from knotfab_validators.shadows.verify_view import VerifiedView, verify_view
from knotfab_validators.shadows.view import view_geometry
from knotfab_validators.tube.solid_matter import strand_faces, tube_vertices
from knotfab_validators.tube.tube_fit import check_tube
from tests.hold.test_stand import ONE, PLA

CURVE = ONE.knots[0].points
GEOMETRY = view_geometry(VIEW, 90, 90)  # type: ignore[arg-type]
Body = tuple[np.ndarray, np.ndarray]


def _lone(line: np.ndarray, radius: float) -> Curves:
    return Curves((line,), ("unknot",), (True,), radius)


def push_outwards(by_mm: float) -> np.ndarray:
    """The ring with its right side pushed out."""
    t = np.arctan2(CURVE[:, 1], CURVE[:, 0])
    bump = by_mm * np.exp(-((t / 0.3) ** 2))
    out = CURVE / np.hypot(CURVE[:, 0], CURVE[:, 1])[:, None] * [1, 1, 0]
    return np.asarray(CURVE + bump[:, None] * out)


@cache
def on_a_stand(by_mm: float = 0.0) -> Body:
    own = Knots((Knot(push_outwards(by_mm)),), RADIUS)
    mount = plan_stand(own, [camera()], [EMPTY], 0.4, PLA, StandSettings(4.0, 10.0, 0.8))
    return stand_bodies([sweep(own.knots[0].points, RADIUS, 64)], mount)[0]


@cache
def shadow() -> Mask:
    """What the bare ring darkens of its frame."""
    vertices, faces = sweep(CURVE, RADIUS, 96)
    seen = verify_view(vertices, faces.astype(np.int64), EMPTY | True, GEOMETRY)
    across, down = seen.frame.pad_x, seen.frame.pad_y
    return seen.exact[down:-down, across:-across]


def verify(body: Body, *, stand: bool = True) -> VerifiedView:
    """Verify a part against the ring as it should be; the picture is the ring's own shadow."""
    vertices, faces = body
    fine = view_geometry(VIEW, 1024, 1024)  # type: ignore[arg-type]
    return verify_view(
        vertices,
        faces.astype(np.int64),
        shadow(),
        fine,
        polygons=[CURVE],
        radius=RADIUS,
        mounted=True,
        stand=stand,
    )


def outline(view: VerifiedView) -> float:
    assert view.outline_px is not None
    return view.outline_px


@pytest.mark.slow
def test_the_stand_is_no_fault_of_the_outline() -> None:
    view = verify(on_a_stand())
    assert outline(view) < 0.5
    assert outline(verify(on_a_stand(), stand=False)) > 20  # the base, far below
    # matter that darkens below the frame does not count, matter that darkens inside does
    assert view.whole.iou < view.framed.iou < view.judged.iou and view.intrusion is not None
    own = float(view.target.sum())
    assert view.judged.iou == pytest.approx(1.0, abs=2e-3)
    assert view.framed.iou == pytest.approx(own / (own + view.intrusion * 1024**2), rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("by_mm", some([0.3, -0.3, 1.5], 2))
def test_a_displaced_tube_is_found(by_mm: float) -> None:
    """Its shadow moves by 1.2 / 0.176 pixels a millimetre."""
    view = verify(on_a_stand(by_mm))
    assert outline(view) == pytest.approx(abs(by_mm) * 1.2 * 1024 / 180, rel=0.1)
    assert view.outline is not None
    if abs(by_mm) < 1:
        # seen on both its sides, so that neither a post nor another strand could hide it
        assert view.outline.spill_mm == pytest.approx(view.outline.missing_mm, rel=0.15)
    else:
        # a post stands on that place: what sticks out might be its; what lacks is not
        assert view.outline.missing_mm == pytest.approx(abs(by_mm) * 1.2, rel=0.1)


@pytest.mark.slow
def test_a_missing_part_is_found() -> None:
    whole = on_a_stand()
    mesh = manifold3d.Mesh64(whole[0], whole[1].astype(np.uint64))
    hole = manifold3d.Manifold.cube((8, 8, 60), True).translate((50, 0, 0))
    cut = (manifold3d.Manifold(mesh) - hole).to_mesh64()
    view = verify((np.array(cut.vert_properties[:, :3]), np.array(cut.tri_verts)))
    assert view.outline is not None and outline(view) > 5
    assert view.outline.missing_mm > view.outline.spill_mm


@pytest.mark.slow
def test_the_floor_is_asked_of_the_tube() -> None:
    view = verify(on_a_stand())

    def status(floor: float) -> str:
        found = shadow_checks(
            {"front": view},
            on_a_stand()[0],
            iou_floor=floor,
            max_outline_px=0.5,
            no_rendering="left out",
            polygons_decide=True,
            mount="stand",
        )
        return {c.name: c.status for c in found}["shadow"]

    assert status(view.judged.iou) == "pass"
    assert status(view.judged.iou + 1e-9) == "fail"


def test_what_leads_away_is_the_mount_and_what_swells_is_not() -> None:
    """A square column on a tube counts from certain edges on; a wart does not."""
    line = np.column_stack([np.linspace(0, 40, 41), np.zeros(41), np.zeros(41)])
    curve = np.concatenate([line, line[::-1] + [0.0, 200.0, 0.0]])
    on = np.array([[10.0, 0, 1.0], [12.0, 0, 1.0], [11.0, 0.0, 1.0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]])
    for height, is_tube in ((1.05, True), (1.5, True), (1.99, True), (2.01, False), (9.0, False)):
        vertices = np.vstack([on, [[11.0, 0.0, height]]])
        found = tube_vertices(vertices, faces, [curve], 1.0)
        assert found[:3].all() and found[3] == is_tube
    # joined to what leads away, a vertex near the tube is the mount's too; unless it is on the tube
    for middle, is_tube in ((1.061, False), (1.059, True)):
        vertices = np.vstack([on, [[11.0, 0.0, middle]], [[11.0, 0.0, 5.0]], [[11.5, 0.0, 5.0]]])
        longer = np.vstack([faces, [[3, 4, 5]]])
        assert tube_vertices(vertices, longer, [curve], 1.0)[3] == is_tube


@pytest.mark.slow
def test_a_stands_struts_leave_enough_of_the_tube() -> None:
    vertices, faces = on_a_stand()
    mesh = Mesh(vertices, faces.astype(np.int64))
    for radius, status in ((RADIUS, "pass"), (0.9 * RADIUS, "fail")):
        assert check_tube(mesh, _lone(CURVE, radius), mounted=True).status == status


def test_long_faces_of_a_strand_are_its_own_and_bridges_not() -> None:
    t = np.linspace(0.0, np.pi, 33)
    arc = np.column_stack([8.0 * np.sin(t), 8.0 * np.cos(t), 0.0 * t])
    line = np.concatenate([arc + [40.0, 0.0, 0.0], -arc])  # two legs of 40 mm, an edge each
    vertices, faces = sweep(line, 2.0, 32)
    steps = np.arange(0.0, 40.0, 0.26) * np.array([[1.0], [0.0], [0.0]])
    finer = np.concatenate([line[:33], line[32] - steps.T[1:], line[33:], line[-1] + steps.T[1:]])
    for points in line, finer:  # a knot's vertices may be much nearer than its faces are long
        assert strand_faces(Mesh(vertices, faces), _lone(points, 2.0)).all()
    on_legs = (vertices[:, 0] > -0.5) & (vertices[:, 0] < 40.5)
    (legs,) = np.nonzero(on_legs & (np.abs(np.abs(vertices[:, 1]) - 6.0) < 0.5))
    upper, lower = legs[vertices[legs, 1] > 0][0], legs[vertices[legs, 1] < 0]
    bridge = np.array([[upper, lower[0], lower[1]]])
    for points in line, finer:
        assert not strand_faces(Mesh(vertices, bridge), _lone(points, 2.0)).any()


@pytest.mark.parametrize("side", [3.5, 5.0, 6.0, 8.0, 12.0])
def test_inner_sides_that_mitres_shorten_are_a_strands_own(side: float) -> None:
    radius, corners = 2.0, 16
    t = 2 * np.pi * np.arange(corners) / corners
    large = side * radius / (2 * np.sin(np.pi / corners))
    line = large * np.column_stack([np.cos(t), np.sin(t), 0.0 * t])
    vertices, faces = sweep(line, radius, 24)
    assert strand_faces(Mesh(vertices, faces), _lone(line, radius), proud=1.2).all()
