"""The good parts of the corpus: none of the checks that a part must pass may reject one of them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from .broken_print import arch, funnel, gallows, island, plain, slab, slot, table
from .case import Good, change_scene, make_part, make_tied_part, with_picture, with_scene
from .curves import (
    Array,
    circle,
    ellipse,
    figure_eight,
    granny,
    lissajous,
    mirror,
    square,
    stadium,
    torus_knot,
    wavy,
)
from .files import Part, encode
from .parts import RING, Body, ball, blocks, box, cut_and_cap, drum, join, tube

APART = np.array([80.0, 0.0, 0.0])


def good() -> list[Good]:
    """All good cases; their names differ."""
    cases = [
        *_knots(), *_links(), *_sizes(), *_formats(), *_scenes(), *_regions(), *_at_limits(), *_foreign(),
        *_printable(),
    ]  # fmt: skip
    assert len({case.name for case in cases}) == len(cases)
    return cases


def _knots() -> Iterator[Good]:
    """Knot types and shapes of unknots."""
    shapes: dict[str, tuple[str, float, Callable[[], Array]]] = {
        "ring": ("unknot", 3.0, circle),
        "oval": ("unknot", 3.0, lambda: ellipse(40.0, 20.0)),
        "stadium": ("unknot", 3.0, lambda: stadium(50.0, 20.0)),
        "crown of 3": ("unknot", 3.0, lambda: wavy(waves=3)),
        "crown of 5": ("unknot", 3.0, wavy),
        "crown of 8": ("unknot", 2.0, lambda: wavy(36.0, 8, 5.0, 8.0, 240)),
        "tall crown": ("unknot", 2.0, lambda: wavy(30.0, 2, 0.0, 25.0)),
        "unknot with one crossing": ("unknot", 2.0, curl),
        "trefoil": ("3_1", 3.0, lambda: torus_knot(2, 3)),
        "mirrored trefoil": ("3_1", 3.0, lambda: mirror(torus_knot(2, 3))),
        "trefoil the other way round the torus": ("3_1", 3.0, lambda: torus_knot(3, 2)),
        "figure-eight": ("4_1", 3.0, figure_eight),
        "cinquefoil": ("5_1", 3.0, lambda: torus_knot(2, 5)),
        "three-twist": ("5_2", 1.0, lambda: lissajous(3, 2, 7, 0.7, 0.2)),
        "stevedore": ("6_1", 2.0, lambda: lissajous(3, 2, 5, 1.5, 0.2)),
        "seven crossings": ("7_1", 2.0, lambda: torus_knot(2, 7, n=300)),
        "torus knot of 3 and 4": ("8_19", 2.0, lambda: torus_knot(3, 4, n=300)),
        "granny": ("3_1#3_1", 2.0, granny),
        "square": ("square", 2.0, square),
        "right-handed trefoil": ("right-handed trefoil", 3.0, lambda: torus_knot(2, 3)),
        "left-handed trefoil": ("left-handed 3_1", 3.0, lambda: mirror(torus_knot(2, 3))),
        "torus knot by its name": ("T(2,5)", 3.0, lambda: torus_knot(2, 5)),
    }
    for name, (kind, radius, curve) in shapes.items():
        yield Good(name, partial(make_tied_part, curve, radius, [kind], sides=18))


def _links() -> Iterator[Good]:
    """Several tubes that are not linked."""
    rings: dict[str, tuple[Sequence[str], Callable[[], Sequence[Array]]]] = {
        "side by side": ((), lambda: [circle(), circle() + APART]),
        "stacked": ((), lambda: [circle(), circle() + [0.0, 0.0, 9.0]]),
        "one inside the other": ((), lambda: [circle(30.0), circle(20.0)]),
        "three": ((), lambda: [circle(15.0), circle(25.0) + [0, 0, 10.0], circle(35.0)]),
        "at right angles": ((), lambda: [circle(), circle(12.0)[:, [0, 2, 1]] + [0, 0, 20.0]]),
        "a trefoil and a ring": (("3_1", "unknot"), lambda: [torus_knot(2, 3), circle() + APART]),
        "two knots": (("4_1", "3_1"), lambda: [figure_eight(), torus_knot(2, 3) + APART]),
    }
    for name, (types, curves) in rings.items():
        yield Good(f"tubes {name}", partial(make_tied_part, curves, 3.0, types))


def _sizes() -> Iterator[Good]:
    """Radii, sides, densities of mesh and curve."""
    for radius, ring in ((0.8, 8.0), (1.2, 20.0), (2.0, 12.0), (5.0, 40.0), (8.0, 80.0)):
        yield Good(
            f"tube radius {radius:g} on a ring of {ring:g}",
            partial(make_tied_part, partial(circle, ring), radius),
        )
    for sides in (12, 16, 33, 64):
        yield Good(f"{sides} sides", partial(make_tied_part, circle, 3.0, sides=sides))
    for n in (40, 300):
        yield Good(f"{n} rings", partial(make_tied_part, partial(circle, n=n), 3.0, sides=16))
    yield Good("unevenly sampled", lambda: make_part(_uneven()))
    yield Good("open tube", _open)
    yield Good("without a radius", lambda: replace(make_part(circle()), radius=None))
    yield Good("without knots", lambda: replace(make_part(circle()), knots=()))
    yield Good(
        "knots alone", lambda: replace(make_part(torus_knot(2, 3), types=["3_1"]), body=None)
    )


def _formats() -> Iterator[Good]:
    for form in ("stl-text", "3mf", "obj", "ply", "ply-binary"):
        yield Good(f"tube as {form}", partial(_as, _trefoil, form))
        yield Good(f"box as {form}", partial(_as, _plain_box, form))
    yield Good(
        "OBJ with texture and normals", lambda: Part(None, raw={"part.obj": _obj_relative()})
    )
    yield Good("STL with its 3MF", lambda: _with_3mf(lambda body: body))
    yield Good("STL with a 3MF in another order", lambda: _with_3mf(_reorder))
    yield Good("3MF in inches", lambda: replace(plain(_box().scale(1 / 25.4)), format="3mf-inch"))


def _with_3mf(change: Callable[[Body], Body]) -> Part:
    """Two rings with the 3MF files that a build writes beside them."""
    part = make_part([circle(), circle() + APART])
    assert part.body is not None
    content = encode(change(part.body), "3mf")
    return replace(part, raw={"part.3mf": content, "part-colours.3mf": content})


def _reorder(body: Body) -> Body:
    """The same faces: vertices and faces shuffled, corners turned."""
    rng = np.random.default_rng(0)
    order = rng.permutation(len(body.vertices))
    number = np.argsort(order)
    faces = number[np.roll(body.faces, 1, axis=1)[rng.permutation(len(body.faces))]]
    return Body(body.vertices[order], faces)


def _scenes() -> Iterator[Good]:
    """Lights, walls, eyes and poses; the picture is the shadow."""
    views: dict[str, dict[str, Any]] = {
        "from above": {}, "light from the side": {"azimuth_deg": 35.0},
        "tilted wall": {"wall_tilt_deg": 15.0},
        "near light": {"light_distance_mm": 200.0, "frame_width_mm": 140.0, "frame_height_mm": 140.0},
        "far wall": {"wall_distance_mm": 300.0, "frame_width_mm": 180.0, "frame_height_mm": 180.0},
        "wide frame": {"frame_width_mm": 160.0, "frame_height_mm": 110.0}, "an eye": {"kind": "eye"},
    }  # fmt: skip
    for name, view in views.items():
        yield Good(f"shadow, {name}", partial(_view, view))
    yield Good("shadow, part that stands", _standing)
    yield Good("shadow, part beside the frame's middle", _beside)
    yield Good("shadow, two tubes", lambda: with_scene(make_part([circle(30.0), circle(18.0)])))
    yield Good("shadow, white picture on black", _negative)
    yield Good("shadow as 3MF", lambda: replace(with_scene(_trefoil()), format="3mf"))
    asked: dict[str, tuple[Array, str]] = {
        "left trefoil": (mirror(torus_knot(2, 3)), "left-handed 3_1"),
        "T(2, 5)": (torus_knot(2, 5), "5_1"),
        "trivial": (circle(), "unknot"),
        "": (circle(), "unknot"),
    }
    for name, (curve, kind) in asked.items():
        yield Good(
            f"shadow, asked for {name!r}",
            lambda c=curve, k=kind, n=name: with_scene(make_part(c, types=[k]), piece={"knot": n}),  # type: ignore[misc]
        )
    yield Good(
        "shadow, one of two tied",
        lambda: with_scene(
            make_part([circle(30.0), torus_knot(2, 3) + APART], types=["unknot", "3_1"]),
            piece={"knot": "trefoil"},
            view={"frame_width_mm": 240.0, "frame_height_mm": 240.0},
        ),
    )
    yield Good("shadow, no floor, accepted as it is", lambda: _wrong_picture_without_floor())


def _regions() -> Iterator[Good]:
    room = encode(ball(45.0, 48), "stl")
    regions: dict[str, dict[str, Any]] = {
        "box": {"kind": "box", "size_mm": [70.0, 70.0, 8.0]},
        "cylinder": {"kind": "cylinder", "size_mm": [80.0, 70.0, 80.0]},
        "sphere": {"kind": "sphere", "size_mm": [70.0, 70.0, 70.0]},
        "box off the middle": {"kind": "box", "size_mm": [90.0, 90.0, 9.0], "center_mm": [9, -9, 0.0]},
        "mesh": {"kind": "mesh", "file": "room.stl"},
    }  # fmt: skip
    for name, region in regions.items():
        yield Good(f"region {name}", partial(in_region, region, {"room.stl": room}))
    yield Good("small printer", lambda: _with_room(0.5))


def _at_limits() -> Iterator[Good]:
    """Exactly at a limit, which is not beyond it."""
    yield from [
        Good("gap at the clearance", lambda: beside(6.4, 0.4)),
        Good("gap twice the clearance", lambda: beside(6.8, 0.4)),
        Good("gap without a clearance", lambda: beside(6.5, 0.0)),
        Good("bend at the limit",
         lambda: with_scene(_ring(), material={"min_bend_radius_mm": bend_of_circle(30.0, 96)})),
        Good("length at the budget",
         lambda: with_scene(_ring(), material={"max_length_mm": length_of(circle())})),
        Good("part as large as the printer", lambda: _with_room(0.0)),
    ]  # fmt: skip
    for kind, size in (("box", [66.0, 66.0, 6.0]), ("sphere", [66.0] * 3)):
        yield Good(
            f"{kind} as large as the tube", partial(in_region, {"kind": kind, "size_mm": size})
        )


def _foreign() -> Iterator[Good]:
    """Parts that no tube is in."""
    bodies: dict[str, Callable[[], Body]] = {
        "box": _box, "plate": lambda: box((0, 0, 0), (60, 40, 2)),
        "ball": lambda: ball(15.0).move((20, 20, 15)), "drum": lambda: drum(12.0, 30.0).move((20, 20, 0)),
        "hollow box": _hollow, "two boxes": lambda: join(_box(), _box().move((40, 0, 0))),
        "frame": lambda: _make_frame(1), "frame with three holes": lambda: _make_frame(3),
        "staircase": _staircase, "table": table, "ball, fine": lambda: ball(15.0, 64).move((20, 20, 15)),
        "long thin faces": lambda: box((0, 0, 0), (200, 2, 2)),
    }  # fmt: skip
    for name, body in bodies.items():
        yield Good(f"foreign {name}", partial(_alone, body))
    for name in ("box", "plate", "table", "hollow box", "frame"):
        yield Good(f"foreign {name} in a scene", partial(_in_scene, bodies[name]))


def _printable() -> Iterator[Good]:
    """Printable as they are: walls, gaps, bridges and overhangs up to the limits."""
    no = {"supports": False}
    yield Good("wall 1.2 nozzles thick", lambda: plain(slab(0.48)))
    yield Good("wall of two nozzles", lambda: plain(slab(0.8)))
    yield Good("wall of a wide nozzle", lambda: plain(slab(0.9), printer={"nozzle_mm": 0.8}))
    yield Good("gap 1.2 nozzles wide", lambda: plain(slot(0.48)))
    yield Good("gap of two nozzles", lambda: plain(slot(0.8)))
    yield Good("box without supports", lambda: plain(_box(), printer=no))
    yield Good("arch with a short bridge", lambda: plain(arch(6.0), printer=no))
    yield Good("arch of the longest bridge", lambda: plain(arch(9.0), printer=no))
    yield Good("island on supports", lambda: plain(island()))
    yield Good("long bridge on supports", lambda: plain(arch(40.0)))
    yield Good("little support", lambda: plain(table(), printer={"max_support_cm3": 50.0}))
    stand = {"kind": "stand"}
    yield Good("stand with a short arm", lambda: plain(gallows(8.0), mount=stand))
    yield Good("stand that nearly topples", lambda: plain(gallows(14.8), mount=stand))
    yield Good("cone without supports", lambda: plain(funnel(40.0), printer=no))


def _ring() -> Part:
    return make_part(circle())


def _open() -> Part:
    """A ring with a gap wider than its tube, whose ends are flat."""
    rings = 6
    part = _ring()
    assert part.body is not None
    line = np.roll(part.knots[0], -RING - rings, axis=0)[: 1 - rings]
    return replace(part, body=cut_and_cap(part.body, rings), knots=(line,), closed=False)


def _trefoil() -> Part:
    return make_part(torus_knot(2, 3), types=["3_1"])


def _as(make: Callable[[], Part], form: str) -> Part:
    return replace(make(), format=form)


def _alone(body: Callable[[], Body]) -> Part:
    return Part(body())


def _in_scene(body: Callable[[], Body]) -> Part:
    return plain(body())


def _plain_box() -> Part:
    return plain(_box())


def _view(view: Mapping[str, Any]) -> Part:
    return with_scene(_trefoil(), view=view)


def in_region(region: Mapping[str, Any], files: Mapping[str, bytes] | None = None) -> Part:
    return replace(with_scene(_ring(), region=region), raw=files or {})


def curl(apart: float = 12.0) -> Array:
    """A figure of eight seen from above, whose strands cross `apart` from each other."""
    t = 2 * np.pi * np.arange(160) / 160
    return np.column_stack([35 * np.sin(t), 16 * np.sin(2 * t), apart / 2 * np.cos(t)])


def _uneven() -> Array:
    t = 2 * np.pi * np.arange(120) / 120
    t = t + 0.5 * np.sin(t)
    return 30 * np.column_stack([np.cos(t), np.sin(t), 0 * t])


def beside(apart: float, clearance: float) -> Part:
    """Two rings in one plane whose centre lines come as near as `apart`."""
    curves = [circle(), circle() + np.array([60.0 + apart, 0.0, 0.0])]
    wide = {"frame_width_mm": 180.0, "frame_height_mm": 100.0}
    return with_scene(make_part(curves, sides=64), piece={"clearance_mm": clearance}, view=wide)


def bend_of_circle(radius: float, n: int) -> float:
    """MinRad of a regular polygon: its edge over 2 tan of half its turning angle."""
    return float(radius * np.cos(np.pi / n))


def length_of(curve: Array) -> float:
    """Length of a closed polygon."""
    return float(np.linalg.norm(np.roll(curve, -1, axis=0) - curve, axis=1).sum())


def _with_room(spare: float) -> Part:
    """A ring in a printer that is larger than it by `spare` mm."""
    part = _ring()
    assert part.body is not None
    size = part.body.vertices.max(axis=0) + spare
    return with_scene(part, printer={"build_volume_mm": size.tolist()})


def _standing() -> Part:
    """The trefoil upright on the bed; the pose lays it before the light."""
    part = _trefoil()
    assert part.body is not None
    turn = [0, 2, 1]
    flip = np.array([1.0, -1.0, 1.0])
    placed = Body(part.body.vertices[:, turn] * flip, part.body.faces)
    shift = np.array([4.0, 4.0, 0.0]) - placed.vertices.min(axis=0)
    placed = placed.move(shift)
    knots = tuple(k[:, turn] * flip + shift for k in part.knots)
    middle = (placed.vertices.max(axis=0) + placed.vertices.min(axis=0)) / 2
    pose = np.eye(4)
    pose[:3, :3] = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    pose[:3, 3] = -pose[:3, :3] @ middle
    scene = with_scene(replace(part, body=placed, knots=knots))
    return with_picture(change_scene(scene, "pose", matrix=pose.tolist()), placed)


def _beside() -> Part:
    part = with_scene(_trefoil())
    assert part.scene is not None and part.body is not None
    pose = np.array(part.scene["pose"]["matrix"])
    pose[:3, 3] += [12.0, -8.0, 5.0]
    return with_picture(change_scene(part, "pose", matrix=pose.tolist()), part.body)


def _negative() -> Part:
    part = with_scene(_trefoil())
    return replace(part, pictures={name: ~mask for name, mask in part.pictures.items()})


def _wrong_picture_without_floor() -> Part:
    part = change_scene(
        with_scene(_trefoil()), "accuracy", iou_floor="auto", accept=["unrecognisable"]
    )
    return replace(part, pictures={name: mask[:, ::-1] for name, mask in part.pictures.items()})


def _box() -> Body:
    return box((2, 2, 0), (27, 22, 12))


def _hollow() -> Body:
    inner = box((7, 7, 3), (22, 17, 9))
    return join(_box(), Body(inner.vertices, inner.faces[:, ::-1]))


def _make_frame(holes: int) -> Body:
    cells = np.ones((2 * holes + 1, 3, 1), dtype=bool)
    cells[1::2, 1, 0] = False
    return blocks(cells, [8.0 * i for i in range(2 * holes + 2)], (0, 8, 20, 28), (0, 6))


def _staircase() -> Body:
    steps = np.arange(5)
    cells = (steps[:, None] >= steps[None])[:, None, :]
    return blocks(cells, [6.0 * i for i in range(6)], (0, 20), [4.0 * i for i in range(6)])


def _obj_relative() -> bytes:
    """A tube as OBJ with comments, texture coordinates, normals and relative indices."""
    body = tube(circle(20.0, 48), 3.0, 16).move((24, 24, 4))
    lines = ["# a comment", "mtllib none.mtl", "o tube"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in body.vertices]
    lines += ["vt 0 0", "vn 0 0 1", "usemtl none", "s off"]
    n = len(body.vertices)
    lines += [f"f {a - n}/1/1 {b - n}/1/1 {c - n}/1/1" for a, b, c in body.faces]
    return "\n".join([*lines, ""]).encode()
