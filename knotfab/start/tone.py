"""Draw a grey picture as one closed line of the tube's width, which is denser where the picture is darker.

Points are spread with a density that follows the darkness, and a short tour leads through all of them (Kaplan
and Bosch, "TSP art", Bridges 2005). A tour that crosses itself can be shortened, so the result is simple and,
like every start, an unknot.
"""

from __future__ import annotations

import numpy as np
from PIL import Image

from knotfab.base.arrays import Array, Mask
from knotfab.geometry.polylines import sample_evenly
from knotfab.picture import raster
from knotfab.picture.read import Target
from knotfab.picture.silhouette import resample_mask
from knotfab.start.filling import simple_curves, smooth_closed
from knotfab_formats.errors import InputError

_TURN = 1.25  # step of the tour over the least distance of lines, in black
_ROUNDS = 30  # rounds of Lloyd's method
_CELLS = 3.0  # cells of the density's grid per least distance of lines
_LINE_PX = 10.0  # width of a line in the drawing, px
_STEP = 0.125  # distance between points of the line, in widths
_NEAR = 10  # nearest points that a tour may lead to
_LEAST = 8  # least number of points of a line
_SEED = 1
_SMOOTH = 0.35  # width of the smoothing, in pitches
_HELD = 0.1  # share of the way back to the tour, in each round of rounding off
_APART = 2.0  # distance along the line, in pitches, within which it is its own neighbour


def draw_tones(darkness: Array, width: float, gap: float) -> tuple[Mask, Array]:
    """Draw tones by one closed line of constant width, by its distance from itself.

    Args:
        darkness: (H, W) from 0 to 1, where lines have gaps of `gap`. width, gap: px of it.

    Returns:
        The drawing (h, w) of the same frame, with 10 px per line width, and the line (n, 2), x and y in its
        pixels. Both are empty if nothing is dark.
    """
    height, across = darkness.shape
    pitch, zoom = width + gap, _LINE_PX / width
    size = (max(1, round(zoom * height)), max(1, round(zoom * across)))
    cells, cell = _shrink(darkness, pitch / _CELLS)
    area = float(cell.prod())
    wanted = float(cells.sum()) * area / pitch  # length of the line
    step = _TURN * pitch
    count = round(float((cells**2).sum()) * area / step**2)
    line = np.empty((0, 2))
    for _ in range(2):  # the second time with the number of points that gives this length
        points = spread_points(cells**2, count) * cell if count >= _LEAST else np.empty((0, 2))
        if len(points) == 0:
            return np.zeros(size, dtype=bool), np.empty((0, 2))
        line = _round_off(points[shortest_tour(points)], width, pitch)
        length = float(np.hypot(*(np.roll(line, -1, axis=0) - line).T).sum())
        count = round(count * (wanted / length) ** 2)
    drawn = (line * [size[1] / across, size[0] / height]) - 0.5
    return _draw(drawn, size), drawn


def spread_points(density: Array, count: int) -> Array:
    """Spread at most `count` points evenly by a density, (n, 2), x and y in cells; none if all of it is pale.

    By Lloyd's method with the density as weight (Secord, "Weighted Voronoi stippling", NPAR 2002).
    """
    from scipy.spatial import cKDTree

    rows, columns = np.nonzero(density > 0.1**2)  # a darkness of 0.1; density is its square
    if len(rows) == 0:
        return np.empty((0, 2))
    weight = density[rows, columns]
    cells = np.column_stack([columns, rows]) + 0.5
    rng = np.random.default_rng(_SEED)
    share = np.cumsum(weight)
    at = np.searchsorted(share, (np.arange(count) + rng.random(count)) * (share[-1] / count))
    points: Array = cells[np.minimum(at, len(cells) - 1)] + rng.uniform(-0.5, 0.5, (count, 2))
    for _ in range(_ROUNDS):
        _, owner = cKDTree(points).query(cells)
        total = np.bincount(owner, weight, len(points))
        kept = total > 0
        middle = [np.bincount(owner, weight * c, len(points))[kept] for c in cells.T]
        points = np.stack(middle, axis=1) / total[kept, None]
    return points


def shortest_tour(points: Array) -> list[int]:
    """Return the order of a short closed tour through points (n, 2) that does not cross itself.

    The nearest-neighbour tour is improved by 2-opt and Or-opt among near points until neither helps (Bentley,
    "Fast algorithms for geometric traveling salesman problems", ORSA J. Computing 4, 1992).
    """
    tour = _Tour(points)
    better = True
    while better:
        better = False
        for a in range(len(points)):
            while tour.two_opt(a) or tour.or_opt(a):
                better = True
        for i, j in [] if better else _crossings(points[tour.order]):
            tour.reverse(i + 1, j)  # shortens the tour, for crossing edges are longer
            better = True
            break
    return tour.order


class _Tour:
    """A closed tour through points (n, 2): their order, and each point's place in it."""

    def __init__(self, points: Array) -> None:
        from scipy.spatial import cKDTree

        self.count = len(points)
        _, near = cKDTree(points).query(points, k=min(_NEAR + 1, self.count))
        self.neighbours = [row[1:] for row in near.tolist()]
        self.points = points.tolist()
        self.order = _nearest_first(points)
        self.place = np.argsort(self.order).tolist()

    def far(self, a: int, b: int) -> float:
        (x, y), (u, v) = self.points[a], self.points[b]
        return float(((x - u) ** 2 + (y - v) ** 2) ** 0.5)

    def at(self, place: int) -> int:
        """Return the point at a place, modulo the length of the tour."""
        return self.order[place % self.count]

    def reverse(self, i: int, j: int) -> None:
        """Reverse the tour from place i to place j, or equivalently the rest if that is shorter."""
        count = self.count
        inside = (j - i) % count + 1
        if 2 * inside > count:
            i, j, inside = (j + 1) % count, (i - 1) % count, count - inside
        for _ in range(inside // 2):
            a, b = self.order[i], self.order[j]
            self.order[i], self.order[j] = b, a
            self.place[b], self.place[a] = i, j
            i, j = (i + 1) % count, (j - 1) % count

    def two_opt(self, a: int) -> bool:
        """Try a 2-opt move at point a; return whether the tour got shorter."""
        far = self.far
        for way in (1, -1):
            b = self.at(self.place[a] + way)
            first = far(a, b)
            for c in self.neighbours[a]:
                gain = first - far(a, c)
                if gain <= 0:
                    break
                d = self.at(self.place[c] + way)
                if gain + far(c, d) - far(b, d) > 1e-9:
                    one, other = (b, c) if way == 1 else (c, b)
                    self.reverse(self.place[one], self.place[other])
                    return True
        return False

    def or_opt(self, a: int) -> bool:
        """Try an Or-opt move of up to three points from a on; return whether the tour got shorter."""
        far = self.far
        for way in (1, -1):
            for more in (0, 1, 2):
                i = self.place[a]
                moved = [self.at(i + way * k) for k in range(more + 1)]
                e, p, n = moved[-1], self.at(i - way), self.at(i + way * (more + 1))
                saved = far(p, a) + far(e, n) - far(p, n)
                for c in self.neighbours[a]:
                    if far(a, c) >= saved:
                        break
                    if c in moved:
                        continue
                    for d in (self.at(self.place[c] + 1), self.at(self.place[c] - 1)):
                        if d in moved or {c, d} == {p, n}:
                            continue
                        if saved - far(c, a) - far(e, d) + far(c, d) > 1e-9:
                            self._insert(moved, c, d)
                            return True
        return False

    def _insert(self, moved: list[int], c: int, d: int) -> None:
        """Move points, in their order, between c and d."""
        rest = [x for x in self.order if x not in moved]
        at = rest.index(c)
        if rest[(at + 1) % len(rest)] == d:  # c, a … e, d
            rest[at + 1 : at + 1] = moved
        else:  # d, e … a, c
            rest[at:at] = moved[::-1]
        self.order, self.place = rest, np.argsort(rest).tolist()


def _crossings(points: Array) -> list[tuple[int, int]]:
    """Return the pairs of edges of a closed polygon (n, 2) that cross, by the index of their first points."""
    import shapely

    edges = shapely.linestrings(np.stack([points, np.roll(points, -1, axis=0)], axis=1))
    one, other = shapely.STRtree(edges).query(edges, predicate="crosses")
    return [(int(a), int(b)) for a, b in zip(one, other, strict=True) if a < b]


def _nearest_first(points: Array) -> list[int]:
    """Return the tour that always goes on to the nearest point left."""
    left = np.ones(len(points), dtype=bool)
    tour = [0]
    left[0] = False
    for _ in range(len(points) - 1):
        away = np.where(left, ((points - points[tour[-1]]) ** 2).sum(axis=1), np.inf)
        tour.append(int(away.argmin()))
        left[tour[-1]] = False
    return tour


def _shrink(darkness: Array, cell: float) -> tuple[Array, Array]:
    """Return the mean darkness over cells of about `cell` px, and the cells' exact width and height."""
    height, width = darkness.shape
    size = (max(8, round(width / cell)), max(8, round(height / cell)))
    small = resample_mask(darkness, *size).astype(np.float64)
    return small, np.array([width / size[0], height / size[1]])


def _round_off(tour: Array, width: float, pitch: float) -> Array:
    """Round off a closed polygon and bring its strands to about `pitch` from each other; sample it evenly.

    Points are pulled to the smoothed curve and back to the polygon, while strands that are too near repel
    each other. The last state without crossings is taken.
    """
    from scipy.spatial import cKDTree

    step = _STEP * width
    line = kept = origin = sample_evenly(tour, step)
    count = len(line)
    for turn in range(1, 41):
        pairs = cKDTree(line).query_pairs(pitch, output_type="ndarray")
        along = np.abs(pairs[:, 0] - pairs[:, 1])
        pairs = pairs[np.minimum(along, count - along) * step > _APART * pitch]
        gap = line[pairs[:, 0]] - line[pairs[:, 1]]
        far = np.maximum(np.hypot(*gap.T), 1e-9)
        push = (0.5 * (pitch - far) / far)[:, None] * gap
        force = np.zeros_like(line)
        share = np.maximum(np.bincount(pairs.ravel(), minlength=count), 1)[:, None]
        for side, sign in ((0, 1.0), (1, -1.0)):
            np.add.at(force, pairs[:, side], sign * push)
        smooth = smooth_closed(line, _SMOOTH * pitch / step)
        move = force / share + 0.3 * (smooth - line) + _HELD * (origin - line)
        most = np.maximum(np.hypot(*move.T) / (0.05 * pitch), 1.0)[:, None]
        line = line + move / most
        if turn % 5 == 0 and simple_curves([line]):
            kept = line
    return sample_evenly(kept, step)


def _draw(line: Array, size: tuple[int, int]) -> Mask:
    """Draw a closed line, x and y in px, with a pen of `_LINE_PX`; (h, w)."""
    from scipy import ndimage

    off = np.ones(size, dtype=bool)
    x, y = np.round(sample_evenly(line, 0.5)).astype(int).T
    on = (x >= 0) & (y >= 0) & (x < size[1]) & (y < size[0])
    off[y[on], x[on]] = False
    return np.asarray(ndimage.distance_transform_edt(off) <= 0.5 * _LINE_PX)


def read_darkness(target: Target, invert: bool = False) -> Array:
    """Read a picture's darkness from 0, white, to 1, black, (H, W); transparent pixels are white.

    The luma of ITU-R BT.601 is stretched so that its 1st percentile is black and its 99th is white.

    Raises:
        InputError: the picture is a single grey.
    """
    what = f"picture {target.shown}"
    image, _ = raster.decode(target.png_bytes, what)
    if target.crop_px is not None:
        left, top, width, height = target.crop_px
        image = image.crop((left, top, left + width, top + height))
    if image.mode.startswith("I"):
        grey = np.asarray(image, dtype=np.float64) / 257.0
    else:
        rgba = image.convert("RGBA")
        white = Image.new("RGBA", rgba.size, "white")
        rgb = np.asarray(Image.alpha_composite(white, rgba).convert("RGB"), dtype=np.float64)
        grey = rgb @ [0.299, 0.587, 0.114]
    if invert:
        grey = 255.0 - grey
    black, white_at = np.percentile(grey, (1.0, 99.0))
    if white_at - black < 1.0:
        raise InputError(what, "it is all one grey, so there are no tones in it", "Use another.")
    return np.asarray(np.clip((white_at - grey) / (white_at - black), 0.0, 1.0))
