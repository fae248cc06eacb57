"""Read other programs' OBJ and PLY into the plain arrays that the validators measure; render a shadow.

trimesh reads them, in a copy of this process with limits.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.disk import read_file, temporary_folder
from knotfab.base.errors import MachineError
from knotfab.base.limited import run_limited
from knotfab.pipeline.verifier import (
    Files,
    Verifier,
    explain_unreadable,
    files_to_validate,
    load_early,
)
from knotfab_formats.errors import InputError, shown
from knotfab_formats.verdict import Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_BYTES = 2_000_000_000  # of a part
SECONDS, GIGABYTES = 300, 12.0  # limits on reading one
REMEDY = "Export it again, or as STL or 3MF."
_FOLDED = 1e-6  # radians from a fold at which the triangles of a polygon lie on each other

OBJ = re.compile(
    rb"(?:\xef\xbb\xbf)?\s*(?:(?:#|mtllib\b|usemtl\b|[ogs]\b)[^\r\n]*[\r\n]\s*)*v\s+[-+.\d]"
)
FACE = re.compile(rb"^[ \t]*f[ \t][^\r\n]*", re.MULTILINE)
# indices that trimesh takes from the whole file's end
RELATIVE = re.compile(rb"\s(?:-\d|0+(?:[/\s]|$))")
SURFACE = re.compile(  # free-form surfaces, and other files
    rb"^[ \t]*(cstype|deg|bmat|step|curv2?|surf|parm|trim|hole|scrv|sp|con|ctech|stech|call|csh|bzp|bsp|"
    rb"cdc|cdp|res|fo)\s",
    re.MULTILINE,
)
COMMA = re.compile(rb"^[ \t]*v\b[^\r\n]*\d,\d", re.MULTILINE)
ELEMENT = re.compile(rb"^element[ \t]+(\S+)[ \t]+(\d+)", re.MULTILINE)
HEADER_END = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE)


@contextmanager
def plain_arrays(part: Path | None) -> Iterator[Path | None]:
    """Yield a part in a format that the validators read: OBJ and PLY as arrays in a temporary file.

    Raises:
        InputError: the file is damaged or cut off, or has what is not read here.
    """
    kind = None if part is None or not part.is_file() else _kind_of(part)
    if part is None or kind is None:
        yield part
        return
    content = read_file(part, part.name, "part", MOST_BYTES).removeprefix(b"\xef\xbb\xbf")
    corners = run_limited(
        lambda: _read(content, kind, part.name),
        part.name,
        seconds=SECONDS,
        gigabytes=GIGABYTES,
        remedy=REMEDY,
    )
    with temporary_folder("knotfab-part-") as folder:
        with (folder / part.name).open("wb") as file:
            np.save(file, corners)
        yield folder / part.name


def validate_files(
    files: Files, skip: Collection[str] = (), unit: str = "mm", keep: bool = False
) -> Verdict:
    """Measure files of any program, by code that shares nothing with what wrote them.

    Args:
        skip: the checks to leave out.
        unit: of a part whose file has none.
        keep: keep the validators for the next call of this process.

    Raises:
        InputError: a file cannot be read, or written.
        MachineError: this machine cannot measure it.
    """
    with load_early(skip, keep), Verifier(skip) as verifier, plain_arrays(files.part) as read:
        return verifier.submit(replace(files, part=read), unit=unit).result()


def _kind_of(part: Path) -> str | None:
    """Return "ply" or "obj" by a file's content, or else its name; None for others."""
    with part.open("rb") as file:
        head = file.read(4096)
    if head.removeprefix(b"\xef\xbb\xbf")[:4] in (b"ply\n", b"ply\r"):
        return "ply"
    return "obj" if OBJ.match(head) or part.suffix.lower() == ".obj" else None


def _read(content: bytes, kind: str, name: str) -> NDArray[np.float64]:
    """Read the triangles (n, 3, 3) of an OBJ or PLY, and refuse what trimesh would read wrongly."""
    import trimesh

    if kind == "obj":
        content = content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
        why, faces = _doubt_obj(content)
    else:
        why, faces = _doubt_ply(content)
    if why:
        raise InputError(name, why, REMEDY)
    for text in dict.fromkeys((content, content.removesuffix(b"\n").removesuffix(b"\r"))):
        try:
            with warnings.catch_warnings(action="ignore"):
                mesh: Any = trimesh.load_mesh(
                    io.BytesIO(text), file_type=kind, process=False, skip_materials=True
                )
            break
        except Exception as error:  # trimesh may raise anything
            why = f"it is damaged, or has what is not read here ({shown(error)})"
    else:
        if "unexpected length" in why:
            why = "it is cut off, longer than its header says, or its faces have different numbers of corners"
        raise InputError(name, why, REMEDY)
    points, triangles = mesh.vertices, getattr(mesh, "faces", np.empty((0, 3), dtype=np.int64))
    if points.shape[1] != 3 or not np.isfinite(points).all():
        raise InputError(name, "it has vertices whose coordinates are not finite", REMEDY)
    wrong = triangles[(triangles < 0) | (triangles >= len(points))]
    if len(wrong):
        why = f"a face names vertex {wrong[0]} (from 0), and there are {len(points)}"
        raise InputError(name, why, REMEDY)
    corners = np.asarray(points[triangles], dtype=np.float64)
    if len(triangles) > faces and _is_folded(trimesh.Trimesh(points, triangles)):
        why = "it has polygons that are concave, which programs cut in different ways, or lie on each other"
        raise InputError(name, why, "Export it as triangles, or as STL or 3MF.")
    return corners


def _doubt_obj(content: bytes) -> tuple[str, int]:
    """Say what trimesh would read wrongly in an OBJ, or ""; also count its faces."""
    if curved := SURFACE.search(content):
        return f"it has curved surfaces ({shown(curved[1].decode())}), which are not read", 0
    if COMMA.search(content):
        return "its numbers have decimal commas, such as 1,5: export it with decimal points", 0
    faces = 0
    for face in FACE.finditer(content):
        faces += 1
        if RELATIVE.search(face[0]):
            return "its faces have an index value below 1, which counts back and is not read", 0
    return "", faces


def _doubt_ply(content: bytes) -> tuple[str, int]:
    """Say what trimesh would read wrongly in a PLY, or ""; also count its faces."""
    ended = HEADER_END.search(content)
    if ended is None or ended.start() > 100_000:  # bytes
        return "its PLY header has no end", 0
    head, body = content[: ended.start()], content[ended.end() :]
    elements = {name: int(count) for name, count in ELEMENT.findall(head)}
    if b"tristrips" in elements:
        return "it has strips of triangles, which are not read", 0
    lines = sum(1 for line in body.splitlines() if line.strip()) if b"\nformat ascii" in head else 0
    if b"\nformat ascii" in head and lines != sum(elements.values()):
        return "it is cut off, or goes on after what its header promises", 0
    return "", elements.get(b"face", 0)


def _is_folded(mesh: Any) -> bool:
    """Return whether triangles that share an edge lie on each other, as the fan of a concave polygon does."""
    return bool((mesh.face_adjacency_angles > np.pi - _FOLDED).any())


def render_shadow(part: Path, scene: Path | None, out: Path, view_name: str | None = None) -> None:
    """Render the shadow that `part` casts in a view of `scene` (the first by default) to the PNG `out`.

    A folder stands for the part and scene of its build.

    Raises:
        InputError: a file cannot be read, there is no such view, or `out` cannot be written.
        MachineError: this machine cannot render.
    """
    from knotfab.picture.read import read_target  # `validate` reads no picture
    from knotfab.scene.load import pick_view
    from knotfab_validators.files.mesh import read_mesh
    from knotfab_validators.files.scene import read_scene
    from knotfab_validators.shadows.frame import working_frame, write_shadow
    from knotfab_validators.shadows.render import CannotRender, SilhouetteRenderer
    from knotfab_validators.shadows.view import view_geometry

    if out.suffix.lower() != ".png":
        raise InputError(f"--out {out}", "the shadow is written as PNG", "Name a file in .png.")
    files = files_to_validate(part, None, scene)
    if files.part is None or files.scene is None:
        raise InputError(
            part.name, "its scene is not given, by which it is lit", "Name the scene.toml too."
        )
    own, lit_by = files.part, files.scene

    def render() -> tuple[NDArray[Any], Any]:
        setting, mesh = read_scene(lit_by), read_mesh(own)
        view = pick_view(setting.views, view_name)
        height, width = read_target(lit_by.parent / view.picture, view).mask.shape
        pose = (
            np.eye(4) if setting.pose is None else np.asarray(setting.pose.matrix, dtype=np.float64)
        )
        vertices = setting.material.shrinks_to * mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        frame = working_frame(width, height)
        geometry = view_geometry(view, width, height).resample(frame)
        with SilhouetteRenderer(vertices, mesh.faces) as renderer:
            return renderer.render(geometry), frame

    try:
        seen, frame = run_limited(
            render,
            own.name,
            seconds=SECONDS,
            gigabytes=GIGABYTES,
            verb="rendering it",
            remedy=REMEDY,
        )
        write_shadow(out, seen, frame)
    except CannotRender as error:
        raise MachineError("rendering", error.reason, error.remedy) from error
    except ValueError as error:
        raise explain_unreadable(str(error)) from error
    except OSError as error:
        why = f"it cannot be written ({error.strerror or error})"
        raise InputError(str(out), why, "Choose another place for --out.") from error
