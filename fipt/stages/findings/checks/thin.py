"""Thin things that never fill a pixel: their colour is only seen mixed with what stands behind.

A part counts where no training pixel shows it alone. Parts are connected pieces of the mesh: ids tell which pieces
share a material, not how thick they are.
"""

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.scene.mesh import connected_parts
from fipt.scene.samples import summed_by
from fipt.stages.findings.checks.brightness import drawn
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom

_ERROR = 0.4
"""Error of a base colour that is only seen mixed (7.9 dB, measured on metal legs of a classroom)."""
_LIMIT = (0.1 / _ERROR) ** 2
"""Share of the surface shown that alone brings the error of all base colours to 0.1, 20 dB."""
_ALONE = 0.9
"""Share of a pixel that counts as all of it."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell parts that no pixel shows alone."""
    share, thin = thin_share(room)
    measure = Measure("surface shown whose parts never fill a pixel", share, _LIMIT)
    level = notes.judge("thin-parts", measure)
    if level is None:
        return []
    pixels = room.explained
    marked = np.isin(pixels.triangle, np.flatnonzero(thin))
    view = int(np.bincount(pixels.view[marked]).argmax()) if marked.any() else 0
    return [
        RoomFinding(
            "thin-parts",
            level,
            f"{100 * share:.0f} % of what the views show belongs to parts so thin that they never fill a pixel: their "
            "colour, roughness and metallic are guessed from mixed pixels.",
            measure,
            "Photograph with more pixels or from nearer. The id of a thicker part of their material helps the fit.",
            {"views": [pixels.views[view]]},
            image=drawn(room, pixels, view, marked),
        )
    ]


def thin_share(room: JudgedRoom) -> tuple[float, np.ndarray]:
    """Share of the surface shown, and (T,) bool: triangles of parts that never fill a pixel."""
    part = connected_parts(room.mesh)
    seen = [(part[np.asarray(shard.samples.triangle)], np.asarray(shard.samples.weight)) for shard in room.shards]
    total, alone = summed_by(seen, int(part.max()) + 1), np.zeros(int(part.max()) + 1)
    for own, weight in seen:
        np.maximum.at(alone, own, weight)
    thin = (total > 0) & (alone < _ALONE)
    return float(total[thin].sum() / max(total.sum(), 1e-9)), thin[part]
