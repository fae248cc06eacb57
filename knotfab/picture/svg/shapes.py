"""CSS transforms as matrices, and strokes that do not scale as strokes that do."""

from __future__ import annotations

import copy
import math
from xml.etree.ElementTree import Element

from fontTools.misc.transform import Identity, Transform
from fontTools.pens.basePen import AbstractPen, PenError
from fontTools.pens.boundsPen import BoundsPen
from fontTools.pens.svgPathPen import SVGPathPen
from fontTools.pens.transformPen import TransformPen
from fontTools.svgLib.path import parse_path

from knotfab.picture.svg.size import read_length
from knotfab.picture.svg.style import MOVING, Styles
from knotfab.picture.svg.transforms import (
    NUMBER,
    Box,
    UnreadableError,
    as_function,
    read_list,
    read_origin,
    spread,
)
from knotfab.picture.svg.xml import SVG, XLINK, local_name

_UNEVEN = 1.01  # a stroke stretched by less is as wide to every side
_CALLS = frozenset([*MOVING, "vector-effect"])


def place(root: Element, styles: Styles, longer_px: float) -> None:
    """Write the transforms of a tree as matrices, and strokes that do not scale in the widths they have.

    Args:
        root: <svg>, with the size in px at which it is drawn. styles: what its elements say.
        longer_px: px of CSS of its longer side, as the file has it.
    """
    if any(_CALLS.intersection(own) for own in styles.of.values()) or any(
        "transform-origin" in e.attrib for e in root.iter()
    ):
        _Placer(root, styles, longer_px)


class _Placer:
    def __init__(self, root: Element, styles: Styles, longer_px: float) -> None:
        wide, high = (read_length(root.get(side, "")) or 100.0 for side in ("width", "height"))
        shrink = longer_px / max(wide, high)
        wide, high = wide * shrink, high * shrink
        box = _view_box(root) or Box(0.0, 0.0, wide, high)
        scale = wide / box.width, high / box.height
        if root.get("preserveAspectRatio", "").strip() != "none":
            scale = (min(scale),) * 2
        self._root, self._styles, self._box = root, styles, box
        self._ids = {e.get("id"): e for e in root.iter() if e.get("id")}
        if any("vector-effect" in s for s in styles.of.values()):
            self._left = 10_000  # elements that references may be written out to
            self._write_out_uses(root, ())
        self._visit(root, Transform(scale[0], 0, 0, scale[1], 0, 0), box, {})

    def _write_out_uses(self, parent: Element, within: tuple[Element, ...]) -> None:
        """Replace references to shapes whose stroke does not scale by copies."""
        of = self._styles.of
        for place, child in enumerate(list(parent)):
            target = self._ids.get(child.get(f"{{{XLINK}}}href", "").removeprefix("#"))
            if local_name(child) != "use" or target is None or target in within:
                self._write_out_uses(child, within)
                continue
            copied = copy.deepcopy(target)
            self._left -= sum(1 for _ in copied.iter())
            if self._left < 0:
                self._styles.note("strokes that do not scale are scaled where it repeats shapes")
                return
            for old, new in zip(target.iter(), copied.iter(), strict=True):
                of[new] = dict(of.get(old, {}))
            if local_name(copied) == "symbol":
                copied.tag = f"{{{SVG}}}svg"
                for side in ("width", "height"):
                    copied.set(side, child.get(side, "100%"))
            group = Element(
                f"{{{SVG}}}g", {k: v for k, v in child.attrib.items() if k == "transform"}
            )
            inner = Element(
                f"{{{SVG}}}g",
                {
                    "transform": f"translate({read_length(child.get('x', '0')) or 0:g} "
                    f"{read_length(child.get('y', '0')) or 0:g})"
                },
            )
            inner.append(copied)
            group.append(inner)
            group.tail = child.tail
            of[group], of[inner] = of.get(child, {}), {}
            parent[place] = group
            self._write_out_uses(copied, (*within, target))

    def _visit(
        self, element: Element, matrix: Transform, box: Box, inherited: dict[str, str]
    ) -> None:
        """Write an element's own transform and stroke; `matrix` leads from its parent's units to CSS px."""
        own = self._styles.of.get(element, {})
        outer = matrix
        try:
            moved = self._transform(element, own, box)
        except (ValueError, ArithmeticError, TypeError) as unknown:
            self._styles.note(f"transform: {str(unknown)[:60]} is left out, which is not known")
            moved = None
        matrix = matrix.transform(moved or Identity)
        if element is not self._root and element.get("viewBox"):
            matrix, box = _enter(element, matrix, box)
        strokes = inherited | {k: v for k, v in own.items() if k.startswith("stroke")}
        if own.get("vector-effect") == "non-scaling-stroke":
            try:
                self._keep_stroke(element, own, strokes, matrix, outer, box)
            except (ValueError, ArithmeticError, TypeError, AssertionError, IndexError, PenError):
                self._styles.note("a stroke that does not scale is drawn as if it did")
        for child in list(element):
            self._visit(child, matrix, box, strokes)

    def _transform(self, element: Element, own: dict[str, str], box: Box) -> Transform | None:
        """Return the transform of an element, which it then carries as a matrix where CSS had a word in it.

        CSS Transforms 1 and 2: about the origin, `translate`, `rotate`, `scale`, then `transform`.
        """
        attribute = element.get("transform", "")
        origin = own.get("transform-origin", element.attrib.pop("transform-origin", ""))
        said = {
            name: own[name] for name in ("translate", "rotate", "scale", "transform") if name in own
        }
        if not said and not (origin and attribute):
            return read_list(attribute, box) if attribute.strip() else None
        place = Box(0.0, 0.0, *box[2:])
        if own.get("transform-box", "view-box") != "view-box":
            place = self._bounds(element, own)
        elif element is self._root:
            place, origin = box, origin or "50% 50%"
        matrix = Identity
        for name, value in said.items():
            if value.strip().lower() != "none":
                text = value if name == "transform" else as_function(name, value)
                matrix = matrix.transform(read_list(text, place))
        if "transform" not in said:
            matrix = matrix.transform(read_list(attribute, box))
        x, y = read_origin(origin, place)
        matrix = Identity.translate(x, y).transform(matrix).translate(-x, -y)
        written = f"matrix({' '.join(f'{v:.9g}' for v in matrix)})"
        if element is not self._root:
            element.set("transform", written)
            return matrix
        group = Element(f"{{{SVG}}}g", {"transform": written})  # its children carry what it says
        group.extend(list(element))
        element[:] = [group]
        return None

    def _bounds(self, element: Element, own: dict[str, str]) -> Box:
        """Return the box of what an element draws, in its own units, with its stroke where that counts."""
        pen = BoundsPen(None)
        if not self._trace(element, pen, Identity) or pen.bounds is None:
            raise UnreadableError(f"{own['transform-box']} of <{local_name(element)}>")
        left, top, right, bottom = pen.bounds
        grown = 0.0
        if (
            own["transform-box"] in ("stroke-box", "border-box")
            and own.get("stroke", "none") != "none"
        ):
            grown = (read_length(own.get("stroke-width", "1")) or 0.0) / 2
        return Box(left - grown, top - grown, right - left + 2 * grown, bottom - top + 2 * grown)

    def _trace(self, element: Element, pen: AbstractPen, matrix: Transform) -> bool:
        """Draw an element and those in it with a pen; False where one has no outline that is known."""
        name = local_name(element)
        if name in ("g", "a", "svg"):
            return all(
                self._trace(
                    child, pen, matrix.transform(read_list(child.get("transform", ""), self._box))
                )
                for child in element
                if local_name(child) not in ("defs", "style")
            )
        if name == "use":
            target = self._ids.get(element.get(f"{{{XLINK}}}href", "").removeprefix("#"))
            at = (read_length(element.get(side, "0")) or 0.0 for side in ("x", "y"))
            if target is None or local_name(target) in ("use", "g", "symbol"):
                return False
            moved = read_list(target.get("transform", ""), self._box)
            return self._trace(target, pen, matrix.translate(*at).transform(moved))
        data = _path_data(element, self._box)
        if data is None:
            return False
        try:
            parse_path(data, TransformPen(pen, matrix))
        except (ValueError, TypeError, AssertionError, IndexError, PenError):
            return False
        return True

    def _keep_stroke(
        self, element: Element, own: dict[str, str], strokes: dict[str, str],
        matrix: Transform, outer: Transform, box: Box,
    ) -> None:  # fmt: skip
        """Give a stroke the width, in units of its element, that it has in CSS px."""
        xx, xy, yx, yy = matrix[:4]
        near = math.hypot(xx + yy, xy - yx), math.hypot(xx - yy, xy + yx)
        large, small = (near[0] + near[1]) / 2, abs(near[0] - near[1]) / 2
        if small <= 0:
            return
        if large / small > _UNEVEN and strokes.get("stroke", "none") != "none":
            self._stroke_apart(element, own, strokes, matrix, outer, box)
            return
        scale = math.sqrt(large * small)
        own["stroke-width"] = (
            f"{(read_length(strokes.get('stroke-width', '1')) or 0.0) / scale:.9g}"
        )
        for key in ("stroke-dasharray", "stroke-dashoffset"):
            if key in strokes:
                own[key] = NUMBER.sub(
                    lambda m: f"{(read_length(m[0]) or 0) / scale:.9g}", strokes[key]
                )

    def _stroke_apart(
        self, element: Element, own: dict[str, str], strokes: dict[str, str],
        matrix: Transform, outer: Transform, box: Box,
    ) -> None:  # fmt: skip
        """Draw a stretched shape's stroke as a path of its own, in px, over the filled shape."""
        pen = SVGPathPen(None, ntos=lambda v: f"{v:.6g}")
        data = _path_data(element, box)
        if data is None:
            return
        parse_path(data, TransformPen(pen, matrix))
        parts = [
            Element(f"{{{SVG}}}path", {"d": data}),
            Element(f"{{{SVG}}}path", {"d": pen.getCommands()}),
        ]
        if "transform" in element.attrib:
            parts[0].set("transform", element.attrib.pop("transform"))
        parts[1].set("transform", f"matrix({' '.join(f'{v:.9g}' for v in outer.inverse())})")
        element.tag = f"{{{SVG}}}g"
        element.extend(parts)
        of = self._styles.of
        of[parts[0]] = {**{k: v for k, v in own.items() if k.startswith("fill")}, "stroke": "none"}
        of[parts[1]] = {**strokes, "fill": "none"}
        for key in [k for k in own if k.startswith(("fill", "vector-effect"))]:
            del own[key]


def _view_box(element: Element) -> Box | None:
    try:
        numbers = [float(n) for n in element.get("viewBox", "").replace(",", " ").split()]
    except ValueError:
        return None
    return Box(*numbers) if len(numbers) == 4 and min(numbers[2:]) > 0 else None


def _enter(element: Element, matrix: Transform, box: Box) -> tuple[Transform, Box]:
    """Return the units inside a nested <svg> or the like, by its viewBox."""
    inner = _view_box(element)
    if inner is None:
        return matrix, box
    wide = read_length(element.get("width", "100%"), box[2]) or box[2]
    high = read_length(element.get("height", "100%"), box[3]) or box[3]
    across, down = wide / inner[2], high / inner[3]
    if element.get("preserveAspectRatio", "").strip() != "none":
        across = down = min(across, down)
    return matrix.scale(across, down), inner


def _path_data(element: Element, box: Box) -> str | None:
    """Return the outline of a basic shape or path as path data; None where it has none."""
    name = local_name(element)
    if name == "path":
        return element.get("d", "")
    if name in ("polygon", "polyline"):
        points = " ".join(spread(element.get("points", "")))
        return f"M{points}{'Z' if name == 'polygon' else ''}" if points else ""

    def get(key: str, usual: float = 0.0) -> float:
        diagonal = math.hypot(box[2], box[3]) / math.sqrt(2)
        whole = diagonal if key == "r" else box[3] if "y" in key or key == "height" else box[2]
        found = read_length(element.get(key, ""), whole)
        return usual if found is None else found

    if name == "line":
        return f"M{get('x1')} {get('y1')}L{get('x2')} {get('y2')}"
    if name in ("circle", "ellipse"):
        x, y = get("cx"), get("cy")
        rx, ry = (
            (get("r"),) * 2 if name == "circle" else (get("rx", get("ry")), get("ry", get("rx")))
        )
        return f"M{x - rx} {y}A{rx} {ry} 0 1 1 {x + rx} {y}A{rx} {ry} 0 1 1 {x - rx} {y}Z"
    if name == "rect":
        x, y, w, h = (get(k) for k in ("x", "y", "width", "height"))
        rx, ry = min(get("rx", get("ry")), w / 2), min(get("ry", get("rx")), h / 2)
        if rx <= 0 or ry <= 0:
            return f"M{x} {y}h{w}v{h}h{-w}Z"
        arc = f"a{rx} {ry} 0 0 1 "
        return (
            f"M{x + rx} {y}h{w - 2 * rx}{arc}{rx} {ry}v{h - 2 * ry}{arc}{-rx} {ry}"
            f"h{2 * rx - w}{arc}{-rx} {-ry}v{2 * ry - h}{arc}{rx} {-ry}Z"
        )
    return None
