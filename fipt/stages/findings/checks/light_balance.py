"""Light balance: what emitters and materials found give, against what the photographs show, as a whole and by place.

Some training views are rendered with the model alone. The median logarithm of the ratio to the photograph is one number
a view; its median over views is the balance, their scatter its error. A slope of the ratio over the room is fitted to
the medians of cells, and its standard error comes from their scatter about it.

Too little light need not be light that is missing. Were it missing, the fit would make up for it by base colours near
white, until they are as white as can be. Where few are, the rendering is dark because base colours are: the shading
under which they were found was brighter than that of the emitters.
"""

from collections.abc import Sequence

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.scene.observed import fully_weighted
from fipt.stages.findings.drawing import compared, log_ratio, plan
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.retakes import Retake
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE, median_error

_CELLS = 8
"""Cells along the longest side of the room."""
_FEWEST = 20
"""Pixels that a cell must have."""
_RANGE = (5, 95)
"""Percentiles of the cells' places between which the slope is told."""
_MISSING = (
    "Look for light that no view shows (photograph the whole ceiling and every window), for holes of the mesh, and for "
    "surface inside the mesh that hides a lamp."
)
_WHITE = 0.87
"""Brightest channel of a base colour above which surface is about as white as paint can be (0.9, `fit.whitest`)."""
_DARK_COLORS = (
    "Run more rounds (raise rounds in the configuration): base colours follow the light of the emitters. If it stays, "
    "look for surface that no view shows, whose colour is a guess, and photograph it."
)
_EXCESS = "Look for emitters that are none or too large in the list of emitters, and reject them."


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell light that is missing or too much, in all of the room or towards one side."""
    if not len(room.fitted.emitters.triangle) and room.fitted.environment.mode == "none":
        return []  # nothing can be balanced: the check no_emitter says so
    judged = [retake for retake in room.retakes if usable(retake).any()]
    if not judged:
        return []
    return [*_offset(room, notes, judged), *_slope(room, notes)]


def usable(retake: Retake) -> np.ndarray:
    """(H, W) bool: valid pixels that see surface which does not emit."""
    return fully_weighted(retake.weight) & ~retake.emits


def _ratios(retake: Retake) -> np.ndarray:
    return log_ratio(retake.render, retake.photo)[usable(retake)]


def _offset(room: JudgedRoom, notes: Notes, judged: Sequence[Retake]) -> list[RoomFinding]:
    ratios = np.array([np.median(_ratios(retake)) for retake in judged])
    offset = float(np.median(ratios))
    measure = Measure("light given against light photographed, off by", abs(np.expm1(offset)), TOLERANCE)
    level = notes.judge("light-balance", measure, median_error(ratios))
    if level is None:
        return []
    typical = judged[int(np.abs(ratios - offset).argmin())]
    less, white = offset < 0, _white_share(room)
    dark = less and white <= TOLERANCE
    wrong = (
        "base colours are too dark, since few are near white, as they would be if a lamp were missing"
        if dark
        else "base colours or emitters are wrong by about as much"
    )
    cause = (
        f"The emitters and materials found give {100 * measure.value:.0f} % {'less' if less else 'more'} light than "
        f"the photographs show: {wrong}."
    )
    return [
        RoomFinding(
            "light-balance",
            level,
            cause,
            measure,
            _DARK_COLORS if dark else _MISSING if less else _EXCESS,
            {"views": [typical.camera.name]},
            {"ratio": float(np.exp(offset)), "standard_error": median_error(ratios), "white": white},
            image=compared(typical.photo, typical.render, room.exposure),
        )
    ]


def _white_share(room: JudgedRoom) -> float:
    """Share of the pixels that one piece of surface fills whose base colour is near white, or who are brighter."""
    pixels = room.explained
    chosen = pixels.use & ~pixels.emits & ~pixels.mixed
    over = (pixels.base_color.max(axis=1) > _WHITE) | (pixels.photo.mean(axis=1) > (1 + TOLERANCE) * pixels.brightest)
    return float(over[chosen].mean()) if chosen.any() else 0.0


def _slope(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    place = np.concatenate([retake.position[usable(retake)] for retake in room.retakes])
    value = np.concatenate([_ratios(retake) for retake in room.retakes])
    centers, medians = _cells(place, value)
    if len(centers) < 8:  # a plane has four unknowns
        return []
    design = np.column_stack([np.ones(len(centers)), centers - centers.mean(axis=0)])
    solution = np.linalg.lstsq(design, medians, rcond=None)[0]
    left = medians - design @ solution
    covariance = np.linalg.pinv(design.T @ design) * (left @ left) / (len(centers) - 4)
    slope = solution[1:]
    steep = float(np.linalg.norm(slope))
    direction = slope / max(steep, 1e-12)
    along = centers @ direction
    low, high = np.percentile(along, _RANGE)
    error = float(np.sqrt(max(direction @ covariance[1:, 1:] @ direction, 0.0)) * (high - low))
    measure = Measure("change of that ratio across the room", float(np.expm1(steep * (high - low))), TOLERANCE)
    level = notes.judge("light-slope", measure, error)
    if level is None:
        return []
    dark, bright = centers[along.argmin()], centers[along.argmax()]
    cause = (
        f"The light found is {100 * measure.value:.0f} % too weak near {_place(dark)} compared with {_place(bright)}: "
        "some of it comes from elsewhere, or arrives where it should not."
    )
    marks = [("too dark", dark), ("too bright", bright)]
    cameras = [retake.camera for retake in room.retakes]
    drawn = plan(room.mesh, cameras, room.fitted.emitters, marks, (centers, medians - np.median(medians), "log ratio"))
    remedy = f"Photograph the ceiling, lamps and windows near {_place(dark)}; check the mesh there for holes and leaks."
    where = {"position": [round(float(v), 2) for v in dark]}
    return [RoomFinding("light-slope", level, cause, measure, remedy, where, {"standard_error": error}, image=drawn)]


def _cells(place: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean place (C, 3) and median value (C,) of cells of the room."""
    if not len(place):
        return place, value
    low, high = np.percentile(place, (1, 99), axis=0)  # what a window shows outside may be far away
    inside = ((place >= low) & (place <= high)).all(axis=1)
    place, value = place[inside], value[inside]
    size = max(float((high - low).max()) / _CELLS, 1e-6)
    key, cell = np.unique(np.floor((place - place.min(axis=0)) / size).astype(int), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    count = np.bincount(cell, minlength=len(key))
    chosen = np.flatnonzero(count >= _FEWEST)
    centers = np.array([place[cell == k].mean(axis=0) for k in chosen]).reshape(-1, 3)
    return centers, np.array([np.median(value[cell == k]) for k in chosen])


def _place(point: np.ndarray) -> str:
    return "(" + ", ".join(f"{v:.1f}" for v in point) + ")"
