"""Finish a piece: write, verify and report it, on the requested holder or on the one that serves best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from knotfab.base.arrays import Array
from knotfab.base.errors import SceneError
from knotfab.base.folder import OutputFolder
from knotfab.base.progress import Progress
from knotfab.design.budget import Budget
from knotfab.design.candidates import hours_of_plate, hours_of_tube
from knotfab.design.design import Design, design_knots
from knotfab.geometry.overhang import Estimate, Strands, estimate
from knotfab.geometry.tube import join_meshes
from knotfab.hold.hang import HOLE_MM
from knotfab.hold.modeller import rest_modeller
from knotfab.hold.mount import BASE_DOWN, choose_foot
from knotfab.part.assemble import Part, rules_of
from knotfab.part.orient import estimate_print_minutes, propose_turns, rank_turns, strands_of
from knotfab.part.slicer import SlicerQueue
from knotfab.part.slicer_profile import write_profile
from knotfab.picture.read import Target
from knotfab.pipeline.finish import report_piece
from knotfab.pipeline.piece import Settled, WrittenPiece, discard_piece, settle, write_piece
from knotfab.pipeline.verifier import Verifier
from knotfab.render.part_picture import draw_part, place_eyes
from knotfab.report.page import load_template
from knotfab.request import Request
from knotfab.scene.camera import Camera, camera_of
from knotfab_formats.report import Report
from knotfab_formats.scene import ResolvedScene, SettledScene
from knotfab_formats.verdict import WORDS as BEST_FIRST
from knotfab_formats.verdict import list_unmet

_SEEN_SHARE = 0.0005  # of the frame: what a holder darkens beyond that is told


@dataclass(frozen=True)
class Workshop:
    """What is needed to finish a piece: its pictures, its folder, verifier and slicer."""

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
        planned is built and verified. If a check fails, the next is tried, but not under a time budget, nor
        if the knots break a limit, nor if the same checks failed as before. One that worsens the verdict
        gives way to one that does not and costs little more (`_keep_word`).
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
                return self._keep_word(request, made, (piece, report), paler)
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
        others: Sequence[Guess],
    ) -> tuple[WrittenPiece, Report]:
        """Finish the piece on the first other holder that does not show; keep it if its verdict is better."""
        for guess in others:
            asked, design = _with_mount(request, made, guess.kind)
            settled = self._plan(asked, design)
            shows = 1.0 if isinstance(settled, str) else _shows(settled)
            if isinstance(settled, str) or shows >= _SEEN_SHARE:
                continue
            why = f"Held by {guess}, since the shadow suffers on what takes less. --mount none leaves it out."
            with TemporaryDirectory(dir=self.folder.work.parent) as aside:
                discard_piece(done[0], self.folder, Path(aside))
                other = self.finish(asked, settled[0], settled, why)
                if not _list_failed(other[1]) and _rank_word(other[1]) < _rank_word(done[1]):
                    return other
                discard_piece(other[0], self.folder)
                for path in Path(aside).iterdir():
                    path.rename(self.folder.file(path.name))
            break
        return done

    def _plan(self, request: Request, made: Design) -> Settled | str:
        """Plan the piece on the requested mount, or say why that does not hold."""
        try:
            settled = settle(request, made, self.targets, self.progress)
        except SceneError as error:
            return error.why
        sag = settled[1].mounted.check_sag()
        if sag is not None and sag.status == "fail":
            return f"it sags {sag.measured:.2g} mm"
        return settled


def make_piece(
    shop: Workshop, request: Request, left: Budget | None
) -> tuple[Report, str, list[WrittenPiece]]:
    """Design one piece and finish it; return its report, its title, and the piece in a list."""
    made = design_knots(request.scene, shop.targets, request.device, shop.progress, left)
    finish = shop.finish_held if request.chooses_holder else shop.finish
    piece, report = finish(request, made)
    return report, " and ".join(target.shown for target in shop.targets), [piece]


def _shows(settled: Settled) -> float:
    """Return the share of the picture's frame that a holder will darken, according to its plan."""
    return settled[1].mounted.figures.predicted_intrusion or 0.0


def _list_failed(report: Report) -> set[str]:
    return {check.name for check in list_unmet(report.checks) if check.status == "fail"}


def _rank_word(report: Report) -> int:
    """Return how many ranks a report's verdict lies below the best one; 0 without a verdict."""
    return 0 if report.verdict is None else BEST_FIRST.index(report.verdict.word)


def _with_mount(request: Request, made: Design, kind: str) -> tuple[Request, Design]:
    """Return request and design with this kind of mount, which the search had left open."""
    turns = not request.scene.hangs(len(made.knots.knots))
    given = {"kind": kind, "turns": turns}
    asked = request.scene.but(mount=request.scene.mount.but(**given))
    own = made.scene.but(mount=made.scene.mount.but(**given))
    return replace(request, scene=asked), replace(made, scene=own)


def _tell_choice(
    guess: Guess, guesses: Sequence[Guess], refused: Sequence[str], shows: float
) -> str:
    """Say which holder was chosen and what it costs, which cost more, and why others do not hold.

    Args:
        shows: the share of the picture's frame that the chosen one darkens.
    """
    others = [f"more for {one}" for one in guesses[guesses.index(guess) + 1 :]]
    others += [f"not {one}" for one in refused]
    dark = "" if shows < _SEEN_SHARE else f" It darkens {100 * shows:.1f}% of the picture's frame."
    return f"Held by {'; '.join([str(guess), *others])}.{dark} --mount none leaves it out."


def _draw(part: Part, scene: SettledScene, path: Path) -> None:
    vertices, faces = join_meshes(part.bodies)
    seen = vertices @ part.pose.matrix[:3, :3].T + part.pose.matrix[:3, 3]
    draw_part(seen, faces, path, place_eyes(scene.views), color=scene.material.color)


Kind = Literal["wall", "stand", "hang"]
WORDS: dict[Kind, str] = {"wall": "a wall mount", "stand": "a stand", "hang": "eyelets for threads"}
_RODS = 2000  # rods that stand for the strands
# Usual members, as built for the project's own pictures: how many, how long as a share of the piece's
# height (a peg's of its way to the wall), and how thick as a share of the tube.
_POSTS = {"hang": (3, 0.25), "stand": (4, 0.3), "wall": (7, 1.0)}
_MEMBER_SHARE = 0.7


# share of what a piece takes on a holder; another holder that adds more is dear
_MODEST = 1 / 3


@dataclass(frozen=True)
class Guess:
    """What a holder adds to the bare piece, its supports included; `hours` are NaN but for filament.

    `bare_grams` and `bare_hours` are the piece's own.
    """

    kind: Kind
    grams: float
    hours: float
    bare_grams: float
    bare_hours: float

    def is_dear_beside(self, other: Guess) -> bool:
        """Return whether this holder takes much more than another one, piece included."""
        if np.isnan(self.hours):
            return self.grams - other.grams > _MODEST * (self.bare_grams + other.grams)
        return self.hours - other.hours > _MODEST * (self.bare_hours + other.hours)

    def __str__(self) -> str:
        hours = "" if np.isnan(self.hours) else f" and {max(self.hours, 0.0):.1f} h"
        return f"{WORDS[self.kind]} (some {max(self.grams, 0.0):.0f} g{hours} with its supports)"


def can_hold(scene: ResolvedScene) -> list[Kind]:
    """List the holders that a scene allows: a wall mount only for a single shadow on a flat wall.

    A piece that prints without supports allows none, since members would begin in mid-air.
    """
    if scene.piece.supports == "none":
        return []
    # where lamps share a screen, they stand as the holder lets them, which was settled before
    kinds: list[Kind] = ["hang"] if scene.share_wall else ["hang", "stand"]
    return [*kinds, "wall"] if scene.is_one_shadow else kinds


def guess_holders(made: Design, targets: Sequence[Target]) -> list[Guess]:
    """Guess what each holder that the scene allows would add; those of least hours and grams come first."""
    scene, knots = made.scene, made.knots
    kinds = can_hold(scene)
    if not kinds:
        return []
    rules, strands = rules_of(scene), strands_of(knots, most=_RODS)
    best = rank_turns(strands, propose_turns(strands), rules)[0].estimate
    camera = camera_of(scene.views[0], targets[0].width, targets[0].height)
    found = []
    for kind in kinds:
        posed, member_mm3, solid_mm3 = best, _members_mm3(kind, knots.points, made, camera), 0.0
        if kind == "hang":
            wire = _MEMBER_SHARE * knots.radius_mm
            member_mm3 += 2 * np.pi**2 * (0.5 * HOLE_MM + wire) * wire**2
        else:
            turn = BASE_DOWN if kind == "stand" else camera.wall_axes
            foot, solid_mm3 = _foot_of(kind, made, camera)
            posed = estimate(_on_a_foot(strands, foot, turn), turn, rules)
        found.append(_price(kind, scene, knots.radius_mm, posed, best, member_mm3, solid_mm3))
    by_hours = scene.material.process == "filament"
    return sorted(found, key=lambda one: (one.hours, one.grams) if by_hours else (one.grams,))


def _price(
    kind: Kind,
    scene: ResolvedScene,
    radius: float,
    posed: Estimate,
    bare: Estimate,
    member_mm3: float,
    solid_mm3: float,
) -> Guess:
    filament = scene.material.process == "filament"
    supports_cm3 = posed.filament_cm3 - bare.filament_cm3 if filament else 0.0
    grams = scene.material.density_g_cm3 * (supports_cm3 + 1e-3 * (member_mm3 + solid_mm3))
    hours = (estimate_print_minutes(posed) - estimate_print_minutes(bare)) / 60
    hours += hours_of_tube(member_mm3, radius) + hours_of_plate(solid_mm3)
    bare_grams = float(scene.material.density_g_cm3 * bare.filament_cm3)
    bare_hours = float(estimate_print_minutes(bare) / 60)
    return Guess(
        kind, float(grams), float(hours) if filament else float("nan"), bare_grams, bare_hours
    )


def _members_mm3(kind: Kind, points: Array, made: Design, camera: Camera) -> float:
    count, share = _POSTS[kind]
    length = float(np.ptp(points[:, 1]))
    if kind == "wall":
        length = float((points @ camera.receiver[:3]).mean() + camera.receiver[3])
        count *= len(made.knots.knots)
    return count * share * length * np.pi * (_MEMBER_SHARE * made.knots.radius_mm) ** 2


def _foot_of(kind: Kind, made: Design, camera: Camera) -> tuple[Array, float]:
    """Return a point (3,) of the plane on which the holder stands, and the volume of its plate or base."""
    points, asked, radius = made.knots.points, made.scene.mount, made.knots.radius_mm
    if kind == "stand":
        size = np.ptp(points @ camera.level_axes.T, axis=0) + 2 * radius
        tall = 0.5 * size[1] * np.tan(np.deg2rad(asked.min_tip_deg))
        area = size[0] * max(size[2], 2 * tall)
        low = points[int(points[:, 1].argmin())] - np.array([0.0, 2 * radius, 0.0])
        return low, float(area * asked.base_thickness_mm)
    off = camera.receiver[:3] * -(camera.receiver[3] + camera.receiver[:3] @ points.mean(axis=0))
    middle = points.mean(axis=0) + off
    foot = choose_foot(made.scene, made.knots, camera) if asked.foot == "auto" else asked.foot
    if foot == "dowel":
        return middle, 0.0
    across, along = (side + 2 * asked.plate_margin_mm for side in camera.frame_mm)
    return middle, float(across * along * asked.thickness_mm)


def _on_a_foot(strands: Strands, foot: Array, turn: Array) -> Strands:
    """Add a speck at a foot, so that supports and height count from there."""
    return replace(
        strands,
        middle=np.vstack([strands.middle, foot]),
        along=np.vstack([strands.along, turn[0]]),
        length=np.append(strands.length, 1e-6),
        sizes=(*strands.sizes, 1),
    )
