"""Exposures of single views that are off: a view is brighter or darker than the fit of all views says.

A view's gain is the median ratio of its photograph to the fit, over its pixels that one piece fills.
"""

import numpy as np

from fipt.robust import spread
from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.checks.brightness import drawn
from fipt.stages.findings.drawing import log_ratio
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import OUTLIER, TOLERANCE

_FEWEST = 100
"""Pixels that a view must have."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell views whose exposure is off."""
    pixels = room.explained
    usable = pixels.use & ~pixels.emits & ~pixels.mixed
    ratio = log_ratio(pixels.photo, pixels.predicted) if len(pixels) else np.zeros(0)
    views = [k for k in range(len(pixels.views)) if (usable & (pixels.view == k)).sum() >= _FEWEST]
    if len(views) < 3:
        return []
    gains = np.array([np.median(ratio[usable & (pixels.view == k)]) for k in views])
    off = np.abs(gains - np.median(gains))
    # the fit follows a view that is off in part: what is left of an error is half of it where two views see a surface
    threshold = max(OUTLIER * spread(gains), TOLERANCE / 2)
    measure = Measure(
        "a view's exposure against what all views together say, off by",
        float(np.expm1(off.max())),
        float(np.expm1(threshold)),
    )
    level = notes.judge("exposure", measure)
    if level is None:
        return []
    worst = [views[k] for k in np.argsort(-off) if off[k] > threshold]
    names = [pixels.views[k] for k in worst]
    gain = {pixels.views[k]: round(float(np.exp(g - np.median(gains))), 4) for k, g in zip(views, gains, strict=True)}
    return [
        RoomFinding(
            "exposure",
            level,
            f"The exposure of {'views' if len(names) > 1 else 'view'} {', '.join(names)} does not fit the others: off "
            f"by {100 * measure.value:.0f} %.",
            measure,
            "Keep aperture, ISO and light fixed; photograph these views again, correct their exposure, or leave them "
            "out.",
            {"views": names},
            {name: gain[name] for name in names},
            image=drawn(room, pixels, worst[0], np.zeros(len(pixels), bool)),
        )
    ]
