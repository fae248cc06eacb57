"""Broken surfaces, and files that do not belong to the part: another 3MF, other pictures and lights."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from .case import READ, Broken, Place, between, change_scene, make_part, places_of, with_scene
from .curves import circle, torus_knot
from .files import Part, encode
from .hostile import Hostile, handmade
from .parts import (
    FACE,
    SIDES,
    Body,
    add_back,
    ball,
    box,
    collapse,
    cut_and_cap,
    dent,
    fin,
    flip,
    handle,
    join,
    needle,
    repeat_corner,
    repeat_faces,
    spike,
    t_junction,
    tube,
    unmerge,
)

RADIUS = 3.0
NEAR = 2 * RADIUS
APART = np.array([80.0, 0.0, 0.0])

Change = Callable[[Body], Body]
Places = Callable[[Part], Iterable[Place]]


def broken_mesh() -> Iterator[Broken]:
    """Faults of the mesh, made on a ring or two."""
    for start, faults in ((_ring, FAULTS), (_rings, FAULTS_OF_TWO)):
        for name, change, meant, places in faults:
            yield Broken(name, _change_body(change, start), meant, places, NEAR)
    for name, body, meant, places, within in BESIDE_A_CUBE:
        yield Broken(name, partial(Part, join(CUBE, body)), meant, places, within)
    yield from _of_bodies()
    yield from _of_crossings()
    yield from _of_fit()


def _ring() -> Part:
    return make_part(circle())


def _rings() -> Part:
    return make_part([circle(), circle() + APART])


def _change_body(change: Change, start: Callable[[], Part] = _ring) -> Callable[[], Part]:
    def make() -> Part:
        part = start()
        assert part.body is not None
        return replace(part, body=change(part.body))

    return make


def _at_face(face: int = FACE, start: Callable[[], Part] = _ring) -> Callable[[Part], list[Place]]:
    def places(_: Part) -> list[Place]:
        body = start().body
        assert body is not None
        return list(places_of(body.middle_of(face)))

    return places


def _at_ring(*rings: int) -> Callable[[Part], Iterable[Place]]:
    """The points of the centre line (of the first knot) at some rings."""
    return lambda part: places_of(part.knots[0][list(rings)])


def _along(knot: int = 0) -> Callable[[Part], Iterable[Place]]:
    return lambda part: places_of(part.knots[knot])


def _at(*place: float) -> Places:
    return lambda _: places_of(np.array(place))


HALF = range(len(circle()) * SIDES, 2 * len(circle()) * SIDES)
SECOND = range(2 * len(circle()) * SIDES, 4 * len(circle()) * SIDES)
AROUND = range(2 * 10 * SIDES, 2 * 11 * SIDES)
# name, the change of a ring's body, the check that must reject it, and where
FAULTS: list[tuple[str, Change, str, Places | None]] = [
    ("one face missing", lambda b: b.without(FACE), "mesh_closed", _at_face()),
    ("four faces missing", lambda b: b.without(*range(FACE, FACE + 4)), "mesh_closed", _at_face()),
    ("a ring of faces missing", lambda b: b.without(*AROUND), "mesh_closed", _at_ring(10, 11)),
    ("half of the tube missing", lambda b: b.without(*HALF), "mesh_closed", _at_ring(0, 48)),
    ("a vertex unmerged by 1e-4 mm", unmerge, "mesh_closed", _at_face()),
    ("a T-junction", t_junction, "mesh_closed", _at_face()),
    ("a fin on an edge", fin, "mesh_closed", _at_face()),
    ("one face wound against the rest", lambda b: flip(b, [FACE]), "mesh_winding", _at_face()),
    ("half of the faces wound against the rest", lambda b: flip(b, HALF), "mesh_winding", _at_ring(0, 48)),
    ("a vertex on its neighbour", collapse, "mesh_degenerate", _at_face()),
    ("a vertex on the line of two others", needle, "mesh_degenerate", _at_face()),
    ("a face that names a vertex twice", repeat_corner, "mesh_degenerate", _at_face()),
    ("a face twice", lambda b: repeat_faces(b, [FACE]), "mesh_duplicate", _at_face()),
    ("a face and its back", add_back, "mesh_duplicate", _at_face()),
    ("many faces twice", lambda b: repeat_faces(b, range(200)), "mesh_duplicate", _at_ring(*range(5))),
    ("the whole body twice", lambda b: join(b, b), "mesh_duplicate", _along()),
    ("inside out", lambda b: Body(b.vertices, b.faces[:, ::-1]), "mesh_volume", _along()),
    ("a tube too thin by 5 %", lambda _: _swept(0.95), "mesh_volume", _along()),
    ("a tube too thick by 5 %", lambda _: _swept(1.05), "mesh_volume", _along()),
    ("a ball beside the ring", lambda b: join(b, ball(5.0).move((100, 30, 5))), "mesh_bodies",
     _at(100.0, 30.0, 5.0)),
    ("a ring with a bar across", handle, "mesh_genus", lambda p: _on_bar(p)),
    ("a ring cut open with capped ends", cut_and_cap, "mesh_genus", _along()),
    ("a face pushed through the other side", spike, "mesh_self_intersection", _at_ring(10)),
    ("a dent", lambda b: dent(b, -0.5), "tube", _at_ring(10)),
    ("a wart", lambda b: dent(b, 0.5), "tube", _at_ring(10)),
    ("the part in metres", lambda b: b.scale(1e-3), "tube", None),
    ("the part in inches", lambda b: b.scale(1 / 25.4), "tube", None),
    ("the part shifted by half a radius", lambda b: b.move((0, 1.5, 0)), "tube", None),
]  # fmt: skip
# the same faults are made in two rings
FAULTS_OF_TWO: list[tuple[str, Change, str, Places | None]] = [
    ("a hole in the second of two", lambda b: b.without(FACE), "mesh_closed", _at_face()),
    ("one of two bodies twice", lambda b: repeat_faces(b, range(len(b.faces) // 2)), "mesh_duplicate",
     _along()),
    ("the second of two inside out", lambda b: flip(b, SECOND), "mesh_volume", _along(1)),
]  # fmt: skip
CUBE = box((0, 0, 0), (10, 10, 10))
# name, another body beside a cube, the check that must reject them, and within how many mm of where
BESIDE_A_CUBE: list[tuple[str, Body, str, Places, float]] = [
    ("two boxes that share an edge", box((10, 10, 0), (20, 20, 10)), "mesh_manifold", _at(10, 10, 5), NEAR),
    ("two boxes that share a corner", box((10, 10, 10), (20, 20, 20)), "mesh_manifold",
     _at(10, 10, 10), NEAR),
    ("a box twice", CUBE, "mesh_duplicate", _at(5, 5, 5), 9.0),
    ("two boxes that overlap", box((9, 2, 2), (20, 8, 8)), "mesh_self_intersection", _at(9.5, 5, 5), 9.0),
    ("a box against a box", box((10, 2, 2), (20, 8, 8)), "mesh_self_intersection", _at(10, 5, 5), 9.0),
]  # fmt: skip


def _of_bodies() -> Iterator[Broken]:
    yield from [
        Broken("a ball inside out",
               lambda: Part(Body(ball(8.0).vertices + 10, ball(8.0).faces[:, ::-1])), "mesh_volume"),
        Broken("one of two too thin by 5 %",
               lambda: replace(_rings(), body=join(_swept(1.0), _swept(0.95).move(APART))),
               "mesh_volume", _along(1), NEAR),
        Broken("knots.json with a radius 5 % larger", lambda: replace(_ring(), radius=3.15), "mesh_volume"),
        Broken("one strand of two missing: mesh_bodies",
               lambda: replace(_rings(), body=_ring().body), "mesh_bodies"),
        Broken("one strand of two missing: tube",
               lambda: replace(_rings(), body=_ring().body), "tube", _along(1), NEAR),
        Broken("a strand that knots.json does not know",
               lambda: replace(_rings(), knots=_rings().knots[:1], types=("unknot",)),
               "mesh_bodies", lambda _: places_of(_rings().knots[1]), NEAR),
        Broken("a knots.json that says the ring is open",
               lambda: replace(_ring(), closed=False), "mesh_genus"),
    ]  # fmt: skip


def _of_crossings() -> Iterator[Broken]:
    crossing = "mesh_self_intersection"
    for factor in (0.5, 0.95, 0.99):
        make = partial(_beside, factor * 2 * RADIUS)
        yield Broken(
            f"two strands {factor} diameters apart", make, crossing, between, NEAR / factor
        )
    yield from [
        Broken("a strand through another", lambda: _beside(-10.0), crossing, _where_they_meet, NEAR),
        Broken("a trefoil too thick for itself",
               lambda: make_part(torus_knot(2, 3, 12.0, 5.0), RADIUS * 2, ["3_1"]),
               crossing, _along(), 4 * RADIUS),
    ]  # fmt: skip


def _of_fit() -> Iterator[Broken]:
    yield from [
        Broken("knots.json of another size", lambda: replace(_ring(), knots=(_ring().knots[0] * 1.02,)),
               "tube", _along(), NEAR),
        Broken("knots.json with half the radius", lambda: replace(_ring(), radius=1.5), "tube"),
        Broken("a corner of the knot cut off", _cut_corner, "tube",
               lambda p: places_of(_ring().knots[0][20:29]), NEAR),
        Broken("knots.json with a radius 3 % smaller than the scene's",
               lambda: replace(with_scene(_ring()), radius=0.97 * RADIUS), "tube"),
    ]  # fmt: skip
    # beside pegs there is matter about the tube, so that these are nowhere bare
    mounted: dict[str, Callable[[Part], Part]] = {
        "too thick by 5 %": lambda p: replace(p, body=_swept(1.05)),
        "too thick by 20 %": lambda p: replace(p, body=_swept(1.2)),
        "swollen by a fifth of its radius along 12 radii": lambda p: replace(p, body=_swollen(0.2 * RADIUS)),
        "with four fifths of its radius in knots.json": lambda p: change_scene(
            replace(p, radius=0.8 * RADIUS), "piece", tube_radius_mm=0.8 * RADIUS),
    }  # fmt: skip
    for name, change in mounted.items():
        yield Broken(f"a mounted tube {name}", partial(_mounted, change), "tube")
    left_out = partial(_mounted, lambda part: part)
    yield Broken("a wall mount whose members knots.json leaves out", left_out, "mount")


def _mounted(change: Callable[[Part], Part]) -> Part:
    """A ring whose scene says that it has a wall mount."""
    return change(with_scene(_ring(), mount={"kind": "wall"}))


def _swollen(by_mm: float) -> Body:
    """The ring's tube, thicker by so much about vertex 10 of its line, smoothly."""
    curve, body = _ring().knots[0], _swept(1.0)
    middle = np.repeat(curve, SIDES, axis=0)
    away = np.linalg.norm(middle - curve[10], axis=1) / (4 * RADIUS)
    out = (body.vertices - middle) / RADIUS
    return Body(body.vertices + by_mm * np.exp(-(away**4))[:, None] * out, body.faces)


def _swept(factor: float) -> Body:
    part = _ring()
    return tube(part.knots[0], RADIUS * factor, SIDES)


def _on_bar(part: Part) -> tuple[Place, ...]:
    """Points of the bar, and of the ring that has it."""
    one, other = part.knots[0][[0, 48]]
    bar = one + np.linspace(0, 1, 30)[:, None] * (other - one)
    return places_of(np.concatenate([bar, part.knots[0]]))


def _beside(apart: float) -> Part:
    """Two rings in one plane; their centre lines come as near as `apart`, or cross if negative."""
    return make_part([circle(), circle() + np.array([60.0 + apart, 0.0, 0.0])], sides=32)


def _where_they_meet(part: Part) -> tuple[Place, ...]:
    one, other = part.knots
    apart = np.linalg.norm(one[:, None] - other[None], axis=2)
    return places_of(one[apart.min(axis=1) < RADIUS])


def _cut_corner() -> Part:
    """knots.json leaves out nine vertices in a row: the chord is 1.3 mm inside the arc."""
    part = _ring()
    return replace(part, knots=(np.delete(part.knots[0], range(20, 29), axis=0),))


def broken_files() -> Iterator[Broken]:
    """Faults of files beside the part; the readers must name theirs in a sentence."""
    yield from _of_3mf()
    yield from [
        Broken("a picture that is none",
         lambda: replace(with_scene(make_part(circle())), raw={"front.png": b"GIF89a and no more"}), READ,
         says="front.png"),
        Broken("a picture that is missing", lambda: replace(with_scene(make_part(circle())), pictures={}),
         READ),
        Broken("a part behind the light",
         lambda: with_scene(make_part(circle()), view={"light_distance_mm": 1.0}), READ, says="light"),
    ]  # fmt: skip


def _of_3mf() -> Iterator[Broken]:
    """The verified STL is right, and what is printed is something else."""
    wrong: dict[str, Callable[[Body], Body]] = {
        "of another part": lambda _: _make_other(),
        "1 % larger": lambda body: body.scale(1.01),
        "moved by 0.1 mm": lambda body: body.move((0.1, 0, 0)),
        "with a bump": _bump,
        "without a face": lambda body: body.without(100),
        "inside out": lambda body: Body(body.vertices, body.faces[:, ::-1]),
        "with a face turned": _turn_one,
        "with a face twice": lambda b: Body(b.vertices, np.concatenate([b.faces, b.faces[:1]])),
    }
    for name, change in wrong.items():
        yield Broken(f"a 3MF {name}", partial(_with_other_3mf, change), "same_3mf")
    damaged = {"part.3mf": b"PK\x03\x04 and no more"}
    yield Broken(
        "a 3MF that is damaged", lambda: replace(make_part(circle()), raw=damaged), "same_3mf"
    )
    yield Broken(
        "coloured bodies of another part", partial(_with_other_3mf, _bump, "-colours"), "same_3mf"
    )


def _make_other() -> Body:
    """Files of a trefoil on the bed."""
    body = make_part(torus_knot(2, 3)).body
    assert body is not None
    return body


def _with_other_3mf(change: Callable[[Body], Body], suffix: str = "") -> Part:
    """A ring with a 3MF that is changed, and the right one too where that is another file's."""
    part = make_part(circle())
    assert part.body is not None
    raw = {"part.3mf": encode(part.body, "3mf")}
    raw[f"part{suffix}.3mf"] = encode(change(part.body), "3mf")
    return replace(part, raw=raw)


def _bump(body: Body) -> Body:
    """Pushed up by 0.6 mm about one vertex."""
    away = np.linalg.norm(body.vertices - body.vertices[500], axis=1)
    up = np.outer(0.6 * np.exp(-((away / 4) ** 2)), (0.0, 0.0, 1.0))
    return Body(body.vertices + up, body.faces)


def _turn_one(body: Body) -> Body:
    faces = body.faces.copy()
    faces[7] = faces[7, ::-1]
    return Body(body.vertices, faces)


def refused_files() -> Iterator[Broken]:
    """The files made by hand that must be refused."""
    for file in handmade():
        if file.says is not None:
            yield Broken(file.name, partial(_alone, file), READ, says=file.says)


def _alone(file: Hostile) -> Part:
    """The file by the name that it would have beside others of a part."""
    kind = file.name.rpartition(".")[2]
    return Part(
        None,
        raw={{"json": "knots.json", "toml": "scene.toml"}.get(kind, f"part.{kind}"): file.content},
    )
