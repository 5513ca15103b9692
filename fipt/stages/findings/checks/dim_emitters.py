"""Surface that may emit, but no brighter than a mirror could be: screens, lampshades, lit curtains.

A matte surface cannot show more than Ld. What is brighter reflects like a mirror or emits. A mirror's picture moves
with the viewer, an emitter's does not. So of surface that is brighter than any matte one and is no emitter, the pixels
of one place in several views are compared: does the radiance change with the view, or not at all?
"""

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.checks.brightness import drawn, place_of
from fipt.stages.findings.explained import ExplainedPixels
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE

_PIXELS = 4.0
"""Size of a place, pixels that are compared."""
_FEWEST = 3
"""Views that must show a place."""
_AREA = 16
"""Places that must agree: a region of so many is no chance."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell surface of which the views cannot say whether it emits or mirrors."""
    return [*_undecided(room, notes), *_steady(room, notes)]


def _undecided(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """What the emitters' stage left undecided, if it is much of the light."""
    emitters, pixels = room.fitted.emitters, room.explained
    shown = np.isin(pixels.triangle, emitters.undecided.triangle)
    if not shown.any():
        return []
    area = float(room.mesh.areas[emitters.undecided.triangle].sum())
    open_power = area * float(pixels.photo[shown].mean())
    power = float(emitters.power.sum())
    share = open_power / max(open_power + power, 1e-12)
    measure = Measure("light of what may emit or mirror, of all light", share, TOLERANCE)
    level = notes.judge("undecided-emitters", measure)
    if level is None:
        return []
    view, place = int(np.bincount(pixels.view[shown]).argmax()), place_of(pixels, shown)
    return [
        RoomFinding(
            "undecided-emitters",
            level,
            f"{len(emitters.undecided.emits)} regions emit or mirror, and the photographs do not tell which: "
            f"{100 * share:.0f} % of the light hangs on them, most near ({', '.join(f'{v:.1f}' for v in place)}).",
            measure,
            "Decide about them in emitters_review.yaml, which has a picture of each.",
            {"views": [pixels.views[view]], "position": place},
            image=drawn(room, pixels, view, shown),
        )
    ]


def _steady(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    pixels = room.explained
    steady, shown = steady_places(pixels)
    measure = Measure("places brighter than a matte surface, and alike from everywhere", float(shown), _AREA, "")
    level = notes.judge("emitter-or-mirror", measure)
    if level is None:
        return []
    view = int(np.bincount(pixels.view[steady]).argmax())
    place = place_of(pixels, steady)
    segments = [int(k) for k in np.unique(pixels.segment[steady]) if k]
    return [
        RoomFinding(
            "emitter-or-mirror",
            "warning",
            f"Surface near ({', '.join(f'{v:.1f}' for v in place)}) is brighter than a white wall could be and looks "
            "the same from everywhere, but is not among the emitters: a screen, a shade, a lit curtain?",
            measure,
            "If it emits, accept it in emitters_review.yaml (fipt point tells its triangles).",
            {"views": [pixels.views[view]], "position": place, "segments": segments[:20]},
            image=drawn(room, pixels, view, steady),
        )
    ]


def steady_places(pixels: ExplainedPixels) -> tuple[np.ndarray, int]:
    """(N,) bool: pixels of places that are bright and steady; and how many such places there are."""
    matte = pixels.diffuse.mean(axis=1)
    usable = pixels.use & ~pixels.emits & ~pixels.mixed
    none = np.zeros(len(pixels), bool)
    bright = usable & (pixels.photo.mean(axis=1) > (1 + TOLERANCE) * matte)
    if not bright.any():
        return none, 0
    size = _PIXELS * max(pixels.spacing(bright), 1e-6)  # a screen may be small, or nearer than the walls
    cells = np.floor(pixels.position[usable] / size).astype(np.int64)
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    cell, rows = cell.reshape(-1), np.flatnonzero(usable)
    count = int(cell.max()) + 1
    views = np.zeros(count, np.int64)
    np.add.at(views, np.unique(np.stack([cell, pixels.view[rows]]), axis=1)[0], 1)
    level = np.log(pixels.photo.mean(axis=1)[rows] + 1e-6)
    total = np.bincount(cell, minlength=count)
    mean = np.bincount(cell, level, count) / total
    scatter = np.sqrt(np.maximum(np.bincount(cell, level**2, count) / total - mean**2, 0))
    over = np.bincount(cell, bright[rows], count) / total
    good = (views >= _FEWEST) & (over > 0.9) & (scatter < TOLERANCE)
    none[rows[good[cell]]] = True
    return none, int(good.sum())
