"""Verify one view: compare the file's shadow, rendered and by exact polygons, with its picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from knotfab_validators.arrays import Array, Ints, Mask
from knotfab_validators.geometry.mesh import Mesh
from knotfab_validators.shadows.compare import Overlap, overlap
from knotfab_validators.shadows.exact_shadow import ShadowCaster, shadow_mask, shadow_polygon
from knotfab_validators.shadows.frame import WorkingFrame, padded_mask, working_frame
from knotfab_validators.shadows.outlines import WrongStretch, find_wrong_stretch
from knotfab_validators.shadows.render import SilhouetteRenderer
from knotfab_validators.shadows.tube_field import OutlineError, outline_error, tube_field
from knotfab_validators.shadows.view import ViewGeometry
from knotfab_validators.tube.solid_matter import tube_vertices


@dataclass(frozen=True)
class VerifiedView:
    """The figures of one view.

    The masks lie on the padded working frame. `rendered` is None where nothing was rendered;
    `stray_px` counts the pixels at which rendering and polygons disagree farther than one pixel
    from the outline. `tube` and `outline` are None without knots; `outline_vertex` is the number
    of the part's vertex that casts the outline where it is farthest off. `wrong` is the longest stretch
    along which the outlines of shadow and picture differ. `intrusion` is the share of the frame
    that a mount darkens outside both picture and knots; None where the knots are not known. `bar_mm2` is the
    largest patch on the receiver that a bar darkens there.
    `framed` is `whole` without what a stand darkens outside the frame; `judged`, to which the floor applies,
    is without all that it darkens beside the tube, and has the strokes as wide as they are drawn (`drawn`).
    Without a stand and wider strokes all three are the same.
    `seen` is the shadow that `framed` compares, `of_tube` that without the stand. `tube_px` is half the width
    of the tube's, in the middle of its depth; None without knots.
    """

    frame: WorkingFrame
    target: Mask
    drawn: Mask
    exact: Mask
    rendered: Mask | None
    whole: Overlap
    framed: Overlap
    judged: Overlap
    exact_iou: float
    stray_px: int | None
    tube: Overlap | None
    wrong: WrongStretch
    seen: Mask
    of_tube: Mask
    outline: OutlineError | None = None
    outline_px: float | None = None
    outline_vertex: int | None = None
    intrusion: float | None = None
    bar_mm2: float = 0.0
    tube_px: float | None = None

    @property
    def shadow(self) -> Mask:
        """The verified shadow: the rendered one if there is one."""
        return self.exact if self.rendered is None else self.rendered


def verify_view(
    vertices: Array,
    faces: Ints,
    target: Mask,
    geometry: ViewGeometry,
    *,
    polygons: Sequence[Array] | None = None,
    radius: float | None = None,
    closed: Sequence[bool] | None = None,
    mounted: bool = False,
    stand: bool = False,
    renderer: SilhouetteRenderer | None = None,
    caster: ShadowCaster | None = None,
    longer: int = 1024,
    drawn: Mask | None = None,
    ends: bool = False,
    bars: bool = False,
    bar_bodies: Mesh | None = None,
) -> VerifiedView:
    """Measure the shadow of a mesh in one view, all in scene coordinates (mm).

    Args:
        vertices, faces: (n, 3) and (m, 3), the part. target: (H, W), the picture's silhouette.
        geometry: the view, on the picture's pixels.
        polygons, radius: the knots' centre lines and the tube's radius, where they are known.
        closed: for each of them, whether its last point joins the first; all by default.
        mounted: whether the part is more than the tube about `polygons`; then the knots' own shadow
            is that of the exact tube, which the check `tube` finds in the part.
        stand: whether that is a stand or an eyelet, which shows outside the frame and perhaps inside it. The
            outline is then that of the tube's own surface, and the tube's shadow is what is judged.
        renderer: renderer of this mesh, where rendering is possible. caster: caster of this mesh, where one
            is at hand.
        longer: pixels on the longer side of the frame.
        drawn: (H, W), the silhouette with its strokes as wide as they are drawn, by which the shadow is
            judged; `target` where left out.
        bars: whether bars may stand between the strands: the outline is that of the tube's own surface then
            too, and what they darken is `intrusion`. bar_bodies: these bars alone, in scene coordinates.
        ends: whether the wall ends at the picture's frame, so that nothing beside it is shadow.

    Raises:
        ShadowError: the part reaches the light.
    """
    frame = working_frame(target.shape[1], target.shape[0], longer)
    fine = geometry.resample(frame)
    wanted = padded_mask(target, frame)
    wide = wanted if drawn is None else padded_mask(drawn, frame)
    caster = caster or ShadowCaster(vertices, faces)
    lines = caster.lines(fine)
    whole_exact, polygon = shadow_mask(lines, fine), shadow_polygon(lines)
    rendered = renderer.render(fine) if renderer is not None else None
    stray = None if rendered is None else count_stray(rendered, whole_exact, polygon)
    screen = frame.mask if ends else np.ones_like(whole_exact)
    exact = whole_exact & screen
    rendered = None if rendered is None else rendered & screen
    shadow = exact if rendered is None else rendered
    whole = overlap(shadow, wanted)
    result = VerifiedView(
        frame=frame,
        target=wanted,
        exact=exact,
        rendered=rendered,
        whole=whole,
        framed=whole,
        judged=whole if drawn is None else overlap(shadow, wide),
        drawn=wide,
        exact_iou=overlap(exact, wanted).iou,
        stray_px=stray,
        tube=None if mounted else whole,
        wrong=find_wrong_stretch(shadow, wanted),
        seen=shadow,
        of_tube=shadow,
    )
    if polygons is None or radius is None:
        return result
    field = tube_field(polygons, radius, fine, closed)
    own = None
    if stand:
        result = _beside_stand(result, field.mask)
    if stand or bars:
        own = fine.project(vertices[tube_vertices(vertices, faces, polygons, radius)])[0]
    error = outline_error(field, shapely.get_coordinates(polygon), whole_exact, own)
    # w is the distance from the light, over the receiver's
    middle = float(np.median(fine.project(np.concatenate(polygons))[1]))
    seen, _ = fine.project(vertices)
    nearest = int(((seen - np.array(error.where)) ** 2).sum(axis=1).argmin())
    intruding = shadow & ~field.mask & ~wanted
    shown = 0.0
    if bar_bodies is not None:
        cast = ShadowCaster(bar_bodies.vertices, bar_bodies.faces).lines(fine)
        shown = _largest_px(intruding & shadow_mask(cast, fine)) * fine.pixel_mm**2
    return replace(
        result,
        tube=overlap(field.mask & screen, wanted) if mounted else whole,
        outline=error,
        outline_px=error.largest_mm / fine.pixel_mm,
        outline_vertex=nearest,
        intrusion=float(intruding[frame.mask].mean()) if mounted else 0.0,
        bar_mm2=shown,
        tube_px=radius / middle / fine.pixel_mm,
    )


def _beside_stand(view: VerifiedView, tube: Mask) -> VerifiedView:
    """Return the view without what a stand darkens outside the frame or beside the tube's shadow (H, W)."""
    kept, of_tube = view.shadow & (view.frame.mask | tube), view.shadow & tube
    return replace(
        view,
        framed=overlap(kept, view.target),
        judged=overlap(of_tube, view.drawn),
        wrong=find_wrong_stretch(kept, view.target),
        seen=kept,
        of_tube=of_tube,
    )


def _largest_px(mask: Mask) -> int:
    """Count the pixels of a mask's largest patch."""
    from scipy.ndimage import label

    patches, count = label(mask, np.ones((3, 3)))
    return int(np.bincount(patches.ravel())[1:].max()) if count else 0


def count_stray(rendered: Mask, exact: Mask, polygon: Any) -> int:
    """Count pixels at which two masks disagree farther than a pixel from the outline.

    Args:
        rendered, exact: (H, W). polygon: what `exact` was rastered from, in pixels. Its own boundary
            is asked, not the raster's: a hole finer than the pixels is outline too.
    """
    rows, columns = np.nonzero(rendered != exact)
    if len(rows) == 0:
        return 0
    outline = polygon.boundary
    shapely.prepare(outline)
    near = shapely.dwithin(shapely.points(columns, rows), outline, 1.0)
    return int(np.count_nonzero(~near))
