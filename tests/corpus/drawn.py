"""Forgeries drawn by a seed: each holder by each kind of edit, where and how large by chance."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from knotfab_validators.tube.mount_members import PLATE_HOLES

from .curves import Array
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
ON_PLATE = "wall pegs", "full plate", "outline plate"
WITH_MEMBERS = "wall pegs", "drilled holes", "stand", "hang"
MOUNTED = *ON_PLATE, "drilled holes", "stand", "hang"
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


EDITS: Mapping[str, tuple[tuple[str, ...], Edit]] = {
    "matter on the mount": (MOUNTED, _grow),
    "a block beside": (EVERY, _lay_beside),
    "a strand swollen": (EVERY, _swell),
    "a strand necked or cut": (EVERY, _neck),
    "a void in a strand": (EVERY, _hollow_strand),
    "a screw hole narrowed": (ON_PLATE, _plug),
    "other screw holes listed": (ON_PLATE[1:], _list_holes),
    "a member necked": (WITH_MEMBERS, _cut_member),
    "a collar on a member": (WITH_MEMBERS, _collar_member),
    "a void in a member": (WITH_MEMBERS, _hollow_member),
    "a dowel thicker": (("drilled holes",), _fatten_dowel),
    "an eyelet filled": (("hang",), _fill_eyelet),
    "a listing moved": (WITH_MEMBERS, _move_listing),
    "a listing dropped": (WITH_MEMBERS, _drop_listing),
    "a bar's listing changed": (("no supports",), _move_bar),
    "a wall listed as a strip": (("no supports",), _stand_a_wall),
    "another radius said": (EVERY, _say_radius),
    "strands said elsewhere": (EVERY, _warp),
    "mirrored": (EVERY, _mirror),
    "scaled": (EVERY, _scale),
}


def drawn_forgeries(seed: int, count: int) -> list[Forged]:
    """Draw forgeries; every edit comes on every holder that it fits before any pair comes again."""
    rng = np.random.default_rng(seed)
    pairs = [(holder, name) for name, (holders, _) in EDITS.items() for holder in holders]
    order: list[int] = []
    found = []
    for number in range(count):
        order = order or rng.permutation(len(pairs)).tolist()
        holder, name = pairs[order.pop()]
        forge = partial(_forge, edit=EDITS[name][1], seed=[seed, number])
        found.append(Forged(holder, f"{name} ({seed}.{number})", forge))
    return found


def _forge(held: Held, edit: Edit, seed: list[int]) -> None:
    edit(held, np.random.default_rng(seed))
