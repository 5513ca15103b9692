"""Lamps come in sets: a modeller sets up one, and copies it (ADR 92).

A piece of the mesh that has the shape of an emitter, and faces the same way, emits as that does, if the pixels that
show it do not say otherwise. What no view shows is guessed, and said to be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fipt.meshing.copies import first_copies
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.observed import ObservedShard
from fipt.stages.emitters.decided import Decided
from fipt.stages.emitters.expected import as_expected

_FEWEST = 2
"""Triangles of a piece: a pane is a lamp, too."""
_WHOLE = 0.9
"""Share of the area of a piece that must emit before its copies are taken to emit, too."""
_TOLD = 0.1
"""Share of the area of a piece that pixels may show alone: more tells by itself whether it emits."""
_SAME_WAY = 0.99
"""Cosine between the vectors of area of copies: a pane that is turned shows another part of the world."""
_CLOSED = 0.02
"""Vector of area over area below which a piece is closed, and faces no way."""
_SAME_RADIANCE = 0.35
"""Relative difference up to which emitters of one shape are one set; how well the radiance of unseen ones is known."""


@dataclass(frozen=True)
class _Pieces:
    """P connected pieces of the mesh.

    Attributes
    ----------
    part
        (T,) int64 piece of each triangle.
    triangles
        Those of each piece, ascending.
    shape
        (P,) int64: pieces of one number are copies, triangle by triangle.
    area
        (P,) of each.
    center, facing
        (P, 3) mean of its corners; vector of area over area.
    """

    part: np.ndarray
    triangles: list[np.ndarray]
    shape: np.ndarray
    area: np.ndarray
    center: np.ndarray
    facing: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh) -> "_Pieces":
        """The pieces of a mesh."""
        part = np.unique(connected_parts(mesh), return_inverse=True)[1].reshape(-1)
        count = int(part.max(initial=-1)) + 1
        triangles = np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part, minlength=count))[:-1])
        first = np.array([own[0] for own in triangles], np.int64)
        area = np.maximum(np.bincount(part, mesh.areas, count), 1e-12)
        center, vector = (
            np.stack([np.bincount(part, column, count) for column in values.T], axis=1)
            for values in (mesh.corners.mean(axis=1) * mesh.areas[:, None], mesh.area_normals)
        )
        shape = part[first_copies(mesh, _FEWEST)[first]]
        return cls(part, triangles, shape, area, center / area[:, None], vector / area[:, None])

    def same_way(self, piece: int, others: np.ndarray) -> np.ndarray:
        """(N,) bool: whether others (N,) face where a piece does; what is closed faces no way."""
        length = np.linalg.norm(self.facing, axis=1)
        cosine = self.facing[others] @ self.facing[piece] / np.maximum(length[others] * length[piece], 1e-12)
        return (cosine >= _SAME_WAY) | ((length[others] < _CLOSED) & (length[piece] < _CLOSED))


def with_copies(
    mesh: Mesh,
    shards: Sequence[ObservedShard],
    found: Emitters,
    sure: np.ndarray,
    alone: np.ndarray,
    decided: Decided,
    guess: bool,
) -> Emitters:
    """The emitters with copies of them.

    Parameters
    ----------
    shards
        The training views.
    sure
        (E,) bool: triangles of emitters of which there is no doubt; copies of others are no emitters.
    alone
        (T,) bool: triangles that pixels show alone, or show to be dark.
    decided
        What a person accepted or rejected is no copy.
    guess
        Whether copies that no pixel shows emit.
    """
    pieces = _Pieces.of(mesh)
    barred = decided.rejected | (decided.emitter >= 0)
    told = np.bincount(pieces.part, mesh.areas * alone) > _TOLD * pieces.area
    free = ~told & (np.bincount(pieces.part, barred) == 0)
    lamp = _lamp_of_copies(mesh, pieces, found, sure, free)
    copies = np.flatnonzero(lamp >= 0)
    if len(copies) == 0:
        return found
    row = np.full(len(mesh.triangles), -1)
    row[found.triangle] = np.arange(len(found.triangle))
    rows = [_filled(row[pieces.triangles[k]]) for k in lamp[copies]]
    number = np.full(len(lamp), -1)
    number[copies] = np.arange(len(copies))
    level = np.array([found.radiance[own].mean() for own in rows], np.float64)
    said = as_expected(shards, found, number[pieces.part], level)
    result = found
    for k in np.flatnonzero(np.where(said.shown, said.shines, guess)):
        copy = _copy(mesh, found.chosen(rows[k]), pieces.triangles[copies[k]], said.views[k])
        result = result.joined(replace(copy, emitter=copy.emitter + np.int32(int(result.emitter.max()) + 1)))
    return result


def _filled(rows: np.ndarray) -> np.ndarray:
    """Rows (N,) of emitters, some first one where there is none."""
    return np.where(rows >= 0, rows, rows[rows >= 0][0])


def _copy(mesh: Mesh, like: Emitters, triangles: np.ndarray, views: int) -> Emitters:
    """One emitter of triangles (N,), each like one of N of another; guessed where no view shows it."""
    guessed = np.full(len(triangles), views == 0)
    return replace(
        like,
        triangle=triangles.astype(np.int32),
        area=mesh.areas[triangles].astype(np.float32),
        emitter=np.zeros(len(triangles), np.int32),
        views=np.full(len(triangles), views, np.int32),
        error=np.maximum(like.error, np.float32(_SAME_RADIANCE) * like.radiance),
        guessed=guessed,
        spread=(_SAME_RADIANCE * guessed).astype(np.float32),
    )


def _lamp_of_copies(mesh: Mesh, pieces: _Pieces, found: Emitters, sure: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(P,) the nearest piece that emits as a whole, of which each ``free`` piece (P,) is a copy; -1 for none."""
    count, emits, certain = len(pieces.triangles), np.zeros(len(mesh.triangles), bool), np.zeros(len(mesh.triangles))
    emits[found.triangle], certain[found.triangle] = True, sure
    whole = np.bincount(pieces.part, mesh.areas * certain, count) > _WHOLE * pieces.area
    free = free & (np.bincount(pieces.part, emits, count) == 0)
    bright = np.zeros(len(mesh.triangles))
    bright[found.triangle] = found.radiance.mean(axis=1)
    level = np.bincount(pieces.part, mesh.areas * bright, count) / pieces.area
    result = np.full(count, -1)
    for shape in np.unique(pieces.shape[whole]):
        lamps = np.flatnonzero(whole & (pieces.shape == shape))
        if np.ptp(level[lamps]) > _SAME_RADIANCE * level[lamps].max():
            continue
        for copy in np.flatnonzero(free & (pieces.shape == shape)):
            near = lamps[pieces.same_way(int(copy), lamps)]
            if len(near):
                distance = np.linalg.norm(pieces.center[near] - pieces.center[copy], axis=1)
                result[copy] = near[int(np.argmin(distance))]
    return result


def copies_in_words(mesh: Mesh, found: Emitters) -> tuple[str, ...]:
    """What to say of emitters that were guessed since others of their shape emit."""
    numbers = np.unique(found.emitter[found.guessed])
    if len(numbers) == 0:
        return ()
    power = np.bincount(found.emitter, found.power)
    strongest = found.triangle[found.emitter == numbers[power[numbers].argmax()]]
    place = ", ".join(f"{v:.2f}" for v in np.average(mesh.corners[strongest].mean(1), 0, mesh.areas[strongest]))
    share = 100 * power[numbers].sum() / power.sum()
    return (
        f"no view shows {len(numbers)} pieces that have the shape of emitters, the brightest near ({place}): they are "
        f"taken to shine as these do, with {share:.0f} % of the power; photograph them, or reject them in "
        "emitters_review.yaml",
    )
