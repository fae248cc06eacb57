"""Write the files of a piece, or of knots from which none can be made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from knotfab.base.arrays import Array
from knotfab.base.folder import OutputFolder
from knotfab.design.design import Design
from knotfab.geometry.polylines import polylines_of
from knotfab.geometry.tube import Mesh
from knotfab.knots import count_in_words
from knotfab.part.assemble import Part, enlarge_knots, shrink_of
from knotfab.part.files import About, write_3mf, write_coloured_3mf, write_stl
from knotfab.picture.raster import encode_image, encode_mask
from knotfab.picture.read import Target
from knotfab.render.image import image_at
from knotfab.render.pages import length
from knotfab.render.part_picture import PAPER
from knotfab.scene.load import dump_scene
from knotfab_formats.libraries import took_part
from knotfab_formats.piece import FramePlate, Pose
from knotfab_formats.scene import ResolvedView, SettledScene

Row = tuple[float, float, float, float]

COLOURED = "part-colours.3mf"
# after the material's own, of the second body and on: told apart by everybody (Okabe and Ito, 2008)
_PALETTE = ("#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7")


def make_pose(matrix: Array) -> Pose:
    """Make the scene's [pose]: `matrix` (4, 4) takes part.stl to the scene."""
    return Pose(matrix=_rows(matrix))


def pose_scene(part: Part) -> SettledScene:
    """Add to the part's scene, its mount resolved, the pose that takes the written files to it."""
    pose, scene = make_pose(part.pose.matrix), part.mounted.scene
    table, _ = part.framing
    sheets = () if table is None else table.sheets
    frame = tuple(
        FramePlate(
            file=sheet.name,
            matrices=tuple(_rows(motion) for motion in sheet.to_scene),
            bars=tuple(sheet.bars),
        )
        for sheet in sheets
    )
    lamps = scene.lamps.but(table=frame)
    return scene.but(pose=pose, lamps=lamps)


def write_part(
    folder: OutputFolder,
    part: Part,
    scene: SettledScene,
    targets: Sequence[Target],
    colours: bool = False,
    suffix: str = "",
) -> None:
    """Write part.stl and .3mf, knots.json, the pictures and scene.toml.

    Args:
        scene: with the pose (`pose_scene`).
        colours: whether part-colours.3mf is written too.
        suffix: in the names of part, knots and scene, such as "-01" of a sequence's frame.
    """
    about = about_part(part, scene, targets)
    write_stl(folder.file(f"part{suffix}.stl"), part.bodies)
    write_3mf(folder.file(f"part{suffix}.3mf"), part.bodies, about)
    if colours:
        count = len(part.bodies)
        paint = [scene.material.color, *(_PALETTE[k % len(_PALETTE)] for k in range(count - 1))]
        write_coloured_3mf(
            folder.file(COLOURED.replace(".", f"{suffix}.")), part.bodies, part.names, paint, about
        )
    table, _ = part.framing
    for sheet in () if table is None else table.sheets:
        own = replace(about, title=f"{about.title}, frame", thumbnail_png=b"")
        write_3mf(folder.file(sheet.name), sheet.bodies, own)
    to_part = np.asarray(np.linalg.inv(part.pose.matrix))
    makeup = part.mounted.makeup(to_part)
    more: dict[str, Any] = {key: some for key, some in makeup.items() if some}
    if (slab := part.mounted.slab(to_part)) is not None:
        more["plate"] = slab
    if part.standing is not None:
        bars = [bar.record() for bar in part.standing.bars]
        more |= {"feet": {"cut_mm": part.standing.cut_mm}, **({"bars": bars} if bars else {})}
    part.pose.knots.write(folder.file(f"knots{suffix}.json"), **more)
    _write_scene(folder, scene, targets, suffix)


def write_model(folder: OutputFolder, part: Part, scene: SettledScene, suffix: str = "") -> None:
    """Write part.glb, which is for viewing and is not verified. Arguments are as for `write_part`."""
    assert scene.pose is not None
    pose, color = np.array(scene.pose.matrix), scene.material.color
    write_glb(folder.file(f"part{suffix}.glb"), part.bodies, pose, part.names, color)


def write_unbuilt(
    folder: OutputFolder, made: Design, targets: Sequence[Target], suffix: str = ""
) -> SettledScene:
    """Write knots.json, the pictures and scene.toml of knots without a part; return that scene.

    The knots are enlarged as a part's would be (`enlarge_knots`), and the scene's pose takes them
    back.
    """
    scene = made.scene.but(pose=make_pose(shrink_of(made.scene)))
    enlarge_knots(made).write(folder.file(f"knots{suffix}.json"))
    _write_scene(folder, scene, targets, suffix)
    return scene


def _write_scene(
    folder: OutputFolder, scene: SettledScene, targets: Sequence[Target], suffix: str
) -> None:
    for view, target in zip(scene.views, targets, strict=True):
        folder.write(view.picture, encode_mask(target.asked))
        if (given := target.given) is not None:
            folder.write(scene.lamps.picture or f"given-{view.name}{given.suffix}", given.data)
        if target.bending is not None:
            folder.write(view.drawn_picture, encode_mask(target.mask))
    written = scene.but(views=tuple(view.as_written() for view in scene.views))
    folder.write(f"scene{suffix}.toml", dump_scene(written))


def _rows(matrix: Array) -> tuple[Row, Row, Row, Row]:
    a, b, c, d = ((float(w), float(x), float(y), float(z)) for w, x, y, z in matrix)
    return a, b, c, d


def write_glb(
    path: Path, bodies: Sequence[Mesh], pose: Array, names: Sequence[str], color: str
) -> None:
    """Write all `bodies` (vertices (n, 3) mm, faces (m, 3)) into one file of named meshes.

    Args:
        pose: (4, 4), from the bodies' coordinates to the scene, whose y is up as glTF's is.
        names, color: the bodies' names, and their common colour, "#rrggbb".
    """
    import trimesh as untyped

    took_part("trimesh", "wrote part.glb")
    trimesh: Any = untyped
    rgb = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    paint = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*rgb, 255], metallicFactor=0.0, roughnessFactor=0.7
    )
    scene = trimesh.Scene()
    for (vertices, faces), name in zip(bodies, names, strict=True):
        placed = 1e-3 * (vertices @ pose[:3, :3].T + pose[:3, 3])  # metres
        mesh = trimesh.Trimesh(placed, faces, process=False)
        mesh.visual = trimesh.visual.TextureVisuals(material=paint)
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    path.write_bytes(bytes(scene.export(file_type="glb")))


# What files say of the piece: its title, how to light it, and a small picture.

THUMBNAIL_PX = 300  # side of the picture in part.3mf
_INK = (61, 57, 53)


def about_part(part: Part, scene: SettledScene, targets: Sequence[Target]) -> About:
    """Collect the words of the part's 3MF files, from the scene's [about] and the piece.

    The title defaults to the pictures' names, the designer to knotfab. If the scene gives no licence
    terms, the file has none, since knotfab cannot know whose picture it is.
    """
    names = " and ".join(target.shown for target in targets)
    return About(
        title=scene.about.title or names,
        designer=scene.about.designer or "knotfab",
        description=_describe(part, scene.views, names),
        licence=scene.about.licence,
        thumbnail_png=_draw_thumbnail(part, scene.views[0]),
    )


def _draw_thumbnail(part: Part, view: ResolvedView) -> bytes:
    """Draw the knots as the view's light sees them, so that its picture shows: a square PNG."""
    curves = [knot.points for knot in part.pose.knots.moved(part.pose.matrix).knots]
    points, rings = np.concatenate(curves), polylines_of(curves)
    side = max(view.frame_mm)
    square = view.but(frame_width_mm=side, frame_height_mm=side)
    radius = part.pose.knots.radius_mm
    image = image_at(square, np.zeros((8, 8), dtype=bool), radius, THUMBNAIL_PX)
    dark = image.seen(points, rings, radius)
    return encode_image(Image.fromarray(np.where(dark[..., None], _INK, PAPER).astype(np.uint8)))


def _describe(part: Part, views: Sequence[ResolvedView], names: str) -> str:
    """Say in a sentence what the piece is and how to light it; setup.pdf says more."""
    view, knots = views[0], part.pose.knots
    tube = f"{count_in_words(len(knots.knots))} of a tube {length(2 * knots.radius_mm)} mm thick"
    tube = tube[:1].upper() + tube[1:]
    if len(views) > 1:
        return (
            f"{tube} with {len(views)} shadows: {names}; scene.toml says where lamps and walls are."
        )
    off = f"{length(view.light_distance_mm)} mm from its middle"
    if view.kind == "eye":
        return f"{tube} that an eye {off} sees as {names}."
    lamp = f"a lamp {length(view.light_size_mm)} mm wide" if view.light_size_mm else "a small lamp"
    size = " × ".join(length(side) for side in view.frame_mm)
    wall = f"the wall {length(view.wall_distance_mm)} mm behind"
    return f"{tube} whose shadow is {names}: {size} mm on {wall}, by {lamp}, {off}."
