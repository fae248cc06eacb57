"""Files that do not belong to the part: a 3MF of another surface, pictures and lights that it cannot have."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from .case import READ, Broken, make_part, with_scene
from .curves import circle, torus_knot
from .files import Part, encode
from .hostile import Hostile, handmade
from .parts import Body


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
        yield Broken(f"a 3MF {name}", partial(_beside, change), "same_3mf")
    damaged = {"part.3mf": b"PK\x03\x04 and no more"}
    yield Broken(
        "a 3MF that is damaged", lambda: replace(make_part(circle()), raw=damaged), "same_3mf"
    )
    yield Broken("coloured bodies of another part", partial(_beside, _bump, "-colours"), "same_3mf")


def _make_other() -> Body:
    """Files of a trefoil on the bed."""
    body = make_part(torus_knot(2, 3)).body
    assert body is not None
    return body


def _beside(change: Callable[[Body], Body], suffix: str = "") -> Part:
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
