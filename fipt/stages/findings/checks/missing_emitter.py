"""Something that shines where the mesh has nothing: a lamp that the mesh lacks, and its place.

Pixels count that show several times the radiance of the brightest surface there could be: shading is never off by so
much where the room's light is known. Seen from several views, what shines is where the rays through them meet.
"""

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.checks.brightness import drawn
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom

_TIMES = 3.0
"""The brightest surface's radiance, from which on a pixel counts."""
_FEWEST = 2
"""Views: in more of them it must show; two rays meet somewhere by chance."""
_PIXELS = 10
"""That it must have in all views together."""
_REACH = 0.03
"""Of the room's longest side: so far behind the surface that a ray meets its place may seem to be."""
_ANGLE = 0.1
"""Radians by which a ray may miss a place that it points at: lamps are some decimetres wide, metres away."""
_STEPS = 5
_TRIED = 400
"""Pairs of rays whose meeting is tried."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell the place where most views see something that is too bright for a surface."""
    pixels = room.explained
    radiance = pixels.photo.mean(axis=1)
    ratio = radiance / np.maximum(pixels.brightest, 1e-9)
    sound = pixels.use & ~pixels.emits & ~pixels.mixed
    usual = float(np.median(radiance[sound])) if sound.any() else 0.0  # noise in dark corners does not shine
    bright = np.flatnonzero(pixels.brighter(_TIMES) & (radiance > usual))
    reach = _REACH * float(np.ptp(room.mesh.vertices, axis=0).max())
    place, here = _meeting(room, bright, reach)
    views = np.unique(pixels.view[here])
    enough = len(here) >= _PIXELS
    measure = Measure(
        "views that show something too bright for a surface in one place", len(views) if enough else 0, _FEWEST, ""
    )
    level = notes.judge("lamp-missing", measure)
    if level is None:
        return []
    view = int(np.bincount(pixels.view[here]).argmax())
    marked = np.zeros(len(pixels), bool)
    marked[here] = True
    named = ", ".join(f"{v:.2f}" for v in place)
    return [
        RoomFinding(
            "lamp-missing",
            level,
            f"What {len(views)} views show near ({named}) is {np.median(ratio[here]):.0f} times as bright as any "
            f"surface there could be. The mesh lacks a lamp there, or it was not found.",
            measure,
            "Add the lamp to the mesh (photograph it from near, all around); surface behind it and beside it is wrong.",
            {"views": [pixels.views[k] for k in views], "position": [round(float(v), 2) for v in place]},
            {"times": float(np.median(ratio[here]))},
            image=drawn(room, pixels, view, marked),
        )
    ]


def _meeting(room: JudgedRoom, bright: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """(3,) place that rays of most views point at, then most rays, and the pixels (K,) of ``bright`` whose rays do."""
    pixels, rng = room.explained, np.random.default_rng(room.settings.seed)
    nowhere = np.zeros(3), bright[:0]
    view = pixels.view[bright]
    if len(np.unique(view)) <= _FEWEST:
        return nowhere
    centers = np.array([room.data.camera(name).center for name in pixels.views])[view]
    rays = pixels.position[bright] - centers
    length = np.linalg.norm(rays, axis=1)
    rays = rays / np.maximum(length, 1e-9)[:, None]

    def pointing(place: np.ndarray) -> np.ndarray:
        along = ((place - centers) * rays).sum(axis=1)
        away = np.linalg.norm(place - centers - along[:, None] * rays, axis=1)
        return np.flatnonzero((away < _ANGLE * along) & (along < length + reach))

    best, most = nowhere[0], (0, 0)
    for first, second in rng.integers(0, len(bright), (_TRIED, 2)):
        if view[first] != view[second]:
            place = _nearest(centers[[first, second]], rays[[first, second]])
            own = pointing(place)
            count = len(np.unique(view[own])), len(own)
            if count > most:
                most, best = count, place
    for _ in range(_STEPS):  # to the middle of what each view shows there
        own = pointing(best)
        parts = [own[view[own] == number] for number in np.unique(view[own])]
        if len(parts) <= _FEWEST:
            return nowhere
        middle = np.array([rays[part].mean(axis=0) for part in parts])
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        best = _nearest(centers[[part[0] for part in parts]], middle)
    return best, bright[pointing(best)]


def _nearest(centers: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(3,) the point that is nearest to lines through points (N, 3) along unit directions (N, 3)."""
    across = np.eye(3) - rays[:, :, None] * rays[:, None]
    middle = centers.mean(axis=0)  # parallel lines: no point is better than another
    right = (across @ (centers - middle)[:, :, None]).sum(axis=0)[:, 0]
    return middle + np.linalg.lstsq(across.sum(axis=0), right, rcond=1e-6)[0]
