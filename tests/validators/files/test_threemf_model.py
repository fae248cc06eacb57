"""Rows of a 3MF that are read apart are those that expat would read, and nothing else is taken for one."""

from __future__ import annotations

import numpy as np
import pytest

from knotfab_validators.check import BadFile
from knotfab_validators.files import threemf_model
from knotfab_validators.files.threemf import corners_3mf
from knotfab_validators.files.threemf_model import Rows, cut_rows
from tests.corpus.cube_files import as_3mf, model

POINTS = np.random.default_rng(0).normal(0, 90, (40, 3))
FACES = np.random.default_rng(1).integers(0, 40, (2000, 3))


def mesh(
    point: str = '<vertex x="{}" y="{}" z="{}" />',
    face: str = '<triangle v1="{}" v2="{}" v3="{}"/>',
    digits: str = ".6f",
    space: str = "\n\t",
) -> str:
    points = [point.format(*(format(x, digits) for x in row)) for row in POINTS.tolist()]
    faces = [face.format(*row) for row in FACES.tolist()]
    inner = f"<vertices>{space}{space.join(points)}</vertices>"
    return f"<mesh>{inner}<triangles>{space.join(faces)}{space}</triangles></mesh>"


def package(content: str) -> bytes:
    return as_3mf(model(f'<object id="1">{content}</object>', '<item objectid="1"/>'))


def cut(content: str) -> dict[int, Rows]:
    return cut_rows(content.encode())[1]


def by_expat(content: bytes, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    monkeypatch.setattr(threemf_model, "cut_rows", lambda text: (text, {}))
    found = corners_3mf(content, "a.3mf")
    monkeypatch.undo()
    return found


WRITTEN = {
    "as lib3mf writes it": mesh(),
    "without spaces": mesh(space=""),
    "fifteen digits": mesh(digits=".11f"),
    "whole numbers": mesh(digits=".0f"),
    "more digits than a double has": mesh(digits=".17f"),
}
OTHERWISE = {
    "exponents": mesh(digits=".9e"),
    "other quotes": mesh(point="<vertex x='{}' y='{}' z='{}' />"),
    "another order": mesh(point='<vertex z="{}" y="{}" x="{}" />'),
    "an end tag": mesh(point='<vertex x="{}" y="{}" z="{}"></vertex>'),
    "a sign": mesh(point='<vertex x="+1" y="{}" z="{}" /><!-- {} -->'),
}


@pytest.mark.parametrize("name", [*WRITTEN, *OTHERWISE])
def test_corners_are_those_that_expat_reads(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    content = {**WRITTEN, **OTHERWISE}[name]
    kinds = {rows.kind for rows in cut(content).values()}
    assert kinds == ({"vertices", "triangles"} if name in WRITTEN else {"triangles"})
    found = corners_3mf(package(content), "a.3mf")
    assert found.shape == (2000, 3, 3)
    assert np.array_equal(found, by_expat(package(content), monkeypatch))


def test_rows_stand_where_their_tag_is_in_what_is_left() -> None:
    content = mesh().encode()
    rest, found = cut_rows(content + content)
    assert rest == b"<mesh><vertices></vertices><triangles></triangles></mesh>" * 2
    assert len(found) == 4
    for place, rows in found.items():
        assert rest[place:].startswith(f"<{rows.kind}>".encode())
        if rows.kind == "triangles":
            assert np.array_equal(rows.numbers, FACES)
        else:
            np.testing.assert_allclose(rows.numbers, POINTS, atol=5.1e-7, rtol=0)


@pytest.mark.parametrize("hidden", ["<!--{}-->", "<metadata><![CDATA[{}]]></metadata>"])
def test_what_is_no_element_is_not_read(hidden: str, monkeypatch: pytest.MonkeyPatch) -> None:
    content = package(hidden.format(mesh(digits=".0f")) + mesh())
    found = corners_3mf(content, "a.3mf")
    assert found.shape == (2000, 3, 3)
    assert np.array_equal(found, by_expat(content, monkeypatch))


@pytest.mark.parametrize(
    "row",
    [
        *('<vertex x="1" y="2"/>', '<vertex x="" y="1" z="2"/>', '<vertex x="1" y="2" z="a"/>'),
        *('<vertex x="1-2" y="" z="3"/>', '<vertex x="1.2.3" y="1" z="2"/>'),
        *(
            '<vertex x="1 2" y="3" z=""/>',
            '<vertex x="1 2" y=" " z="3"/>',
            '<vertex x1="" y="2" z="3"/>',
        ),
    ],
)
def test_a_row_that_is_no_three_numbers_is_refused_as_before(row: str) -> None:
    with pytest.raises(BadFile, match="not three numbers"):
        corners_3mf(package(mesh().replace("<vertices>", f"<vertices>{row}")), "a.3mf")


def test_a_file_larger_than_is_looked_at_at_once_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threemf_model, "MOST_AT_ONCE", 1000)
    content = package(mesh())
    assert np.array_equal(corners_3mf(content, "a.3mf"), by_expat(content, monkeypatch))
