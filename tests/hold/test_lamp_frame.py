"""The frame for several lamps: its bars and joints, where it has lamps and screen, what is rejected."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from shown_pieces import lit_scene

from knotfab.hold.lamp_frame import Table, frame_of, plan_table
from knotfab_fixtures.solids import HEAD_MM, TAIL_DEPTH_MM, table_bar
from knotfab_validators.files.mesh import Plate
from knotfab_validators.files.scene import parse_scene
from knotfab_validators.geometry.mesh import Mesh, number_bodies
from knotfab_validators.shadows.table import check_table


def table_of(**printer: Any) -> tuple[Table, Any]:
    scene = lit_scene()
    scene = scene.model_copy(update={"printer": scene.printer.model_copy(update=printer)})
    mounted: Any = SimpleNamespace(scene=scene, wall=None, stand=None, hang=None)
    table = plan_table(mounted)
    assert table is not None
    return table, scene


@pytest.mark.parametrize(
    "bed", [(250.0, 210.0, 220.0), (180.0, 180.0, 180.0), (120.0, 300.0, 100.0)]
)
def test_bars_fit_the_bed_and_each_ends_where_the_next_begins(bed: tuple[float, ...]) -> None:
    table, _ = table_of(build_volume_mm=bed)
    starts = [tuple(np.round(bar.start, 6)) for bar in table.bars]
    for bar in table.bars:
        assert bar.length_mm + TAIL_DEPTH_MM * bar.tail <= max(bed)
        for x, _, wide, _ in bar.holes:
            assert wide / 2 <= x <= bar.length_mm - wide / 2
        end = bar.start + bar.length_mm * bar.along
        if not bar.tail:
            continue
        following = [
            b for b, at in zip(table.bars, starts, strict=True) if at == tuple(np.round(end, 6))
        ]
        if bar.along[1] == 1.0 or following:  # the spine's pieces, and those of an arm
            assert [b.socket for b in following] == [True]
        else:  # an arm's last enters the side of the spine
            spine = [b for b in table.bars if b.along[1] == 1.0]
            sides = [(b.start[1] + x, side) for b in spine for x, side in b.sockets]
            assert any(abs(y - end[1]) < 1e-6 and side == -bar.along[0] for y, side in sides)
    own = {(round(x, 6), round(z, 6)) for _, x, z, _ in table.lamps}
    feet = {
        tuple(np.round(bar.start + x * bar.along + y * np.array([bar.along[1], -bar.along[0]]), 6))
        for bar in table.bars
        for x, y, _, boss in bar.holes
        if boss > 0
    }
    assert {tuple(np.abs(f)) for f in feet} == {tuple(np.abs(f)) for f in own}


def test_lamps_near_the_middle_widen_the_spine() -> None:
    table, scene = table_of()
    spine = [bar for bar in table.bars if bar.along[1] == 1.0]
    assert {bar.width_mm for bar in spine} == {2 * (10.0 + 8.3 / 2 + 3.0 + 8.5)}

    def framed(rights: tuple[float, ...], count: int = 3) -> tuple[Table | None, str]:
        views = [
            view.model_copy(update={"light_right_mm": right})
            for view, right in zip(scene.views, rights, strict=True)
        ]
        asked = scene.model_copy(update={"views": tuple(views[:count])})
        return frame_of(SimpleNamespace(scene=asked, wall=None, stand=None, hang=None))  # type: ignore[arg-type]

    found, why = framed((22.0, 35.0, 48.0))
    assert found is None and "side by side" in why
    assert framed((0.0, 36.0, 70.0), 1) == (None, "")


@pytest.mark.slow
def test_a_bar_is_watertight_and_refuses_invalid_sizes() -> None:
    vertices, faces = table_bar(
        90.0, 32.0, 5.0, tail=True, socket=True, sockets=[(45.0, 1)], holes=[(70.0, 0.0, 8.3, 12.0)]
    )
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert vertices[:, 0].max() == pytest.approx(90.0 + TAIL_DEPTH_MM)
    assert vertices[:, 2].max() == pytest.approx(17.0)
    for named in ({"holes": [(88.0, 0.0, 8.0, 0.0)]}, {"sockets": [(HEAD_MM / 2, 1)]}):
        with pytest.raises(ValueError, match="meets"):
            table_bar(90.0, 32.0, 5.0, **named)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="no room"):
        table_bar(90.0, 12.0, 5.0)


@pytest.mark.slow
def test_the_frame_is_checked_as_it_was_written() -> None:
    table, scene = table_of()
    asked = parse_scene(scene.model_dump(by_alias=True, mode="json"))
    plates = []
    for sheet in table.sheets:
        shift = np.cumsum([0, *(len(vertices) for vertices, _ in sheet.bodies)])
        faces = [f + k for (_, f), k in zip(sheet.bodies, shift, strict=False)]
        mesh = Mesh(
            np.concatenate([v for v, _ in sheet.bodies]), np.concatenate(faces).astype(np.int64)
        )
        plates.append(Plate(sheet.name, mesh, number_bodies(mesh)[0], np.array(sheet.to_scene)))
    judged = check_table(plates, asked)
    assert [(c.name, c.status, c.required) for c in judged] == [
        ("table_mesh", "pass", True),
        ("table", "pass", True),
        ("table_shadow", "pass", True),
    ]
    # each is wrong: lamp, wall or bar elsewhere, a bar too few, an open surface, a smaller bed
    aside = [*scene.views[:2], scene.views[2].model_copy(update={"light_right_mm": 72.0})]
    far = [v.model_copy(update={"wall_distance_mm": v.wall_distance_mm + 1.0}) for v in scene.views]
    for views in (aside, far):
        other = scene.model_copy(update={"views": tuple(views)}).model_dump(
            by_alias=True, mode="json"
        )
        assert check_table(plates, parse_scene(other))[1].status == "fail"
    moved = plates[0].to_part.copy()
    moved[:, :3, 3] += 2.0
    raised = plates[0].to_part.copy()
    raised[:, 1, 3] += 60.0
    dark = check_table([replace(p, to_part=raised) for p in plates[:1]], asked)[2]
    assert dark.status == "fail" and dark.required
    assert check_table([replace(plates[0], to_part=moved), *plates[1:]], asked)[1].status == "fail"
    fewer = replace(plates[0], to_part=plates[0].to_part[1:])
    assert check_table([fewer, *plates[1:]], asked)[1].status == "fail"
    mesh = plates[0].mesh
    torn = replace(plates[0], mesh=Mesh(mesh.vertices, mesh.faces[1:]))
    assert check_table([torn, *plates[1:]], asked)[0].status == "fail"
    small = scene.printer.model_copy(update={"build_volume_mm": (100.0, 100.0, 100.0)})
    tight = scene.model_copy(update={"printer": small}).model_dump(by_alias=True, mode="json")
    assert check_table(plates, parse_scene(tight))[0].status == "fail"
