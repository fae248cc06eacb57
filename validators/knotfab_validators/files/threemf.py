"""Read the triangles of a 3MF file, a zip archive of which only the models are unpacked, in memory."""

from __future__ import annotations

import io
import re
import unicodedata
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from knotfab_formats.errors import short
from knotfab_validators.arrays import Array
from knotfab_validators.check import MOST_TRIANGLES, BadFile
from knotfab_validators.files.threemf_model import (
    MOST_PLACED,
    WHOLE,
    Model,
    Placed,
    Shape,
    parse_xml,
    read_model,
    read_relations,
)
from knotfab_validators.geometry.mesh import Corners

MOST_UNPACKED = 2_000_000_000  # bytes of all models together
SUSPICIOUS = 50_000_000  # bytes above which a high packing ratio is suspicious
MOST_RATIO = 50  # unpacked over packed size; meshes reach about 10
DEEPEST = 100  # the deepest nesting of components
BLOCK = 1 << 18
ENTRY = b"PK\x01\x02"  # the signature of each entry in the archive's directory
PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # the two methods that the standard allows
SETTINGS = (  # settings of PrusaSlicer (SuperSlicer), and of Bambu Studio and OrcaSlicer
    "metadata/slic3r_pe_model.config",
    "metadata/superslicer_model.config",
    "metadata/model_settings.config",
)
OWN = {"[content_types].xml", "_rels/.rels", "3d/3dmodel.model", "metadata/thumbnail.png"}
PNG = b"\x89PNG\r\n\x1a\n"
TYPED = re.compile(rb'Extension="(\w+)" ContentType="([^"]*)"')
MODEL_KIND = b"application/vnd.ms-package.3dmanufacturing-3dmodel+xml"
KINDS = {  # of content, that lib3mf names
    *(
        MODEL_KIND,
        b"application/vnd.openxmlformats-package.relationships+xml",
        b"image/png",
        b"image/jpeg",
    ),
    b"application/vnd.ms-package.3dmanufacturing-3dmodeltexture",
}
HARMLESS = (".model", ".rels", ".png", ".jpg", ".jpeg")  # entries of strangers that steer no slicer
GCODE = (".gcode", ".bgcode")
SET = re.compile(r'key="(\w+)" value="([^"]*)"|^[; ]*(\w+) = ([^\r\n]*)', re.MULTILINE)
NAMES = re.compile(
    r"name|version|matrix|source_\w+|extruder|volume_type|modifier|mesh_\w+|thumbnail\w*"
)
MOST_SAID = 3  # settings of an entry that are named
PRINTED = {"modelpart", "normal_part"}
NEGATIVE = {"negativevolume", "negative_part"}


def is_3mf(content: bytes) -> bool:
    return content[:4] == b"PK\x03\x04"


def corners_3mf(
    content: bytes, name: str, notes: list[str] | None = None, *, strict: bool = False
) -> Corners:
    """Return the corners (m, 3, 3), mm, of all faces that the build items print, in the file's order.

    Support objects, items that are not printable and the modifiers of a slicer's project are left out;
    `notes` gets a sentence that says so.

    `strict` refuses what a build does not write and slicers obey, or read in different ways: entries other
    than its own, all that is left out, and XML that some take for more or for less than the standard does.

    Nothing is unpacked to disk, and the triangles that items and components place are counted before any
    is made. The faces of what a transform mirrors, which the standard forbids, are turned back.

    Raises:
        BadFile: the archive is damaged, unpacks to far more than a mesh would, or is not a 3MF; the
            message says what is wrong.
    """
    try:
        with _open(content, name) as archive:
            package = _Package(archive, len(content), name)
            found = package.corners()
            if strict and (doubts := package.tell_doubts()):
                raise BadFile(f"{name}: {doubts}, and no build writes that: build it anew")
            if notes is not None and (settings := package.tell_settings(foreign=True)):
                notes.append(f"{name}: {'; '.join(settings)}: not checked, and slicers obey it")
            if package.left_out and notes is not None:
                notes.append(f"{name}: {package.tell_left_out()}")
            if package.mirrored and notes is not None:
                notes.append(
                    f"{name}: mirrored an object, as its build asks for, faces turned back"
                )
            return found
    except (zipfile.BadZipFile, zlib.error, OSError, RuntimeError, EOFError,
            NotImplementedError, ValueError) as error:  # fmt: skip
        if isinstance(error, BadFile):
            raise
        raise BadFile(f"{name}: is not a 3MF file, or is damaged ({short(error)})") from error


def _open(content: bytes, name: str) -> zipfile.ZipFile:
    """Open the archive; too many entries, equal names, and names that lead out of it are refused."""
    if (entries := content.count(ENTRY)) > 10_000:  # each entry costs a kilobyte once it is parsed
        raise BadFile(f"{name}: has some {entries} entries, too many for a 3MF")
    archive = zipfile.ZipFile(io.BytesIO(content))
    seen: set[str] = set()
    for entry in archive.filelist:
        key = _plain(entry.filename)
        steps = entry.filename.replace("\\", "/").split("/")
        if ".." in steps or steps[0] == "" or ":" in steps[0]:
            raise BadFile(f"{name}: has an entry whose name leads elsewhere, {short(key)}")
        if key in seen:
            raise BadFile(f"{name}: has two entries of the name {short(key)}")
        seen.add(key)
    return archive


class _Package:
    """The models of an archive, read on demand."""

    def __init__(self, archive: zipfile.ZipFile, packed: int, name: str) -> None:
        self.archive, self.packed, self.name = archive, packed, name
        self.entries = {
            key: entry
            for entry in archive.filelist
            if not (key := _plain(entry.filename)).startswith("__macosx/")
            and not key.rpartition("/")[2].startswith(("._", ".ds_store"))
        }
        self.models: dict[str, Model] = {}
        self.unpacked = 0
        self.cost: dict[tuple[str, int], tuple[int, int]] = {}
        self.left_out: list[str] = []
        self.doubts: list[str] = []
        self.mirrored = False  # whether an item or a component is
        self.steering = _Steering()
        self._require_plausible(sum(entry.file_size for entry in archive.filelist))

    def corners(self) -> Corners:
        inside = next(
            (e.removesuffix("_rels/.rels") for e in self.entries if e.endswith("/_rels/.rels")), ""
        )
        if inside and "_rels/.rels" not in self.entries:
            raise BadFile(
                f"{self.name}: its files lie in the folder {short(inside)} of the archive: zip what is in it"
            )
        models = read_relations(self._blocks("_rels/.rels"), self.name, self.doubts)
        if len(models) != 1:
            count = f"{len(models)} models" if models else "no model"
            raise BadFile(f"{self.name}: is not a 3MF file: it names {count} to start from")
        start = _part(models[0], "")
        for entry in self.entries:
            if entry.endswith(".rels") and entry != "_rels/.rels":
                read_relations(self._blocks(entry), self.name, self.doubts)
        model = self._model(start)
        gcode = [short(e.rpartition("/")[2]) for e in self.entries if e.endswith(GCODE)]
        if gcode and not model.items:
            raise BadFile(
                f"{self.name}: it holds only G-code ({gcode[0]}): save the slicer's project instead"
            )
        for entry in SETTINGS:
            if entry in self.entries:
                self.steering = _read_steering(self._blocks(entry), self.name)
        triangles = placed = 0
        for item in model.items:
            more = self._cost(_part(item.part, start), item.number, 0)
            triangles, placed = triangles + more[0], placed + more[1]
            self._require_few(triangles, placed)
        self._require_all_read()
        parts: list[Corners] = [np.empty((0, 3, 3))]
        # a number that overflowed to infinity is refused as too far
        with np.errstate(over="ignore", invalid="ignore"):
            for item in model.items:
                part = _part(item.part, start)
                if self._shape(part, item.number).kind == "other":
                    raise BadFile(
                        f"{self.name}: builds an object of the type other, which 3MF forbids"
                    )
                if item.printed:
                    self._place_object(part, item, np.eye(4) * model.unit_mm, parts)
                else:
                    self.left_out.append("an item that is not printable")
        self.left_out += [f"a body that is a {kind}" for kind in self.steering.kinds]
        if model.items and self.left_out and not sum(map(len, parts)):
            raise BadFile(f"{self.name}: nothing of it is printed: {self.tell_left_out()}")
        return np.concatenate(parts)

    def _require_all_read(self) -> None:
        """Refuse models that no build item places: PrusaSlicer loads every one in the archive."""
        for entry in self.entries:
            if entry.endswith(".model") and entry not in self.models:
                raise BadFile(
                    f"{self.name}: has a model that its build does not place, {short(entry)}, and some "
                    "slicers would print it: take it out"
                )

    def tell_doubts(self) -> str:
        """Say what some slicers would print in another way; "" if all print the same."""
        found = [self.tell_left_out()] if self.left_out else []
        found += [f"has {what}" for what in (*self.doubts, *self._doubt_archive())]
        found += [f"has {what}" for model in self.models.values() for what in model.doubts]
        every = [(part, number) for part, model in self.models.items() for number in model.shapes]
        found += [f"has object {n}, which its build does not place"
                  for part, n in every if (part, n) not in self.cost]  # fmt: skip
        return "; ".join([*found, *self.tell_settings()])

    def _doubt_archive(self) -> Iterator[str]:
        """Say what other readers of the archive may take otherwise."""
        if self.archive.comment or min(e.header_offset for e in self.archive.filelist):
            yield "bytes before or behind its entries"
        types = b"".join(self._blocks("[content_types].xml"))
        if not {kind for _, kind in TYPED.findall(types)} <= KINDS or b"<Override" in types:
            yield "other types of content"
        elif (b"model", MODEL_KIND) not in TYPED.findall(types):
            yield "a model that is of another type of content"
        thumbnail = "metadata/thumbnail.png"
        if thumbnail in self.entries and next(self._blocks(thumbnail), b"")[:8] != PNG:
            yield "a thumbnail that is no PNG"

    def tell_settings(self, foreign: bool = False) -> list[str]:
        """Say which entries a build does not write, and their first settings; `foreign`: those with any."""
        found = []
        for key, entry in self.entries.items():
            if key in OWN or key.endswith("/") or (foreign and key.endswith(HARMLESS)):
                continue
            name, text = (
                short(entry.filename),
                next(self._blocks(key), b"").decode("utf-8", "replace"),
            )
            said = [(a or c, b or d) for a, b, c, d in SET.findall(text)]
            sets = [f"{short(k)} to {short(v)}" for k, v in said if not NAMES.fullmatch(k)]
            if sets:
                found.append(f"{name} sets {', '.join(sets[:MOST_SAID])}")
            elif not foreign:
                found.append(f"has {name}")
        return found

    def tell_left_out(self) -> str:
        """Say which objects of the file are not printed."""
        count = Counter(self.left_out)
        return "left out " + ", ".join(
            f"{what} ({n} times)" if n > 1 else what for what, n in count.items()
        )

    def _blocks(self, part: str) -> Iterator[bytes]:
        """Yield an entry's bytes and count them; the sizes that an archive states prove nothing."""
        entry = self.entries.get(part)
        if entry is None:
            raise BadFile(f"{self.name}: is not a 3MF file: it has no {short(part)}")
        if entry.compress_type not in PACKINGS:
            raise BadFile(f"{self.name}: is packed in a way that 3MF does not allow")
        self._require_plausible(self.unpacked + entry.file_size)
        with self.archive.open(entry) as stream:
            while block := stream.read(BLOCK):
                self.unpacked += len(block)
                self._require_plausible(self.unpacked)
                yield block

    def _require_plausible(self, size: int) -> None:
        if size > MOST_UNPACKED or (size > SUSPICIOUS and size > MOST_RATIO * self.packed):
            raise BadFile(
                f"{self.name}: unpacks to more than {size // 10**6} MB from "
                f"{self.packed / 1e6:.3g} MB, which is no mesh"
            )

    def _model(self, part: str) -> Model:
        if part not in self.models:
            self.models[part] = read_model(self._blocks(part), self.name)
            units = {model.unit_mm for model in self.models.values()}
            if len(units) > 1:
                raise BadFile(f"{self.name}: its models are in different units")
        return self.models[part]

    def _shape(self, part: str, number: int) -> Shape:
        shape = self._model(part).shapes.get(number)
        if shape is None:
            raise BadFile(f"{self.name}: names object {number}, which is not there")
        return shape

    def _cost(self, part: str, number: int, depth: int) -> tuple[int, int]:
        """Count the triangles and placed objects of an object with all its components, each only once.

        Components that contain themselves are found by their depth.
        """
        if (known := self.cost.get((part, number))) is not None:
            return known
        if depth > DEEPEST:
            raise BadFile(
                f"{self.name}: its components are in each other, more than {DEEPEST} deep"
            )
        shape = self._shape(part, number)
        triangles, placed = len(shape.corners) // 3, 1
        for component in shape.components:
            more = self._cost(_part(component.part, part), component.number, depth + 1)
            triangles, placed = triangles + more[0], placed + more[1]
        self.cost[part, number] = triangles, placed
        return triangles, placed

    def _require_few(self, triangles: int, placed: int) -> None:
        if triangles > MOST_TRIANGLES:
            raise BadFile(f"{self.name}: its objects make more than {MOST_TRIANGLES} triangles")
        if placed > MOST_PLACED:
            raise BadFile(f"{self.name}: places more than {MOST_PLACED} objects")

    def _place_object(self, part: str, item: Placed, onto: Array, parts: list[Corners]) -> None:
        """Append the corners of an object and its components to `parts`; `onto` (4, 4) is applied last."""
        matrix = np.column_stack([item.matrix, [0.0, 0.0, 0.0, 1.0]]) @ onto
        shape = self._shape(part, item.number)
        if shape.kind in ("support", "solidsupport"):
            self.left_out.append("a support object")
            return
        if shape.steers:
            self.left_out.append(f"a body that is a {shape.steers}")
            return
        if len(shape.corners):
            moved = shape.vertices @ matrix[:3, :3] + matrix[3, :3]
            faces = shape.faces.copy()
            for first, last in self.steering.triangles.get(item.number, []):
                faces[first : last + 1] = -1
            placed = moved[faces[faces[:, 0] >= 0]]
            mirrors = bool(np.linalg.det(matrix[:3, :3]) < 0)
            self.mirrored |= mirrors  # its faces are inside out; slicers turn them back
            parts.append(placed[:, ::-1] if mirrors else placed)
        for component in shape.components:
            if (item.number, component.number) in self.steering.components:
                continue
            self._place_object(_part(component.part, part), component, matrix, parts)


def _plain(name: str) -> str:
    """Normalise an entry's name as slicers compare it: no case, no backslashes, no "." steps."""
    name = unicodedata.normalize("NFKC", name).replace("\\", "/").casefold()
    return "/".join(step for step in name.split("/") if step not in ("", "."))


def _part(path: str | None, here: str) -> str:
    """Resolve the name of a referenced entry, regardless of case; None stands for the referring part."""
    return here if path is None else _plain(path)


@dataclass
class _Steering:
    """Bodies that are not printed: ranges of an object's triangles, or some of its components."""

    triangles: dict[int, list[tuple[int, int]]] = field(default_factory=dict)
    components: set[tuple[int, int]] = field(default_factory=set)
    kinds: list[str] = field(default_factory=list)


def _read_steering(blocks: Iterable[bytes], name: str) -> _Steering:
    """Read from `SETTINGS` which bodies only steer the slicer, such as support blockers.

    Raises:
        BadFile: a body is negative, so that a slicer prints another shape than the file holds.
    """
    found = _Steering()
    at: dict[str, str] = {}  # attributes of the object, volume or part that is open

    def take(kind: str, owner: str, first: str, last: str | None) -> None:
        kind = kind.strip().lower()
        if kind in PRINTED or not all(WHOLE.fullmatch(n) for n in (owner, first, last or "0")):
            return
        if kind in NEGATIVE:
            raise BadFile(
                f"{name}: has a negative volume, which its slicer cuts out of the part: cut it there, and "
                "export the part as it is printed"
            )
        found.kinds.append(short(kind))
        if last is None:
            found.components.add((int(owner), int(first)))
        else:
            found.triangles.setdefault(int(owner), []).append((int(first), int(last)))

    def start(tag: str, given: dict[str, str]) -> None:
        if tag == "object":
            at["object"] = given.get("id", "")
        elif tag == "volume":
            at["first"], at["last"] = given.get("firstid", ""), given.get("lastid", "")
        elif tag == "part":
            take(
                given.get("subtype", "normal_part"), at.get("object", ""), given.get("id", ""), None
            )
        elif (
            tag == "metadata" and given.get("key") in ("volume_type", "modifier") and "first" in at
        ):
            kind = given.get("value", "")
            if given["key"] == "modifier":  # the key that older files use
                kind = "ModelPart" if kind == "0" else "ParameterModifier"
            take(kind, at.get("object", ""), at["first"], at["last"])

    def end(tag: str) -> None:
        if tag == "volume":
            at.pop("first", None)

    parse_xml(blocks, name, start, end, lambda prefix, uri: None)
    return found
