"""Pixels brighter than any surface could be under the light that was found: light that is missing, or that is emitted.

A pixel counts where one piece fills it, where no emitter is, and where the photograph shows more than the brightest
reflection (a white matte surface or a mirror, the brighter) by more than the tolerance.
"""

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.drawing import compared, spread_over
from fipt.stages.findings.explained import ExplainedPixels
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE, mean_error


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell a room of which a good part is brighter than the light found could make it."""
    pixels = room.explained
    over = pixels.brighter(1 + TOLERANCE)
    chosen = over | (pixels.use & ~pixels.emits & ~pixels.mixed)
    if not chosen.any():
        return []
    counts = np.bincount(pixels.view[chosen], minlength=len(pixels.views))
    shares = (np.bincount(pixels.view[over], minlength=len(counts)) / np.maximum(counts, 1))[counts > 0]
    share = float(over.sum() / chosen.sum())
    measure = Measure("pixels brighter than any surface could be under the light found", share, TOLERANCE)
    # pixels of a view err together: the views are the independent trials
    level = notes.judge("too-bright", measure, mean_error(shares))
    if level is None:
        return []
    view = int(np.bincount(pixels.view[over]).argmax())
    return [
        RoomFinding(
            "too-bright",
            level,
            f"{100 * share:.0f} % of the room is brighter than a white surface could be under the light that was "
            "found: a lamp or window is missing.",
            measure,
            "Photograph the ceiling, all lamps and all windows, and make sure that they are part of the mesh.",
            {"views": [pixels.views[view]], "position": place_of(pixels, over)},
            image=drawn(room, pixels, view, over),
        )
    ]


def place_of(pixels: ExplainedPixels, chosen: np.ndarray) -> list[float]:
    """Median place of chosen pixels (N,), metres."""
    return [round(float(v), 2) for v in np.median(pixels.position[chosen], axis=0)]


def drawn(room: JudgedRoom, pixels: ExplainedPixels, view: int, marked: np.ndarray) -> np.ndarray:
    """Photograph and what the fit says of a view, with marked pixels (N,) outlined."""
    own = pixels.view == view
    camera = room.data.camera(pixels.views[view])
    shape = camera.height, camera.width

    def image(values: np.ndarray) -> np.ndarray:
        return spread_over(shape, pixels.row[own], pixels.column[own], values[own])

    return compared(image(pixels.photo), image(pixels.predicted), room.exposure, "fit", image(marked))
