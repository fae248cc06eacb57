"""A frame of bars that stands on a table and holds screen, piece and lamps in their places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from knotfab.base.arrays import Array
from knotfab.geometry.tube import Mesh
from knotfab.hold.modeller import model_fixture
from knotfab.hold.mount import Mounted
from knotfab.hold.placement import Placement, placement_of
from knotfab.scene.camera import camera_of
from knotfab_fixtures.solids import BOSS_WALL_MM, HEAD_MM, TAIL_DEPTH_MM, table_bar
from knotfab_formats.piece import FrameBar

WIDTH_MM, THICK_MM = 32.0, 5.0  # a bar's
WIDEST_MM = 120.0  # the spine is no wider, where lamps stand near its middle
ROD_MM = 8.0  # diameter of the rod that a lamp stands on
ROD_PLAY_MM, BOSS_MM = 0.3, 12.0
# the least from a lamp to the edge of its holder; on the spine an arm's dovetail comes between
_EDGE = (ROD_MM + ROD_PLAY_MM) / 2 + BOSS_WALL_MM
_INSIDE = _EDGE + TAIL_DEPTH_MM - 0.5
CARD_MM, CARD_PLAY_MM = 3.0, 0.2  # the screen, and its slot
SLOT_MM, RIDGE_MM = 9.0, 3.0  # height and thickness of the slot's ridges
FENCE_MM, FENCE_PLAY_MM = 3.0, 0.3  # about the foot of a stand
MARK_MM = 3.0  # a hole below the middle of the piece
CLEAR_MM = 12.0  # the least from a cut to a hole or ridge
APART_MM, EDGE_MM = 4.0, 4.0  # between bars on the bed, and from them to its edge


@dataclass(frozen=True)
class Bar:
    """One bar: sizes of `fixtures.bar.table_bar`, and where it goes.

    `along` and `start` (2,) are its direction and the middle of its beginning, right and out of the
    wall from the middle of the piece, mm.
    """

    start: Array
    along: Array
    length_mm: float
    width_mm: float = WIDTH_MM
    tail: bool = False
    socket: bool = False
    sockets: tuple[tuple[float, float], ...] = ()
    holes: tuple[tuple[float, float, float, float], ...] = ()
    ridges: tuple[tuple[float, float, float, float, float], ...] = ()

    def make(self) -> Mesh:
        """Make the bar as it is printed: along x, from its own beginning."""
        named: dict[str, Any] = {
            key: getattr(self, key) for key in ("tail", "socket", "sockets", "holes", "ridges")
        }
        return model_fixture(table_bar, self.length_mm, self.width_mm, THICK_MM, **named)

    def record(self, to_scene: Array) -> FrameBar:
        """Record the piece for scene.toml, by which its file is measured."""
        numbers = {key: np.array(getattr(self, key)).tolist() for key in ("holes", "ridges")}
        return FrameBar.model_validate(
            {
                "length_mm": float(self.length_mm),
                "width_mm": float(self.width_mm),
                "thickness_mm": THICK_MM,
                "tail": self.tail,
                "socket": self.socket,
                "sockets": [(float(x), 1 if side > 0 else -1) for x, side in self.sockets],
                "matrix": to_scene.tolist(),
                **numbers,
            }
        )


@dataclass(frozen=True)
class Sheet:
    """Bodies that are printed at once, the motion (4, 4) that takes each to the scene, and the sizes."""

    name: str
    bodies: list[Mesh]
    to_scene: list[Array]
    bars: list[FrameBar]


@dataclass(frozen=True)
class Table:
    """A frame of bars: `level` (3, 3) has rows right, up and out, `top_mm` is its height."""

    bars: tuple[Bar, ...]
    level: Array
    top_mm: float
    bed_mm: tuple[float, float]
    lamps: tuple[tuple[str, float, float, float], ...]  # name, right, out, and above the table

    @cached_property
    def _beds(self) -> list[list[tuple[Bar, float, float]]]:
        """Lay bars side by side on few beds, the longest first; list them with where they begin."""
        wide, deep = (side - 2 * EDGE_MM for side in self.bed_mm)
        room, rows = max(wide, deep), min(wide, deep)
        order = sorted(self.bars, key=lambda bar: (-bar.width_mm, -bar.length_mm))
        beds: list[list[tuple[Bar, float, float]]] = [[]]
        x, y, deep = 0.0, 0.0, order[0].width_mm
        for bar in order:
            size = bar.length_mm + TAIL_DEPTH_MM * bar.tail
            if x + size > room:
                x, y, deep = 0.0, y + deep + APART_MM, bar.width_mm
            if y + deep > rows:
                beds.append([])
                x, y, deep = 0.0, 0.0, bar.width_mm
            beds[-1].append((bar, x, y + bar.width_mm / 2))
            x += size + APART_MM
        return beds

    @property
    def beds(self) -> int:
        """How many beds are printed."""
        return len(self._beds)

    @cached_property
    def sheets(self) -> list[Sheet]:
        """The printed bodies, bed by bed."""
        turned = self.bed_mm[1] > self.bed_mm[0]
        beds = enumerate(self._beds, start=1)
        return [self._lay(f"table-{n}.3mf", bed, turned) for n, bed in beds]

    def _lay(self, name: str, bed: Sequence[tuple[Bar, float, float]], turned: bool) -> Sheet:
        bodies, motions, bars = [], [], []
        turn = (
            np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) if turned else np.eye(3)
        )
        shift = np.array(
            [EDGE_MM + (self.bed_mm[0] - 2 * EDGE_MM if turned else 0.0), EDGE_MM, 0.0]
        )
        for bar, x, y in bed:
            vertices, faces = bar.make()
            off = turn @ np.array([x, y, 0.0]) + shift
            bodies.append((vertices @ turn.T + off, faces))
            own = np.eye(4)
            own[:3, :3], own[:3, 3] = turn, off
            into = self._into_scene(bar)
            motions.append(into @ np.linalg.inv(own))
            bars.append(bar.record(into))
        return Sheet(name, bodies, motions, bars)

    def _into_scene(self, bar: Bar) -> Array:
        """Return the motion (4, 4) from a bar as it is made, its z up, to the scene."""
        right, up, out = self.level
        along = bar.along[0] * right + bar.along[1] * out
        motion = np.eye(4)
        motion[:3, :3] = np.column_stack([along, np.cross(up, along), up])
        motion[:3, 3] = bar.start[0] * right + bar.start[1] * out + (self.top_mm - THICK_MM) * up
        return motion


def frame_or_reason(mounted: Mounted) -> tuple[Table | None, str]:
    """Return the frame and "", or None and why it cannot be made ("" if the scene asks for none)."""
    try:
        return plan_table(mounted), ""
    except ValueError as error:
        return None, f"No frame holds screen and lamps: {error}. Place them by the drawing."


def plan_table(mounted: Mounted) -> Table | None:
    """Plan the frame for lamps on one upright, flat screen; None without these or a printer.

    Raises:
        ValueError: no bars of these kinds hold the lamps.
    """
    scene = mounted.scene
    first = scene.views[0]
    upright = first.elevation_deg == 0 and first.wall_tilt_deg == 0
    if not (any(view.wall for view in scene.views) and upright and scene.piece.printed):
        return None
    places = [placement_of(mounted, camera_of(view, 2, 2)) for view in scene.views]
    level = places[0].level
    lamps = np.stack([level @ place.lamp for place in places])
    bed = (scene.printer.build_volume_mm[0], scene.printer.build_volume_mm[1])
    top = _choose_top(places, lamps)
    bars = _Layout(places[0], lamps, top, max(bed) - 2 * EDGE_MM - TAIL_DEPTH_MM).bars()
    named = zip(scene.views, lamps, strict=True)
    return Table(
        tuple(bars), level, top, bed, tuple((v.name, x, z, y - top) for v, (x, y, z) in named)
    )


def _choose_top(places: Sequence[Placement], lamps: Array) -> float:
    """Choose the height of the frame's top: below a stand, and below the picture."""
    first = places[0]
    edge = float(first.level[1] @ first.middle) - first.frame_mm[1] / 2
    if first.base is not None:
        return min(first.base.bottom, edge - SLOT_MM - 1.0)
    # height of the frame's lower edge and of the lamps above the table, where nothing else says
    return min(edge, float(lamps[:, 1].min())) - 25.0


class _Layout:
    """Where the bars go: a spine from the screen to the lamps, and arms to either side."""

    def __init__(self, place: Placement, lamps: Array, top: float, longest: float) -> None:
        self.lamps, self.longest = lamps, longest
        self.spine = _spine_width(np.abs(lamps[:, 0]))
        self.screen = float(place.level[2] @ place.middle)
        # the screen's foot reaches so far to either side, by the frame's width
        self.reach = 0.45 * place.frame_mm[0]
        self.base = place.base
        self.raised = 0.0 if place.base is None else place.base.bottom - top  # a stand, on pads

    def bars(self) -> list[Bar]:
        arms, holes = self._arms()
        begin = self._begin
        end = max(*(float(z) for z in self.lamps[:, 2]), 0.0) + WIDTH_MM / 2
        half = self.spine / 2
        ridges = [(z0, z1, -half, half, high) for z0, z1, high in self._cross_ridges()]
        spine = _cut_bar(
            Bar(
                np.array([0.0, begin]),
                np.array([0.0, 1.0]),
                end - begin,
                self.spine,
                sockets=tuple((arm.start[1] - begin, -arm.along[0]) for arm in arms),
                holes=tuple((z - begin, x, wide, boss) for x, z, wide, boss in holes),
                ridges=tuple((z0 - begin, z1 - begin, y0, y1, h) for z0, z1, y0, y1, h in ridges),
            ),
            self.longest,
        )
        return [*spine, *(piece for arm in arms for piece in _cut_bar(arm, self.longest))]

    def _arms(self) -> tuple[list[Bar], list[tuple[float, float, float, float]]]:
        """Lay out arms beside the spine, and its holes (right, out, diameter, boss).

        Raises:
            ValueError: a lamp stands so near to the spine, or to another, that nothing can hold it.
        """
        wide, half = ROD_MM + ROD_PLAY_MM, self.spine / 2
        holes: list[tuple[float, float, float, float]] = []
        feet: dict[tuple[int, float], list[tuple[float, float]]] = {}
        for x, z in sorted({(round(float(x), 3), round(float(z), 3)) for x, _, z in self.lamps}):
            if abs(x) + _INSIDE <= half:
                holes.append((x, z, wide, BOSS_MM))
                continue
            side = 1 if x > 0 else -1
            near = [
                key for key in feet if key[0] == side and abs(key[1] - z) + _EDGE <= WIDTH_MM / 2
            ]
            feet.setdefault(near[0] if near else (side, z), []).append((abs(x), z))
        if self.base is None:
            holes.append((0.0, 0.0, MARK_MM, 0.0))
        arms = [self._screen_arm(side) for side in (1, -1)]
        arms += [arm for side in (1, -1) if (arm := self._stand_arm(side)) is not None]
        for (side, z), lamps in feet.items():
            length = max(x for x, _ in lamps) - half + _EDGE + 2.0
            own = [(length - (x - half), side * (at - z), wide, BOSS_MM) for x, at in lamps]
            arms.append(self._arm(side, z, length, holes=tuple(own)))
        for side in (1, -1):
            places = sorted(arm.start[1] for arm in arms if arm.along[0] == -side)
            if any(b - a < WIDTH_MM for a, b in pairwise(places)):
                raise ValueError("two lamps stand too near to each other, one behind the other")
        return arms, holes

    def _screen_arm(self, side: int) -> Bar:
        """Make an arm with the screen's slot along it."""
        middle = self._begin + WIDTH_MM / 2
        length = max(self.reach - self.spine / 2, 30.0)
        ridges = []
        for z0, z1, high in self._cross_ridges()[:2]:
            y0, y1 = sorted((side * (z0 - middle), side * (z1 - middle)))
            ridges.append((0.0, length, y0, y1, high))
        return self._arm(side, middle, length, ridges=tuple(ridges))

    def _stand_arm(self, side: int) -> Bar | None:
        """Make an arm with a fence for a stand's foot; None if that fits the spine."""
        if self.base is None:
            return None
        edge = (self.base.right if side > 0 else -self.base.left) + FENCE_PLAY_MM
        length = edge + RIDGE_MM - self.spine / 2
        if length < 2 * TAIL_DEPTH_MM:
            return None
        deep = self.base.front - self.base.back
        half = WIDTH_MM / 2
        ridges = [(0.0, RIDGE_MM, -half, half, self.raised + FENCE_MM)]
        if self.raised > 0:
            pad = min(half, deep / 2)
            ridges.append((RIDGE_MM, length, -pad, pad, self.raised))
        return self._arm(side, (self.base.back + self.base.front) / 2, length, ridges=tuple(ridges))

    def _arm(self, side: int, z: float, length: float, **own: Any) -> Bar:
        """Make an arm to one side, from its far end to the spine, which its dovetail enters."""
        start = np.array([side * (self.spine / 2 + length), z])
        return Bar(start, np.array([-float(side), 0.0]), length, tail=True, **own)

    @property
    def _begin(self) -> float:
        """Return how far out of the piece's middle the spine begins, behind the screen's slot."""
        return self.screen - CARD_MM - CARD_PLAY_MM - RIDGE_MM - 4.0

    def _cross_ridges(self) -> list[tuple[float, float, float]]:
        """List ridges across the spine (from, to, height): along slot and stand."""
        front, back = self.screen, self.screen - CARD_MM - CARD_PLAY_MM
        found = [(front, front + RIDGE_MM, SLOT_MM), (back - RIDGE_MM, back, SLOT_MM)]
        if self.base is not None:
            near, far = self.base.back - FENCE_PLAY_MM, self.base.front + FENCE_PLAY_MM
            high = self.raised + FENCE_MM
            found += [(near - RIDGE_MM, near, high), (far, far + RIDGE_MM, high)]
            if self.raised > 0:
                found.append((near, far, self.raised))
        return found


def _spine_width(aside: Array) -> float:
    """Choose a width at which each lamp, `aside` (n,) mm from the middle, is on the spine or well beside it.

    Raises:
        ValueError: it would be wider than `WIDEST_MM`.
    """
    width = WIDTH_MM
    while True:
        near = aside[(aside + _INSIDE > width / 2) & (aside - _EDGE < width / 2)]
        if not len(near):
            return width
        width = 2 * (float(near.max()) + _INSIDE)
        if width > WIDEST_MM:
            raise ValueError("lamps stand side by side all along the middle")


def _cut_bar(bar: Bar, longest: float) -> list[Bar]:
    """Cut a bar into pieces that the bed holds, but not where something stands on it."""
    taken = [
        (x - wide / 2 - BOSS_WALL_MM, x + wide / 2 + BOSS_WALL_MM) for x, _, wide, _ in bar.holes
    ]
    taken += [(x - HEAD_MM / 2, x + HEAD_MM / 2) for x, _ in bar.sockets]
    taken += [(a, b) for a, b, y0, y1, _ in bar.ridges if y1 - y0 == bar.width_mm]
    ends = [0.0]
    while bar.length_mm - ends[-1] > longest:
        cut = ends[-1] + longest
        for low, high in sorted(taken, reverse=True):
            if low - TAIL_DEPTH_MM - CLEAR_MM < cut < high + CLEAR_MM:
                cut = low - TAIL_DEPTH_MM - CLEAR_MM
        if cut < ends[-1] + 2 * TAIL_DEPTH_MM:
            raise ValueError(f"a bed of {longest:.0f} mm is too small for the frame's bars")
        ends.append(cut)
    ends.append(bar.length_mm)
    pieces = []
    for a, b in pairwise(ends):
        first, last = a == 0.0, b == bar.length_mm
        free = a if first else a + TAIL_DEPTH_MM + 1.0  # a ridge would lie above the socket
        cut_ridges = [
            (max(x0, free) - a, min(x1, b) - a, y0, y1, high) for x0, x1, y0, y1, high in bar.ridges
        ]
        pieces.append(
            Bar(
                bar.start + a * bar.along,
                bar.along,
                b - a,
                bar.width_mm,
                tail=bar.tail if last else True,
                socket=not first,
                sockets=tuple((x - a, side) for x, side in bar.sockets if a < x < b),
                holes=tuple((x - a, y, wide, boss) for x, y, wide, boss in bar.holes if a < x < b),
                ridges=tuple(r for r in cut_ridges if r[1] - r[0] > 1.0),
            )
        )
    return pieces
