"""Forged pieces, each with one fault that a person would not see and that must be rejected; honest ones."""

import json
import re
import shutil
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import tomli_w

from knotfab.geometry.tube import as_manifold, as_mesh
from knotfab.part.assemble import clean_body
from knotfab_formats.verdict import HELD, KNOTS, MESH, PRINTING, SHADOWS, TABLE, TUBE, UPRIGHT
from knotfab_validators import validate
from knotfab_validators.files.mesh import read_mesh

from .curves import Array
from .files import encode
from .forged_frames import of_arches, of_frame
from .forged_members import of_dowels, of_eyelet, of_lists, of_member
from .forging import HOLDERS, Forge, Held, ball, box, hull_of, rod, span_of
from .parts import Body


@dataclass(frozen=True)
class Forged:
    """One fault on a holder (of `forging.HOLDERS`), which some required check must find, or words tell.

    `of` is what it changes, one of `SKIPPED`.
    """

    holder: str
    name: str
    forge: Forge
    of: str = "solid"


def forged() -> list[Forged]:
    """Return all forgeries of solids and of what knots.json and scene.toml say."""
    tables: dict[str, list[Iterator[tuple[str, Forge]]]] = {
        "wall pegs": [of_member(0), of_lists("members"), of_wall_plate()],
        "drilled holes": [of_member(1), of_lists("members", "hulls"), of_dowels()],
        "stand": [of_member(0), of_member(-1), of_lists("members", "hulls"), of_base()],
        "hang": [of_member(0), of_lists("members", "rods"), of_eyelet()], "full plate": [of_foot_plate()],
        "outline plate": [of_foot_plate()], "lamp frame": [of_frame()], "no supports": [of_arches()],
    }  # fmt: skip
    return [
        Forged(holder, name, forge)
        for holder, parts in tables.items()
        for part in parts
        for name, forge in part
    ]


QUICK = {*SHADOWS, *PRINTING, *KNOTS, "clearance", "region", "build_volume"}
BESIDE = {*MESH, *TUBE, *KNOTS, *PRINTING, *UPRIGHT, *HELD, *TABLE, *SHADOWS}
# what is left out in turn, the next where nothing is found yet; shadows tell scenes only: geometry alone
# decides about solids, and rings are no picture that is recognised
SKIPPED: dict[str, tuple[set[str], ...]] = {
    "solid": (QUICK, {*SHADOWS}),
    "files": (BESIDE,),
    "scene": (BESIDE, QUICK, {"shadow-render", "recognisable"}),
}
LAXER = re.compile(r"asks for less than [^;.]*: (.*?)[;.] |accepts any shadow")


def judge(folder: Path, skipped: Sequence[set[str]] = ({*SHADOWS},)) -> tuple[str, ...]:
    """Validate a folder; return the required checks that fail, or the sentence that refuses or doubts it."""
    files = folder / "part.stl", folder / "knots.json", folder / "scene.toml"
    try:
        for skip in skipped:
            verdict = validate(*files, skip=skip)
            failed = tuple(c.name for c in verdict.checks if c.required and c.status != "pass")
            failed = tuple(name for name in failed if name not in skip)
            if failed:
                return failed
            if said := LAXER.search(verdict.conclusion):
                return (f"says {said[1] or said[0]}",)
    except ValueError as error:
        return (str(error),)
    return ()


def judge_forged(case: Forged, held: Held, folder: Path) -> tuple[str, ...]:
    """Forge a copy of a piece, write it to a folder, and judge it."""
    own = held.copy()
    case.forge(own)
    own.write(folder)
    return judge(folder, SKIPPED[case.of])


def of_wall_plate() -> Iterator[tuple[str, Forge]]:
    """Forge the plate that pegs stand on, printed face up: from z = 0 to its thickness."""

    def foot(held: Held) -> Array:
        return np.array(held.knots["members"][0]["to"])

    def sides(held: Held) -> tuple[float, Array, Array]:
        low, high = span_of(held)
        return float(foot(held)[2]), low, high

    def groove(held: Held, from_back: bool, left: float, x: float = 0.3) -> None:
        thick, low, high = sides(held)
        middle = (low + high) / 2
        middle[0] = low[0] + x * (high - low)[0]
        middle[2] = (thick - left) / 2 if from_back else thick - (thick - left) / 2
        held.cut(box(middle, (2.0, 2 * (high - low)[1], thick - left)))

    def saw(held: Held) -> None:
        thick, low, high = sides(held)
        middle = (low + high) / 2 + [20.0, 25.0, 0.0]
        held.cut(box(middle * [1, 1, 0] + [0, 0, thick / 2], (0.3, 60.0, 2 * thick)))

    def hollow(held: Held) -> None:
        thick, low, high = sides(held)
        middle = (low + high) / 2 * [1, 1, 0] + [0, 0, thick / 2]
        held.cut(box(middle, (40.0, 40.0, thick - 1.0)))

    def under(held: Held, size: float) -> None:
        at = foot(held)
        held.cut(box(at * [1, 1, 0.4], (size, size, 0.6)))

    def drill(held: Held, at: tuple[float, float], wide: float) -> None:
        _, low, high = sides(held)
        x, y = low[:2] + np.array(at) * (high - low)[:2]
        held.cut(rod(np.array([x, y, -1.0]), np.array([x, y, 9.0]), wide / 2))

    def trim(held: Held, normal: Array, share: float) -> None:
        low, high = span_of(held)
        (whole,) = held.bodies
        plate = whole.trim_by_plane((0.0, 0.0, -1.0), -float(foot(held)[2]))
        rest = whole.trim_by_plane((0.0, 0.0, 1.0), float(foot(held)[2]))
        at = float(np.where(normal > 0, low, high) @ normal + share)
        held.bodies = [plate.trim_by_plane(tuple(normal), at) + rest]

    def screw(held: Held) -> None:
        _, low, high = sides(held)
        drill(held, (5.0 / float((high - low)[0]), 0.5), 8.0)

    def post(held: Held) -> None:
        thick, low, high = sides(held)
        at = (low + high) / 2 * [1, 1, 0] + [12.0, 9.0, thick - 0.5]
        held.add(rod(at, at + [0.0, 0.0, 4.0], 1.0))

    x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    yield "a post on the plate", post
    yield "plate grooved from behind", partial(groove, from_back=True, left=0.5)
    yield "plate grooved in its face", partial(groove, from_back=False, left=2.7, x=0.6)
    yield "plate sawn", saw
    yield "plate hollow", hollow
    yield "void under a peg", partial(under, size=4.0)
    yield "small void under a peg", partial(under, size=0.8)
    yield "pinhole in the plate", partial(drill, at=(0.4, 0.35), wide=0.5)
    yield "third screw hole", partial(drill, at=(0.5, 0.9), wide=4.0)
    yield "screw hole too wide", screw
    yield "plate narrower", partial(trim, normal=x, share=3.0)
    yield "plate thinner", partial(trim, normal=z, share=0.5)


def of_base() -> Iterator[tuple[str, Forge]]:
    """Forge the base of a stand, printed as it stands: from z = 0 up."""

    def foot(held: Held) -> Array:
        return np.array(held.knots["members"][0]["to"])

    def ends(held: Held) -> tuple[Array, Array]:
        corners = np.array(held.knots["hulls"][0]["corners"])
        return corners.min(axis=0), corners.max(axis=0)

    def groove(held: Held, deep: float) -> None:
        low, high = ends(held)
        at = (low + high) / 2 * [1, 1, 0] + low * [0, 0, 1]
        held.cut(box(at + [4.0, 0, 0], (1.5, 999.0, 2 * deep)))

    def corner(held: Held) -> None:
        low, _ = ends(held)
        held.cut(box(low, (12.0, 12.0, 90.0)))

    def shrink(held: Held, share: float) -> None:
        one = held.knots["hulls"][0]
        corners = np.array(one["corners"])
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        small = {**one, "corners": (middle + (corners - middle) * [share, share, 1.0]).tolist()}
        held.cut(hull_of(one) - hull_of(small))
        one["corners"] = small["corners"]

    def slab(held: Held) -> None:
        low, high = ends(held)
        at = (low + high) / 2
        held.cut(box([at[0], at[1], low[2] + 1.2], (*(0.7 * (high - low)[:2]), 0.5)))

    def pinhole(held: Held) -> None:
        at = foot(held) * [1, 1, 0] + [9.0, 1.0, 0.0]
        held.cut(rod(at - [0, 0, 1.0], at + [0, 0, 30.0], 0.3))

    yield "base grooved from below", partial(groove, deep=2.0)
    yield "base scratched from below", partial(groove, deep=0.4)
    yield "base hollow", slab
    yield "base without a corner", corner
    yield "void under a post", lambda held: held.cut(ball(foot(held) - [0, 0, 1.6], 0.8))
    yield "pinhole in the base", pinhole
    yield "base smaller in all files", partial(shrink, share=0.3)


def of_foot_plate() -> Iterator[tuple[str, Forge]]:
    """Forge the plate in which a piece stands by its valleys, printed face up."""

    def slab(held: Held) -> tuple[Array, Array, float]:
        plate = held.knots["plate"]
        outline = np.array(plate["outline"])
        return outline, outline.mean(axis=0), float(plate["thickness_mm"])

    def groove(held: Held, deep: float, behind: bool) -> None:
        _, middle, thick = slab(held)
        z = middle[2] - (thick if behind else 0.0)
        held.cut(box([middle[0] + 8.0, middle[1], z], (1.0, 999.0, 2 * deep)))

    def drill(held: Held, wide: float, listed: bool) -> None:
        _, middle, thick = slab(held)
        at = np.array([middle[0] + 14.0, middle[1] + 12.0, middle[2]])
        held.cut(rod(at - [0, 0, 2 * thick], at + [0, 0, 0.01], wide / 2))
        if listed:
            held.knots["plate"]["holes"].append(at.tolist())

    def thin(held: Held, by: float, listed: bool) -> None:
        _, middle, thick = slab(held)
        held.cut(box([middle[0], middle[1], middle[2] - thick], (999.0, 999.0, 2 * by)))
        if listed:
            held.knots["plate"]["thickness_mm"] -= by

    def void(held: Held, under_foot: bool) -> None:
        _, middle, thick = slab(held)
        at = middle.copy()
        if under_foot:
            points = np.array(held.knots["knots"][0]["points"])
            at = points[int(points[:, 2].argmin())].copy()
        at[2] = middle[2] - thick / 2
        held.cut(box(at, (2.0, 2.0, 0.5)))

    def smaller(held: Held, listed: bool) -> None:
        outline, middle, thick = slab(held)
        points = np.concatenate([k["points"] for k in held.knots["knots"]])
        foot = points[points[:, 2] < middle[2] + 2.0, 1].max()  # of the highest foot in the picture
        edge = float(foot) - 1.0
        held.cut(box([middle[0], edge + 50.0, middle[2] - thick / 2], (999.0, 100.0, thick + 0.02)))
        if listed:
            outline[:, 1] = np.minimum(outline[:, 1], edge)
            held.knots["plate"]["outline"] = outline.tolist()

    def letter(held: Held) -> None:
        _, middle, _ = slab(held)
        at = middle + [10.0, 10.0, 1.7]
        held.add(box(at, (5.0, 1.0, 3.6)), box(at, (1.0, 5.0, 3.6)))

    def narrow(held: Held) -> None:
        _, middle, thick = slab(held)
        for hole in held.knots["plate"]["holes"]:
            at = np.array([*hole[:2], middle[2]])
            ring = rod(at - [0, 0, thick], at, 2.2) - rod(
                at - [0, 0, 2 * thick], at + [0, 0, 1], 0.5
            )
            held.add(ring)

    yield "a letter on the plate", letter
    yield "screw holes of 1 mm", narrow
    yield "plate grooved from behind", partial(groove, deep=1.1, behind=True)
    yield "plate scratched", partial(groove, deep=0.2, behind=False)
    yield "pinhole in the plate", partial(drill, wide=0.6, listed=False)
    yield "a third hole that knots.json lists", partial(drill, wide=4.0, listed=True)
    yield "plate thinner", partial(thin, by=0.3, listed=False)
    yield "plate thinner in all files", partial(thin, by=0.9, listed=True)
    yield "void in the plate", partial(void, under_foot=False)
    yield "void under a foot", partial(void, under_foot=True)
    yield "plate smaller", partial(smaller, listed=False)
    yield "plate smaller in all files", partial(smaller, listed=True)
    yield "no plate in knots.json", lambda held: held.knots.pop("plate")


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


def _reorder(folder: Path, seed: int = 3) -> None:
    rng, body = np.random.default_rng(seed), _body(folder)
    order = rng.permutation(len(body.vertices))
    faces = np.argsort(order)[body.faces[rng.permutation(len(body.faces))]]
    turned = (np.arange(3) + rng.integers(0, 3, (len(faces), 1))) % 3
    _write(folder, Body(body.vertices[order], np.take_along_axis(faces, turned, axis=1)))


def _say_otherwise(folder: Path, seed: int) -> None:
    """Write knots.json and scene.toml with other spaces, orders and last digits; start rings elsewhere."""
    rng = np.random.default_rng(seed)
    knots = json.loads((folder / "knots.json").read_text())
    for knot in knots["knots"]:
        points = np.roll(np.round(knot["points"], 7), int(rng.integers(99)), axis=0)
        knot["points"] = points[:: rng.choice([1, -1])].tolist()
    (folder / "knots.json").write_text(json.dumps(knots, indent=int(rng.integers(5))))
    scene = tomllib.loads((folder / "scene.toml").read_text())
    (folder / "scene.toml").write_text("# again\n" + tomli_w.dumps(scene))
    lines = (folder / "slicer.ini").read_text().splitlines()
    shuffled = [lines[k].replace(" = ", "=") for k in rng.permutation(len(lines))]
    (folder / "slicer.ini").write_text("# generated\n" + "\r\n".join(shuffled))


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
    "reordered": _reorder, "refined": lambda folder: _remesh(folder, refined=2),
    "decimated": lambda folder: _remesh(folder, within_mm=0.008), "text": _save("stl-text"),
    "OBJ": _save("obj"), "PLY": _save("ply-binary"), "3MF in inches": _save("stl", "3mf-inch"),
    "STL by trimesh": _by_trimesh, "3MF by lib3mf": _by_lib3mf,
}  # fmt: skip


def _save_again(name: str, folder: Path, seed: int) -> None:
    """Save in another format, and say the rest otherwise."""
    _say_otherwise(folder, seed)
    VARIATIONS[name](folder)


def drawn_variations(seed: int, count: int) -> dict[str, dict[str, Vary]]:
    """Draw honest variations by holder and name; each kind comes on each holder in turn."""
    rng = np.random.default_rng(seed)
    ways: dict[str, Callable[..., None]] = {
        "reordered": _reorder,
        "decimated": lambda folder, seed: _remesh(folder, within_mm=0.001 * (1 + seed % 8)),
        "refined": lambda folder, seed: _remesh(folder, refined=2 + seed % 2),
        "said otherwise": _say_otherwise,
    }
    saved = ("text", "OBJ", "PLY", "3MF in inches", "STL by trimesh", "3MF by lib3mf")
    ways |= {name: partial(_save_again, name) for name in saved}
    found: dict[str, dict[str, Vary]] = {}
    for number in range(count):
        name = list(ways)[number % len(ways)]
        holder = list(HOLDERS)[number % len(HOLDERS)]
        own = partial(ways[name], seed=int(rng.integers(1 << 30)))
        found.setdefault(holder, {})[f"{name} ({seed}.{number})"] = own
    return found


def write_variation(vary: Vary, written: Path, folder: Path) -> tuple[Path, Path, Path]:
    """Copy a written piece to a folder and vary it; return its part, knots and scene."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(written, folder)
    vary(folder)
    (part,) = [p for p in folder.glob("part.*") if p.suffix in (".stl", ".obj", ".ply")]
    return part, folder / "knots.json", folder / "scene.toml"
