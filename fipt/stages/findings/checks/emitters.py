"""Emitters that were found but are doubtful: torn into pieces, or clipped in every exposure."""

import numpy as np
from scipy.spatial import cKDTree

from fipt.groups import connected_groups
from fipt.scene.findings import Measure, RoomFinding
from fipt.scene.mesh import Mesh, surface_points
from fipt.stages.findings.checks.brightness import drawn
from fipt.stages.findings.drawing import plan
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE

_GAP = 2.0
"""Widths of a pixel within which two emitters would be one in a picture."""
_SPECKLE = 8.0
"""Side of a speckle at most, pixels: half of them lie at its edge, where pixels are mixed."""
_MANY = 8
"""Speckles beside others: a strip of so many small lamps, closer together than pixels, is no room's."""
_POINTS = 5000
"""On all emitters, about."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell emitters in pieces, and emitters whose radiance is only a lower bound."""
    if not len(room.fitted.emitters.triangle):
        return []
    return [*_torn(room, notes), *_clipped(room, notes)]


def _torn(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    emitters, footprint = room.fitted.emitters, room.explained.footprint
    pixel = float(np.median(footprint)) if len(footprint) else 0.0
    number = np.unique(emitters.emitter, return_inverse=True)[1].reshape(-1)
    speckles = np.bincount(number, emitters.area) < (_SPECKLE * pixel) ** 2
    group = groups(room.mesh, emitters.triangle, number, _GAP * pixel)
    # each group but its largest piece: what would be in one piece if the mesh were what the pictures show
    extra = int(speckles.sum()) - int(np.unique(group[speckles]).size)
    measure = Measure("speckles that would be parts of larger emitters in a picture", float(extra), float(_MANY), "")
    level = notes.judge("torn-emitters", measure)
    if level is None:
        return []
    return [
        RoomFinding(
            "torn-emitters",
            level,
            f"{len(speckles)} emitters were found where pictures would show {int(group.max()) + 1}: noise of the mesh "
            "tears lamps and windows into speckles, each judged by a few pixels.",
            measure,
            "Prepare the mesh (smooth and decimate it to what pixels resolve), or accept and merge the pieces in "
            "emitters_review.yaml.",
            {"triangles": emitters.triangle[speckles[number]][:100].tolist()},
            {"emitters": len(speckles), "groups": int(group.max()) + 1},
            image=_drawn(room, emitters.triangle[speckles[number]]),
        )
    ]


def _drawn(room: JudgedRoom, speckles: np.ndarray) -> np.ndarray:
    """The view that shows most pixels of speckles, emitters outlined; a plan where none shows any."""
    pixels = room.explained
    shown = np.isin(pixels.triangle, speckles)
    if not shown.any():
        return plan(room.mesh, [each.camera for each in room.retakes], room.fitted.emitters, [])
    return drawn(room, pixels, int(np.bincount(pixels.view[shown]).argmax()), pixels.emits)


def groups(mesh: Mesh, triangle: np.ndarray, number: np.ndarray, gap: float) -> np.ndarray:
    """(K,) group of each emitter: those with triangles (E,) nearer than ``gap`` metres to each other's are one."""
    own = Mesh(mesh.vertices, mesh.triangles[triangle])
    low, high = mesh.vertices.min(axis=0) - 1, mesh.vertices.max(axis=0) + 1
    spacing = max(gap, float(np.sqrt(own.areas.sum() / _POINTS)))
    points, owner = surface_points(own, spacing / 2, low, high, seed=0)
    a, b = number[owner][cKDTree(points).query_pairs(spacing, output_type="ndarray")].T
    count = int(number.max()) + 1
    return connected_groups((a, b), count)


def _clipped(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    emitters = room.fitted.emitters
    power = emitters.power
    share = float((power * emitters.lower_bound).sum() / max(power.sum(), 1e-12))
    measure = Measure("emitted power of which only a lower bound is known", share, TOLERANCE)
    level = notes.judge("clipped-emitters", measure)
    if level is None:
        return []
    numbers = np.unique(emitters.emitter[emitters.lower_bound])
    return [
        RoomFinding(
            "clipped-emitters",
            level,
            f"{len(numbers)} emitter{'s are' if len(numbers) > 1 else ' is'} clipped in every exposure, with "
            f"{100 * share:.0f} % of the power that was found: they are brighter than that.",
            measure,
            "Photograph them again with shorter exposures.",
            {"triangles": emitters.triangle[emitters.lower_bound][:100].tolist()},
        )
    ]
