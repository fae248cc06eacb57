"""How much of a photograph's subject its cut-out shows: the share of the subject's edges that are drawn."""

from __future__ import annotations

import numpy as np
from PIL import Image

from knotfab_validators.arrays import Array, Mask

SIDE = 256  # px of the subject's longer side; hair is no feature
BLUR = 1.5  # px, sigma of the gradient
STRONG = 7.0  # levels (of 255) per px from which a gradient is an edge
RIM = 6.0  # px within the outline whose edges are the outline's own
NEAR = 5.0  # px from an edge of the cut-out within which an edge is drawn
WIDE = 3.0  # px across which an edge of the photograph is strong


def edges_drawn(darkness: Array, drawn: Mask) -> float | None:
    """Return the share, by length, of a subject's edges that its cut-out draws; None if that is empty.

    The subject's outline counts as drawn.

    Args:
        darkness: (H, W) in 0 to 1, of the photograph. drawn: (H, W), the cut-out.
    """
    from scipy import ndimage

    if not drawn.any():
        return None
    rows, columns = np.flatnonzero(drawn.any(1)), np.flatnonzero(drawn.any(0))
    here = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    own, levels = drawn[here], 255 * darkness[here]
    scale = SIDE / max(own.shape)
    size = max(1, round(own.shape[1] * scale)), max(1, round(own.shape[0] * scale))
    levels = np.asarray(
        Image.fromarray(levels.astype(np.float32)).resize(size, Image.Resampling.BOX)
    )
    own = np.pad(np.asarray(Image.fromarray(own).resize(size, Image.Resampling.NEAREST)), 1)
    steep = np.pad(ndimage.gaussian_gradient_magnitude(levels, BLUR), 1)
    whole = ndimage.binary_fill_holes(own)
    edges = (ndimage.distance_transform_edt(whole) > RIM) & (steep > STRONG)
    outline = own ^ ndimage.binary_erosion(own)
    near = ndimage.distance_transform_edt(~outline) <= NEAR
    rim = WIDE * float((whole ^ ndimage.binary_erosion(whole)).sum())
    return (rim + float((edges & near).sum())) / (rim + float(edges.sum()))
