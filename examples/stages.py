"""The stages one by one, as a script of one's own would call them: from a glyph to a verified part.

`python -m examples.stages [PICTURE] [FOLDER]`
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from knotfab.design.design import opening_iou, problem_of, resolve_view
from knotfab.files.stl import write_stl
from knotfab.geometry.tube import sweep
from knotfab.part.pose import choose_pose
from knotfab.scene.catalogue import resolve
from knotfab.scene.load import dump_scene
from knotfab.scene.model import Pose, Scene
from knotfab.scene.settings import search_settings
from knotfab.search.search import search
from knotfab.start.filling import fill
from knotfab.target.read import read_target

__all__ = ["main"]


def main(picture: str = "text:♥", out: Path = Path("stages-out"), accuracy: str = "draft") -> float:
    """Build `picture` into `out`, printing what each stage gives; returns the verified IoU."""
    out.mkdir(parents=True, exist_ok=True)

    target = read_target(picture)
    print(f"target: {target.width} x {target.height} px, {target.mask.mean():.0%} filled")

    scene = resolve(Scene(), [(target.width, target.height)])
    view = resolve_view(scene.views[0], target)
    scene = scene.model_copy(update={"views": (view,)})
    problem = problem_of(scene, target)
    print(f"scene: lamp at {view.light_distance_mm:g} mm, wall {view.wall_distance_mm:g} mm behind")

    radius = 2.5
    template = fill(problem.polygon, radius)
    length = sum(np.linalg.norm(np.diff(c, axis=0), axis=1).sum() for c in template.curves)
    print(f"template: {len(template.curves)} curve(s), {length:.0f} mm, all unknots")

    found = search(problem, template, radius, search_settings(accuracy, {}))
    print(
        f"search: IoU {found.iou_estimate:.4f} (a tube of this radius without spill: "
        f"{opening_iou(problem.polygon, radius):.4f}), {found.account.accepted} certified steps, "
        f"bends from {found.standing.bend_mm:.2f} mm, strands {found.standing.gap_mm:.2f} mm apart"
    )

    tubes = [sweep(k.points, radius, 48) for k in found.knots.knots]
    pose = choose_pose(found.knots, tubes, scene.printer.build_volume_mm)
    print(f"part: {' x '.join(f'{s:.0f}' for s in pose.size_mm)} mm on the bed")

    write_stl(out / "part.stl", list(pose.tubes))
    pose.knots.write(out / "knots.json")
    (out / view.picture).write_bytes(target.png_bytes)
    rows = pose.matrix.tolist()
    piece = scene.piece.model_copy(update={"tube_radius_mm": radius})
    accepted = scene.accuracy.model_copy(update={"iou_floor": 0.9})
    posed = scene.model_copy(
        update={
            "pose": Pose(matrix=(rows[0], rows[1], rows[2], rows[3])),
            "piece": piece,
            "accuracy": accepted,
            "region": problem.region,
        }
    )
    (out / "scene.toml").write_text(dump_scene(posed), encoding="utf-8")

    from knotfab_validators.validate import validate

    verdict = validate(out / "part.stl", out / "knots.json", out / "scene.toml")
    for check in verdict.checks:
        print(f"  {check.status:<7} {check.name}: {check.measured} {check.unit}")
    return float(verdict.views[0]["iou"])


if __name__ == "__main__":
    main(*sys.argv[1:2], *[Path(p) for p in sys.argv[2:3]])
