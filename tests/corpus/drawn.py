"""Forgeries drawn by a seed: each holder by each kind of edit, where and how large by chance."""

import re
from collections.abc import Callable, Mapping
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from knotfab_validators.tube.mount_members import PLATE_HOLES

from .curves import Array
from .files import rewrite_archive
from .forged import Forged
from .forging import (
    HOLDERS,
    RADIUS_MM,
    Bar,
    Held,
    axes_of,
    ball,
    bar_of,
    box,
    collar,
    disc,
    hull_of,
    rod,
    span_of,
)

Rng = np.random.Generator
Edit = Callable[[Held, Rng], object]
Change = Callable[[bytes], bytes]
ON_PLATE = "wall pegs", "roots", "rounded plate", "full plate", "outline plate"
WITH_MEMBERS = "wall pegs", "drilled holes", "stand", "hang", "hang, no supports"
MOUNTED = *ON_PLATE, "drilled holes", "stand", "hang", "hang, no supports"
EVERY = tuple(HOLDERS)


def _strand(held: Held, rng: Rng) -> tuple[Array, Array]:
    """Choose a place on a centre line, and its direction."""
    points = np.array(held.knots["knots"][rng.integers(len(held.knots["knots"]))]["points"])
    k = int(rng.integers(len(points)))
    return points[k], points[k] - points[k - 1]


def _on_mount(held: Held, rng: Rng) -> tuple[Array, Array]:
    """Choose a place on the mount's surface, well off the strands, and the normal there."""
    body = held.bodies[0].to_mesh64()
    corners = np.asarray(body.vert_properties)[:, :3][np.asarray(body.tri_verts)]
    lines = np.concatenate([k["points"] for k in held.knots["knots"]])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    share = rng.random((len(corners), 2))
    share = np.where(share.sum(axis=1, keepdims=True) > 1, 1 - share, share)
    spots = corners[:, 0] + np.einsum("nk,nkj->nj", share, corners[:, 1:] - corners[:, :1])
    for k in rng.choice(len(spots), 400, p=area / area.sum()):
        if np.linalg.norm(lines - spots[k], axis=1).min() > 2.5 * RADIUS_MM:
            return spots[k], normal[k] / area[k]
    raise LookupError("no place off the strands")


def _grow(held: Held, rng: Rng) -> None:
    """A post, ball, flag or letter X on the mount."""
    at, out = _on_mount(held, rng)
    size, kind = float(rng.uniform(0.6, 3.0)), int(rng.integers(4))
    if kind == 0:
        held.add(rod(at - 0.2 * out, at + 2 * size * out, 0.5 * size))
    elif kind == 1:
        held.add(ball(at + 0.4 * size * out, size))
    else:
        turn = axes_of(out)
        for way in (1.0, -1.0)[: kind - 1]:
            own = np.stack([turn[0] + way * turn[1], turn[1] - way * turn[0]]) / np.sqrt(2)
            held.add(box(at + 0.3 * size * out, (4 * size, 0.8, size), np.stack([*own, out])))


def _lay_beside(held: Held, rng: Rng) -> None:
    """A block on the bed, beside the piece or touching it."""
    low, high = span_of(held)
    side = float(rng.uniform(2.0, 8.0))
    at = np.array([high[0] + side * rng.uniform(-0.4, 1.0), rng.uniform(low[1], high[1]), low[2]])
    held.add(box(at + [0, 0, side / 2], (side, side, side)))


def _swell(held: Held, rng: Rng) -> None:
    at, along = _strand(held, rng)
    held.add(
        disc(at, along, RADIUS_MM + float(rng.uniform(0.5, 2.0)), float(rng.uniform(0.6, 3.0)))
    )


def _neck(held: Held, rng: Rng) -> None:
    at, along = _strand(held, rng)
    inner, thick = RADIUS_MM * float(rng.uniform(0.0, 0.8)), float(rng.uniform(0.1, 1.5))
    held.cut(
        collar(at, along, inner, 1.1 * RADIUS_MM, thick)
        if inner > 0.3
        else disc(at, along, 3, thick)
    )


def _hollow_strand(held: Held, rng: Rng) -> None:
    at, _ = _strand(held, rng)
    held.cut(ball(at, float(rng.uniform(0.3, 1.8))))


def _holes(held: Held) -> tuple[Array, Array, float]:
    """Return the middles (k, 3) of the screw holes' mouths, the normal and the width."""
    if "plate" in held.knots:
        plate = held.knots["plate"]
        return np.array(plate["holes"]), np.array(plate["out"]), plate["hole_mm"]
    low, high = span_of(held)
    mount = held.scene["mount"]
    wide = mount["hole_diameter_mm"]
    inset = mount["plate_margin_mm"] / 2 + wide / 4
    y, z = (low[1] + high[1]) / 2, float(held.knots["members"][0]["to"][2])
    ends = [[low[0] + inset, y, z], [high[0] - inset, y, z]]
    return np.array(ends), np.array([0.0, 0.0, 1.0]), wide


def _plug(held: Held, rng: Rng) -> None:
    """Narrow a screw hole, or fill it, all through or in part."""
    middles, out, wide = _holes(held)
    at = middles[rng.integers(PLATE_HOLES)]
    thick = float(held.knots["plate"]["thickness_mm"]) if "plate" in held.knots else 3.0
    deep = thick * float(rng.uniform(0.3, 1.0))
    full = disc(at - out * deep / 2, out, wide / 2 + 0.3, deep)
    held.add(
        full - rod(at + out, at - 9 * out, float(rng.uniform(0.1, 0.4)) * wide)
        if rng.random() < 0.7
        else full
    )


def _list_holes(held: Held, rng: Rng) -> None:
    plate = held.knots["plate"]
    kind = int(rng.integers(3))
    if kind == 0:
        plate["holes"] = []
    elif kind == 1:
        plate["hole_mm"] = float(rng.uniform(0.2, 0.8)) * plate["hole_mm"]
    else:
        plate["holes"] = plate["holes"][:1]


def _member(held: Held, rng: Rng, key: str = "members") -> Bar:
    return bar_of(held, key, int(rng.integers(len(held.knots[key]))))


def _cut_member(held: Held, rng: Rng) -> None:
    bar = _member(held, rng)
    share, thick = float(rng.uniform(0.35, 0.8)), float(rng.uniform(0.08, 1.5))
    inner = float(rng.uniform(0.0, 0.85)) * bar.radius
    outer = 2 * bar.radius
    held.cut(collar(bar.at(share), bar.along, max(inner, 0.05), outer, thick))


def _collar_member(held: Held, rng: Rng) -> None:
    bar = _member(held, rng)
    at, thick = bar.at(float(rng.uniform(0.35, 0.7))), float(rng.uniform(0.4, 3.0))
    held.add(disc(at, bar.along, bar.radius + float(rng.uniform(0.5, 2.0)), thick))


def _hollow_member(held: Held, rng: Rng) -> None:
    bar = _member(held, rng)
    held.cut(
        ball(bar.at(float(rng.uniform(0.35, 0.8))), float(rng.uniform(0.35, 0.7)) * bar.radius)
    )


def _fatten_dowel(held: Held, rng: Rng) -> None:
    """Thicken a dowel, in the part alone or in knots.json too."""
    one = held.knots["hulls"][rng.integers(len(held.knots["hulls"]))]
    corners = np.array(one["corners"])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    share = float(rng.uniform(1.2, 1.6))
    fat = {**one, "corners": (middle + (corners - middle) * [share, share, 1.0]).tolist()}
    held.add(hull_of(fat))
    if rng.random() < 0.5:
        one["corners"] = fat["corners"]


def _fill_eyelet(held: Held, rng: Rng) -> None:
    ring = np.array([rod_["from"] for rod_ in held.knots["rods"]])
    middle, across = ring.mean(axis=0), np.linalg.svd(ring - ring.mean(axis=0))[2][2]
    reach = float(np.linalg.norm(ring - middle, axis=1).max())
    held.add(disc(middle, across, reach, float(rng.uniform(0.3, 0.8))))


def _move_listing(held: Held, rng: Rng) -> None:
    """Move a member, rod or hull of knots.json off its matter."""
    key = str(rng.choice([k for k in ("members", "rods", "hulls") if held.knots.get(k)]))
    one = held.knots[key][rng.integers(len(held.knots[key]))]
    off = rng.normal(size=3)
    off *= rng.uniform(1.5, 4.0) / np.linalg.norm(off)
    for name in {"from", "to"} & set(one):
        one[name] = (np.array(one[name]) + off).tolist()
    if key == "hulls":
        one["corners"] = (np.array(one["corners"]) + 2 * off).tolist()


def _drop_listing(held: Held, rng: Rng) -> None:
    key = str(rng.choice([k for k in ("members", "rods") if held.knots.get(k)]))
    held.knots[key].pop(int(rng.integers(len(held.knots[key]))))


def _list_more(held: Held, rng: Rng) -> None:
    """Grow a post on the mount, and list it in knots.json, as a member, rod or hull."""
    at, out = _on_mount(held, rng)
    start, end, wide = (
        at - 0.5 * out,
        at + float(rng.uniform(2, 6)) * out,
        float(rng.uniform(0.6, 1.5)),
    )
    held.add(rod(start, end, wide))
    ends = {"from": end.tolist(), "to": start.tolist()}
    corners = np.asarray(rod(start, end, wide).to_mesh64().vert_properties)[:, :3].tolist()
    key, one = [
        ("members", {**ends, "radius_mm": [wide, wide]}),
        ("rods", {**ends, "radius_mm": wide}),
        ("hulls", {"name": str(rng.choice(["dowel", "base", "x"])), "corners": corners}),
    ][rng.integers(3)]
    held.knots.setdefault(key, []).append(one)


def _move_bar(held: Held, rng: Rng) -> None:
    """Move, widen or drop the listing of a bar."""
    bars = held.knots["bars"]
    one, kind = bars[rng.integers(len(bars))], int(rng.integers(3))
    if kind == 0:
        bars.remove(one)
    elif kind == 1:
        one[str(rng.choice(["width_mm", "height_mm"]))] *= float(rng.uniform(1.3, 2.0))
    else:
        along = np.array(one["to"]) - one["from"]
        aside = float(rng.uniform(0.7, 2.0)) * axes_of(along)[int(rng.integers(2))]
        for name in ("from", "to"):
            one[name] = (np.array(one[name]) + aside).tolist()


def _stand_a_wall(held: Held, rng: Rng) -> None:
    """A high wall that knots.json lists as a strip on the bed."""
    start, end = (np.array(k["points"]) for k in held.knots["knots"])
    a, b = start[start[:, 2].argmin()].copy(), end[end[:, 2].argmin()].copy()
    high = float(rng.uniform(1.0, 6.0))
    a[2] = b[2] = high / 2
    wide, middle = float(rng.uniform(0.8, 1.6)), (a + b) / 2
    along = (b - a) / np.linalg.norm(b - a)
    axes = np.stack([along, np.cross([0.0, 0.0, 1.0], along), [0.0, 0.0, 1.0]])
    held.bodies.append(box(middle, (float(np.linalg.norm(b - a)), wide, high), axes))
    held.knots["bars"].append(
        {"from": a.tolist(), "to": b.tolist(), "width_mm": wide, "height_mm": high}
    )


def _say_radius(held: Held, rng: Rng) -> None:
    held.knots["radius_mm"] *= float(rng.choice([0.8, 0.9, 1.12, 1.3]))


def _warp(held: Held, rng: Rng) -> None:
    """Turn, shift or scale what knots.json says of the strands."""
    off = rng.normal(size=3)
    off *= rng.uniform(0.5, 3.0) / np.linalg.norm(off)
    for knot in held.knots["knots"]:
        knot["points"] = (np.array(knot["points"]) + off).tolist()


def _mirror(held: Held, rng: Rng) -> None:
    del rng
    held.bodies = [body.mirror((1.0, 0.0, 0.0)) for body in held.bodies]


def _scale(held: Held, rng: Rng) -> None:
    share = float(rng.choice([0.95, 1.05, 1.2]))
    held.bodies = [body.scale((share,) * 3) for body in held.bodies]


# part.3mf, which slicers read, and slicer.ini

MODEL = "3D/3dmodel.model"
KEYS = (
    "layer_height", "perimeters", "support_material", "fill_density", "raft_layers", "start_gcode",
)  # fmt: skip
ENTRIES = (
    *("Metadata/Slic3r_PE.config", "Metadata/Slic3r_PE_model.config", "metadata/SUPERSLICER.config"),
    *("Metadata/model_settings.config", "Metadata/project_settings.config", "Metadata/slice_info.config"),
    *("Metadata/Prusa_Slicer_layer_heights_profile.txt", "Metadata/layer_config_ranges.xml"),
    *("Metadata/custom_gcode_per_layer.xml", "Metadata/cut_information.xml", "Cura/machine.def.cfg"),
    *("3D/Texture/a.png", "3D/Objects/object_1.model", "3D/_rels/3dmodel.model.rels", "a.gcode", "x"),
)  # fmt: skip
SPACES = (
    *("slic3rpe", "http://schemas.slic3r.org/3mf/2017/06"),
    *("s", "http://schemas.microsoft.com/3dmanufacturing/slice/2015/07"),
    *("b", "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"),
    *("bo", "http://schemas.3mf.io/3dmanufacturing/booleanoperations/2023/07"),
    *("urn", "urn:own"),
)
# attributes that are put into an element, and elements before another
ATTRIBUTES: Mapping[str, tuple[str, ...]] = {
    "triangle": ("paint_supports='4'", "paint_color='8'", "{0}:custom_seam='4'", "{0}:x='1'"),
    "vertex": ("{0}:height='0.35'", "w='1'"),
    "object": ("{0}:slicestackid='5'", "type='surface'", "type='support'", "pid='9'", "partnumber='x'"),
    "item": ("printable='0'", "partnumber='x'", "{0}:path='/3D/o.model'", "transform='{1}'"),
    "model": ("requiredextensions='{0}'", "recommendedextensions='{0}'", "{0}:Version='2'"),
    "mesh": ("{0}:beamset='1'",),
}  # fmt: skip
ELEMENTS: Mapping[str, tuple[str, ...]] = {
    "resources": ("metadata name='{0}:Version3mf'|1", "metadata name='LayerHeight'|0.3"),
    "object": ("{0}:slicestack id='5'|", "colorgroup id='5'|", "object id='7' type='model'|"),
    "build": ("{0}:settings layer='0.3'|",),
    "mesh": ("metadatagroup|<metadata name='cura:support_mesh'>True</metadata>", "{0}:x|", "mesh|"),
    "vertices": ("{0}:vertices|",),
    "triangles": ("{0}:beamlattice radius='9'|", "trianglesets|"),
    "item": ("{0}:item objectid='1'|", "item objectid='1' transform='{1}'|"),
    "triangle": ("{0}:triangle v1='0' v2='1' v3='2'|", "triangle v1='0' v2='1' v3='2'|"),
    "vertex": ("{0}:vertex x='0' y='0' z='0'|",),
}


def _edit_model(held: Held, rng: Rng, pattern: str, new: str) -> None:
    """Replace one place of a pattern in the model, chosen at random, and give it a namespace at need."""

    def edit(entries: dict[str, bytes]) -> None:
        text = entries[MODEL].decode()
        found = list(islice(re.finditer(pattern, text), 5000))
        at = found[rng.integers(len(found))]
        text = text[: at.start()] + at.expand(new) + text[at.end() :]
        for prefix, uri in zip(SPACES[::2], SPACES[1::2], strict=True):
            if f"xmlns:{prefix}=" not in text and re.search(rf"[<\s']{prefix}[:']", text):
                text = text.replace("<model ", f"<model xmlns:{prefix}='{uri}' ", 1)
        entries[MODEL] = text.encode()

    held.files["part.3mf"] = partial(rewrite_archive, change=edit)


def _pick(rng: Rng, table: Mapping[str, tuple[str, ...]]) -> tuple[str, str]:
    tag = str(rng.choice(list(table)))
    matrix = np.round(np.eye(4, 3) + rng.normal(0, [0.01, 5.0][rng.integers(2)], (4, 3)), 4)
    moved = " ".join(str(x) for x in matrix.ravel())
    return tag, str(rng.choice(table[tag])).format(str(rng.choice(SPACES[::2])), moved)


def _put_entry(held: Held, rng: Rng) -> None:
    name, key = str(rng.choice(ENTRIES)), str(rng.choice(KEYS))
    name = "".join(c.upper() if rng.random() < 0.1 else c for c in name)
    text = str(
        rng.choice(["", f"; {key} = 3\n", f'<config><x key="{key}" value="3"/></config>', "{}"])
    )

    def put(entries: dict[str, bytes]) -> None:
        entries[name] = text.encode()

    held.files["part.3mf"] = partial(rewrite_archive, change=put)


def _put_attribute(held: Held, rng: Rng) -> None:
    tag, word = _pick(rng, ATTRIBUTES)
    key = re.escape(word.partition("=")[0])
    _edit_model(
        held, rng, rf"<{tag}\b(?:([^>]*?)\s{key}=(?:\"[^\"]*\"|'[^']*'))?", rf"<{tag}\1 {word}"
    )


def _put_element(held: Held, rng: Rng) -> None:
    tag, word = _pick(rng, ELEMENTS)
    start, _, inner = word.partition("|")
    own = f"<{start}>{inner}</{start.partition(' ')[0]}>"
    behind = tag in ("triangle", "vertex", "item", "object") and rng.random() < 0.5
    tag = f"/{tag}s" if behind and tag == "triangle" else tag
    _edit_model(held, rng, rf"<{tag}\b", own + rf"<{tag}")


def _change_mesh(held: Held, rng: Rng) -> None:
    """Move a vertex, or drop, double or turn a face, in part.3mf alone; or name another unit."""
    off = float(rng.choice([-1, 1]) * rng.uniform(0.01, 30.0))
    pattern, new = [
        (r'<vertex x="(-?)\d+', rf'<vertex x="\g<1>{abs(off):.3f}'),
        (r"<triangle [^>]*/>", ""),
        (r"(<triangle [^>]*/>)", r"\1\1"),
        (r'v1="(\d+)" v2="(\d+)"', r'v1="\2" v2="\1"'),
        ("millimeter", str(rng.choice(["inch", "micron", "centimeter", "meter", "foot"]))),
        (r'z="(-?\d+)\.', r'z="1\1.'),
    ][rng.integers(6)]
    _edit_model(held, rng, pattern, new)


def _start_elsewhere(held: Held, rng: Rng) -> None:
    """Relate the archive to another model as well, or instead."""
    own, name = bool(rng.random() < 0.5), str(rng.choice(["3D/a.model", "3D/b/C.Model", "a.model"]))

    def relate(entries: dict[str, bytes]) -> None:
        entries[name] = entries[MODEL].replace(b' x="', b' x="1', 1)
        rels = entries["_rels/.rels"]
        more = re.sub(rb'"/3D/3dmodel.model"([^>]*)rel0', b'"/%s"\\1rel9' % name.encode(), rels)
        one = re.search(rb"<Relationship [^>]*rel9[^>]*>", more)
        assert one is not None
        entries["_rels/.rels"] = (
            more if own else rels.replace(b"</Relationships>", one[0] + b"</Relationships>")
        )

    held.files["part.3mf"] = partial(rewrite_archive, change=relate)


def _set_profile(held: Held, rng: Rng) -> None:
    """Change, drop or add a line of slicer.ini."""
    more = (
        *("post_process = /tmp/x.sh", "layer_gcode = M600", "raft_layers = 5", "xy_size_compensation = -0.4"),
        *("[print:x]", "scale = 50%", "complete_objects = 1", "support_material = 1", "LAYER_HEIGHT = 0.3"),
    )  # fmt: skip

    def change(content: bytes) -> bytes:
        lines = content.decode().splitlines()
        k, kind = int(rng.integers(len(lines))), int(rng.integers(4))
        key, _, value = lines[k].partition(" = ")
        if kind == 0:
            lines.pop(k)
        elif kind == 1:
            lines.insert(k, str(rng.choice(more)))
        else:
            number = re.search(r"\d+", value)
            share = (
                str(float(rng.choice([0, 0.5, 2, 10])) * float(number[0]) + 0.25) if number else "x"
            )
            new = value.replace(number[0], share, 1) if number else value + share
            lines[k] = f"{key} = {new}" if kind == 2 else lines[k] + f"\n{key} = {new}"
        return "\n".join(lines).encode()

    held.files["slicer.ini"] = change


# keys of scene.toml, at what asks for less: a factor between two, or one of some values
LOOSER: Mapping[str, tuple[float, float] | list[Any]] = {
    "piece.printed": [False], "piece.clearance_mm": (0.0, 0.45), "piece.tube_radius_mm": (0.5, 0.85),
    "piece.knots": [1, 3], "piece.knot": ["3_1", "4_1"], "material.process": ["powder"],
    "material.young_modulus_mpa": (3.0, 100.0), "material.min_bend_radius_mm": (0.01, 0.8),
    "material.shrinkage_percent": [3.0, 8.0], "printer.process": ["powder"],
    "printer.min_wall_mm": (0.01, 0.8), "printer.min_gap_mm": (0.01, 0.8),
    "printer.layer_height_mm": (0.05, 0.35), "printer.max_overhang_deg": (1.3, 1.9),
    "printer.max_bridge_mm": (2.0, 100.0), "printer.build_volume_mm": [[900.0, 900.0, 900.0]],
    "views.light_diameter_mm": [90.0, 150.0, 400.0], "views.threshold": [0.01, 0.97, 0.99],
    "views.speck_px": [2000, 5000], "views.invert": [True],
    "accuracy.max_outline_error_px": (3.0, 1000.0), "mount.kind": ["none"],
    "mount.max_sag_mm": [5.0, 60.0], "mount.pegs": [[], [1, 1]],
    "mount.hole_diameter_mm": [1.0, 2.0, 8.0], "mount.thread_mm": ["none", [0.0, 0.0, 0.0]],
}  # fmt: skip


def _loosen(held: Held, rng: Rng) -> None:
    """Ask for less in scene.toml, and leave the profile out, which would tell most of it."""
    has = [key for key in LOOSER if _fits(held, key)]
    key = str(rng.choice(has))
    table, _, name = key.partition(".")
    asked, value = held.scene[table], LOOSER[key]
    for one in asked if isinstance(asked, list) else [asked]:
        one[name] = (
            value[rng.integers(len(value))]
            if isinstance(value, list)
            else float(rng.uniform(*value)) * one[name]
        )
    held.files["slicer.ini"] = None


def _fits(held: Held, key: str) -> bool:
    """Return whether asking less of a key asks less of this piece."""
    table, _, name = key.partition(".")
    mount = held.scene["mount"]
    asked = held.scene[table]
    value = (asked[0] if isinstance(asked, list) else asked).get(name)
    if isinstance(LOOSER[key], tuple) and not isinstance(value, int | float):
        return False
    return {
        "mount.kind": mount["kind"] != "none",
        "mount.pegs": bool(mount["pegs"]) and "members" in held.knots,
        "mount.max_sag_mm": mount["kind"] != "none",
        "mount.hole_diameter_mm": "plate" in held.knots or held.folder.name == "wall pegs",
        "piece.printed": bool(held.knots.keys() & {"members", "plate", "bars"} or held.frame),
        "mount.thread_mm": mount["kind"] == "hang",
    }.get(key, True)  # fmt: skip


OF = {  # what edits change, if not the solid
    **dict.fromkeys((_put_entry, _put_attribute, _put_element, _change_mesh), "files"),
    **dict.fromkeys((_start_elsewhere, _set_profile), "files"),
    _loosen: "scene",
}
EDITS: Mapping[str, tuple[tuple[str, ...], Edit]] = {
    "matter on the mount": (MOUNTED, _grow), "a block beside": (EVERY, _lay_beside),
    "a strand swollen": (EVERY, _swell), "a strand necked or cut": (EVERY, _neck),
    "a void in a strand": (EVERY, _hollow_strand), "a screw hole narrowed": (ON_PLATE, _plug),
    "other screw holes listed": (ON_PLATE[1:], _list_holes),
    "a member necked": (WITH_MEMBERS, _cut_member),
    "a collar on a member": (WITH_MEMBERS, _collar_member),
    "a void in a member": (WITH_MEMBERS, _hollow_member),
    "a dowel thicker": (("drilled holes",), _fatten_dowel), "an eyelet filled": (("hang",), _fill_eyelet),
    "a listing moved": (WITH_MEMBERS, _move_listing), "a listing dropped": (WITH_MEMBERS, _drop_listing),
    "a post that is listed": (MOUNTED, _list_more),
    "a bar's listing changed": (("no supports",), _move_bar),
    "a wall listed as a strip": (("no supports",), _stand_a_wall),
    "another radius said": (EVERY, _say_radius), "strands said elsewhere": (EVERY, _warp),
    "mirrored": (EVERY, _mirror), "scaled": (EVERY, _scale), "an entry in part.3mf": (EVERY, _put_entry),
    "an attribute in part.3mf": (EVERY, _put_attribute), "an element in part.3mf": (EVERY, _put_element),
    "another mesh in part.3mf": (EVERY, _change_mesh),
    "another start in part.3mf": (EVERY, _start_elsewhere), "another profile": (EVERY, _set_profile),
    "a looser scene": (EVERY, _loosen), "another looser scene": (EVERY, _loosen),
}  # fmt: skip


def drawn_forgeries(seed: int, count: int) -> list[Forged]:
    """Draw forgeries; every edit comes on every holder that it fits before any pair comes again."""
    rng = np.random.default_rng(seed)
    pairs = [(holder, name) for name, (holders, _) in EDITS.items() for holder in holders]
    order: list[int] = []
    found = []
    for number in range(count):
        order = order or rng.permutation(len(pairs)).tolist()
        holder, name = pairs[order.pop()]
        edit = EDITS[name][1]
        forge = partial(_forge, edit=edit, seed=[seed, number])
        found.append(Forged(holder, f"{name} ({seed}.{number})", forge, OF.get(edit, "solid")))
    return found


def _forge(held: Held, edit: Edit, seed: list[int]) -> None:
    edit(held, np.random.default_rng(seed))
