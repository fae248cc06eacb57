"""Find the centre lines of a mesh of closed tubes from its surface alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from knotfab_formats.verdict import Check
from knotfab_validators.arrays import Array, Ints
from knotfab_validators.check import at_most, skip_check
from knotfab_validators.geometry.curves import Curves
from knotfab_validators.geometry.mesh import Mesh, sew_rims, winding_numbers
from knotfab_validators.geometry.surface import CircleFunction, Surface, circle_functions, survey

LIMIT = 0.15  # rms residual in radii: a hexagon's is 0.05, a square's 0.11
STEP = 0.25  # radii between the points at which a centre line is fitted
THIN = 3  # of the fitted points, every third is kept: at a finer spacing, facets pass for bends
# lengths of faces: shorter waves are smoothed away, since they may come from the faces
FACETS = 3.0
SHORTEST, LONGEST = 1.2, 3.0  # bounds in radii on that wavelength
LEAST_POINTS, MOST_POINTS = 72, 20_000
MOST_FACES = 1_500_000  # a larger mesh would take minutes
MOST_BODIES = 200
LEAST_SLOPE = 0.2  # least speed of the feet along the line, as a share of the points' own
ROUNDS = 6  # iterations of the fit, which converges in three or four
EVEN = 0.1  # tolerance in radii within which tubes have one thickness


@dataclass(frozen=True)
class CentreLine:
    """The centre line (n, 3) of one closed tube, evenly sampled, with its local radii (n,), mm.

    `rms` and `worst` are the residual: how far the surface departs from the local radius around the
    line, in radii, over the surface's area and at its worst place `at` (3,).
    """

    points: Array
    radii: Array
    rms: float
    worst: float
    at: Array


def check_centre_lines(mesh: Mesh) -> tuple[Check, Curves | None]:
    """Check `centre_line`: the mesh consists of closed tubes only. Return the lines found too, or None.

    It is not required, since a part that is not a tube may well be good. `measured` is the largest rms
    residual of the bodies, in radii. Tubes of different or varying thickness have no radius.
    """
    name = "centre_line"
    if not mesh.usable:
        return skip_check(name, "the mesh has no faces, or coordinates that are not finite"), None
    if len(mesh.faces) > MOST_FACES:
        return skip_check(name, f"not looked for in more than {MOST_FACES} faces"), None
    found = survey(mesh)
    if len(found.genus) > MOST_BODIES:
        return skip_check(name, f"not looked for in more than {MOST_BODIES} bodies"), None
    lines, faults = _find_all(mesh, found)
    if not lines:
        at = [line.at for line in faults.values() if isinstance(line, CentreLine)]
        detail = "no closed tube: " + _word_faults(faults, len(found.genus))
        shown = tuple((float(x), float(y), float(z)) for x, y, z in at)
        return Check(name, "fail", False, "no tube", None, "", detail, shown), None
    radii = np.concatenate([line.radii for line in lines])
    # sweeps may be twisted, and so pinched, in a few places
    low, middle, high = (float(v) for v in np.percentile(radii, (5, 50, 95)))
    even = high - low <= EVEN * middle
    worst = max(lines, key=lambda line: line.worst)
    size = f"radius {middle:.3f} mm" if even else f"radii {low:.2f} to {high:.2f} mm"
    number = "one closed tube" if len(lines) == 1 else f"{len(lines)} closed tubes"
    detail = f"found from the mesh: {number}, {size}, residual at most {worst.worst:.1%} of it"
    curves = Curves(
        tuple(line.points for line in lines),
        ("unknown",) * len(lines),
        (True,) * len(lines),
        middle if even else None,
    )
    rms = max(line.rms for line in lines)
    if faults:
        detail += "; but " + _word_faults(faults, len(found.genus))
        return Check(name, "fail", False, rms, LIMIT, "radii", detail), curves
    return at_most(name, rms, LIMIT, "radii", detail, required=False, at=[worst.at]), curves


def find_centre_line(mesh: Mesh) -> CentreLine | None:
    """Find the centre line of one body of genus 1; None if no line within it is surrounded by rings.

    Level sets of a harmonic function along the tube are rings about it, and their centroids the
    first line. Then each stretch is moved to the centre of the circle that fits the surface about it,
    and the line smoothed, a few times.

    Args:
        mesh: closed, wound in one way, nowhere pinched; every vertex is used.
    """
    corner = mesh.vertices[mesh.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    volume = abs(float(np.einsum("ij,ij->", corner[:, 0] - corner[0, 0], normal))) / 6
    if volume <= 0:
        return None
    radius = 2 * volume / float(area.sum())
    length = float(area.sum()) / (2 * np.pi * radius)
    count = int(np.clip(np.ceil(length / (STEP * radius)), LEAST_POINTS, MOST_POINTS))
    count += -count % THIN
    for function in circle_functions(mesh):
        ring, points, weight = _cut_rings(mesh, function, count)
        total = np.maximum(np.bincount(ring, weight, count), 1e-300)
        line = np.stack([np.bincount(ring, weight * x, count) / total for x in points.T], axis=1)
        probes = line[:: max(1, count // 24)]  # points of a line that must lie in the tube
        if np.abs(winding_numbers(probes, mesh)).mean() > 0.75:
            break
    else:
        return None
    place = ring.astype(np.float64)
    # where curvature sets in abruptly, as in the tightest bends, the fit overshoots without short waves
    longest = float(np.median(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(1)))
    wave = float(np.clip(FACETS * longest, SHORTEST * radius, LONGEST * radius))
    for _ in range(ROUNDS):
        line, place = _space_evenly(_smooth(line, wave), place)
        line = _recentre(line, points, weight, place)
    line, place = _space_evenly(_smooth(line, wave), place)
    far, at = _distances(line, points, place)
    radii = _mean_radii(far, at, weight, line, wave)
    return _measure_residual(mesh, area, function, line, radii, (ring, place))


def _find_all(mesh: Mesh, found: Surface) -> tuple[list[CentreLine], dict[int, CentreLine | str]]:
    """Find the lines of the bodies that are tubes; for the others, by number, say what they are."""
    lines: list[CentreLine] = []
    faults: dict[int, CentreLine | str] = {}
    for number, genus in enumerate(found.genus.tolist()):
        if found.volumes_mm3[number] < 0 < found.volumes_mm3.max():
            faults[number] = "turned inwards, a cavity"
        elif (body := _take_body(mesh, found, number)) is None:
            faults[number] = "an open surface, one wound both ways, or pinched"
        elif genus != 1:
            faults[number] = f"a surface of genus {genus}, and a closed tube's is 1"
        elif (line := _find_or_none(body)) is None:
            faults[number] = "a surface of genus 1 without a line within"
        elif line.rms > LIMIT:
            faults[number] = line
        else:
            lines.append(line)
    return lines, faults


def _find_or_none(body: Mesh) -> CentreLine | None:
    """Find a body's centre line; None too if its faces are too degenerate for a function along it."""
    try:
        return find_centre_line(body)
    except (ArithmeticError, RuntimeError, np.linalg.LinAlgError):
        return None


def _take_body(mesh: Mesh, found: Surface, number: int) -> Mesh | None:
    """Extract one body, sewn where its two ends meet; None if it is not a closed surface."""
    used, index = np.unique(mesh.faces[found.body == number], return_inverse=True)
    body = Mesh(mesh.vertices[used], index.reshape(-1, 3))
    if found.manifold or (own := survey(body)).manifold:
        return body
    sewn = None if own.crowded_edges.size or own.flipped_edges.size else sew_rims(body)
    return sewn if sewn is not None and survey(sewn).manifold else None


def _word_faults(faults: dict[int, CentreLine | str], bodies: int) -> str:
    number, fault = next(iter(faults.items()))
    if isinstance(fault, CentreLine):
        words = f"off one radius about the best line by {fault.rms:.0%} of it (rms)"
    else:
        words = fault
    which = "it is" if bodies == 1 else f"body {number} is"
    more = f", and {len(faults) - 1} more are none" if len(faults) > 1 else ""
    return f"{which} {words}{more}"


def _cut_rings(mesh: Mesh, function: CircleFunction, count: int) -> tuple[Ints, Array, Array]:
    """Cut the faces by `count` evenly spaced levels of a function, which gives rings.

    Returns ring numbers, points (k, 3) and lengths (k,). Each piece of a ring becomes three points, by
    Simpson's rule.
    """
    first = count * function.phase[mesh.faces[:, 0]]
    value = np.stack([first, *(first + count * function.rise.T)], axis=1)
    order = np.argsort(value, axis=1)
    value = np.take_along_axis(value, order, axis=1)
    corner = mesh.vertices[np.take_along_axis(mesh.faces, order, axis=1)]
    least = np.floor(value[:, 0]).astype(np.int64) + 1
    times = np.floor(value[:, 2]).astype(np.int64) + 1 - least
    face = np.repeat(np.arange(len(times)), times)
    level = np.arange(len(face)) - np.repeat(np.cumsum(times) - times, times) + least[face]
    (low, mid, high), (a, b, c) = value[face].T, corner[face].transpose(1, 0, 2)

    def between(p: Array, q: Array, begin: Array, end: Array) -> Array:
        share = (level - begin) / np.maximum(end - begin, 1e-300)
        return np.asarray(p + np.clip(share, 0.0, 1.0)[:, None] * (q - p))

    one = between(a, c, low, high)
    other = np.where((level < mid)[:, None], between(a, b, low, mid), between(b, c, mid, high))
    length = np.linalg.norm(other - one, axis=1)
    points = np.concatenate([one, 0.5 * (one + other), other])
    weight = np.concatenate([length / 6, length * 4 / 6, length / 6])
    return np.tile(level % count, 3), points, weight


def _mean_radii(far: Array, at: Ints, weight: Array, line: Array, wave: float) -> Array:
    """Return the mean distance (n,) of the surface around each point of a line, smoothed."""
    count = len(line)
    total = np.bincount(at, weight, count)
    radii = np.bincount(at, weight * far, count) / np.maximum(total, 1e-300)
    filled = np.flatnonzero(total)
    radii = np.interp(np.arange(count), filled, radii[filled], period=count)
    return _smooth(radii[:, None], wave, line)[:, 0]


def _smooth(values: Array, shortest: float, line: Array | None = None) -> Array:
    """Remove waves below `shortest` mm from values (n, k) along an even closed line (default: its points).

    By Whittaker's smoothing with third differences, in closed form on a circle, a wave of length w keeps
    1 / (1 + (`shortest` / w)^6) of its amplitude.
    """
    points = values if line is None else line
    step = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).mean()
    count = len(values)
    wave = np.sin(np.pi * np.fft.rfftfreq(count))
    cut = np.sin(np.pi * min(0.5, step / shortest))
    spectrum = np.fft.rfft(values, axis=0) / (1 + (wave / cut) ** 6)[:, None]
    return np.asarray(np.fft.irfft(spectrum, count, axis=0))


def _space_evenly(line: Array, place: Array) -> tuple[Array, Array]:
    """Resample a closed line evenly by a periodic cubic spline, and convert `place` to the new numbering."""
    from scipy.interpolate import CubicSpline

    count = len(line)
    closed = np.concatenate([line, line[:1]])
    steps = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-12 * steps.mean()))])
    even = CubicSpline(arc, closed, bc_type="periodic")(np.arange(count) * (arc[-1] / count))
    moved = np.interp(place % count, np.arange(count + 1), arc) * (count / arc[-1])
    return np.asarray(even), moved


def _frames(line: Array) -> tuple[Array, Array, Array, float]:
    """Return unit tangents and two unit normals (n, 3) at an even closed line's points, and its step."""
    along = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0)
    length = np.linalg.norm(along, axis=1)
    tangent = along / np.maximum(length, 1e-300)[:, None]
    normal = np.cross(tangent, np.eye(3)[np.abs(tangent).argmin(axis=1)])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return tangent, normal, np.cross(tangent, normal), float(length.mean()) / 2


def _project(line: Array, points: Array, place: Array) -> tuple[Ints, Array]:
    """Find the feet of points on the line: the line's nearest points (k,), and two coordinates across.

    Between its points the line is a parabola with the local curvature: chords would displace a bend
    as tight as the tube by half a hundredth of the radius, and turn it into waves. `place` (k,) is
    a guess of where along the line the feet are, and is corrected.
    """
    count = len(line)
    tangent, normal, other, step = _frames(line)
    bend = (np.roll(line, -1, axis=0) + np.roll(line, 1, axis=0) - 2 * line) / step**2
    for _ in range(3):
        at = np.round(place).astype(np.int64) % count
        gap = points - line[at]
        # Newton's step; inside a bend as tight as the tube all feet run together
        slope = np.maximum(1 - np.einsum("ij,ij->i", gap, bend[at]), LEAST_SLOPE)
        ahead = np.einsum("ij,ij->i", gap, tangent[at]) / (step * slope)
        place += np.clip(np.round(place) + ahead - place, -2.0, 2.0)
    at = np.round(place).astype(np.int64) % count
    along = (step * np.clip(place - np.round(place), -0.5, 0.5))[:, None]
    gap = points - line[at] - along * tangent[at] - 0.5 * along**2 * bend[at]
    across = np.stack([np.einsum("ij,ij->i", gap, side[at]) for side in (normal, other)], axis=1)
    # the foot's plane is turned against that of the line's point; lengths are the same in both
    far = np.maximum(np.linalg.norm(across, axis=1), 1e-300)
    return at, across * (np.linalg.norm(gap, axis=1) / far)[:, None]


def _recentre(line: Array, points: Array, weight: Array, place: Array) -> Array:
    """Move each point of the line to the centre of a circle, by least squares, through the surface around it.

    |p - c|² = r² is linear in c and r² - |c|² (Kåsa, "A circle fitting procedure", IEEE Trans.
    Instrum. Meas. 25, 1976). `place` is updated.
    """
    count = len(line)
    at, across = _project(line, points, place)
    square = np.einsum("ij,ij->i", across, across)
    rows = np.stack([2 * across[:, 0], 2 * across[:, 1], np.ones(len(at))], axis=1)
    left, right = np.empty((count, 3, 3)), np.empty((count, 3))
    for i in range(3):
        right[:, i] = np.bincount(at, weight * rows[:, i] * square, count)
        for j in range(3):
            left[:, i, j] = np.bincount(at, weight * rows[:, i] * rows[:, j], count)
    # a stretch with few points stays where it is
    total, size = left[:, 2, 2] + 1e-300, float(weight @ square / weight.sum())
    left += 1e-6 * total[:, None, None] * np.diag([size, size, 1.0])
    empty = left[:, 2, 2] <= 1e-290
    left[empty], right[empty] = np.eye(3), 0.0
    centre = np.linalg.solve(left, right[:, :, None])[:, :2, 0]
    reach = np.sqrt(size) / np.maximum(np.linalg.norm(centre, axis=1), 1e-300)
    centre *= np.minimum(1.0, 0.5 * reach)[:, None]
    _, normal, other, _ = _frames(line)
    return line + centre[:, :1] * normal + centre[:, 1:] * other


def _distances(line: Array, points: Array, place: Array) -> tuple[Array, Ints]:
    """Measure the distance (k,) of points from the line near `place`, and the nearest of its points."""
    at, across = _project(line, points, place)
    return np.linalg.norm(across, axis=1), at


def _measure_residual(
    mesh: Mesh,
    area: Array,
    function: CircleFunction,
    line: Array,
    radii: Array,
    rings: tuple[Ints, Array],
) -> CentreLine:
    """Measure how far the surface departs from the tube around a line, over corners and centres of faces.

    The integral of a square over a triangle is a quarter of the corners' mean and three quarters of the
    centre's value, exactly. `rings` are levels of the function, and where along the line they have moved.
    """
    count = len(line)
    level, place = rings
    # the mean position of each level along the line, unrolled from the first
    angle = np.exp(2j * np.pi * place / count)
    mean = np.bincount(level, angle.real, count) + 1j * np.bincount(level, angle.imag, count)
    turned = np.unwrap(np.angle(mean)) * count / (2 * np.pi)
    way = np.append(turned, turned[0] + count * np.sign(turned[-1] - turned[0]))
    corner = mesh.vertices[mesh.faces]
    middle = function.phase[mesh.faces[:, 0]] + function.rise.sum(axis=1) / 3
    where = np.concatenate([function.phase, middle % 1.0]) * count
    points = np.concatenate([mesh.vertices, corner.mean(axis=1)])
    far, at = _distances(line, points, np.interp(where, np.arange(count + 1), way))
    off = np.abs(far / radii[at] - 1)
    corners = off[: len(mesh.vertices)][mesh.faces] ** 2
    square = corners.mean(axis=1) / 4 + 0.75 * off[len(mesh.vertices) :] ** 2
    rms, worst = float(np.sqrt(area @ square / area.sum())), int(off.argmax())
    return CentreLine(line[::THIN], radii[::THIN], rms, float(off[worst]), points[worst])
