"""Views whose red and blue are exchanged (BGR for RGB), among others that are sound.

Luminance hardly tells: structure stays in place. But light that is warm in one view and cold in another, on the same
surface, is no reflection. The colour of a view is the log of red over blue; exchanged, it changes its sign. What two
views show of the same surface is compared by the cosine between their colours: near 1 for sound views of anything
coloured, near -1 where one of the two is exchanged, near 0 where all is grey.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fipt.render.scene import RayScene
from fipt.stages.check_poses.surface import ReducedView, visible
from fipt.stages.check_poses.verdict import Verdict

_PIXELS = 2000
"""Pixels of a view that are compared, at most."""

_FEWEST = 30
"""Pixels that two views must share."""

_COLOURED = 0.05
"""Root mean square of log red over blue that both must show there: less is grey."""

_EXCHANGED = -0.5
"""Median cosine with its partners below which a view is exchanged; sound views have 0.63 or more in seven rooms."""

_WITNESSES = 3
"""Partners that must tell it."""


def exchanged(scene: RayScene, views: Sequence[ReducedView], verdicts: Sequence[Verdict]) -> list[Verdict]:
    """Reject accepted views that show what most others show with red and blue exchanged.

    Which of two halves is right cannot be told; the fewer are taken for wrong. Nor can it where all are exchanged.
    """
    place = {view.camera.name: i for i, view in enumerate(views)}
    cosines = [
        {place[name]: c for name in verdict.partners if (c := _cosine(scene, view, views[place[name]])) is not None}
        if verdict.accepted
        else {}
        for view, verdict in zip(views, verdicts, strict=True)
    ]
    odd: set[int] = set()
    while True:  # the worst first: its partners are then judged without it
        left = {i: [c for j, c in row.items() if j not in odd] for i, row in enumerate(cosines) if i not in odd}
        medians = {i: float(np.median(row)) for i, row in left.items() if len(row) >= _WITNESSES}
        if not medians or min(medians.values()) > _EXCHANGED:
            break
        odd.add(min(medians, key=medians.__getitem__))
    reason = "shows what others show with red and blue exchanged (BGR for RGB?)"
    return [replace(v, accepted=False, reason=reason) if i in odd else v for i, v in enumerate(verdicts)]


def _cosine(scene: RayScene, here: ReducedView, there: ReducedView) -> float | None:
    """Cosine between the colours of what two views share; None where that is too little, or grey."""
    index = np.flatnonzero(here.hit & here.valid)
    pixels, front, _ = visible(scene, here, there, index[:: -(-max(len(index), 1) // _PIXELS)])
    column, row = pixels[front].astype(int).T
    known = there.valid[row, column]
    a, b = here.redness.ravel()[front][known], there.redness[row, column][known]
    size = [float(np.sqrt(np.mean(values**2))) for values in (a, b)] if known.sum() >= _FEWEST else [0.0]
    return float(np.mean(a * b)) / (size[0] * size[1]) if min(size) > _COLOURED else None
