"""The public functions: a whole build as one call, and its stages one by one, from data to data.

Everything heavy is imported where it is needed.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from re import Match
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from knotfab.base.errors import OPTION
from knotfab.base.progress import Event, Progress
from knotfab.picture.read import Target, read_target
from knotfab_formats.errors import InputError, KnotfabError
from knotfab_formats.libraries import recording
from knotfab_formats.scene import Scene
from knotfab_formats.views import Reading, View

if TYPE_CHECKING:
    from torch import Tensor

    from knotfab.design.design import Design
    from knotfab.design.question import Question
    from knotfab.knots import Knot
    from knotfab.part.assemble import Part
    from knotfab.problem import Start
    from knotfab.request import Outcome
    from knotfab.search.objective import Term
    from knotfab.search.state import SearchResult
    from knotfab_formats.search import SearchSettings

Source = str | Path | Any  # a file, text:…, a picture of PIL, or an array


def build(
    pictures: Source | Sequence[Source] = (),
    out: str | Path | None = None,
    *,
    progress: Callable[[Event], object] | None = None,
    **options: Any,
) -> Outcome:
    """Turn a picture, or several, into a verified part: what `knotfab build` does.

    Args:
        pictures: an image file, an SVG, `text:…`, a picture of PIL, or an array, (H, W) or (H, W, 3), of
            bytes or truth values (True is drawn); several are several views of one part, or with
            `sequence=True` frames of one moving knot; none: those that the scene names.
        out: the folder to write; by default knotfab-out/NAME, after the picture.
        progress: called with each thing that happens, from any thread. What it raises ends the build as an
            error does: it is raised here, and nothing stays half-written.
        options: those of the command line by their names, with `_` for `-` (`print_=True` for `--print`):
            `mount="wall"`, `accuracy="draft"`, `tube_radius=2.5`, `time_budget=30`.

    Returns:
        `exit_code` by the contract, `folder` (where the files are), and `report`, the content of
        report.json. The process of the validators stays for the next call, and ends with this one.

    Raises:
        InputError: an option, the scene or a picture is wrong. SceneError: the scene cannot be met.
        MachineError: this machine lacks something.
    """
    from knotfab.pipeline.options import options_from
    from knotfab.pipeline.prepare import prepare_build
    from knotfab.pipeline.verifier import load_early

    sources: list[Source] = [pictures]
    if isinstance(pictures, Sequence) and not isinstance(pictures, str):
        sources = list(pictures)
    with _in_keywords(""):
        given = options_from({**options, "out": out})
    words = [f"{key}={value!r}" for key, value in options.items()]
    shown = [str(s) if isinstance(s, str | Path) else f"<{type(s).__name__}>" for s in sources]
    command = f"knotfab.build({', '.join([repr(shown), repr(out and str(out)), *words])})"
    with (
        load_early(given.skip, keep=True),
        recording(),
        TemporaryDirectory() as folder,
        _in_keywords(f"{folder}{os.sep}"),
        Progress("quiet", heard=progress) as told,
    ):
        files = [
            _file_of(s, Path(folder) / f"picture-{n}.png") for n, s in enumerate(sources, start=1)
        ]
        request = prepare_build(files, given, command, told)
        from knotfab.pipeline.build import run_build

        outcome = run_build(request, told)
        told.tell("end", exit_code=outcome.exit_code, folder=str(outcome.folder))
    return outcome


@contextmanager
def _in_keywords(place: str) -> Iterator[None]:
    """Rewrite errors to name options as keywords, `tube_radius=2` for `--tube-radius 2`, and no folder."""
    from knotfab.pipeline.options import BuildOptions

    def keyword(found: Match[str]) -> str:
        name, value = found[1].replace("-", "_"), found[2]
        if name != "print" and name not in BuildOptions.__dataclass_fields__:
            return found[0]
        if not value:
            return name
        return f"{name}={value!r}" if value.islower() else f"{name}={value}"

    def plain(sentence: str) -> str:
        sentence = sentence.replace(place, "") if place else sentence
        return sentence if "knotfab " in sentence else OPTION.sub(keyword, sentence)

    try:
        yield
    except KnotfabError as error:
        words = (error.what, error.why, error.remedy)
        raise type(error)(*map(plain, words)) from error


def read_picture(source: Source, *, font: str | None = None, **reading: Any) -> Target:
    """Read a picture and take its silhouette: a file, an SVG, or `text:` and characters.

    Args:
        reading: keys of a view that say how it is read: `invert=True`, `ink="dark"`, `threshold=0.3`,
            `crop_px="auto"`, `keep_largest=1`, `speck_px=20`, `smooth_px=2`.

    Raises:
        InputError: it cannot be read, or holds no silhouette; or a key is wrong.
    """
    try:
        for key in reading.keys() & (View.model_fields.keys() - Reading.model_fields.keys()):
            raise InputError(
                "read_picture", f"{key} does not say how a picture is read", "Leave it out."
            )
        how = Scene.model_validate({"views": [reading]}, context="read_picture").views[0]
    except InputError as error:
        why = error.why.replace("[[views]] number 1 ", "")
        raise InputError(error.what, why, error.remedy) from error
    with TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        try:
            return read_target(_file_of(source, path), how, font=font)
        except InputError as error:
            what = error.what.replace(str(path), "the picture")
            raise InputError(what, error.why, error.remedy) from error


def _file_of(source: Source, path: Path) -> str:
    """Return the path of a picture, which is first written to `path` if it is not a file.

    Raises:
        InputError: it is not a picture.
    """
    from PIL import Image

    if isinstance(source, str | os.PathLike):
        return os.fspath(source)
    try:
        image = source
        if not isinstance(source, Image.Image):
            pixels = np.asarray(source)
            image = Image.fromarray(~pixels if pixels.dtype == bool else pixels)
        image.save(path)
    except (TypeError, ValueError, OSError, AttributeError) as error:
        why = f"a {type(source).__name__} is none that can be read"
        remedy = "Give a path, text:…, a picture of PIL, or an array (H, W) or (H, W, 3) of bytes."
        raise InputError("the picture", why, remedy) from error
    return str(path)


def design_knots(
    scene: Scene, targets: Sequence[Target], *, device: str = "cpu", budget_s: float | None = None
) -> Design:
    """Design feasible knots for a scene and the pictures of its views, in their order.

    Args:
        budget_s: seconds that this may take.

    Raises:
        SceneError: the scene cannot be met. InputError: the scene or a picture is wrong.
    """
    from knotfab.design.budget import Budget
    from knotfab.design.design import design_knots as design
    from knotfab.scene.catalogue import resolve

    budget = None if budget_s is None else Budget(time.perf_counter() + budget_s)
    return design(resolve(scene), targets, device, None, budget)


def pose_question(scene: Scene, targets: Sequence[Target]) -> Question:
    """Set up a search's question: views with their frames, silhouettes and bounds, and the limits.

    Raises:
        InputError: the scene or a picture is wrong.
    """
    from knotfab.design.question import ask
    from knotfab.scene.catalogue import resolve

    return ask(resolve(scene), targets)


def choose_tube(question: Question, accuracy: str = "standard") -> tuple[Question, float, Start]:
    """Choose the tube's radius (mm), unless the scene sets it, and start curves of known type.

    Returns:
        The question with the depth that this radius leaves, the radius, and the start.

    Raises:
        SceneError: no tube draws the pictures.
    """
    from knotfab.design.design import choose_tube as choose

    settings = _settings_for(question, accuracy, {})
    question, radius, start, _ = choose(question, settings, Progress("quiet"))
    return question, radius, start


def search_knots(
    question: Question,
    start: Start,
    radius: float,
    accuracy: str = "standard",
    *,
    terms: Sequence[Term | Callable[[Tensor], Tensor]] = (),
    device: str = "cpu",
    **settings: Any,
) -> SearchResult:
    """Search for knots that draw every picture of the question, by certified steps from the start.

    Args:
        radius: radius of the tube, mm. settings: keys of [search], which override the scene's.
        terms: further parts of the objective: functions in torch of the vertices [N, 3], mm, to a scalar
            (such as `lambda points: 0.01 * points[:, 1].relu().square().mean()`), or instances of `Term`.

    Returns:
        `knots`, `ious`, and whether it is `feasible`, or which limit is violated and where.
    """
    from knotfab.design.design import refine_settings
    from knotfab.search.objective import Term
    from knotfab.search.search import search
    from knotfab.search.term import TorchTerm

    # vertices as close together as the outline's limit needs them
    fine = refine_settings(question, _settings_for(question, accuracy, settings), radius)
    own = tuple(
        t if isinstance(t, Term) else TorchTerm(t, _name_of(t, n))
        for n, t in enumerate(terms, start=1)
    )
    return search(question.problem, start, radius, fine, terms=own, device=device)


def _name_of(term: object, number: int) -> str:
    name = getattr(term, "__name__", type(term).__name__)
    return f"{number} of terms" if name == "<lambda>" else name


def settle_design(question: Question, result: SearchResult, accuracy: str = "standard") -> Design:
    """Turn a search's result into a design: its knots, and the scene with every choice made."""
    from knotfab.design.design import settle_design as settle

    return settle(question, result, _settings_for(question, accuracy, {}))


def _settings_for(question: Question, accuracy: str, settings: Mapping[str, Any]) -> SearchSettings:
    """Return the search settings that a build would use: accuracy < scene < `settings`."""
    from knotfab.design.settings import suit_settings
    from knotfab_formats.search import search_settings

    given = {**question.scene.search, **settings}
    return suit_settings(search_settings(accuracy, given), question, given)


def sweep_tube(
    knot: Knot, radius: float, sides: int = 48
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Sweep a watertight tube about a closed knot: vertices (n, 3), mm, and triangles (m, 3).

    Raises:
        SceneError: it bends tighter than a tube of this radius can.
        InputError: the radius is not above 0.
    """
    from knotfab.geometry.tube import sweep

    if not radius > 0:
        raise InputError(f"radius={radius:g}", "a tube has a radius above 0", "Give one, in mm.")

    return sweep(knot.points, radius, sides)


def assemble_part(design: Design, targets: Sequence[Target], *, printing: bool = True) -> Part:
    """Build the part: one watertight tube per knot with its mount, in print pose.

    Raises:
        SceneError: the piece does not fit the printer, or its mount does not fit the piece.
    """
    from knotfab.part.assemble import part_of

    return part_of(design, printing, targets)


def write_files(part: Part, targets: Sequence[Target], folder: str | Path) -> Path:
    """Write part.stl, part.3mf, part.glb, knots.json, scene.toml and the pictures, all or none.

    Raises:
        InputError: the folder cannot be written.
    """
    from knotfab.base.folder import OutputFolder
    from knotfab.part.write import pose_scene, write_model, write_part

    with OutputFolder(Path(folder)) as staged:
        scene = pose_scene(part)
        write_part(staged, part, scene, targets)
        write_model(staged, part, scene)
        staged.commit()
    return Path(folder)


def validate_part(
    part: str | Path | None,
    knots: str | Path | None = None,
    scene: str | Path | None = None,
    unit: str = "mm",
) -> dict[str, Any]:
    """Check written files with independent code; a folder stands for the files in it.

    Args:
        unit: unit of a part whose file knows none: "mm", "cm", "m" or "in".

    Returns:
        {"status", "checks", "views"}, as `knotfab validate --json` prints it.

    Raises:
        InputError: a file cannot be read, or there is no such unit.
        MachineError: this machine cannot measure it.
    """
    from knotfab.pipeline.strangers import validate_files
    from knotfab.pipeline.verifier import files_to_validate
    from knotfab_validators.files.mesh import UNITS_MM

    if unit not in UNITS_MM:
        raise InputError(
            f"unit={unit!r}", "there is no such unit", f"Give one of {', '.join(UNITS_MM)}."
        )
    given = (None if path is None else Path(path) for path in (part, knots, scene))
    return validate_files(files_to_validate(*given), unit=unit, keep=True).to_dict()
