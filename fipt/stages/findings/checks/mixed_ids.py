"""Ids that hold several things: one part, separate pieces of surface, each of a colour of its own.

The colour of a pixel is what a matte surface there would need (photograph over Ld), so that it does not depend on the
fit. Pieces of a part are told by place and facing. A texture varies within a piece; two things differ between pieces
that are uniform. The spread between the pieces' colours is compared with that within them.
"""

import numpy as np
from scipy.spatial import cKDTree

from fipt.groups import connected_groups
from fipt.robust import spread
from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.checks.brightness import drawn
from fipt.stages.findings.explained import ExplainedPixels
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import OUTLIER, TOLERANCE

_FEWEST = 40
"""Pixels that a piece must have."""
_GAP = 6.0
"""Pixels that are compared between two pieces of surface, at least."""
_DISTINCT = np.log(2.0)
"""Logarithm of the ratio of two colours that are two: one is twice the other in a channel."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell the share of the room whose ids join things of different colour."""
    pixels = room.explained
    if not len(pixels) or not pixels.segment.any():
        return []
    usable = pixels.use & ~pixels.emits & ~pixels.mixed & (pixels.segment > 0)
    joined = [
        int(part) for part in np.unique(pixels.segment[usable]) if several(pixels, usable & (pixels.segment == part))
    ]
    marked = usable & np.isin(pixels.segment, joined)
    measure = Measure(
        "pixels whose id holds things of several colours", float(marked.sum() / max(usable.sum(), 1)), TOLERANCE
    )
    level = notes.judge("mixed-ids", measure)
    if level is None:
        return []
    view = int(np.bincount(pixels.view[marked]).argmax())
    return [
        RoomFinding(
            "mixed-ids",
            level,
            f"{len(joined)} part id{'s' if len(joined) > 1 else ''} with {100 * measure.value:.0f} % of the pixels "
            "hold things of several colours: roughness and metallic are shared by what is not one material.",
            measure,
            "Correct the ids, or let parts be grown (segment.mode: geometry).",
            {"views": [pixels.views[view]], "segments": joined[:50]},
            image=drawn(room, pixels, view, marked),
        )
    ]


def several(pixels: ExplainedPixels, own: np.ndarray) -> bool:
    """Whether the pixels of a part (N,) bool show separate pieces whose colours differ more than each varies."""
    rows = np.flatnonzero(own)
    if len(rows) < 2 * _FEWEST:
        return False
    color = np.log((pixels.photo[rows] + 1e-3) / (pixels.diffuse[rows] + 1e-3))
    piece = pieces(pixels.position[rows], pixels.normal[rows], _GAP * pixels.spacing(own))
    groups = [color[piece == k] for k in range(int(piece.max()) + 1)]
    groups = [group for group in groups if len(group) >= _FEWEST]
    if len(groups) < 2:
        return False
    levels = np.array([np.median(group, axis=0) for group in groups])
    within = np.array([spread(group) for group in groups])
    difference = np.abs(levels[:, None] - levels[None]).max(axis=-1)
    scatter = np.maximum(within[:, None], within[None]).max(axis=-1)
    return bool((difference > np.maximum(_DISTINCT, OUTLIER * scatter)).any())


def pieces(place: np.ndarray, normal: np.ndarray, gap: float) -> np.ndarray:
    """(N,) number of the piece of each point: neighbours within ``gap`` metres that face alike belong together."""
    pairs = cKDTree(place).query_pairs(gap, output_type="ndarray")
    alike = (normal[pairs[:, 0]] * normal[pairs[:, 1]]).sum(axis=1) > np.cos(np.deg2rad(30))
    a, b = pairs[alike].T
    return connected_groups((a, b), len(place))
