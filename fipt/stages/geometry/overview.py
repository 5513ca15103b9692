"""A picture of the depth of some views, and of where it comes from: what to photograph again."""

from collections.abc import Sequence

import numpy as np

from fipt.formats.images import to_display
from fipt.stages.geometry.completion import Completed

_ROWS = 6
"""Views that are shown."""
_WHITE = 90
"""Percentile of a view's radiance that is white."""
_MEASURED, _COMPLETED, _WALL = (0, 90, 181), (120, 170, 160), (225, 120, 20)
"""Colours of depth of a view's own, of depth that planes tell, and of walls: blue, grey, orange."""


def overview(views: Sequence[Completed]) -> np.ndarray:
    """(H, W, 3) uint8: a row a view, photograph, depth, and where it comes from; those with most walls first.

    Views of one size alone are shown, the most common.
    """
    from matplotlib import colormaps

    sizes = [(view.view.camera.height, view.view.camera.width) for view in views]
    usual = max(sizes, key=sizes.count)
    shown = [view for view, size in zip(views, sizes, strict=True) if size == usual]
    shown = sorted(shown, key=lambda view: -view.closed.mean())[:_ROWS]
    farthest = max(float(np.percentile(view.view.map.depth, 99)) for view in shown)
    rows = []
    for view in shown:
        radiance, depth = view.view.radiance, view.view.map.depth
        photo = to_display(radiance / max(float(np.percentile(radiance, _WHITE)), 1e-9))
        near = colormaps["viridis_r"](np.clip(depth / max(farthest, 1e-9), 0, 1), bytes=True)[..., :3]
        source = np.where(view.measured[..., None], _MEASURED, np.where(view.closed[..., None], _WALL, _COMPLETED))
        rows.append(np.hstack([photo, near, source.astype(np.uint8)]))
    return np.vstack(rows)
