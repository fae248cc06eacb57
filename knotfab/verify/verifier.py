"""The validators as a build and the command line call them."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any, NoReturn

from knotfab.errors import InputError, MachineError

__all__ = ["Verifier", "render_shadow"]

NO_GRAPHICS = "--no-graphics"


HALVES = ("shadows", "geometry")  # of the validators' work, in the order of their children


class Verifier:
    """`python -m knotfab_validators` as children: they load VTK while their parent still searches.

    Two share the work where there are shadows to verify: geometry and shadows take about as long. A
    graphics library that crashes takes its child down, not the build; the answer is then a
    MachineError that says what to do.
    """

    def __init__(self, graphics: bool = True, shadows: bool = True) -> None:
        self._arguments = [[] if graphics else [NO_GRAPHICS], [NO_GRAPHICS]][not shadows :]
        self._children: list[subprocess.Popen[str]] = []

    def __enter__(self) -> Verifier:
        for arguments in self._arguments:
            child = subprocess.Popen(
                # -P: modules come from the installation, never from the folder one happens to be in
                [sys.executable, "-P", "-m", "knotfab_validators", *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                # Ctrl-C is for the parent, which then ends the child
                start_new_session=True,
            )
            self._children.append(child)
        return self

    def __exit__(self, *_: object) -> None:
        for child in self._children:
            child.kill()
            child.communicate()
        self._children = []

    def begin(
        self,
        part: Path | None,
        knots: Path | None,
        scene: Path | None,
        skip: Collection[str],
        pictures_dir: Path | None,
        failures: Path | None = None,
    ) -> None:
        """Hand over the written files; `verdict` waits for the answer."""
        self._files = {"part": part, "knots": knots, "scene": scene, "pictures_dir": pictures_dir}
        self._failures = failures
        request: dict[str, Any] = {k: None if p is None else str(p) for k, p in self._files.items()}
        request |= {"skip": sorted(skip), "failures": None}
        both = len(self._children) == len(HALVES)
        for child, half in zip(self._children, HALVES, strict=False):
            assert child.stdin is not None
            try:
                child.stdin.write(json.dumps({**request, "only": half if both else None}) + "\n")
                child.stdin.flush()
            except BrokenPipeError:
                _, err = child.communicate()
                _crashed(child, err)

    def verdict(self) -> dict[str, Any]:
        """{"status", "exit_code", "checks", "views", "picture", "seconds"} of the files.

        Raises:
            MachineError: a child crashed. InputError: it could not read a file.
        """
        answers = [_answer(child) for child in reversed(self._children)]
        codes = [answer["exit_code"] for answer in answers]
        whole: dict[str, Any] = {
            "status": "pass" if all(a["status"] == "pass" for a in answers) else "fail",
            "exit_code": next((code for code in (1, 3) if code in codes), 0),
            "checks": [check for answer in answers for check in answer["checks"]],
            "views": [view for answer in answers for view in answer["views"]],
            "seconds": {k: v for answer in answers for k, v in answer["seconds"].items()},
        }
        return {**whole, "picture": self._drawn(whole["checks"])}

    def _drawn(self, checks: list[dict[str, Any]]) -> str | None:
        """Draw what failed; None where nothing did, or it could not be drawn."""
        if self._failures is None or not any(
            c["status"] == "fail" and c["required"] for c in checks
        ):
            return None
        from knotfab_validators.check import Check
        from knotfab_validators.failure_picture import draw_failures
        from knotfab_validators.files.knots import read_knots
        from knotfab_validators.files.mesh import read_mesh

        part, knots = self._files["part"], self._files["knots"]
        found = [Check(**{**c, "at": tuple(map(tuple, c["at"]))}) for c in checks]
        try:
            mesh = None if part is None else read_mesh(part)
            curves = None if knots is None else read_knots(knots)
            drawn = draw_failures(self._failures, found, mesh, curves)
        except OSError as error:
            raise InputError(
                str(self._failures),
                f"it cannot be written ({error.strerror or error})",
                "Choose another place for --failures",
            ) from error
        return str(self._failures) if drawn else None


def _answer(child: subprocess.Popen[str]) -> dict[str, Any]:
    out, err = child.communicate()
    try:
        # a whole answer counts, even if the graphics library then crashes as it is unloaded
        answer: dict[str, Any] = json.loads(out.strip().splitlines()[-1])
    except (IndexError, ValueError):
        _crashed(child, err)
    if "error" in answer:
        raise _unreadable(str(answer["error"]))
    return answer


def _crashed(child: subprocess.Popen[str], err: str) -> NoReturn:
    code = child.wait()
    how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    last = (err.strip().splitlines() or [""])[-1].strip().rstrip(".")
    raise MachineError(
        "verification",
        f"its process ended with {how}" + (f" ({last})" if last else ""),
        "If graphics are the cause, install them (apt-get install libegl1 libgl1) or go on without "
        "rendering (--skip shadow-render); knotfab doctor says what this machine lacks.",
    )


def _unreadable(sentence: str) -> InputError:
    """The validators' `NAME: reason` about a file that they cannot read."""
    name, _, reason = sentence.partition(": ")
    if not reason:
        name, reason = "the files", sentence
    return InputError(name, reason.rstrip("."), "Correct that file, or name another.")


def render_shadow(part: Path, scene: Path, out: Path, view_name: str | None = None) -> None:
    """Write the picture of the shadow that `part` casts in a view of `scene`.

    Raises:
        InputError: a file cannot be read, there is no such view, or `out` cannot be written.
        MachineError: this machine cannot render.
    """
    import numpy as np

    from knotfab_validators.files.mesh import read_mesh
    from knotfab_validators.files.picture import read_silhouette
    from knotfab_validators.files.scene import read_scene
    from knotfab_validators.shadows.frame import working_frame
    from knotfab_validators.shadows.pictures import write_shadow
    from knotfab_validators.shadows.render import CannotRender, SilhouetteRenderer
    from knotfab_validators.shadows.view import view_geometry

    if out.suffix.lower() != ".png":
        raise InputError(f"--out {out}", "the shadow is written as PNG", "Name a file in .png.")
    staged = out.with_name(f".{out.stem}-new.png")
    try:
        setting, mesh = read_scene(scene), read_mesh(part)
        named = [v for v in setting.views if view_name in (None, v.name)]
        if not named:
            names = ", ".join(v.name for v in setting.views)
            raise InputError(
                f"--view {view_name}", "the scene has no such view", f"It has: {names}"
            )
        height, width = read_silhouette(scene.parent / named[0].picture).shape
        pose = np.eye(4) if setting.pose is None else np.asarray(setting.pose, dtype=np.float64)
        vertices = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
        frame = working_frame(width, height)
        geometry = view_geometry(named[0], width, height).resampled(frame)
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
        raise _unreadable(str(error)) from error
    except OSError as error:
        why = f"it cannot be written ({error.strerror or error})"
        raise InputError(str(out), why, "Choose another place for --out.") from error
