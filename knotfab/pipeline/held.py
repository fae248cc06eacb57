"""Finish a piece: write, verify and report it, on the holder that is asked for or that serves best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from knotfab.base.errors import SceneError
from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.design.design import Design
from knotfab.geometry.tube import join_meshes
from knotfab.hold.modeller import rest_modeller
from knotfab.part.assemble import Part
from knotfab.part.holders import WORDS, Guess, guess_holders
from knotfab.part.slicer import SlicerQueue
from knotfab.part.slicer_profile import write_profile
from knotfab.picture.read import Target
from knotfab.pipeline.finish import report_piece
from knotfab.pipeline.piece import Settled, WrittenPiece, discard_piece, settle, write_piece
from knotfab.pipeline.verifier import Verifier
from knotfab.render.part_picture import draw_part, place_eyes
from knotfab.report.page import load_template
from knotfab.request import Request
from knotfab_formats.report import Report
from knotfab_formats.scene import SettledScene
from knotfab_formats.verdict import WORDS as BEST_FIRST
from knotfab_formats.verdict import list_unmet

_SEEN_SHARE = 0.0005  # of the frame: what a holder darkens beyond that is told


@dataclass(frozen=True)
class Workshop:
    """What finishing a piece takes: its pictures, its folder, and who verifies and slices it."""

    targets: Sequence[Target]
    folder: OutputFolder
    verifier: Verifier
    slicer: SlicerQueue
    progress: Progress

    def finish(
        self, request: Request, made: Design, settled: Settled | None = None, note: str = ""
    ) -> tuple[WrittenPiece, Report]:
        """Write a design's piece, have it verified and sliced, and report it.

        Args:
            settled: its part, where it has been made already. note: a sentence for the report.
        """
        folder, progress = self.folder, self.progress
        if request.printing:
            write_profile(folder.work, made.scene)
        work = folder, request, self.verifier, self.slicer, progress
        piece = write_piece(made, self.targets, *work, settled=settled)
        piece = replace(piece, notes=(*piece.notes, *filter(None, [note])))
        rest_modeller()
        if piece.part is not None:
            with progress.stage("verify"):  # while the validators measure
                _draw(piece.part, piece.scene, folder.file("part.png"))
                load_template()
        return piece, report_piece(piece, folder, request, progress)

    def finish_held(self, request: Request, made: Design) -> tuple[WrittenPiece, Report]:
        """Finish the piece on the holder that costs least of those that pass every check, else on none.

        Holders are planned in the order of a guess of their hours and grams, and only one that can be
        planned is built and verified. The next is tried where a check fails: not under a time budget, nor
        where the knots break a limit, nor where it failed the same checks as the one before. One that spoils
        the word gives way to one that does not and is not dear (`_keep_word`).
        """
        refused: list[str] = []
        failed: set[str] = set()
        guesses = guess_holders(made, self.targets)
        for guess in guesses:
            asked, design = _with_mount(request, made, guess.kind)
            settled = self._plan(asked, design)
            if isinstance(settled, str):
                refused.append(f"{WORDS[guess.kind]} ({settled})")
                continue
            shows = _shows(settled)
            said = _tell_choice(guess, guesses, refused, shows)
            piece, report = self.finish(asked, settled[0], settled, said)
            unmet = _list_failed(report)
            once = request.time_budget_s is not None or not made.result.feasible
            if once or (unmet and unmet == failed):
                return piece, report
            if not unmet:
                later = guesses[guesses.index(guess) + 1 :] if shows >= _SEEN_SHARE else []
                rank = _rank_word(report)
                # no price is too high for a piece that is coarse
                paler = [one for one in later if rank > 1 or not one.is_dear_beside(guess)]
                if not rank or not paler:
                    return piece, report
                first = asked, settled[0], settled, said
                return self._keep_word(request, made, (piece, report), first, paler)
            failed = unmet
            refused.append(f"{WORDS[guess.kind]} (failed: {', '.join(sorted(unmet))})")
            discard_piece(piece, self.folder)
        asked, design = _with_mount(request, made, "none")
        why = "; ".join(refused) or "none is known for this scene"
        if made.scene.piece.supports == "none":
            why = "members between strands need supports; --plate outline needs none"
        return self.finish(asked, design, note=f"No holder was found: {why}.")

    def _keep_word(
        self,
        request: Request,
        made: Design,
        done: tuple[WrittenPiece, Report],
        first: tuple[Request, Design, Settled, str],
        others: Sequence[Guess],
    ) -> tuple[WrittenPiece, Report]:
        """Finish a piece on the first of other holders that is not seen, if its word is better there.

        Args:
            done: the piece as it is on its holder. first: what it was finished from.
        """
        for guess in others:
            asked, design = _with_mount(request, made, guess.kind)
            settled = self._plan(asked, design)
            shows = 1.0 if isinstance(settled, str) else _shows(settled)
            if isinstance(settled, str) or shows >= _SEEN_SHARE:
                continue
            discard_piece(done[0], self.folder)
            why = f"Held by {guess}, since the shadow suffers on what takes less. --mount none leaves it out."
            other = self.finish(asked, settled[0], settled, why)
            if not _list_failed(other[1]) and _rank_word(other[1]) < _rank_word(done[1]):
                return other
            discard_piece(other[0], self.folder)
            return self.finish(*first)
        return done

    def _plan(self, request: Request, made: Design) -> Settled | str:
        """Plan the piece on the mount that is asked for, or say why it does not hold."""
        try:
            settled = settle(request, made, self.targets, self.progress)
        except SceneError as error:
            return error.why
        sag = settled[1].mounted.check_sag()
        if sag is not None and sag.status == "fail":
            return f"it sags {sag.measured:.2g} mm"
        return settled


def _shows(settled: Settled) -> float:
    """Return the share of the picture's frame that a holder darkens, as its plan has it."""
    return settled[1].mounted.figures.predicted_intrusion or 0.0


def _list_failed(report: Report) -> set[str]:
    return {check.name for check in list_unmet(report.checks) if check.status == "fail"}


def _rank_word(report: Report) -> int:
    """Return how far a report's word is from the best one; 0 where there is none."""
    return 0 if report.verdict is None else BEST_FIRST.index(report.verdict.word)


def _with_mount(request: Request, made: Design, kind: str) -> tuple[Request, Design]:
    """Return request and design with the mount given; the search went by what was left open."""
    turns = not request.scene.hangs(len(made.knots.knots))
    given = {"kind": kind, "turns": turns}
    asked = request.scene.but(mount=request.scene.mount.but(**given))
    own = made.scene.but(mount=made.scene.mount.but(**given))
    return replace(request, scene=asked), replace(made, scene=own)


def _tell_choice(
    guess: Guess, guesses: Sequence[Guess], refused: Sequence[str], shows: float
) -> str:
    """Say which holder was chosen and what it costs, which cost more, and why others are none.

    Args:
        shows: the share of the picture's frame that it darkens.
    """
    others = [f"more for {one}" for one in guesses[guesses.index(guess) + 1 :]]
    others += [f"not {one}" for one in refused]
    dark = "" if shows < _SEEN_SHARE else f" It darkens {100 * shows:.1f}% of the picture's frame."
    return f"Held by {'; '.join([str(guess), *others])}.{dark} --mount none leaves it out."


def _draw(part: Part, scene: SettledScene, path: Path) -> None:
    vertices, faces = join_meshes(part.bodies)
    seen = vertices @ part.pose.matrix[:3, :3].T + part.pose.matrix[:3, 3]
    draw_part(seen, faces, path, place_eyes(scene.views), color=scene.material.color)
