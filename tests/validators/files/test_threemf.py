"""A 3MF's components and transforms are placed as lib3mf places them, over several parts as well."""

from __future__ import annotations

import lib3mf
import numpy as np
import pytest

from knotfab_validators.check import MOST_TRIANGLES, BadFile
from knotfab_validators.files.threemf import DEEPEST, corners_3mf
from tests.corpus.cube_files import CORE, MESH, as_3mf, model

TURNED = "0.8 0.6 0 -0.6 0.8 0 0 0 1 3 -4 5"
STRETCHED = "2 0 0 0.5 1 0 0 0.25 1.5 7 8 -9"


def nest() -> str:
    """Two cubes in an object that is in another, each with a transform of its own."""
    pair = f'<component objectid="1" transform="{TURNED}"/><component objectid="1"/>'
    more = f'<component objectid="2" transform="{STRETCHED}"/><component objectid="1"/>'
    objects = [
        f'<object id="1" type="model">{MESH}</object>',
        f'<object id="2" type="model"><components>{pair}</components></object>',
        f'<object id="3" type="model"><components>{more}</components></object>',
    ]
    items = f'<item objectid="3" transform="{TURNED}"/><item objectid="1"/>'
    return model("".join(objects), items)


def by_lib3mf(content: bytes) -> np.ndarray:
    read = lib3mf.get_wrapper().CreateModel()
    read.QueryReader("3mf").ReadFromBuffer(content)
    objects, parts = read.MergeToModel().GetMeshObjects(), []
    while objects.MoveNext():
        body = objects.GetCurrentMeshObject()
        points = np.array([list(p.Coordinates) for p in body.GetVertices()])
        parts.append(points[np.array([list(t.Indices) for t in body.GetTriangleIndices()])])
    return np.concatenate(parts)


def test_components_within_components_are_placed_as_by_lib3mf() -> None:
    content = as_3mf(nest())
    ours = corners_3mf(content, "a.3mf")
    assert ours.shape == (48, 3, 3)
    np.testing.assert_allclose(ours, by_lib3mf(content), atol=1e-4)


def test_objects_may_lie_in_another_part_of_the_package() -> None:
    """Some slicers write them so (Production Extension)."""
    production = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
    part = model(f'<object id="7" type="model">{MESH}</object>', "")
    root = (
        f'<model xmlns="{CORE}" xmlns:p="{production}" requiredextensions="p"><resources>'
        '<object id="1"><components><component p:path="/3D/Objects/A.model" objectid="7" '
        'transform="1 0 0 0 1 0 0 0 1 5 0 0"/></components></object></resources>'
        '<build><item objectid="1"/></build></model>'
    )
    content = as_3mf(root, **{"3D/objects/a.model": part})
    corners = corners_3mf(content, "a.3mf")
    assert corners.shape == (12, 3, 3) and corners.max(axis=(0, 1)) == pytest.approx([25, 20, 20])
    with pytest.raises(BadFile, match="different units"):
        corners_3mf(as_3mf(root, **{"3D/objects/a.model": part.replace("millimeter", "inch")}), "")
    with pytest.raises(BadFile, match=r"has no 3d/objects/a\.model"):
        corners_3mf(as_3mf(root), "a.3mf")


def chain(levels: int) -> bytes:
    objects = [f'<object id="0">{MESH}</object>']
    for i in range(levels):
        inner = f'<components><component objectid="{i}"/></components>'
        objects.append(f'<object id="{i + 1}">{inner}</object>')
    return as_3mf(model("".join(objects), f'<item objectid="{levels}"/>'))


def test_components_may_be_in_each_other_up_to_a_limit() -> None:
    assert len(corners_3mf(chain(DEEPEST), "a.3mf")) == 12
    with pytest.raises(BadFile, match="in each other"):
        corners_3mf(chain(DEEPEST + 1), "a.3mf")


def test_triangles_are_counted_before_they_are_made() -> None:
    """The largest number that is allowed would be made: here the count alone is looked at."""
    rows = 2000
    mesh = MESH.replace(
        "</triangles>", '<triangle v1="0" v2="1" v3="2"/>' * (rows - 12) + "</triangles>"
    )
    most = MOST_TRIANGLES // rows
    items = '<item objectid="1"/>' * (most + 1)
    with pytest.raises(BadFile, match="more than 20000000 triangles"):
        corners_3mf(as_3mf(model(f'<object id="1">{mesh}</object>', items)), "a.3mf")


def test_points_are_in_single_precision_as_by_lib3mf() -> None:
    content = as_3mf(nest().replace("20.0", "20.123456789"))
    plain = as_3mf(
        model(
            f'<object id="1">{MESH.replace("20.0", "20.123456789")}</object>',
            '<item objectid="1"/>',
        )
    )
    assert np.array_equal(corners_3mf(plain, "a.3mf"), by_lib3mf(plain))
    np.testing.assert_allclose(corners_3mf(content, "a.3mf"), by_lib3mf(content), atol=1e-4)


def test_what_is_not_built_is_not_read_as_part_of_it() -> None:
    two = f'<object id="1">{MESH}</object><object id="2">{MESH}</object>'
    assert len(corners_3mf(as_3mf(model(two, '<item objectid="2"/>')), "a.3mf")) == 12


@pytest.mark.parametrize(
    "line", ['<!DOCTYPE m [<!ENTITY x SYSTEM "file:///dev/zero">]>', "<!DOCTYPE m>"]
)
def test_document_types_are_refused_before_they_do_anything(line: str) -> None:
    with pytest.raises(BadFile, match="document type"):
        corners_3mf(as_3mf(nest().replace("<model", f"{line}<model", 1)), "a.3mf")
