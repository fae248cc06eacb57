"""The picture of the shadow that a written part casts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from knotfab.base.disk import require_within
from knotfab.base.errors import InputError, MachineError
from knotfab.verify.verifier import explain_unreadable

__all__ = ["render_shadow"]


def render_shadow(part: Path, scene: Path, out: Path, view_name: str | None = None) -> None:
    """Write the picture of the shadow that `part` casts in a view of `scene`.

    Raises:
        InputError: a file cannot be read, there is no such view, or `out` cannot be written.
        MachineError: this machine cannot render.
    """
    from knotfab_validators.files.mesh import read_mesh
    from knotfab_validators.files.picture import read_silhouette
    from knotfab_validators.files.scene import read_scene
    from knotfab_validators.shadows.frame import working_frame
    from knotfab_validators.shadows.pictures import write_shadow
    from knotfab_validators.shadows.render import CannotRender, SilhouetteRenderer
    from knotfab_validators.shadows.view import view_geometry
    from knotfab_validators.shadows.wall import receive

    if out.suffix.lower() != ".png":
        raise InputError(f"--out {out}", "the shadow is written as PNG", "Name a file in .png.")
    for path in (part, scene):
        require_within(path)
    staged = out.with_name(f".{out.stem}-new.png")
    try:
        setting, mesh = read_scene(scene), read_mesh(part)
        named = [v for v in setting.views if view_name in (None, v.name)]
        if not named:
            names = ", ".join(v.name for v in setting.views)
            raise InputError(
                f"--view {view_name}", "the scene has no such view", f"It has: {names}"
            )
        require_within(scene.parent / named[0].picture)
        height, width = read_silhouette(scene.parent / named[0].picture).shape
        pose = (
            np.eye(4) if setting.pose is None else np.asarray(setting.pose.matrix, dtype=np.float64)
        )
        vertices = setting.material.shrinks_to * mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        frame = working_frame(width, height)
        whole, _ = receive(
            view_geometry(named[0], width, height),
            setting.effects,
            setting.settings.tolerance_px,
        )
        geometry = whole.resample(frame)
        with SilhouetteRenderer(vertices, mesh.faces) as renderer:
            seen = renderer.render(geometry)
        out.parent.mkdir(parents=True, exist_ok=True)
        try:
            write_shadow(staged, seen, frame)
            staged.replace(out)
        finally:
            staged.unlink(missing_ok=True)
    except CannotRender as error:
        raise MachineError("rendering", error.reason, error.remedy) from error
    except ValueError as error:
        raise explain_unreadable(str(error)) from error
    except OSError as error:
        why = f"it cannot be written ({error.strerror or error})"
        raise InputError(str(out), why, "Choose another place for --out.") from error
