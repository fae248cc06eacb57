"""Draw random arches: depth profiles whose strands stand on the bed and carry themselves in print."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from knotfab.base.arrays import Array
from knotfab.geometry.polylines import arc_lengths
from knotfab.start.doubled import Doubled
from knotfab_formats.upright import LEAST_TIP_DEG

# least and most angle of a flank from the bed, and the lowest peak over the highest: lower ones make the
# picture plainer from the side
_FLANKS_DEG = 46.0, 51.0
_LOWEST_PEAK = 0.85
_FEET = 3  # fewest feet on which a curve stands
_ROUNDED_RADII = 2.1  # width of what rounds a peak and a valley, in tube radii
LOWEST_ARCH_RADII = 2.5  # what has no room for arches as high lies on the floor instead
_NARROW_RADII = 2.2  # a loop as wide has sides that hide each other: it stands on its edge
# how near its middle a side of a curve's feet comes, over how near a side of its whole hull does
_FEET_SHARE = 0.6
_TOUCHING_MM = 1e-6  # gap between spans that follow each other
_CHANGED = 0.5  # share of its arches that a variation changes


@dataclass(frozen=True)
class Span:
    """A stretch of a curve from foot to foot: a chain (k, 3) of peaks, mm, and slopes of both flanks.

    It takes as many arches of the chain as fit, scaled to its length. Variations leave a `held` span alone.
    """

    length_mm: float
    chain: Array
    held: bool = False

    def arches(self, length_mm: float) -> tuple[Array, Array]:
        """Return the widths of flanks (2 k,) and the peaks (k,) that fill this length, mm."""
        flanks, share = self._fitted(length_mm)
        return share * flanks.ravel(), share * self.chain[: len(flanks), 0]

    def _fitted(self, length_mm: float) -> tuple[Array, float]:
        flanks = self.chain[:, :1] / self.chain[:, 1:]
        ends = np.cumsum(flanks.sum(1))
        # round the number of arches up and scale them down, which keeps their slopes
        count = min(int(np.searchsorted(ends, length_mm)) + 1, len(flanks))
        return flanks[:count], length_mm / float(ends[count - 1])

    def split(self, at_mm: Array, first: float, radius_mm: float) -> Span:
        """Split each arch at these places in two, the one as wide as the share `first` of it."""
        flanks, share = self._fitted(self.length_mm)
        numbers = np.searchsorted(share * np.cumsum(flanks.sum(1)), at_mm)
        low = min(first, 1.0 - first) * self.chain[:, 0] < LOWEST_ARCH_RADII * radius_mm
        rows = list[Array]()
        for number, row in enumerate(self.chain):
            if number in numbers and not low[number]:
                rows += [row * [first, 1.0, 1.0], row * [1.0 - first, 1.0, 1.0]]
            else:
                rows.append(row)
        return self if len(rows) == len(self.chain) else replace(self, chain=np.array(rows))


@dataclass(frozen=True)
class Arches:
    """A depth profile of arches: the spans of each curve, one after the other.

    A curve that lies on the floor has none, and a ring that stands on its edge a single arch. `begins`: the
    share of its spans' length at which each curve starts. `tops` bound the peaks, mm.
    """

    spans: tuple[tuple[Span, ...], ...]
    begins: Array
    tops: Array
    radius_mm: float

    def heights(self, arcs: list[Array]) -> list[Array]:
        """Return heights above the floor, mm, at each curve's arc lengths (n + 1,), the last its length."""
        given = zip(self.spans, self.begins.tolist(), arcs, strict=True)
        return [self._heights_of(*one) for one in given]

    def _heights_of(self, spans: tuple[Span, ...], begin: float, arc: Array) -> Array:
        if not spans:
            return np.zeros(len(arc) - 1)
        length = float(arc[-1])
        at = (arc[:-1] + begin * length) % length
        if _stands_on_edge(spans):
            top = float(spans[0].chain[0, 0])
            return np.asarray(0.5 * top * (1.0 - np.cos(2.0 * np.pi / length * at)))
        total = sum(span.length_mm for span in spans)
        filled = [span.arches(length * (span.length_mm / total)) for span in spans]
        corners = np.concatenate([[0.0], np.cumsum(np.concatenate([f for f, _ in filled]))])
        peaks = np.zeros(len(corners))
        peaks[1::2] = np.concatenate([p for _, p in filled])
        points = max(8, int(np.ceil(length / (0.3 * self.radius_mm))))
        step = length / points
        rough = np.interp(step * np.arange(points), corners, peaks)
        window = np.hanning(2 * max(1, round(0.5 * _ROUNDED_RADII * self.radius_mm / step)) + 3)[
            1:-1
        ]
        beyond = len(window) // 2
        wrapped = np.take(rough, np.arange(-beyond, points + beyond), mode="wrap")
        smooth = np.convolve(wrapped, window / window.sum(), "valid")
        # lower the rounded valleys to the floor again
        valleys = np.round(corners[::2] / step).astype(int) % points
        raised = np.interp(step * np.arange(points), corners[::2], smooth[valleys])
        smooth = np.maximum(smooth - raised, 0.0)
        return np.asarray(np.interp(at, step * np.arange(points), smooth, period=length))

    def split(self, curve: int, shares: Array, first: float) -> Arches:
        """Split each arch at these shares of a curve's length in two, one as wide as the share `first` of it.

        Both are as steep as it was, and all other arches stay where they are.
        """
        spans, begin = list(self.spans[curve]), 0.0
        total = sum(span.length_mm for span in spans)
        at = (shares + self.begins[curve]) % 1.0 * total
        for number, span in enumerate(spans):
            inside = at[(at >= begin) & (at < begin + span.length_mm)]
            spans[number] = span.split(inside - begin, first, self.radius_mm)
            begin += span.length_mm
        if all(one is other for one, other in zip(spans, self.spans[curve], strict=True)):
            return self
        return replace(self, spans=(*self.spans[:curve], tuple(spans), *self.spans[curve + 1 :]))

    def varied(self, rng: np.random.Generator, change: float) -> Arches:
        """Return a variation in which about half the arches change, by `change` times their spread."""
        low, high = _slopes()

        def vary(span: Span, top: float) -> Span:
            chain = span.chain
            step = change * rng.normal(size=chain.shape) * (rng.random((len(chain), 1)) < _CHANGED)
            peaks = np.clip(chain[:, :1] + 0.5 * top * step[:, :1], _LOWEST_PEAK * top, top)
            slopes = np.clip(chain[:, 1:] * np.exp(0.3 * step[:, 1:]), low, high)
            return replace(span, chain=np.hstack([peaks, slopes]))

        spans = tuple(
            tuple(span if span.held else vary(span, top) for span in curve)
            for curve, top in zip(self.spans, self.tops.tolist(), strict=True)
        )
        moved = self.begins + 0.15 * change * rng.normal(size=len(self.begins))
        still = [_stands_on_edge(curve) or any(s.held for s in curve) for curve in spans]
        return replace(self, spans=spans, begins=np.where(still, self.begins, moved) % 1.0)


def _stands_on_edge(spans: tuple[Span, ...]) -> bool:
    return len(spans) == 1 and len(spans[0].chain) == 1


def _slopes() -> tuple[float, float]:
    low, high = np.tan(np.radians(_FLANKS_DEG)).tolist()
    return low, high


def draw_arches(
    rng: np.random.Generator,
    arcs: list[Array],
    tops: Array,
    radius_mm: float,
    folds: Sequence[float | None],
    doubled: Sequence[Doubled] = (),
) -> Arches:
    """Draw random arches for curves of these arc lengths (n + 1,), with peaks up to `tops`, mm.

    A curve too short for three feet gets lower arches. A very short one lies on the floor, or stands on its
    edge if it is narrow: `folds` is what `fold_of` finds. `doubled` are from `find_doubled`.
    """
    low, high = _slopes()
    wide = 2.0 / (0.5 * (low + high))  # length of an arch over its height
    lengths = np.array([float(arc[-1]) for arc in arcs])
    tops = np.minimum(tops, lengths / (_FEET * wide))
    held: list[list[tuple[float, Span]]] = [[] for _ in arcs]
    for one in doubled:
        more = list(map(list, held))
        for curve, begin, end, slope in one.nest(rng, tops[list(one.curves)].min(), radius_mm):
            along = float((end - begin) % lengths[curve])
            arch = np.array([[0.5 * along * slope, slope, slope]])
            more[curve].append((float(begin % lengths[curve]), Span(along, arch, held=True)))
        more = [sorted(spans, key=lambda at: at[0]) for spans in more]
        if all(map(_are_apart, more, lengths.tolist())):
            held = more

    def draw(length: float, top: float, count: int) -> Span:
        peaks = rng.uniform(_LOWEST_PEAK, 1.0, (count, 1)) * top
        angles = np.radians(rng.uniform(*_FLANKS_DEG, (count, 2)))
        return Span(length, np.hstack([peaks, np.tan(angles)]))

    def draw_free(length: float, top: float) -> Span:
        return draw(length, top, int(np.ceil(length * high / (2 * _LOWEST_PEAK * top))) + 1)

    found, begun = list[tuple[Span, ...]](), dict[int, float]()
    for number, fold in enumerate(folds):
        spans, length, top = list[Span](), float(lengths[number]), float(tops[number])
        nests = held[number]
        if top < LOWEST_ARCH_RADII * radius_mm:
            if fold is not None:
                tops[number] = top = max(0.5 * length, LOWEST_ARCH_RADII * radius_mm)
                spans = [draw(length, top, 1)]
                # both ends are half as high, so that one side passes above the other
                begun[number] = 0.25 - fold
        elif not nests:
            spans = [draw_free(length, top)]
        else:
            begun[number] = -nests[0][0] / length
            for span, gap in zip([span for _, span in nests], _gaps(nests, length), strict=True):
                spans.append(span)
                if gap > _TOUCHING_MM:
                    spans.append(draw_free(gap, top))
        found.append(tuple(spans))
    begins = rng.uniform(size=len(arcs))
    begins[list(begun)] = list(begun.values())
    return Arches(tuple(found), begins % 1.0, tops, radius_mm)


def _gaps(spans: list[tuple[float, Span]], length: float) -> list[float]:
    """Return how far it is from each span to the next on a closed curve, mm; negative if they overlap."""
    begins = [begin for begin, _ in spans]
    return [
        end - begin - span.length_mm
        for (begin, span), end in zip(
            spans, [*begins[1:], *(b + length for b in begins[:1])], strict=True
        )
    ]


def _are_apart(spans: list[tuple[float, Span]], length: float) -> bool:
    return all(gap > -_TOUCHING_MM for gap in _gaps(spans, length))


def fold_of(curve: Array, radius_mm: float) -> float | None:
    """Find where a narrow closed curve (n, 2) turns back, as a share of its length; None if it is wide."""
    arc, (x, y) = arc_lengths(curve), curve.T
    area = 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    if 4.0 * area >= _NARROW_RADII * radius_mm * arc[-1]:
        return None
    centred = curve - curve.mean(0)
    axis = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    return float(arc[int((centred @ axis).argmax())] / arc[-1])


def highest_mm(curve: Array) -> float:
    """Return how high, mm, the peaks of a closed curve (n, 2) that stands alone may be without toppling it.

    Its centre is taken to lie at 0.4 of that height, and its feet anywhere along the curve.
    """
    edge = np.roll(curve, -1, axis=0) - curve
    length = np.linalg.norm(edge, axis=1)
    middle = length @ (curve + 0.5 * edge) / length.sum()
    try:
        sides = ConvexHull(curve).equations
    except QhullError:
        return 0.0
    inside = float(-(sides[:, :2] @ middle + sides[:, 2]).max())
    return _FEET_SHARE * inside / (0.4 * float(np.tan(np.radians(LEAST_TIP_DEG))))
