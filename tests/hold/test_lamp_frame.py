"""The frame for several lamps: its bars and joints, where it has lamps and screen, what is rejected."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pieces import lit_scene

from knotfab.base.errors import MachineError
from knotfab.hold import modeller
from knotfab.hold.lamp_frame import Table, frame_or_reason, plan_table
from knotfab.hold.modeller import keep_modeller, model_fixture
from knotfab_fixtures.holders import eyelet
from knotfab_fixtures.solids import HEAD_MM, TAIL_DEPTH_MM, peg, table_bar
from knotfab_formats.piece import FramePlate
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
        return frame_or_reason(SimpleNamespace(scene=asked, wall=None, stand=None, hang=None))  # type: ignore[arg-type]

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
    listed = tuple(
        FramePlate(file=s.name, matrices=[m.tolist() for m in s.to_scene], bars=tuple(s.bars))
        for s in table.sheets
    )
    scene = scene.model_copy(update={"lamps": scene.lamps.but(table=listed)})
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
        ("table_bars", "pass", True),
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
        assert check_table(plates, parse_scene(other))[2].status == "fail"
    moved = plates[0].to_part.copy()
    moved[:, :3, 3] += 2.0
    raised = plates[0].to_part.copy()
    raised[:, 1, 3] += 60.0
    dark = check_table([replace(p, to_part=raised) for p in plates[:1]], asked)[3]
    assert dark.status == "fail" and dark.required
    assert check_table([replace(plates[0], to_part=moved), *plates[1:]], asked)[2].status == "fail"
    fewer = replace(plates[0], to_part=plates[0].to_part[1:])
    assert check_table([fewer, *plates[1:]], asked)[-1].status == "fail"
    mesh = plates[0].mesh
    torn = replace(plates[0], mesh=Mesh(mesh.vertices, mesh.faces[1:]))
    assert check_table([torn, *plates[1:]], asked)[0].status == "fail"
    small = scene.printer.model_copy(update={"build_volume_mm": (100.0, 100.0, 100.0)})
    tight = scene.model_copy(update={"printer": small}).model_dump(by_alias=True, mode="json")
    assert check_table(plates, parse_scene(tight))[0].status == "fail"


# Solids come from a process that is started beside the search, and has gone when the block ends.


def _children() -> set[str]:
    return set(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


@pytest.mark.slow
def test_a_process_of_its_own_makes_the_same_solids() -> None:
    here = peg(40.0, 1.3, 2.1, root_radius_mm=3.0, sink_mm=0.1)
    ring = eyelet(4.0, 1.0)
    with keep_modeller(early=False):
        before = _children()
        for there, expected in (
            (model_fixture(peg, 40.0, 1.3, 2.1, root_radius_mm=3.0, sink_mm=np.float64(0.1)), here),
            (model_fixture(eyelet, 4.0, 1.0), ring),
        ):
            for array, same in zip(there, expected, strict=True):
                assert array.dtype == same.dtype
                np.testing.assert_array_equal(array, same)
        started = _children() - before
        assert len(started) == 1  # one for both
        with pytest.raises(ValueError, match="every size of a peg"):
            model_fixture(peg, -1.0, 1.3, 2.1)
    assert not _children() & started


@pytest.mark.slow
def test_the_maker_loads_no_modeller() -> None:
    script = (
        "import sys\nfrom knotfab.hold.modeller import keep_modeller, model_fixture\n"
        "from knotfab_fixtures.solids import peg\n"
        "with keep_modeller(True): model_fixture(peg, 9.0, 1.0, 1.0)\n"
        "print([name for name in ('cadquery', 'OCP') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "[]", "")


def test_without_one_it_is_modelled_here() -> None:
    here = model_fixture(lambda size: (size * np.eye(3), np.array([[0, 1, 2]])), 2.0)
    np.testing.assert_array_equal(here[0], 2 * np.eye(3))


def test_a_process_that_ends_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modeller, "_MODULE", "no_such_modeller")
    with (
        keep_modeller(early=True),
        pytest.raises(MachineError, match=r"exit code 1: .*no_such_modeller") as told,
    ):
        model_fixture(peg, 9.0, 1.0, 1.0)
    assert "--mount none" in str(told.value)


def test_nobody_asks_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    """No process starts where none is asked; and the block ends though it is still loading."""
    before = _children()
    with keep_modeller(early=False):
        assert _children() == before
    with keep_modeller(early=True):
        assert len(_children() - before) == 1
    assert _children() == before
