"""Build a piece or a sequence: from pictures to a folder of parts, verified after they were written."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

from knotfab.base.folder import OutputFolder
from knotfab.base.pool import count_jobs
from knotfab.base.progress import Progress
from knotfab.hold.modeller import keep_modeller
from knotfab.pipeline.verifier import Verifier
from knotfab.plan import Attempts
from knotfab.request import Outcome, Request, require_device
from knotfab.scene.require import require_sequence
from knotfab_formats.libraries import recording


def run_build(request: Request, progress: Progress | None = None) -> Outcome:
    """Build a piece, or the frames of a sequence: search, sweep, mount, pose, write, verify, slice, report.

    The folder then holds the files of the contract. What fails a required check is written whole to
    DIR/rejected, and an earlier good result stays as it was.

    Raises:
        KnotfabError: with the exit code of its kind; nothing is left half-written.
    """
    progress, film = progress or Progress("quiet"), request.sequence
    attempts = Attempts(progress)
    require_device(request)
    if film:
        require_sequence(request.scene)
    else:
        progress.plan(_usual_seconds(request))
    with recording(), OutputFolder(request.out) as folder, ExitStack() as stack:
        for line in request.preview:
            progress.say(line)
        # frames side by side, each with two processes to verify and one to slice
        jobs = min(len(request.targets), max(1, count_jobs() // 2)) if film else 1
        verifier = stack.enter_context(Verifier(request.skip, jobs=jobs))
        # imported only now, while the validators load in their own processes
        from knotfab.part.slicer import SlicerQueue
        from knotfab.pipeline.finish import finish_build
        from knotfab.pipeline.plan import plan_piece, plan_supports
        from knotfab.pipeline.workshop import Workshop

        slicer = stack.enter_context(SlicerQueue(jobs=jobs))
        stack.enter_context(keep_modeller(request.mounted))
        shop = Workshop(folder, verifier, slicer, progress)
        if film:
            from knotfab.pipeline.film import plan_film

            pieces, report = attempts.carry_out(plan_supports(shop, request, plan_film))
            title = "a sequence"
        else:
            piece, report = attempts.carry_out(plan_supports(shop, request, plan_piece))
            pieces, title = [piece], " and ".join(target.shown for target in request.targets)
        report = replace(report, attempts=tuple(attempts.made))
        return finish_build(folder, request, report, title, pieces, progress)


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
    """Estimate the seconds of each stage, from which progress estimates the time left."""
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
