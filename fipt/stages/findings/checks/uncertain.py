"""Base colours that the fit itself says are uncertain: their predicted errors, over the surface that the views show."""

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.checks.brightness import drawn, place_of
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE, mean_error

_CALIBRATED = 1.5
"""Factor within which predicted and found errors agree (measured, docs/accuracy.md)."""
_LIMIT = _CALIBRATED * TOLERANCE / 2
"""Error of kd: that of a base colour of 0.5, where light is off by the tolerance; 22.5 dB."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell a room whose base colours are expected to be far off, and where."""
    pixels = room.explained
    shown = pixels.use & ~pixels.emits
    if room.confidence is None or not shown.any():
        return []
    off = room.confidence.layers(pixels.position, pixels.normal)["kd_error"].astype(np.float64)
    counts = np.bincount(pixels.view[shown], minlength=len(pixels.views))
    squares = np.bincount(pixels.view, shown * off**2, len(counts))
    error = float(np.sqrt(squares.sum() / counts.sum()))
    # pixels of a view err together: the views are the independent trials
    trials = squares[counts > 0] / counts[counts > 0]
    measure = Measure("predicted error of diffuse reflectance, root mean square", error, _LIMIT)
    level = notes.judge("uncertain-colors", measure, mean_error(trials) / max(2 * error, 1e-9))
    if level is None:
        return []
    worst = shown & (off > 2 * _LIMIT)
    view = int(np.argmax(squares / np.maximum(counts, 1)))
    return [
        RoomFinding(
            "uncertain-colors",
            level,
            f"Base colours are expected to be off by {error:.2f} (a kd of {-20 * np.log10(error):.0f} dB): "
            f"{100 * worst.sum() / shown.sum():.0f} % of what the views show errs by more than {2 * _LIMIT:.2f}.",
            measure,
            "Take more photographs, from nearer or with more pixels, above all of what is outlined; a mesh with "
            "sharper edges helps as much.",
            {"views": [pixels.views[view]]} | ({"position": place_of(pixels, worst)} if worst.any() else {}),
            image=drawn(room, pixels, view, worst),
        )
    ]
