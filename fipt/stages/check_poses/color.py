"""Views whose red and blue are exchanged (BGR for RGB), or that have a cast of colour, among others that are sound.

Luminance hardly tells: structure stays in place. But light that is warm in one view and cold in another, on the same
surface, is no reflection. The colour of a view is the log of red over blue; exchanged, it changes its sign. What two
views show of the same surface is compared by the cosine between their colours: near 1 for sound views of anything
coloured, near -1 where one of the two is exchanged, near 0 where all is grey.

A cast moves the colours of all surface by one amount: another white balance, or a channel times a factor.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fipt.render.scene import RayScene
from fipt.robust import deviation
from fipt.stages.check_poses.surface import ReducedView, visible
from fipt.stages.check_poses.verdict import Verdict, accepted_partners

_PIXELS = 2000
"""Pixels of a view that are compared, at most."""

_FEWEST = 30
"""Pixels that two views must share."""

_COLORED = 0.05
"""Root mean square of log red over blue that both must show there: less is grey."""

_EXCHANGED = -0.5
"""Median cosine with its partners below which a view is exchanged; sound views have 0.63 or more in seven rooms."""

_WITNESSES = 3
"""Partners that must tell it."""

_CAST = 1.2
"""Ratio of a view's channels to those of the others from which its cast is named."""


@dataclass(frozen=True)
class SharedColor:
    """How the colour of a view is to that of another one on the surface that both show.

    Attributes
    ----------
    cosine
        Between their logs of red over blue; None where that is too little, or grey.
    redder, greener
        Medians of the difference of both colours, first less second view.
    """

    cosine: float | None
    redder: float
    greener: float


def judged_by_color(scene: RayScene, views: Sequence[ReducedView], verdicts: Sequence[Verdict]) -> list[Verdict]:
    """Reject accepted views whose red and blue are exchanged, and name casts of colour of the others."""
    shared = [
        {j: c for j in partners if (c := _shared(scene, view, views[j])) is not None}
        for view, partners in zip(views, accepted_partners(verdicts), strict=True)
    ]
    odd = _exchanged([{j: c.cosine for j, c in row.items() if c.cosine is not None} for row in shared])
    reason = "shows what others show with red and blue exchanged (BGR for RGB?)"
    found = [replace(v, accepted=False, reason=reason) if i in odd else v for i, v in enumerate(verdicts)]
    casts = np.array(
        [
            np.median([(c.redder, c.greener) for c in row.values()], axis=0) if len(row) >= _WITNESSES else (0.0, 0.0)
            for row in shared
        ]
    ).reshape(-1, 2)
    limit = np.maximum(np.log(_CAST), 5 * deviation(casts, axis=0)) if len(casts) else 0.0
    casts = np.where(np.abs(casts) < limit, 0.0, casts)
    return [
        replace(v, reason=_joined(v.reason, *own)) if v.accepted else v for v, own in zip(found, casts, strict=True)
    ]


def _joined(reason: str, redder: float, greener: float) -> str:
    """A verdict's reason, and by how much the channels are off where they are."""
    said = [f"{np.exp(redder):.2f} times as much red over blue"] if redder else []
    said += [f"{np.exp(greener):.2f} times as much green"] if greener else []
    cast = f"shows {' and '.join(said)} as others on the same surface: another white balance?" if said else ""
    return "; ".join(filter(None, [reason, cast]))


def _exchanged(cosines: Sequence[Mapping[int, float]]) -> set[int]:
    """Views that show what most others show with red and blue exchanged; of each its partners -> cosine.

    Which of two halves is right cannot be told; the fewer are taken for wrong. Nor can it where all are exchanged.
    """
    odd: set[int] = set()
    while True:  # the worst first: its partners are then judged without it
        left = {i: [c for j, c in row.items() if j not in odd] for i, row in enumerate(cosines) if i not in odd}
        medians = {i: float(np.median(row)) for i, row in left.items() if len(row) >= _WITNESSES}
        if not medians or min(medians.values()) > _EXCHANGED:
            return odd
        odd.add(min(medians, key=medians.__getitem__))


def _shared(scene: RayScene, here: ReducedView, there: ReducedView) -> SharedColor | None:
    """Compare the colours of what two views share; None where that is too little."""
    index = np.flatnonzero(here.hit & here.valid)
    pixels, front, _ = visible(scene, here, there, index[:: -(-max(len(index), 1) // _PIXELS)])
    column, row = pixels[front].astype(int).T
    known = there.valid[row, column]
    if known.sum() < _FEWEST:
        return None
    a, b = here.color.reshape(-1, 2)[front][known], there.color[row, column][known]
    size = [float(np.sqrt(np.mean(values[:, 0] ** 2))) for values in (a, b)]
    cosine = float(np.mean(a[:, 0] * b[:, 0])) / (size[0] * size[1]) if min(size) > _COLORED else None
    redder, greener = np.median(a - b, axis=0)
    return SharedColor(cosine, float(redder), float(greener))
