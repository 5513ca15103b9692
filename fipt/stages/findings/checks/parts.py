"""Parts that no material explains: under the shading found, no base colour, roughness and metallic gives what is seen.

A part's figure is the median absolute logarithm of the ratio of its photographs to the fit, over pixels that one piece
fills. It stands out against the other parts of the room, and against the tolerance.
"""

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.checks.brightness import drawn, place_of
from fipt.stages.findings.drawing import log_ratio
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE

_FEWEST = 50
"""Pixels, in two views at least, that a part must have to be judged."""
_OFF = 2 * TOLERANCE
"""Difference from which on a part is not explained: its pixels are off by twice what is tolerated of light."""
_LISTED = 8


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell the share of the room that belongs to such parts."""
    pixels = room.explained
    if not len(pixels) or not pixels.segment.any():
        return []
    usable = pixels.use & ~pixels.emits & ~pixels.mixed & (pixels.segment > 0)
    off = np.abs(log_ratio(pixels.photo, pixels.predicted))
    bad, worst = [], {}
    for part in np.unique(pixels.segment[usable]):
        own = usable & (pixels.segment == part)
        if own.sum() >= _FEWEST and len(np.unique(pixels.view[own])) > 1:
            worst[int(part)] = float(np.median(off[own]))
            if worst[int(part)] > _OFF:
                bad.append(int(part))
    marked = usable & np.isin(pixels.segment, bad)
    measure = Measure(
        "pixels of parts that no material explains", float(marked.sum() / max(usable.sum(), 1)), TOLERANCE / 2
    )
    level = notes.judge("unexplained-parts", measure)
    if level is None:
        return []
    bad.sort(key=lambda part: -worst[part])
    view = int(np.bincount(pixels.view[marked]).argmax())
    listed = ", ".join(map(str, bad[:_LISTED])) + (" and more" if len(bad) > _LISTED else "")
    return [
        RoomFinding(
            "unexplained-parts",
            level,
            f"No material explains what the photographs show of {len(bad)} part{'s' if len(bad) > 1 else ''} (ids "
            f"{listed}): they emit, mirror something that the mesh lacks, or lie in light that was not found.",
            measure,
            "Look at the picture: accept lamps in emitters_review.yaml, complete the mesh around mirrors and glass.",
            {"views": [pixels.views[view]], "segments": bad, "position": place_of(pixels, marked)},
            {f"part_{part}": round(worst[part], 3) for part in bad[:_LISTED]},
            image=drawn(room, pixels, view, marked),
        )
    ]
