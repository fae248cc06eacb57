"""Bend several pictures as little as possible so that their visual hull draws them all.

A contradiction is the part of a picture that the shadow of the hull of the *other* pictures leaves uncovered
(Mitra & Pauly, "Shadow Art", 2009). The control points descend the sum of squared contradictions and an
elastic energy, whose weight falls until the contradictions are negligible.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.base.compiled import compiled
from knotfab.design.hull import rays_within
from knotfab.picture.bending import COLUMNS, ROWS, spline_basis
from knotfab.picture.silhouette import fit_size, holes_of, sample_mask, signed_distance
from knotfab.scene.camera import Camera, Plane

_SIDE_PX = 96  # longer side of the pictures that are bent, px
_FINE_PX = 384  # longer side at which distances from the outline are measured, px
_STEPS = 97  # samples of a ray
_SPARE = 0.16  # width of the empty margin around the frame, as a share of its height
_BLURS_PX = (6.0, 1.0)  # half width of the soft outline, first and last
_WEIGHTS = (0.3, 0.001)  # weight of the elastic energy, first and last
_ROUNDS, _TURNS = 16, 8  # number of weights, and of steps with each
_LESS = 0.8  # factor by which a sufficient bending is reduced while it stays sufficient
_FEWER = 5  # most reductions
_MORE = 9  # further weights that are tried for all that could be reached, once the least is
_PACE = 0.004  # length of a step, as a share of the height
# uniform shift that costs as much as a uniform stretch of 1, as a share of the height
_PLACE = 0.12
_STIFF = 2.0  # stiffness of strokes and small holes, over that of areas
_SLOPE = 0.45  # slope of the displacement above which it is penalised
_FOLD = 3.0  # weight of that penalty
_THIN = 0.07  # width of the widest stroke, as a share of the height
_HOLE = 0.02  # area of the largest small hole, as a share of the squared height
_DENSE = 0.25  # share of strokes and small holes around a control point that makes it fully stiff


class Tension:
    """Energies of the control points of several pictures, contradiction and strain, with their gradients.

    Args:
        cameras: one a view, at its mask's resolution. reach_mm, walls: as for `hull_bounds`.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        masks: Sequence[Mask],
        reach_mm: float,
        walls: Sequence[Plane] = (),
    ) -> None:
        self.fields, self.down, self.across, self.heights, self.pads = [], [], [], [], []
        self.stiff, self.steps = [], []
        begin, ray, owner, inside, projections, shapes = [], [], [], [], [], []
        for k, (camera, mask) in enumerate(zip(cameras, masks, strict=True)):
            width, height = fit_size(camera.width, camera.height, _SIDE_PX)
            pad = int(np.ceil(_SPARE * height))
            small = camera.resized(width, height).padded(pad, pad)
            u, v = np.arange(small.width) - pad, np.arange(small.height) - pad
            self.fields.append(np.pad(_signed_distance(mask, width, height), 2 * pad, mode="edge"))
            self.fields[-1] -= _distance_from_frame(self.fields[-1].shape, 2 * pad)
            self.down.append(spline_basis(v.astype(float), height, ROWS))
            self.across.append(spline_basis(u.astype(float), width, COLUMNS))
            self.heights.append(height)
            self.pads.append(pad)
            stiff = _stiffness(mask)
            self.stiff.append(
                [np.minimum(stiff[1:], stiff[:-1]), np.minimum(stiff[:, 1:], stiff[:, :-1])]
            )
            self.steps.append((1.0 / (ROWS - 3), width / height / (COLUMNS - 3)))
            at = np.stack(np.meshgrid(u + pad, v + pad), axis=-1).reshape(-1, 2)
            on = small.corner + at[:, :1] * small.du + at[:, 1:] * small.dv
            middle, half = rays_within(small, on, reach_mm, walls)
            begin.append(middle)
            ray.append(half)
            owner.append(np.full(len(half), k))
            there = (at >= pad) & (at < pad + np.array([width, height]))
            inside.append(there.all(axis=1))
            projections.append(small.projection)
            shapes.append((small.height, small.width))
        self.shapes = np.array(shapes)
        self.firsts = np.concatenate([[0], np.cumsum(self.shapes.prod(1))])
        self.rays = (
            np.stack(projections),
            np.concatenate(owner),
            np.arange(self.firsts[-1]),
            np.concatenate(inside),
            np.concatenate(begin),
            np.concatenate(ray),
            np.linspace(-1.0, 1.0, _STEPS),
        )
        self.winner = np.full(self.firsts[-1], _STEPS // 2)
        self.ink = float(sum((f > 0).sum() for f in self.fields))

    def covers(self, points: Array, blur_px: float) -> tuple[Array, Array]:
        """Return the soft coverage of each pixel of all views, (N,), and its gradient, (N, 2)."""
        total = int(self.firsts[-1])
        cover, slope = np.empty(total), np.empty((total, 2))
        for k, field in enumerate(self.fields):
            own = slice(self.firsts[k], self.firsts[k + 1])
            height, pad = self.heights[k], self.pads[k]
            away = height * np.einsum(
                "ri,ijd,cj->rcd", self.down[k], points[k], self.across[k], optimize=True
            )
            rows, columns = np.indices(away.shape[:2])
            sample_field(
                field,
                (columns + away[..., 0] + pad).ravel(),
                (rows + away[..., 1] + pad).ravel(),
                cover[own],
                slope[own],
            )
        s = np.clip(0.5 + 0.5 * cover / blur_px, 0.0, 1.0)
        return s * s * (3 - 2 * s), slope * (3 * s * (1 - s) / blur_px)[:, None]

    def contradiction(self, points: Array, blur_px: float) -> tuple[float, Array]:
        """Return the squared uncovered ink over all ink, and its gradient by the control points."""
        cover, slope = self.covers(points, blur_px)
        pull = np.zeros(len(cover))
        total = uncovered(cover, self.firsts, self.shapes, *self.rays, self.winner, pull)
        gradient = np.empty_like(points)
        for k in range(len(points)):
            own = slice(self.firsts[k], self.firsts[k + 1])
            moved = (pull[own, None] * slope[own]).reshape(*self.shapes[k], 2)
            gradient[k] = self.heights[k] * np.einsum(
                "ri,rcd,cj->ijd", self.down[k], moved, self.across[k], optimize=True
            )
        return total / self.ink, gradient / self.ink

    def strain(self, points: Array, weight: float, stiff: float = 1.0) -> tuple[float, Array]:
        """Return the weighted elastic energy plus the penalty on folds, and the gradient.

        Args:
            stiff: 1 stiffens strokes and small holes fully, 0 treats all parts alike.
        """
        total, gradient = 0.0, np.empty_like(points)
        for k, steps in enumerate(self.steps):
            each = weight / (ROWS * COLUMNS)
            total += each * float((points[k] ** 2).sum()) / _PLACE**2
            gradient[k] = 2 * each * points[k] / _PLACE**2
            for axis, step in enumerate(steps):
                slope = np.diff(points[k], axis=axis) / step
                firm = self.stiff[k][axis] ** stiff
                size = np.linalg.norm(slope, axis=2)
                over = np.maximum(size - _SLOPE, 0.0)
                total += each * float((firm * size**2).sum())
                total += _FOLD / (ROWS * COLUMNS) * float((over**2).sum())
                force = each * firm + _FOLD / (ROWS * COLUMNS) * over / np.maximum(size, 1e-12)
                pulled = 2 * force[..., None] * slope / step
                first, last = ([slice(None)] * 2, [slice(None)] * 2)
                first[axis], last[axis] = slice(None, -1), slice(1, None)
                gradient[k][tuple(first)] -= pulled
                gradient[k][tuple(last)] += pulled
        return total, gradient

    def without_folds(self, points: Array) -> Array:
        """Scale the displacements of each picture down until its field cannot fold."""
        steepest = [
            max(
                np.linalg.norm(np.diff(p, axis=axis), axis=2).max() / step
                for axis, step in enumerate(steps)
            )
            for p, steps in zip(points, self.steps, strict=True)
        ]
        # with slopes of 0.7 along both axes a step may vanish
        shares = np.minimum(1.0, 0.69 / np.maximum(steepest, 1e-12))
        return np.asarray(points * shares[:, None, None, None])


def bend_pictures(
    cameras: Sequence[Camera],
    masks: Sequence[Mask],
    reach_mm: float,
    most: float,
    grade: Callable[[Array], int],
    walls: Sequence[Plane] = (),
) -> Array:
    """Return displacements of the control points, (m, ROWS, COLUMNS, 2) in shares of a picture's height.

    The bending grows until `grade` gives it 2, or the last weight of the elastic energy is reached. Where 1
    is reached and 2 is not soon after, the first bending of 1 is returned.

    Args:
        grade: returns how well pictures bent so agree: 0 too little, 1 enough, 2 everywhere.
        cameras, masks, reach_mm, walls: as for `hull_bounds`.
        most: limit on a control point's displacement, as a share of the height.
    """
    tension = Tension(cameras, masks, reach_mm, walls)
    points = np.zeros((len(masks), ROWS, COLUMNS, 2))
    if grade(points) == 2:
        return points
    mean, square, step = np.zeros_like(points), np.zeros_like(points), 0
    reached, first, since = 0, points, 0
    for turn in range(_ROUNDS):
        share = turn / (_ROUNDS - 1)
        weight = _WEIGHTS[0] * (_WEIGHTS[1] / _WEIGHTS[0]) ** share
        blur = max(_BLURS_PX[1], _BLURS_PX[0] * (_BLURS_PX[1] / _BLURS_PX[0]) ** (2 * share))
        for _ in range(_TURNS):
            step += 1
            _, gradient = tension.contradiction(points, blur)
            gradient += tension.strain(points, weight, 1.0 - share)[1]
            mean += 0.1 * (gradient - mean)
            square += 0.02 * (gradient**2 - square)
            points = points - _PACE * (mean / (1 - 0.9**step)) / (
                np.sqrt(square / (1 - 0.98**step)) + 1e-9
            )
            points *= np.minimum(1.0, most / np.maximum(np.linalg.norm(points, axis=3), 1e-12))[
                ..., None
            ]
        points = tension.without_folds(points)
        found = grade(points)
        if found > reached:
            reached, first = found, points
        since += reached > 0
        if reached == 2 or since > _MORE:
            break
    if not reached:
        return points
    for _ in range(_FEWER):  # the last weight was a little too small
        if grade(_LESS * first) < reached:
            break
        first = _LESS * first
    return first


def _distance_from_frame(shape: tuple[int, ...], pad: int) -> Array:
    """Return the distance of each pixel of a padded field from the frame, px; 0 inside it."""
    rows, columns = (
        np.maximum(np.maximum(pad - np.arange(n), np.arange(n) - (n - 1 - pad)), 0) for n in shape
    )
    return np.hypot(rows[:, None], columns[None, :])


def _signed_distance(mask: Mask, width: int, height: int) -> Array:
    """Return the signed distance from the outline in px of a picture of this size, positive inside."""
    from PIL import Image

    wide, high = fit_size(width, height, _FINE_PX)
    fine = np.asarray(Image.fromarray(mask).convert("L").resize((wide, high), Image.Resampling.BOX))
    signed = signed_distance(np.pad(fine >= 128, 1))[1:-1, 1:-1]
    small = Image.fromarray(signed.astype(np.float32)).resize((width, height), Image.Resampling.BOX)
    return np.asarray(small, dtype=np.float64) * (width / wide)


def _stiffness(mask: Mask) -> Array:
    """Return the stiffness at each control point, (ROWS, COLUMNS): 1 for areas, up to `_STIFF`.

    Bending shows first on strokes, which look crooked, and on small holes, which lose their roundness.
    """
    width, height = fit_size(mask.shape[1], mask.shape[0], _SIDE_PX)
    small = sample_mask(mask, width, height)
    reach = 0.5 * _THIN * height
    inside = distance_transform_edt(np.pad(small, 1))[1:-1, 1:-1]
    thick = (
        distance_transform_edt(inside < reach) < reach if (inside >= reach).any() else small & False
    )
    labels, areas = holes_of(small)
    holes = np.isin(labels, 1 + np.flatnonzero(areas < _HOLE * height**2))
    delicate = gaussian_filter(((small & ~thick) | holes).astype(np.float64), height / ROWS)
    rows, columns = (
        np.clip(np.rint((np.arange(count) - 1) / (count - 3) * side - 0.5), 0, side - 1).astype(int)
        for count, side in ((ROWS, height), (COLUMNS, width))
    )
    return np.asarray(
        1.0 + (_STIFF - 1.0) * np.minimum(1.0, delicate[np.ix_(rows, columns)] / _DENSE)
    )


@compiled
def sample_field(field: Array, u: Array, v: Array, value: Array, slope: Array) -> None:
    """Write bilinear values, (n,), and slopes, (n, 2), of a field (h, w) at (u, v), clamped to its edges."""
    rows, columns = field.shape
    for n in range(len(u)):
        x, y = min(max(u[n], 0.0), columns - 1.001), min(max(v[n], 0.0), rows - 1.001)
        i, j = int(y), int(x)
        p, q = y - i, x - j
        a, b, c, d = field[i, j], field[i, j + 1], field[i + 1, j], field[i + 1, j + 1]
        value[n] = (1 - p) * ((1 - q) * a + q * b) + p * ((1 - q) * c + q * d)
        slope[n, 0] = (1 - p) * (b - a) + p * (d - c)
        slope[n, 1] = (1 - q) * (c - a) + q * (d - b)


@compiled
def uncovered(
    cover: Array,
    firsts: Indices,
    shapes: Indices,
    projections: Array,
    owner: Indices,
    pixel: Indices,
    inside: Mask,
    begin: Array,
    ray: Array,
    along: Array,
    winner: Indices,
    pull: Array,
) -> float:
    """Sum the squares of the coverage that the shadow of the other pictures' hull lacks.

    The hull's shadow on a ray is the maximum, over the ray's samples, of the minimum of the others' coverage.

    Args:
        cover: (N,) coverage of all views' pixels; those of view k begin at `firsts[k]`.
        projections: (m, 3, 4) onto these pixels. owner, pixel: the view of each ray and its index in `cover`.
        inside: whether each ray is in its frame; outside it nothing is covered.
        winner: sample at which each ray's maximum was found last, overwritten. pull: (N,) gradient, added to.
    """
    total = 0.0
    count = len(shapes)
    here, ahead = np.empty((count, 3)), np.empty((count, 3))
    for n in range(len(owner)):
        own = cover[pixel[n]]
        if own <= 1e-4:
            continue
        best, where, which = 0.0, -1, -1
        if inside[n]:
            for k in range(count):
                for i in range(3):
                    p = projections[k, i]
                    here[k, i] = p[0] * begin[n, 0] + p[1] * begin[n, 1] + p[2] * begin[n, 2] + p[3]
                    ahead[k, i] = p[0] * ray[n, 0] + p[1] * ray[n, 1] + p[2] * ray[n, 2]
            for trial in range(-1, len(along)):
                t = winner[n] if trial < 0 else trial
                a = along[t]
                least, by = 2.0, -1
                for k in range(count):
                    if k == owner[n]:
                        continue
                    w = here[k, 2] + a * ahead[k, 2]
                    u, v = (here[k, 0] + a * ahead[k, 0]) / w, (here[k, 1] + a * ahead[k, 1]) / w
                    rows, columns = shapes[k]
                    if w <= 0 or not (0 <= u < columns - 1 and 0 <= v < rows - 1):
                        least = 0.0
                        break
                    i, j = int(v), int(u)
                    f, q, e = v - i, u - j, firsts[k] + i * columns + j
                    value = (1 - f) * ((1 - q) * cover[e] + q * cover[e + 1]) + f * (
                        (1 - q) * cover[e + columns] + q * cover[e + columns + 1]
                    )
                    if value < least:
                        least, by = value, k
                    if least <= best:
                        break
                if least > best:
                    best, where, which = least, t, by
                if best >= own:
                    break
        if where >= 0:
            winner[n] = where
        lack = own - best
        if lack <= 0:
            continue
        total += lack * lack
        pull[pixel[n]] += 2 * lack
        if which >= 0:
            a = along[where]
            w = here[which, 2] + a * ahead[which, 2]
            u = (here[which, 0] + a * ahead[which, 0]) / w
            v = (here[which, 1] + a * ahead[which, 1]) / w
            columns = shapes[which, 1]
            i, j = int(v), int(u)
            f, q, e = v - i, u - j, firsts[which] + i * columns + j
            pull[e] -= 2 * lack * (1 - f) * (1 - q)
            pull[e + 1] -= 2 * lack * (1 - f) * q
            pull[e + columns] -= 2 * lack * f * (1 - q)
            pull[e + columns + 1] -= 2 * lack * f * q
    return total
