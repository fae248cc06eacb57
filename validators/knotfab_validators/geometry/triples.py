"""Points and vectors as three numbers, in compiled loops."""

from __future__ import annotations

from knotfab_validators.arrays import Array
from knotfab_validators.compiled import compiled

__all__ = ["corner_of", "cross", "dot", "from_segment", "minus", "nearest_parameters", "step"]

Triple = tuple[float, float, float]


@compiled
def corner_of(rows: Array, k: int) -> Triple:
    """Row k of (n, 3)."""
    return rows[k, 0], rows[k, 1], rows[k, 2]


@compiled
def minus(p: Triple, q: Triple) -> Triple:
    """p - q."""
    return p[0] - q[0], p[1] - q[1], p[2] - q[2]


@compiled
def dot(p: Triple, q: Triple) -> float:
    """The scalar product."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@compiled
def cross(p: Triple, q: Triple) -> Triple:
    """The vector product."""
    return (
        p[1] * q[2] - p[2] * q[1],
        p[2] * q[0] - p[0] * q[2],
        p[0] * q[1] - p[1] * q[0],
    )


@compiled
def step(p: Triple, far: float, along: Triple) -> Triple:
    """p + far * along."""
    return p[0] + far * along[0], p[1] + far * along[1], p[2] + far * along[2]


@compiled
def from_segment(p: Triple, a: Triple, b: Triple) -> float:
    """The distance of p from the segment a b, as `point_segment` has it."""
    span = minus(b, a)
    square = dot(span, span)
    along = dot(minus(p, a), span) / (square if square > 0.0 else 1.0)
    gap = minus(p, step(a, min(max(along, 0.0), 1.0), span))
    return float(dot(gap, gap) ** 0.5)


@compiled
def nearest_parameters(u: Triple, v: Triple, w: Triple) -> tuple[float, float]:
    """Where the segments s u and w + t v, s and t in [0, 1], are nearest, as `nearest_on_two` has it."""
    uu, vv, uv, uw, vw = dot(u, u), dot(v, v), dot(u, v), dot(u, w), dot(v, w)
    det = uu * vv - uv * uv
    s = min(max((uw * vv - vw * uv) / det, 0.0), 1.0) if det > 0.0 else 0.0
    t = min(max((s * uv - vw) / (vv if vv > 0.0 else 1.0), 0.0), 1.0)
    s = min(max((t * uv + uw) / (uu if uu > 0.0 else 1.0), 0.0), 1.0)
    return s, t
