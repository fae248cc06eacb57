"""Broken surfaces: holes, wrong windings, doubled and crossing faces, and tubes that are not the knots'."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from .case import Broken, Place, between, change_scene, make_part, places_of, with_scene
from .curves import circle, torus_knot
from .damage import (
    FACE,
    SIDES,
    add_back,
    collapse,
    cut_and_cap,
    dent,
    fin,
    flip,
    handle,
    needle,
    repeat_corner,
    repeat_faces,
    spike,
    t_junction,
    unmerge,
)
from .files import Part
from .parts import Body, ball, box, join, tube

RADIUS = 3.0
NEAR = 2 * RADIUS
APART = np.array([80.0, 0.0, 0.0])

Change = Callable[[Body], Body]


def broken_mesh() -> Iterator[Broken]:
    """Faults of the mesh, made on a ring or two."""
    yield from _of_edges()
    yield from _of_faces()
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


def _fault(
    name: str,
    change: Change,
    meant: str,
    places: Callable[[Part], Iterable[Place]] | None,
    start: Callable[[], Part] = _ring,
) -> Broken:
    return Broken(name, _change_body(change, start), meant, places, NEAR)


def _of_edges() -> Iterator[Broken]:
    closed = "mesh_closed"
    yield _fault("one face missing", lambda b: b.without(FACE), closed, _at_face())
    yield _fault(
        "four faces missing", lambda b: b.without(*range(FACE, FACE + 4)), closed, _at_face()
    )
    around = range(2 * 10 * SIDES, 2 * 11 * SIDES)
    yield _fault("a ring of faces missing", lambda b: b.without(*around), closed, _at_ring(10, 11))
    half = range(len(circle()) * SIDES, 2 * len(circle()) * SIDES)
    yield _fault("half of the tube missing", lambda b: b.without(*half), closed, _at_ring(0, 48))
    yield _fault(
        "a hole in the second of two", lambda b: b.without(FACE), closed, _at_face(), _rings
    )
    yield _fault("a vertex unmerged by 1e-4 mm", unmerge, closed, _at_face())
    yield _fault("a T-junction", t_junction, closed, _at_face())
    yield _fault("a fin on an edge", fin, closed, _at_face())
    yield Broken(
        "two boxes that share an edge",
        lambda: Part(join(box((0, 0, 0), (10, 10, 10)), box((10, 10, 0), (20, 20, 10)))),
        "mesh_manifold",
        lambda _: places_of(np.array([10.0, 10.0, 5.0])),
        NEAR,
    )
    yield Broken(
        "two boxes that share a corner",
        lambda: Part(join(box((0, 0, 0), (10, 10, 10)), box((10, 10, 10), (20, 20, 20)))),
        "mesh_manifold",
        lambda _: places_of(np.array([10.0, 10.0, 10.0])),
        NEAR,
    )
    yield _fault(
        "one face wound against the rest", lambda b: flip(b, [FACE]), "mesh_winding", _at_face()
    )
    yield _fault(
        "half of the faces wound against the rest",
        lambda b: flip(b, half),
        "mesh_winding",
        _at_ring(0, 48),
    )


def _of_faces() -> Iterator[Broken]:
    flat = "mesh_degenerate"
    yield _fault("a vertex on its neighbour", collapse, flat, _at_face())
    yield _fault("a vertex on the line of two others", needle, flat, _at_face())
    yield _fault("a face that names a vertex twice", repeat_corner, flat, _at_face())
    double = "mesh_duplicate"
    yield _fault("a face twice", lambda b: repeat_faces(b, [FACE]), double, _at_face())
    yield _fault("a face and its back", add_back, double, _at_face())
    yield _fault(
        "many faces twice", lambda b: repeat_faces(b, range(200)), double, _at_ring(*range(5))
    )
    yield _fault("the whole body twice", lambda b: join(b, b), double, _along())
    yield _fault(
        "one of two bodies twice",
        lambda b: repeat_faces(b, range(len(b.faces) // 2)),
        double,
        _along(),
        _rings,
    )
    yield Broken(
        "a box twice",
        lambda: Part(join(*[box((0, 0, 0), (10, 10, 10))] * 2)),
        double,
        lambda _: places_of(np.array([5.0, 5.0, 5.0])),
        9.0,
    )


def _of_bodies() -> Iterator[Broken]:
    volume = "mesh_volume"
    yield _fault("inside out", lambda b: Body(b.vertices, b.faces[:, ::-1]), volume, _along())
    second = range(2 * len(circle()) * SIDES, 4 * len(circle()) * SIDES)
    yield _fault(
        "the second of two inside out", lambda b: flip(b, second), volume, _along(1), _rings
    )
    yield Broken(
        "a ball inside out",
        lambda: Part(Body(ball(8.0).vertices + 10, ball(8.0).faces[:, ::-1])),
        volume,
    )
    yield _fault("a tube too thin by 5 %", lambda b: _swept(0.95), volume, _along())
    yield _fault("a tube too thick by 5 %", lambda b: _swept(1.05), volume, _along())
    yield Broken(
        "one of two too thin by 5 %",
        lambda: replace(_rings(), body=join(_swept(1.0), _swept(0.95).move(APART))),
        volume,
        _along(1),
        NEAR,
    )
    yield Broken(
        "knots.json with a radius 5 % larger", lambda: replace(_ring(), radius=3.15), volume
    )
    bodies = "mesh_bodies"
    for check in ("mesh_bodies", "tube"):
        yield Broken(
            f"one strand of two missing: {check}",
            lambda: replace(_rings(), body=_ring().body),
            check,
            _along(1) if check == "tube" else None,
            NEAR,
        )
    yield Broken(
        "a strand that knots.json does not know",
        lambda: replace(_rings(), knots=_rings().knots[:1], types=("unknot",)),
        bodies,
        lambda _: places_of(_rings().knots[1]),
        NEAR,
    )
    yield _fault(
        "a ball beside the ring",
        lambda b: join(b, ball(5.0).move((100, 30, 5))),
        bodies,
        lambda _: places_of(np.array([100.0, 30.0, 5.0])),
    )
    genus = "mesh_genus"
    yield _fault("a ring with a bar across", handle, genus, _on_bar)
    yield _fault(
        "a ring cut open with capped ends", cut_and_cap, genus, lambda p: places_of(p.knots[0])
    )

    yield Broken(
        "a knots.json that says the ring is open", lambda: replace(_ring(), closed=False), genus
    )


def _of_crossings() -> Iterator[Broken]:
    crossing = "mesh_self_intersection"
    for factor in (0.5, 0.95, 0.99):
        yield Broken(
            f"two strands {factor} diameters apart",
            partial(_beside, factor * 2 * RADIUS),
            crossing,
            between,
            NEAR / factor,
        )
    yield Broken(
        "a strand through another", lambda: _beside(-10.0), crossing, _where_they_meet, NEAR
    )
    yield Broken(
        "a trefoil too thick for itself",
        lambda: make_part(torus_knot(2, 3, 12.0, 5.0), RADIUS * 2, ["3_1"]),
        crossing,
        lambda p: places_of(p.knots[0]),
        4 * RADIUS,
    )
    yield _fault("a face pushed through the other side", spike, crossing, _at_ring(10))
    yield Broken(
        "two boxes that overlap",
        lambda: Part(join(box((0, 0, 0), (10, 10, 10)), box((9, 2, 2), (20, 8, 8)))),
        crossing,
        lambda _: places_of(np.array([9.5, 5.0, 5.0])),
        9.0,
    )
    yield Broken(
        "a box against a box",
        lambda: Part(join(box((0, 0, 0), (10, 10, 10)), box((10, 2, 2), (20, 8, 8)))),
        crossing,
        lambda _: places_of(np.array([10.0, 5.0, 5.0])),
        9.0,
    )


def _of_fit() -> Iterator[Broken]:
    fit = "tube"
    yield _fault("a dent", lambda b: dent(b, -0.5), fit, _at_ring(10))
    yield _fault("a wart", lambda b: dent(b, 0.5), fit, _at_ring(10))
    yield _fault("the part in metres", lambda b: b.scale(1e-3), fit, None)
    yield _fault("the part in inches", lambda b: b.scale(1 / 25.4), fit, None)
    yield _fault("the part shifted by half a radius", lambda b: b.move((0, 1.5, 0)), fit, None)
    yield Broken(
        "knots.json of another size",
        lambda: replace(_ring(), knots=(_ring().knots[0] * 1.02,)),
        fit,
        lambda p: places_of(p.knots[0]),
        NEAR,
    )
    yield Broken("knots.json with half the radius", lambda: replace(_ring(), radius=1.5), fit)
    yield Broken(
        "a corner of the knot cut off",
        _cut_corner,
        fit,
        lambda p: places_of(_ring().knots[0][20:29]),
        NEAR,
    )

    yield Broken(
        "knots.json with a radius 3 % smaller than the scene's",
        lambda: replace(with_scene(_ring()), radius=0.97 * RADIUS),
        fit,
    )
    # beside pegs there is matter about the tube, so that these are nowhere bare
    mounted: dict[str, Callable[[Part], Part]] = {
        "too thick by 5 %": lambda part: replace(part, body=_swept(1.05)),
        "too thick by 20 %": lambda part: replace(part, body=_swept(1.2)),
        "swollen by a fifth of its radius along 12 radii": lambda part: replace(
            part, body=_swollen(0.2 * RADIUS)
        ),
        "with four fifths of its radius in knots.json": lambda part: change_scene(
            replace(part, radius=0.8 * RADIUS), "piece", tube_radius_mm=0.8 * RADIUS
        ),
    }
    for name, change in mounted.items():
        yield Broken(f"a mounted tube {name}", partial(_mounted, change), fit)


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
