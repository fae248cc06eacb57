"""scene.toml is read with the documented defaults, and impossible values are refused."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from knotfab_validators.files.bad_file import BadFile
from knotfab_validators.files.scene import parse_scene, read_scene

CONVENTIONS = Path(__file__).parents[3] / "docs" / "conventions.md"


def documented() -> dict[str, object]:
    found = re.search(r"```toml\n(.*?)```", CONVENTIONS.read_text(encoding="utf-8"), re.DOTALL)
    assert found
    return tomllib.loads(found.group(1))


def test_an_empty_scene_has_the_documented_defaults() -> None:
    said, empty = parse_scene(documented()), parse_scene({})
    assert empty.piece == said.piece and empty.region == said.region
    assert empty.material == said.material and empty.printer == said.printer
    assert empty.accuracy == said.accuracy
    assert empty.pose is None and said.pose is not None
    (view,), (plain,) = said.views, empty.views
    assert view.light_distance_mm == plain.light_distance_mm == 500
    assert view.wall_distance_mm == plain.wall_distance_mm == 100
    assert view.frame_width_mm == 180 and plain.frame_width_mm is None
    assert view.picture == "front.png" and plain.picture == ""


def test_values_are_read(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(
        "schema = 1\n[piece]\ntube_radius_mm = 2.5\n[region]\nkind = 'sphere'\n"
        "center_mm = [1, 2, 3]\nsize_mm = [50, 50, 50]\n[material]\nmin_bend_radius_mm = 4\n"
        "[printer]\nbuild_volume_mm = [100, 90, 80]\n"
        "[[views]]\nname='a'\nazimuth_deg = 90\n[[views]]\nname='b'\nkind='eye'\n"
        "[pose]\nmatrix = [[0,1,0,5],[-1,0,0,6],[0,0,1,7],[0,0,0,1]]\n"
    )
    scene = read_scene(tmp_path / "scene.toml")
    assert scene.piece.tube_radius_mm == 2.5
    assert scene.region.kind == "sphere" and scene.region.center_mm == (1, 2, 3)
    assert scene.region.size_mm == (50, 50, 50) and scene.material.min_bend_radius_mm == 4
    assert scene.printer.build_volume_mm == (100, 90, 80)
    assert [v.name for v in scene.views] == ["a", "b"] and scene.views[0].azimuth_deg == 90
    assert scene.pose is not None and scene.pose[1] == (-1, 0, 0, 6)


def test_auto_is_left_open() -> None:
    scene = parse_scene(
        {
            "piece": {"tube_radius_mm": "auto"},
            "region": {"size_mm": "auto"},
            "material": {"min_bend_radius_mm": "auto"},
            "accuracy": {"iou_floor": "auto"},
        }
    )
    assert scene.piece.tube_radius_mm is None and scene.region.size_mm is None
    assert scene.material.min_bend_radius_mm is None and scene.accuracy.iou_floor is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("schema = 2", "schema"),
        ("piece = 3", r"\[piece\] must be a table"),
        ("[piece]\ntube_radius_mm = -1", "tube_radius_mm"),
        ("[piece]\ntube_radius_mm = '2 mm'", "tube_radius_mm"),
        ("[piece]\nclearance_mm = nan", "clearance_mm"),
        ("[piece]\nclearance_mm = true", "clearance_mm"),
        ("[region]\nkind = 'cone'", "kind must be one of box"),
        ("[region]\nsize_mm = [1, 2]", "three numbers"),
        ("[region]\nsize_mm = [1, 2, 0]", "size_mm"),
        ("[printer]\nbuild_volume_mm = 'auto'", "three numbers"),
        ("views = []", "at least one view"),
        ("[[views]]\nlight_distance_mm = 0", "light_distance_mm"),
        ("[pose]\nmatrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0]]", "4 rows"),
        ("[pose]\nmatrix = 'none'", "4 rows"),
        ("[pose]\nmatrix = [[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "rigid"),
        ("[pose]\nmatrix = [[-1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "rigid"),
        ("[pose", "not TOML"),
    ],
)
def test_impossible_values_are_refused(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(BadFile, match=says):
        read_scene(tmp_path / "scene.toml")


def test_a_missing_scene_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match="cannot be read"):
        read_scene(tmp_path / "none.toml")
