"""Build a piece: from pictures to a folder with a part that was verified after it was written."""

from __future__ import annotations

from dataclasses import replace

from knotfab.base.errors import SceneError
from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.hold.modeller import keep_modeller
from knotfab.picture.read import read_targets
from knotfab.pipeline.verifier import Verifier
from knotfab.request import Outcome, Request, require_device
from knotfab_formats.libraries import recording


def run_build(request: Request, progress: Progress | None = None) -> Outcome:
    """Build what was asked: a piece, or a sequence of them; the other way where the first one fails.

    Raises:
        KnotfabError: with the exit code of its kind; nothing is left half-written.
    """
    progress, run = progress or Progress("quiet"), build
    if request.sequence:
        from knotfab.pipeline.film import build_sequence as run
    with recording():
        try:
            return run(request, progress)
        except SceneError as error:
            if request.otherwise is None:
                raise
            why = f"{error.what}: {error.why}"
        progress.say(f"Built again with the slicer's supports, for without them {why}")
        return run(
            replace(request, scene=request.otherwise, otherwise=None, why_supported=why), progress
        )


def build(request: Request, progress: Progress | None = None) -> Outcome:
    """Build one piece: search, sweep, mount, pose, write, verify, slice, report.

    The folder then holds the files of the contract. A piece that fails a required check is written whole to
    DIR/rejected, and an earlier good result stays as it was.

    Raises:
        KnotfabError: with the exit code of its kind; nothing is left half-written.
    """
    progress = progress or Progress("quiet")
    require_device(request.device)
    progress.plan(_usual_seconds(request))
    with OutputFolder(request.out) as folder:
        for line in request.preview:
            progress.say(line)
        with progress.stage("picture"):
            views = request.scene.views
            targets = list(
                request.targets or read_targets(request.pictures, views, base=request.base)
            )
        with Verifier(request.skip) as verifier:
            # imported only now, while the validators load in their own processes
            from knotfab.design.design import design_knots
            from knotfab.part.slicer import SlicerQueue
            from knotfab.pipeline.finish import finish_build
            from knotfab.pipeline.held import Workshop

            mounted = request.is_mounted(request.scene.count_knots(targets[0].pieces))
            left, device = request.budget(progress.total, mounted), request.device
            with SlicerQueue() as slicer, keep_modeller(mounted or "step" in request.also):
                made = design_knots(request.scene, targets, device, progress, left)
                shop = Workshop(targets, folder, verifier, slicer, progress)
                finish = shop.finish_held if request.chooses_holder else shop.finish
                piece, report = finish(request, made)
        title = " and ".join(target.shown for target in targets)
        return finish_build(folder, request, report, title, [piece], progress)


# for one view in draft; progress corrects them by what this machine takes
_USUAL_S = {
    "question": 0.1,
    "radius": 0.6,
    "template": 0.1,
    "search": 0.5,
    "part": 0.4,
    "verify": 1.2,
    "report": 0.1,
}
_USUAL_PRINTED_S = {"verify": 0.3, "slicer": 8.0, "drawings": 2.0}
_LONGER = {"sketch": 0.4, "draft": 1.0, "standard": 3.5, "fine": 7.0}  # factors for the search
_FREE = 10.0  # factor for a search that finds the pose as well


def _usual_seconds(request: Request) -> dict[str, float]:
    """Estimate the seconds of each stage, from which progress tells the time left."""
    scene = request.scene
    longer, views = _LONGER[scene.accuracy.name], len(scene.views)
    usual = {name: seconds * longer**0.5 * views for name, seconds in _USUAL_S.items()}
    usual["search"] *= longer**0.5 * (_FREE if scene.settings.free_view else 1.0)
    if scene.piece.tube_radius_mm is not None or scene.settings.start:
        del usual["radius"]
    if request.time_budget_s is not None:
        usual["search"] = max(1.0, request.time_budget_s - sum(usual.values()) + usual["search"])
    if request.printing:
        usual |= {name: usual.get(name, 0.0) + s for name, s in _USUAL_PRINTED_S.items()}
        if "slicer" in request.skip:
            del usual["slicer"]
    return usual
