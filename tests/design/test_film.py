"""The chain of frames: what the first frame finds holds for all, and each frame is judged by itself."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from command import knotfab, picture, refuse, square
from PIL import Image, ImageDraw

from knotfab.base.folder import OutputFolder
from knotfab.design import film as chain
from knotfab.design.film import Chain, SequenceFrame, Tie, list_ties, pick_first
from knotfab.design.question import Question, ask
from knotfab.design.radius import RadiusChoice
from knotfab.picture.frames import read_frames
from knotfab.picture.read import Target
from knotfab.scene.catalogue import resolve
from knotfab_formats.piece import Material, Piece, Sequence
from knotfab_formats.scene import Scene
from knotfab_formats.search import PRESETS, SearchSettings

# searched in a second, on small pictures
QUICK = {
    "coarse_px": 64, "fine_px": 64, "coarse_iterations": 12, "fine_iterations": 8, "settle_iterations": 8,
    "depth_candidates": 2,
}  # fmt: skip


def discs(folder: Path, sizes: Iterable[int]) -> tuple[Target, ...]:
    """A disc in the middle, of so many pixels' radius in each frame."""
    names = []
    for number, size in enumerate(sizes):
        image = Image.new("L", (128, 128), 255)
        ImageDraw.Draw(image).ellipse((64 - size, 64 - size, 64 + size, 64 + size), fill=0)
        names.append(str(folder / f"{number}.png"))
        image.save(names[-1])
    return read_frames(names)


def in_order(frames: Chain) -> list[SequenceFrame]:
    return sorted(frames.frames(), key=lambda frame: frame.number)


def test_the_frame_with_the_most_ink_is_searched_first(tmp_path: Path) -> None:
    """What one silhouette hides has no strands to come out with."""
    assert pick_first(discs(tmp_path, (20, 30, 40, 25))) == 2
    assert pick_first(discs(tmp_path, (40, 20, 40))) == 0
    # all but as much is as good, and the frames come in their order
    assert pick_first(discs(tmp_path, (50, 50, 51, 50))) == 2
    assert pick_first(discs(tmp_path, (60, 60, 60))) == 0


def test_a_frame_is_tied_to_what_is_known_on_either_side() -> None:
    """Frames come from frame 2 onwards, then back; the tie need not hold around the end of the sequence."""
    # so far the outlines of five frames move, the last back to the first
    outlines = [1.0, 10.0, 100.0, 1000.0, 10000.0]
    assert set(list_ties(3, {2}, outlines)) == {Tie(2, 100.0), Tie(2, 11011.0, loop=True)}
    assert set(list_ties(4, {2, 3}, outlines)) == {Tie(3, 1000.0), Tie(2, 10011.0, loop=True)}
    assert set(list_ties(1, {2, 3, 4}, outlines)) == {Tie(2, 10.0), Tie(4, 10001.0, loop=True)}
    # all are known, and one is to be searched again between its neighbours
    assert set(list_ties(2, set(range(5)), outlines)) == {Tie(1, 10.0), Tie(3, 100.0)}
    assert set(list_ties(0, set(range(5)), outlines)) == {Tie(1, 1.0), Tie(4, 10000.0, loop=True)}
    assert set(list_ties(1, {0}, [3.0, 5.0])) == {Tie(0, 3.0), Tie(0, 5.0, loop=True)}


def test_the_scene_says_whether_the_frames_are_bound_to_close(tmp_path: Path) -> None:
    targets = discs(tmp_path, (40, 36))
    for loop in (True, False):
        assert Chain(resolve(Scene(sequence=Sequence(loop=loop))), targets)._closing is loop


@pytest.mark.parametrize(("search", "given"), [({}, 0.004), ({"radius_give": 0.02}, 0.02)])
def test_frames_get_no_thicker_tube_than_draws_them_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, search: dict[str, float], given: float
) -> None:
    """What one frame could spare another may need: letters that turn into each other lost theirs."""
    seen: list[float] = []

    def choose(question: Question, settings: SearchSettings, knots: int) -> RadiusChoice:
        seen.append(settings.radius_give)
        return RadiusChoice(2.0, ())

    monkeypatch.setattr(chain, "choose_radius", choose)
    question = ask(resolve(Scene(search=search)), discs(tmp_path, (40, 36))[:1])
    settings = PRESETS["draft"].model_copy(update=search)
    assert chain.radius_for_all(question, (), settings)[0] == 2.0 and seen == [given]


@pytest.mark.slow
def test_the_view_is_found_with_the_first_frame_and_stays(tmp_path: Path) -> None:
    """Lamp and wall stand still while the frames change; and what was found can be repeated."""
    targets = discs(tmp_path, (40, 42))
    asked = Scene(piece=Piece(tube_radius_mm=12.0), search={**QUICK, "free_view": True})
    first, second = (frame.made for frame in in_order(Chain(resolve(asked), targets)))
    views = [made.scene.views[0] for made in (first, second)]
    found = {(v.light_distance_mm, v.wall_distance_mm) for v in views}
    assert len(found) == 1 and found != {(500.0, 100.0)}
    assert [v.name for v in views] == ["frame-01", "frame-02"]
    assert first.result.log.certified and second.result.log.certified
    assert min(made.result.iou_estimate for made in (first, second)) > 0.7
    # frame 2 has more ink, and is searched first
    again = next(Chain(second.scene, targets).frames())
    assert again.number == 1
    assert np.array_equal(again.made.knots.points, second.knots.points)
    assert again.made.scene.views == second.scene.views


@pytest.mark.slow
def test_each_frame_has_its_own_floor_and_prices(tmp_path: Path) -> None:
    """The large disc alone lacks length: the limit has a price there, and none for the small disc."""
    targets = discs(tmp_path, (24, 40))
    material = Material(max_length_mm=250.0)
    asked = Scene(piece=Piece(tube_radius_mm=12.0), material=material, search=QUICK)
    first, second = (frame.made for frame in in_order(Chain(resolve(asked), targets)))
    assert first.binding == ()
    assert [price.limits for price in second.binding] == [("length",)]
    assert second.binding[0].needed[0] > 250.0 > second.knots.knots[0].length_mm
    floors = {made.scene.accuracy.iou_floor for made in (first, second)}
    assert len(floors) == 2  # the floor of each picture's own opening


@pytest.mark.slow
@pytest.mark.study
def test_pieces_apart_in_all_frames_are_knots_of_their_own(tmp_path: Path) -> None:
    names = []
    for number, at in enumerate((30, 50, 70)):
        image = Image.new("L", (128, 128), 255)
        pen = ImageDraw.Draw(image)
        pen.rectangle((4, 100, 124, 124), fill=0)
        pen.ellipse((40, at - 24, 88, at + 24), fill=0)
        names.append(str(tmp_path / f"{number}.png"))
        image.save(names[-1])
    asked = Scene(piece=Piece(tube_radius_mm=8.0), search=QUICK)
    frames = in_order(Chain(resolve(asked), read_frames(names)))
    sizes = {tuple(len(knot.points) for knot in frame.made.knots.knots) for frame in frames}
    assert len(sizes) == 1 and len(sizes.pop()) == 2
    for frame in frames:
        assert frame.made.result.log.certified and frame.made.result.feasible
        assert frame.made.result.iou_estimate > 0.85
    # the floor's knot stays where it is; the ball's goes 28 mm a frame
    middles = [[k.points[:, 1].mean() for k in frame.made.knots.knots] for frame in frames]
    ways = np.ptp(np.array(middles), axis=0)
    assert min(ways) < 5.0 < 35.0 < max(ways)


# `knotfab build --sequence`: what it refuses, and that a new result leaves nothing of an older
# one.


CALL = ("build", "--sequence")
TWO_VIEWS = "[[views]]\nname = 'a'\n[[views]]\nname = 'b'\nazimuth_deg = 90.0\n"


def _frames(folder: Path, count: int = 2, size: int = 64) -> Path:
    """A folder of squares, each a pixel further to the right."""
    folder.mkdir()
    for number in range(1, count + 1):
        picture(folder / f"{number}.png", np.roll(square(size), number, axis=1))
    return folder


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--knots", "2"], "frame 1 has another number of pieces (1)"),
        (["--depth", "9999"], "towards the light"),
    ],
)
def test_what_makes_no_sense_with_a_sequence(tmp_path: Path, options: list[str], why: str) -> None:
    frames = _frames(tmp_path / "frames")
    assert why in refuse(2, *CALL, frames, "--out", tmp_path / "out", *options)
    assert not (tmp_path / "out").exists()


def test_one_piece_has_no_loop_to_leave_open(tmp_path: Path) -> None:
    drawn = picture(tmp_path / "square.png", square())
    done = knotfab("build", drawn, "--no-loop", "--out", tmp_path / "out")
    assert done.code == 2 and "--no-loop" in done.err and "--sequence" in done.err
    assert not (tmp_path / "out").exists()


def test_a_scene_of_two_views_is_no_sequence(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(TWO_VIEWS)
    frames = _frames(tmp_path / "frames")
    said = refuse(2, *CALL, frames, "--scene", scene, "--out", tmp_path / "out")
    assert "2 views" in said


def test_a_shorter_sequence_leaves_no_frames_of_the_one_before(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    old = ["part-01.stl", "part-02.3mf", "knots-02.json", "scene-02.toml", "zoetrope.stl"]
    old += ["plate-02-1.3mf", "setup-02.pdf", "bends-02.csv", "bends-02-1.csv"]
    old += ["bending-templates-a4-02.pdf", "drill-template-letter-02.pdf"]
    for name in [*old, "sequence.gif", "picture-frame-02.png", "report.json", "my-part-1.stl"]:
        (out / name).write_text("old")
    with OutputFolder(out) as folder:
        folder.write("part-01.stl", "new")
        folder.write("report.json", "new")
        folder.commit()
    assert {p.name for p in out.iterdir()} == {"part-01.stl", "report.json", "my-part-1.stl"}


def test_validate_names_the_frames_of_a_sequence(tmp_path: Path) -> None:
    (tmp_path / "part-01.stl").write_text("")
    done = knotfab("validate", tmp_path)
    assert done.code == 2
    assert "it holds a sequence" in done.err and "scene-01.toml" in done.err
