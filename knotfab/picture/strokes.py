"""Centre lines of a drawing's strokes as a plane graph, along whose edges one tube each runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from knotfab.base.arrays import Array, Indices, Mask
from knotfab.geometry.polylines import arc_lengths, points_at
from knotfab.picture.silhouette import fill_holes, sample_mask
from knotfab_formats.libraries import took_part

if TYPE_CHECKING:
    import networkx as nx

Line = Array
"""(n, 2) points of one stroke between two places where strokes end or meet."""

_RADIUS_PX = 6.0  # half a stroke's width in the picture that is thinned
_DEEP = 0.75  # half widths: a line nearer to the outline leads from an end to the outline
_SPUR = 1.3  # half widths: a free end no longer is a corner of the outline, no stroke
_SHORT = 1.6  # half widths: strokes that meet no farther apart meet in one point
_SMOOTH = 0.5  # half widths: the stair steps of pixels are smoothed away by so much
_HOLE = 3.0  # half widths squared: area of a hole too small for strokes about it
_DOT = 0.5  # half widths: length of the line that stands for a dot


def trace_strokes(mask: Mask, width_px: float) -> list[Line]:
    """Trace the centre lines of strokes that are about `width_px` wide or wider.

    The skeleton by thinning (Zhang and Suen 1984, of scikit-image) is taken as a graph of pixels. Its chains
    are lines; spurs are dropped, junctions nearer than a stroke is wide become one, stair steps are smoothed.

    Args:
        mask: (H, W), strokes widened.

    Returns:
        Lines in pixels of the mask. Those that meet have that end in common, exactly; a closed line
        that meets no other begins where it ends.
    """
    from scipy.ndimage import distance_transform_edt
    from skimage.morphology import skeletonize

    took_part("scikit-image", "thinned the picture to strokes")
    height, width = mask.shape
    zoom = _RADIUS_PX / (0.5 * width_px)
    columns, rows = max(1, round(zoom * width)), max(1, round(zoom * height))
    fine = np.pad(sample_mask(mask, columns, rows), 1)
    fine = fill_holes(fine, _HOLE * _RADIUS_PX**2)
    skeleton = np.asarray(skeletonize(fine))
    graph = _build_chains(*_cut_ends(*_link_pixels(skeleton), distance_transform_edt(fine)))
    _tidy_graph(graph)
    scale = np.array([width / columns, height / rows])
    return [(line - 0.5) * scale - 0.5 for line in _lines(graph)]


def _link_pixels(skeleton: Mask) -> tuple[Indices, Indices]:
    """Return the pixels (n, 2) of a skeleton as (x, y) in order, and the pairs (m, 2) that touch.

    Pixels touch corner to corner only where no third pixel joins them.
    """
    on = np.pad(skeleton, 1).T
    pixels = np.argwhere(on)
    number = np.full(on.shape, -1)
    number[tuple(pixels.T)] = np.arange(len(pixels))
    links = []
    for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
        x, y = pixels.T
        linked = on[x + dx, y + dy]
        if dx and dy:
            linked &= ~(on[x + dx, y] | on[x, y + dy])
        links.append(np.stack([np.flatnonzero(linked), number[x + dx, y + dy][linked]], axis=1))
    return pixels - 1, np.concatenate(links)


def _cut_ends(pixels: Indices, links: Indices, inside: Array) -> tuple[Indices, Indices]:
    """Trim the links from a stroke's round end to its outline.

    Args:
        inside: (H, W) px from the background.
    """
    shallow = inside[pixels[:, 1], pixels[:, 0]] < _DEEP * _RADIUS_PX
    kept = np.ones(len(pixels), dtype=bool)
    for _ in range(round(2 * _RADIUS_PX)):
        kept &= ~(shallow & (_degrees(links, len(pixels)) == 1))
        links = links[kept[links].all(axis=1)]
    return pixels[kept], (np.cumsum(kept) - 1)[links]


def _degrees(links: Indices, count: int) -> Indices:
    return np.bincount(links.ravel(), minlength=count)


def _build_chains(pixels: Indices, links: Indices) -> nx.MultiGraph:
    """Build the graph with ends and junctions as nodes, and pixel chains between them as edges."""
    import networkx as nx
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    took_part("networkx", "linked the strokes")
    count = len(pixels)
    pairs = np.concatenate([links, links[:, ::-1]])
    touch = csr_array((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(count, count))
    touch.sort_indices()
    joint = _degrees(links, count) != 2
    part = connected_components(touch, directed=False)[1]
    firsts = np.unique(part, return_index=True)[1]
    joint[firsts[~np.isin(part[firsts], part[joint])]] = True  # a ring begins at its first pixel
    ends, beside, nodes = touch.indptr.tolist(), touch.indices.tolist(), joint.tolist()
    graph = nx.MultiGraph()
    starts = np.flatnonzero(joint).tolist()
    graph.add_nodes_from((k, {"at": pixels[k].astype(np.float64)}) for k in starts)
    for start in starts:
        for step in beside[ends[start] : ends[start + 1]]:
            chain = [start, step]
            while not nodes[chain[-1]]:
                one, other = beside[ends[chain[-1]] : ends[chain[-1] + 1]]
                chain.append(other if one == chain[-2] else one)
            # each chain is met from both of its ends
            if (start, step) <= (chain[-1], chain[-2]):
                _add_line(graph, start, chain[-1], pixels[chain].astype(np.float64))
    return graph


def _length(points: Line) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _add_line(graph: nx.MultiGraph, one: Any, other: Any, points: Line) -> None:
    graph.add_edge(one, other, points=points, length=_length(points))


def _tidy_graph(graph: nx.MultiGraph) -> None:
    """Drop spurs, merge close junctions, and join lines at nodes of degree two."""
    while True:
        degree = dict(graph.degree)
        short = [
            (length, one, other, key)
            for one, other, key, length in graph.edges(keys=True, data="length")
            if length < max(_SPUR, _SHORT) * _RADIUS_PX
        ]
        spurs = [
            (length, one, other, key)
            for length, one, other, key in short
            if length < _SPUR * _RADIUS_PX and {1} < {min(degree[one], 3), min(degree[other], 3)}
        ]
        inner = [
            edge
            for edge in short
            if edge[0] < _SHORT * _RADIUS_PX and min(degree[n] for n in edge[1:3]) > 2
        ]
        if spurs:
            _, one, other, key = min(spurs)
            graph.remove_edge(one, other, key)
            graph.remove_nodes_from([n for n in (one, other) if graph.degree(n) == 0])
        elif inner:
            _, one, other, key = min(inner)
            _contract_edge(graph, one, other, key)
        else:
            break
        for node in (one, other):
            _join_through(graph, node)


def _contract_edge(graph: nx.MultiGraph, one: Any, other: Any, key: int) -> None:
    """Contract an edge to a node at its midpoint; a loop is only removed."""
    graph.remove_edge(one, other, key)
    if one == other:
        return
    graph.nodes[one]["at"] = 0.5 * (graph.nodes[one]["at"] + graph.nodes[other]["at"])
    for a, b, data in list(graph.edges(other, data=True)):
        points = data["points"] if _starts_at(data, graph, a) else data["points"][::-1]
        _add_line(graph, one, one if b == other else b, points)
    graph.remove_node(other)
    at = graph.nodes[one]["at"]
    for _, b, data in graph.edges(one, data=True):
        for end in (0, -1):
            if b == one or (end == 0) == _starts_at(data, graph, one):
                data["points"][end] = at
        data["length"] = _length(data["points"])


def _starts_at(data: dict[str, Any], graph: nx.MultiGraph, node: Any) -> bool:
    """Return whether an edge's points start, rather than end, at this node."""
    first, last = data["points"][0], data["points"][-1]
    at = graph.nodes[node]["at"]
    return bool(np.hypot(*(first - at)) <= np.hypot(*(last - at)))


def _join_through(graph: nx.MultiGraph, node: Any) -> None:
    """Join the two lines at a node of degree two."""
    if node not in graph or graph.degree(node) != 2:
        return
    edges = list(graph.edges(node, keys=True, data=True))
    if len(edges) != 2:
        return  # a ring
    (_, a, ka, one), (_, b, kb, other) = edges
    first = one["points"][::-1] if _starts_at(one, graph, node) else one["points"]
    second = other["points"] if _starts_at(other, graph, node) else other["points"][::-1]
    graph.remove_edges_from([(node, a, ka), (node, b, kb)])
    graph.remove_node(node)
    _add_line(graph, a, b, np.concatenate([first, second[1:]]))


def _lines(graph: nx.MultiGraph) -> list[Line]:
    """Return the edges smoothed with fixed ends; a dot becomes a short line."""
    found = []
    for node in graph:
        if graph.degree(node) == 0:
            at, reach = graph.nodes[node]["at"], np.array([0.5 * _DOT * _RADIUS_PX, 0.0])
            found.append(np.stack([at - reach, at + reach]))
    for one, other, data in graph.edges(data=True):
        closed = one == other and graph.degree(one) == 2
        found.append(_smooth(data["points"], closed))
    return found


def _smooth(points: Line, closed: bool) -> Line:
    """Resample a line evenly and smooth it, with fixed ends unless it is closed."""
    from scipy.ndimage import gaussian_filter1d

    arc = arc_lengths(points, closed=False)
    count = max(3, round(arc[-1]) + 1)
    at = np.linspace(0.0, arc[-1], count)
    even = points_at(points, arc, at)
    sigma = _SMOOTH * _RADIUS_PX
    if closed:
        ring = gaussian_filter1d(even[:-1], sigma, axis=0, mode="wrap")
        return np.concatenate([ring, ring[:1]])
    # mirrored in a point at its ends, so that these stay
    reach = min(count - 1, int(4 * sigma))
    ends = (2 * even[0] - even[reach:0:-1], 2 * even[-1] - even[-2 : -2 - reach : -1])
    wide = gaussian_filter1d(np.concatenate([ends[0], even, ends[1]]), sigma, axis=0)
    smooth = wide[reach : reach + count]
    smooth[[0, -1]] = points[[0, -1]]  # exactly: lines meet there
    return np.asarray(smooth)
