"""Plan a piece: which supports, depth, wall and holder are tried, in which order, and which is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from knotfab.base.errors import SceneError
from knotfab.base.progress import Progress
from knotfab.design.design import Design, plan_searches
from knotfab.hold.foot_plate import on_rounded
from knotfab.hold.roots import NoWayError
from knotfab.hold.wall import NotHeldError
from knotfab.part.assemble import Part, part_of
from knotfab.part.orient import Flattening
from knotfab.picture.read import Target
from knotfab.pipeline.held import WORDS, Guess, guess_holders
from knotfab.pipeline.piece import Settled
from knotfab.pipeline.settle import (
    Place,
    depth_mm,
    may_change,
    propose_depth,
    propose_lower,
    propose_place_for,
    wall_mm,
)
from knotfab.pipeline.workshop import Made, Workshop
from knotfab.plan import Steps, Try
from knotfab.report.rows import SEEN_SHARE
from knotfab.request import Request
from knotfab_formats.errors import in_digits
from knotfab_formats.report import Report
from knotfab_formats.verdict import WORDS as BEST_FIRST
from knotfab_formats.verdict import list_unmet

ROUNDS = 2  # most further searches of a piece on one holder
_HOLDERS = {"none": "no mount"} | {str(kind): told for kind, told in WORDS.items()}
Found = TypeVar("Found")


def plan_supports(
    shop: Workshop, request: Request, plan: Callable[[Workshop, Request, str], Steps[Found]]
) -> Steps[Found]:
    """Plan what was asked and, where that fails and the request has another scene, plan that one.

    Args:
        plan: `plan_piece`, or `plan_film` for a sequence; called with why the plan follows on another.
    """
    if request.otherwise is None:
        return (yield from plan(shop, request, ""))
    try:
        return (yield from plan(shop, request, ""))
    except SceneError as error:
        failed = f"{error.what}: {error.why}"
    shop.clear()
    shop.progress.plan_again()
    other = replace(request, scene=request.otherwise, otherwise=None, why_supported=failed)
    why = f"built again with the slicer's supports, for without them {failed}"
    return (yield from plan(shop, other, why))


def plan_piece(shop: Workshop, request: Request, why: str = "") -> Steps[Made]:
    """Plan one piece: its searches, then the places and holders on which it is tried."""
    left = request.budget(shop.progress.total)
    made = yield from plan_searches(
        request.scene, request.targets, request.device, shop.progress, left, why
    )
    if request.chooses_holder:
        return (yield from plan_holders(shop, request, made))
    return (yield from _plan_held(shop, request, made))


def _try_piece(
    shop: Workshop, request: Request, made: Design, settled: Settled | str, note: str = ""
) -> Try:
    """Return the attempt to write, verify and report a piece: its part as settled, or why there is none."""
    return Try(
        f"piece on {_HOLDERS.get(request.scene.mount.kind, 'its mount')}",
        lambda: shop.finish(request, made, settled, note),
        lambda done: tell_outcome(done[1]),
    )


def plan_holders(shop: Workshop, request: Request, made: Design) -> Steps[Made]:
    """Plan the piece on the holder that costs least of those that pass every check, else on none.

    Holders are settled in the order of a guess of their hours and grams, and only one that can be settled is
    built and verified. If a check fails, the next is tried, but not under a time budget, nor if the knots
    break a limit, nor if the same checks failed as before on one that hardly shows. One that worsens the
    verdict gives way to one that does not and costs little more.
    """
    refused: list[str] = []
    failed: set[str] = set()
    guesses, why = guess_holders(made, request.targets), ""
    for guess in guesses:
        asked, design = with_mount(request, made, guess.kind)
        settled = yield from _settle_held(shop, asked, design, why)
        if isinstance(settled, str):
            why = f"{WORDS[guess.kind]}: {settled}"
            refused.append(f"{WORDS[guess.kind]} ({settled})")
            continue
        dark = _tell_dark(settled)
        said = _tell_choice(guess, guesses, refused, dark)
        done: Made = yield _try_piece(shop, asked, settled[0], settled, said)
        unmet = list_failed(done[1])
        once = request.time_budget_s is not None or not made.result.feasible
        # a holder that hardly shows did not spoil it, and neither does the next
        if once or (unmet and unmet == failed and not dark):
            return done
        if not unmet:
            later = guesses[guesses.index(guess) + 1 :] if dark else []
            price = guess.price(_word_of(done[1]))
            paler = [one for one in later if one.price() < price]
            if not paler:
                return done
            return (yield from _plan_paler(shop, request, made, (done, price), paler))
        failed = unmet
        why = f"{WORDS[guess.kind]} failed: {', '.join(sorted(unmet))}"
        refused.append(f"{WORDS[guess.kind]} (failed: {', '.join(sorted(unmet))})")
        shop.clear()
    asked, design = with_mount(request, made, "none")
    told = "; ".join(refused) or "none is known for this scene"
    if made.scene.piece.supports == "none":
        told = "members between strands need supports; --plate roots needs none"
    return (yield from _plan_held(shop, asked, design, why, f"No holder was found: {told}."))


def _plan_held(
    shop: Workshop, request: Request, made: Design, why: str = "", note: str = ""
) -> Steps[Made]:
    """Plan the piece on the request's own mount, whatever comes of it."""
    try:
        settled: Settled | str = yield from plan_places(
            request, request.targets, made, shop.progress, why
        )
    except SceneError as error:
        settled = str(error)
    done: Made = yield _try_piece(shop, request, made, settled, note)
    return done


def _plan_paler(
    shop: Workshop,
    request: Request,
    made: Design,
    dark: tuple[Made, float],
    others: Sequence[Guess],
) -> Steps[Made]:
    """Plan the piece on the first other holder that does not show; keep it if its price is lower.

    Else a note on the piece that is kept says what was tried besides, and why it was dropped.
    """
    done, price = dark
    why = suffers = "the shadow suffers on what takes less"
    dropped: list[str] = []
    for guess in others:
        asked, design = with_mount(request, made, guess.kind)
        settled = yield from _settle_held(shop, asked, design, why, pale=True)
        if isinstance(settled, str):
            why = f"{WORDS[guess.kind]}: {settled}"
            dropped.append(f"{WORDS[guess.kind]} ({settled})")
            continue
        told = "; not ".join([str(guess), *dropped])
        note = f"Held by {told}, since {suffers}. --mount none leaves it out."
        with TemporaryDirectory(dir=shop.folder.work.parent) as aside:
            shop.clear(Path(aside))
            other: Made = yield _try_piece(shop, asked, settled[0], settled, note)
            unmet = ", ".join(sorted(list_failed(other[1])))
            if not unmet and guess.price(_word_of(other[1])) < price:
                return other
            shop.clear()
            for path in Path(aside).iterdir():
                path.rename(shop.folder.file(path.name))
        lack = f"failed: {unmet}" if unmet else "a shadow no better by what it takes more"
        dropped.append(f"{WORDS[guess.kind]} ({lack})")
        break
    tried = f"Tried as well, and not taken: {'; '.join(dropped)}."
    return done[0], replace(done[1], notes=(*done[1].notes, tried))


def _settle_held(
    shop: Workshop, request: Request, made: Design, why: str, pale: bool = False
) -> Steps[Settled | str]:
    """Plan the part on the requested mount, or say why that does not hold or, if it must be `pale`, shows."""
    try:
        settled = yield from plan_places(request, request.targets, made, shop.progress, why)
    except SceneError as error:
        return error.why
    sag = settled[1].mounted.check_sag()
    if sag is not None and sag.status == "fail":
        assert isinstance(sag.measured, float)
        return f"it sags {in_digits(sag.measured)} mm"
    return (_tell_dark(settled) if pale else "") or settled


@dataclass(frozen=True)
class _Settled:
    """A design and its part. If it needs too much support, `proposed_mm` is a depth that would not."""

    made: Design
    part: Part
    proposed_mm: float | None

    @property
    def over_mm(self) -> float:
        """By how much its sag on the pegs exceeds the limit."""
        wall, most = self.part.mounted.wall, self.part.mounted.scene.mount.max_sag_mm
        return 0.0 if wall is None or most is None else max(wall.sag_mm - most, 0.0)


def _try_part(
    request: Request,
    targets: Sequence[Target],
    made: Design,
    progress: Progress,
    thoroughly: bool,
    why: str = "",
) -> Try:
    """Return the attempt to make the part of a design, for print with its mount and supports."""

    def make() -> _Settled:
        part = part_of(made, request.printing, targets, progress, thoroughly=thoroughly)
        one = len(targets) == 1 and request.printing
        return _Settled(made, part, propose_depth(made, part) if one else None)

    def judge(settled: _Settled) -> str:
        if settled.over_mm > 0:
            return f"it sags {in_digits(settled.over_mm)} mm too much"
        if settled.proposed_mm is not None:
            return f"it needs much support; {settled.proposed_mm:.0f} mm deep it would not"
        return "made"

    holder = _HOLDERS.get(request.scene.mount.kind, "its mount")
    return Try(f"part on {holder}", make, judge, why)


def plan_places(
    request: Request, targets: Sequence[Target], made: Design, progress: Progress, why: str = ""
) -> Steps[Settled]:
    """Plan the part of a design, and further searches if it needs too much support or no pegs hold it.

    Too much support calls for less depth, and so do legs that sag in their plate; pegs that do not hold, for
    a nearer wall and then less depth, too.
    Nothing is searched again against the scene's own depth or wall, a free view, given start knots or a
    time budget: the returned Flattening is then only a proposal. If no search is better, the earlier design
    is kept. Several pictures settle depth and wall by themselves. Feet that no roots can join
    stand in a rounded plate.

    Raises:
        SceneError: no part can be made.
    """
    if len(targets) > 1:
        only: _Settled = yield _try_part(request, targets, made, progress, True, why)
        return made, only.part, None
    shallower, nearer = may_change(request)
    left = ROUNDS if shallower or nearer else 0
    now, unheld, settled = made, "", list[_Settled]()
    while True:
        place = None
        try:
            found: _Settled = yield _try_part(request, targets, now, progress, not left, why)
            settled.append(found)
            if shallower and left and found.proposed_mm is not None:
                place = Place(found.proposed_mm, wall_mm(now))
                why = "it needs too much support"
            elif shallower and left and found.over_mm > 0 and request.scene.mount.on_feet:
                wall, most = found.part.mounted.wall, found.part.mounted.scene.mount.max_sag_mm
                assert wall is not None and most is not None
                place = propose_lower(now, wall.sag_mm, most)
                why = f"it sags {wall.sag_mm:.2f} mm on its feet, and {most:.2f} mm are allowed"
                unheld = unheld or why
        except NotHeldError as error:
            if left:
                with progress.stage("mount"):
                    place = propose_place_for(request, now)
                why = error.why
                if place is None:  # settle the design itself, trying everything
                    left = 0
                    continue
                unheld = unheld or why
            elif now is made:
                raise
        except NoWayError as error:
            rounded = replace(now, scene=on_rounded(now.scene))
            made = rounded if now is made else made
            now, why = rounded, error.why
            continue
        except SceneError:
            if now is made:
                raise
        if place is None:
            break
        try:
            now = yield from search_again(request, targets, now, place, progress, why)
            why = ""
        except SceneError as error:
            progress.say(f"{error.what}: {error.why}; the earlier design is kept")
            if settled and settled[-1].made is now:
                break
            left = 0
            continue
        left -= 1
    if not settled or (settled[-1].over_mm > 0 and settled[0].made is not made):
        try:
            why = "the first design is tried with all that may help"
            settled.insert(0, (yield _try_part(request, targets, made, progress, True, why)))
        except SceneError:
            if not settled:
                raise
    kept = min(reversed(settled), key=lambda one: one.over_mm)
    if kept.made is made:
        unheld = ""
        if kept.proposed_mm is None:
            return made, kept.part, None
    depths, walls = ([of(one) for one in (made, kept.made)] for of in (depth_mm, wall_mm))
    said = Flattening(depths[0], depths[1], kept.proposed_mm, unheld, (walls[0], walls[1]))
    return kept.made, kept.part, said


def search_again(
    request: Request,
    targets: Sequence[Target],
    made: Design,
    place: Place,
    progress: Progress,
    why: str,
) -> Steps[Design]:
    """Plan the searches at another depth and wall. A new wall changes the size, and so the radius.

    Raises:
        SceneError: no tube can draw the picture there.
    """
    scene, (shallower, nearer) = request.scene, may_change(request)
    piece, view = scene.piece, scene.views[0]
    same = place.wall_mm == wall_mm(made)
    if same:
        piece = piece.but(tube_radius_mm=made.knots.radius_mm)
    if shallower:
        piece = piece.but(depth=place.depth_mm)
    if nearer and place.wall_mm != view.wall_distance_mm:
        view = view.but(wall_distance_mm=place.wall_mm)
    scene = scene.but(piece=piece, views=(view,))
    again = yield from plan_searches(scene, targets, request.device, progress, None, why)
    return replace(again, radius=made.radius) if same else again


def _tell_dark(settled: Settled) -> str:
    """Say how much of the picture's frame a holder will darken, by its plan; nothing if nobody sees it."""
    shows = settled[1].mounted.figures.predicted_intrusion or 0.0
    return "" if shows < SEEN_SHARE else f"it darkens {100 * shows:.1f}% of the picture's frame"


def list_failed(report: Report) -> set[str]:
    """Return the names of the required checks that failed."""
    return {check.name for check in list_unmet(report.checks) if check.status == "fail"}


def tell_outcome(report: Report) -> str:
    """Tell which required checks failed, and the verdict's word."""
    failed = ", ".join(sorted(list_failed(report)))
    word = "" if report.verdict is None else f", {report.verdict.word}"
    return (f"failed: {failed}" if failed else "passes every check") + word


def _word_of(report: Report) -> str:
    """Return the word of a report's verdict; the best without one."""
    return BEST_FIRST[0] if report.verdict is None else report.verdict.word


def with_mount(request: Request, made: Design, kind: str) -> tuple[Request, Design]:
    """Return request and design with this kind of mount, which the search had left open."""
    turns = not request.scene.on_wall(len(made.knots.knots))
    given = {"kind": kind, "turns": turns}
    asked = request.scene.but(mount=request.scene.mount.but(**given))
    own = made.scene.but(mount=made.scene.mount.but(**given))
    return replace(request, scene=asked), replace(made, scene=own)


def _tell_choice(guess: Guess, guesses: Sequence[Guess], refused: Sequence[str], dark: str) -> str:
    """Say which holder was chosen and what it costs, which cost more, and why others do not hold.

    Args:
        dark: what the chosen one darkens, if that shows.
    """
    others = [f"more for {one}" for one in guesses[guesses.index(guess) + 1 :]]
    others += [f"not {one}" for one in refused]
    shows = f" {dark[0].upper()}{dark[1:]}." if dark else ""
    return f"Held by {'; '.join([str(guess), *others])}.{shows} --mount none leaves it out."
