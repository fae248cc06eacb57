"""Honest variations of a written piece: meshed, ordered, rounded or saved in another way."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from knotfab.geometry.tube import as_manifold, as_mesh
from knotfab.part.plates import clean_body
from knotfab_validators.files.mesh import read_mesh

from .files import encode
from .parts import Body

Vary = Callable[[Path], None]


def _body(folder: Path) -> Body:
    mesh = read_mesh(folder / "part.stl")
    return Body(mesh.vertices, mesh.faces)


def _write(folder: Path, body: Body, form: str = "stl", beside: str = "3mf") -> None:
    """Write a body for part.stl, or in its place, and as the 3MF beside it."""
    (folder / "part.stl").unlink()
    scale = 1 / 25.4 if beside.endswith("inch") else 1.0
    (folder / "part.3mf").write_bytes(encode(Body(scale * body.vertices, body.faces), beside))
    (folder / f"part.{form.partition('-')[0]}").write_bytes(encode(body, form))


def _reorder(folder: Path) -> None:
    rng, body = np.random.default_rng(3), _body(folder)
    order = rng.permutation(len(body.vertices))
    faces = np.argsort(order)[body.faces[rng.permutation(len(body.faces))]]
    turned = (np.arange(3) + rng.integers(0, 3, (len(faces), 1))) % 3
    _write(folder, Body(body.vertices[order], np.take_along_axis(faces, turned, axis=1)))


def _remesh(folder: Path, refined: int = 1, within_mm: float = 0.0) -> None:
    """Split every edge into as many, or take out what lies within so much of a plane."""
    body = _body(folder)
    solids = as_manifold((body.vertices, body.faces.astype(np.int32)))
    solid = solids.refine(refined) if refined > 1 else solids.simplify(within_mm)
    vertices, faces = clean_body(as_mesh(solid)) if within_mm else as_mesh(solid)
    _write(folder, Body(vertices.astype(np.float32).astype(float), faces.astype(np.int64)))


def _by_trimesh(folder: Path) -> None:
    import trimesh

    trimesh.load_mesh(folder / "part.stl").export(folder / "part.stl")


def _by_lib3mf(folder: Path) -> None:
    import lib3mf

    model = lib3mf.get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(folder / "part.3mf"))
    model.QueryWriter("3mf").WriteToFile(str(folder / "part.3mf"))


def _save(form: str, beside: str = "3mf") -> Vary:
    return lambda folder: _write(folder, _body(folder), form, beside)


VARIATIONS: dict[str, Vary] = {
    "reordered": _reorder,
    "refined": lambda folder: _remesh(folder, refined=2),
    "decimated": lambda folder: _remesh(folder, within_mm=0.008),
    "text": _save("stl-text"),
    "OBJ": _save("obj"),
    "PLY": _save("ply-binary"),
    "3MF in inches": _save("stl", "3mf-inch"),
    "STL by trimesh": _by_trimesh,
    "3MF by lib3mf": _by_lib3mf,
}


def write_variation(name: str, written: Path, folder: Path) -> tuple[Path, Path, Path]:
    """Copy a written piece to a folder and vary it; return its part, knots and scene."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(written, folder)
    VARIATIONS[name](folder)
    (part,) = [p for p in folder.glob("part.*") if p.suffix in (".stl", ".obj", ".ply")]
    return part, folder / "knots.json", folder / "scene.toml"
