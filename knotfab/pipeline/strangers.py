"""Read other programs' OBJ and PLY into the plain arrays that the validators measure; render a shadow.

VTK reads OBJ, since trimesh neither triangulates concave polygons nor takes negative indices. trimesh reads
PLY, since VTK rounds its numbers and crashes on damaged files. Both run in a child process.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.disk import read_file, temporary_folder
from knotfab.base.errors import MachineError
from knotfab.base.pool import Crash, Workers
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
MOST_CORNERS = 10_000  # of one face: the time to triangulate it grows with their square
COMMAS = "its numbers have decimal commas, such as 1,5: export it with decimal points"
LENGTH = (
    "it is cut off, or longer than its header says, or its faces have different numbers of corners, which "
    "a binary PLY may not have here"
)
PLY_TYPES = {
    **{b"char": "i1", b"uchar": "u1", b"short": "i2", b"ushort": "u2", b"int": "i4", b"uint": "u4"},
    **{b"int8": "i1", b"uint8": "u1", b"int16": "i2", b"uint16": "u2", b"int32": "i4"},
    **{b"uint32": "u4", b"float": "f4", b"double": "f8", b"float32": "f4", b"float64": "f8"},
}
HEADER_END = re.compile(rb"^end_header[ \t]*\r?\n", re.MULTILINE)
REMEDY = "Export it again, or as STL or 3MF."

OBJ = re.compile(
    rb"(?:\xef\xbb\xbf)?\s*(?:(?:#|mtllib\b|usemtl\b|[ogs]\b)[^\r\n]*[\r\n]\s*)*v\s+[-+.\d]"
)
# comments, continued lines, texture and normal indices: VTK crashes if the index of one is missing
SHAPELESS = re.compile(rb"#[^\r\n]*|\\\r?\n|(?<=\d)/[-\d/]*|\A\xef\xbb\xbf")
FIRST_WORD = re.compile(rb"^[ \t]*(\S+)", re.MULTILINE)
WORDS = frozenset(  # statements that VTK reads, and those that define no surface
    b"v f vt vn vp g s o mg l p usemtl mtllib usemap maplib bevel c_interp d_interp lod "
    b"shadow_obj trace_obj".split()
)
SURFACES = frozenset(  # free-form surfaces, which are not read and must not be dropped silently
    b"cstype deg bmat step curv curv2 surf parm trim hole scrv sp end con ctech stech call csh "
    b"bzp bsp cdc cdp res fo".split()
)
ELEMENT = re.compile(rb"^element[ \t]+(\S+)[ \t]+(\d+)", re.MULTILINE)


@contextmanager
def plain_arrays(part: Path | None, reader: Workers | None = None) -> Iterator[Path | None]:
    """Yield a part in a format that the validators read: OBJ and PLY as arrays in a temporary file.

    Args:
        reader: a worker of this module, if one is kept running.

    Raises:
        InputError: the file is damaged or cut off, or has surfaces that are not read.
    """
    kind = None if part is None or not part.is_file() else _kind_of(part)
    if part is None or kind is None:
        yield part
        return
    with temporary_folder("knotfab-part-") as folder, ExitStack() as kept:
        reader = reader or kept.enter_context(Workers(__name__))
        request = {"part": str(part.absolute()), "kind": kind, "folder": str(folder)}
        try:
            told = reader.answer(request)
        except Crash as crash:
            why = f"it is damaged: what reads it crashed ({crash.said or crash.code})"
            raise InputError(part.name, why, REMEDY) from None
        if "error" in told:
            raise InputError(part.name, told["error"], REMEDY)
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


def answer(request: dict[str, Any], told: object) -> dict[str, Any]:
    """Write a part's triangles (n, 3, 3) to an array file named like the part, or return why not."""
    del told
    part, folder = Path(request["part"]), Path(request["folder"])
    try:
        content = read_file(part, part.name, "part", MOST_BYTES)
        if request["kind"] == "ply":
            corners = _read_ply(content)
        else:
            corners = _read_obj(content, folder / "tidy.obj")
    except InputError as error:
        return {"error": error.why}
    with (folder / part.name).open("wb") as file:
        np.save(file, corners)
    return {}


def _read_ply(content: bytes) -> NDArray[np.float64]:
    """Read the triangles (n, 3, 3) of a PLY; polygons become fans. Checks the counts that trimesh ignores."""
    import trimesh

    content = content.removeprefix(b"\xef\xbb\xbf")
    ended = HEADER_END.search(content)
    head, body = (content[: ended.start()], content[ended.end() :]) if ended else (content, b"")
    elements = {name: int(count) for name, count in ELEMENT.findall(head)}
    if ended is None or len(head) > 100_000:  # bytes
        raise _refuse("its PLY header has no end")
    if b"tristrips" in elements:
        raise _refuse("it has strips of triangles, which are not read")
    ascii_lines: list[bytes] = []
    if b"\nformat ascii" in head:
        lines = [line for line in body.splitlines() if line.strip()]
        if len(lines) != sum(elements.values()):
            raise _refuse("it is cut off, or goes on after what its header promises")
        listed = re.search(rb"^element[ \t]+face.*\n[ \t]*property[ \t]+list", head, re.MULTILINE)
        ascii_lines = lines if listed else []
        content = b"\n".join([head + b"end_header", *lines, b""])
    elif (mixed := _read_mixed(head, body)) is not None:
        return mixed
    with warnings.catch_warnings(action="ignore"):
        warnings.simplefilter("error", DeprecationWarning)  # how old numpy reports NaN
        try:
            mesh: Any = trimesh.load_mesh(
                io.BytesIO(content), file_type="ply", process=False, skip_materials=True
            )
        except Exception as error:  # trimesh may raise anything
            long = "unexpected length" in str(error)
            raise _refuse(
                LENGTH if long else f"it is damaged, or cut off ({shown(error)})"
            ) from None
    points, faces = mesh.vertices, getattr(mesh, "faces", np.empty((0, 3), dtype=np.int64))
    _require_vertices(faces.ravel(), points)
    if ascii_lines and [*elements][:2] == [b"vertex", b"face"]:
        rows = ascii_lines[elements[b"vertex"] :][: elements[b"face"]]
        try:
            rings = [[int(w) for w in row.split()[1 : 1 + int(row.split()[0])]] for row in rows]
        except ValueError:  # a number with a point: as trimesh has it
            rings = []
        # trimesh makes fans of polygons, which are wrong where these are concave
        if any(len(ring) > 3 for ring in rings):
            return _triangulate(
                np.asarray(points, dtype=np.float64), [r for r in rings if len(r) > 2]
            )
    return np.asarray(points[faces], dtype=np.float64)


def _read_mixed(head: bytes, body: bytes) -> NDArray[np.float64] | None:
    """Read a binary PLY of vertices and polygons of any numbers of corners; None if it has anything else."""
    order = "<" if b"binary_little_endian" in head else ">"
    lines = [line.split() for line in head.splitlines() if line.strip()]
    elements: list[tuple[bytes, int, list[list[bytes]]]] = []
    for words in lines:
        if words[0] == b"element" and len(words) == 3 and words[2].isdigit():
            elements.append((words[1], int(words[2]), []))
        elif words[0] == b"property" and elements:
            elements[-1][2].append(words[1:])
    if [name for name, _, _ in elements] != [b"vertex", b"face"]:
        return None
    (_, count, columns), (_, faces, lists) = elements
    known = all(len(c) == 2 and c[0] in PLY_TYPES for c in columns)
    if not known or len(lists) != 1 or len(lists[0]) != 4 or lists[0][0] != b"list":
        return None
    if any(kind not in PLY_TYPES for kind in lists[0][1:3]):
        return None
    row = np.dtype([(c[1].decode("latin-1"), order + PLY_TYPES[c[0]]) for c in columns])
    size, index = (np.dtype(order + PLY_TYPES[kind]) for kind in lists[0][1:3])
    at = count * row.itemsize
    if not {"x", "y", "z"} <= set(row.names or ()) or at + faces * size.itemsize > len(body):
        return None
    vertices = np.frombuffer(body, row, count)
    points = np.stack([vertices[axis].astype(np.float64) for axis in "xyz"], axis=1)
    rings: list[list[int]] = []
    for _ in range(faces):
        sides = int(np.frombuffer(body, size, 1, at)[0]) if at + size.itemsize <= len(body) else -1
        at += size.itemsize
        if not 0 <= sides <= MOST_CORNERS or at + sides * index.itemsize > len(body):
            return None
        ring = np.frombuffer(body, index, sides, at).tolist()
        at += sides * index.itemsize
        rings += [ring] if sides > 2 else []
    if body[at:].strip(b"\r\n \0"):
        return None
    if all(len(ring) == 3 for ring in rings):
        chosen = np.array(rings, dtype=np.int64).reshape(-1, 3)
        _require_vertices(chosen.ravel(), points)
        return np.asarray(points[chosen])
    return _triangulate(points, rings)


def _read_obj(content: bytes, tidy: Path) -> NDArray[np.float64]:
    """Read the triangles (n, 3, 3) of an OBJ; polygons are triangulated, or fans if they cross themselves."""
    import pyvista

    text = SHAPELESS.sub(b" ", content)
    words = set(FIRST_WORD.findall(text))
    if curved := words & SURFACES:
        raise _refuse(f"it has curved surfaces ({_listed(curved)}), which are not read")
    if others := words - WORDS:
        raise _refuse(f"it has lines that no OBJ has: they begin with {_listed(others)}")
    tidy.write_bytes(text)
    try:
        with pyvista.VtkErrorCatcher(raise_errors=True):
            mesh = pyvista.OBJReader(str(tidy)).read()
    except RuntimeError as error:
        if re.search(rb"^\s*v\b[^\r\n]*\d,\d", text, re.MULTILINE):
            raise _refuse(COMMAS) from None
        said = re.findall(r"\): (.*)", str(error)) or [error]
        raise _refuse(f"it is damaged ({shown(said[0])})") from None
    points: Any = np.asarray(mesh.points, dtype=np.float64)
    if mesh.is_all_triangles:
        _require_vertices(mesh.regular_faces.ravel(), points)
        return np.asarray(points[mesh.regular_faces])
    if not (rings := mesh.irregular_faces):
        return np.empty((0, 3, 3))
    sides = np.array([len(ring) for ring in rings], dtype=np.int64)
    if sides.max(initial=0) > MOST_CORNERS:
        raise _refuse(f"it has a face of {sides.max()} corners, more than {MOST_CORNERS}")
    return _triangulate(points, rings)


def _triangulate(points: NDArray[np.float64], rings: Sequence[Any]) -> NDArray[np.float64]:
    """Cut polygons into triangles (n, 3, 3); those that cross themselves become fans."""
    import pyvista

    sides = np.array([len(ring) for ring in rings], dtype=np.int64)
    _require_vertices(np.concatenate(rings), points)
    listed = np.concatenate([np.append(len(ring), ring) for ring in rings])
    plain = pyvista.PolyData(points, faces=listed)
    plain.cell_data["ring"] = np.arange(len(rings))
    cut = plain.triangulate()
    whole = np.bincount(cut["ring"], minlength=len(rings)) == sides - 2
    fans = [
        (rings[k][0], b, c)
        for k in np.flatnonzero(~whole).tolist()
        for b, c in pairwise(rings[k][1:])
    ]
    kept = cut.regular_faces.reshape(-1, 3)[whole[cut["ring"]]]
    faces = np.concatenate([kept, np.array(fans, dtype=np.int64).reshape(-1, 3)])
    return np.asarray(points[faces])


def _require_vertices(numbers: NDArray[Any], points: NDArray[np.float64]) -> None:
    """Refuse indices without a vertex, and vertices that are not finite."""
    if not np.isfinite(points).all():
        raise _refuse("it has vertices whose coordinates are not finite")
    wrong = numbers[(numbers < 0) | (numbers >= len(points))]
    if len(wrong) and len(points):
        raise _refuse(f"a face names vertex {wrong[0]} (from 0), and there are {len(points)}")


def _refuse(why: str) -> InputError:
    return InputError("", why, REMEDY)


def _listed(words: set[bytes]) -> str:
    return ", ".join(shown(word.decode("latin-1")[:40]) for word in sorted(words)[:3])


def render_shadow(part: Path, scene: Path | None, out: Path, view_name: str | None = None) -> None:
    """Render the shadow that `part` casts in a view of `scene` (the first by default) to the PNG `out`.

    A folder stands for the part and scene of its build.

    Raises:
        InputError: a file cannot be read, there is no such view, or `out` cannot be written.
        MachineError: this machine cannot render.
    """
    from knotfab_validators.files.mesh import read_mesh
    from knotfab_validators.files.picture import read_silhouette
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
    part, scene = files.part, files.scene
    try:
        setting, mesh = read_scene(scene), read_mesh(part)
        named = [v for v in setting.views if view_name in (None, v.name)]
        if not named:
            names = ", ".join(v.name for v in setting.views)
            raise InputError(
                f"--view {view_name}", "the scene has no such view", f"It has: {names}"
            )
        height, width = read_silhouette(scene.parent / named[0].picture).shape
        pose = (
            np.eye(4) if setting.pose is None else np.asarray(setting.pose.matrix, dtype=np.float64)
        )
        vertices = setting.material.shrinks_to * mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        frame = working_frame(width, height)
        geometry = view_geometry(named[0], width, height).resample(frame)
        with SilhouetteRenderer(vertices, mesh.faces) as renderer:
            seen = renderer.render(geometry)
        write_shadow(out, seen, frame)
    except CannotRender as error:
        raise MachineError("rendering", error.reason, error.remedy) from error
    except ValueError as error:
        raise explain_unreadable(str(error)) from error
    except OSError as error:
        why = f"it cannot be written ({error.strerror or error})"
        raise InputError(str(out), why, "Choose another place for --out.") from error
