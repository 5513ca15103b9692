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
from fipt.stages.emitters.completion import Seen
from fipt.stages.emitters.decided import Decided
from fipt.stages.emitters.expected import as_expected, known_light
from fipt.stages.emitters.observations import guess_confidence

_FEWEST = 2
"""Triangles of a piece: a pane is a lamp, too."""
_WHOLE = 0.9
"""Share of the area of a piece that must emit before its copies are taken to emit, too."""
_SEEN_ALONE = 0.1
"""Share of the area of a piece that pixels may show alone: more tells by itself whether it emits."""
_SAME_WAY = 0.99
"""Cosine between the vectors of area of copies: a pane that is turned shows another part of the world."""
_CLOSED = 0.02
"""Vector of area over area below which a piece is closed, and faces no way."""
_SAME_RADIANCE = 0.35
"""Relative difference up to which emitters of one shape are one set; how well the radiance of unseen ones is known."""


@dataclass(frozen=True)
class _ConnectedPieces:
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
    outwards
        (P,) bool: what is closed is wound so that its front is its outside.
    """

    part: np.ndarray
    triangles: list[np.ndarray]
    shape: np.ndarray
    area: np.ndarray
    center: np.ndarray
    facing: np.ndarray
    outwards: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh) -> "_ConnectedPieces":
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
        center /= area[:, None]
        away = ((mesh.corners.mean(axis=1) - center[part]) * mesh.area_normals).sum(axis=1)
        outwards = np.bincount(part, away, count) > 0
        return cls(part, triangles, shape, area, center, vector / area[:, None], outwards)

    def same_way(self, piece: int, others: np.ndarray) -> np.ndarray:
        """(N,) bool: whether others (N,) face where a piece does; what is closed faces outwards, or inwards."""
        length = np.linalg.norm(self.facing, axis=1)
        cosine = self.facing[others] @ self.facing[piece] / np.maximum(length[others] * length[piece], 1e-12)
        closed = (length[others] < _CLOSED) & (length[piece] < _CLOSED)
        return np.where(closed, self.outwards[others] == self.outwards[piece], cosine >= _SAME_WAY)


def with_copies(
    mesh: Mesh,
    shards: Sequence[ObservedShard],
    found: Emitters,
    doubtful: np.ndarray,
    seen: Seen,
    decided: Decided,
    guess: bool,
) -> Emitters:
    """The emitters with copies of them.

    Parameters
    ----------
    shards
        The training views.
    doubtful
        Triangles (N,) that may be lit instead of emitting: copies of such emitters are none.
    decided
        What a person accepted or rejected is no copy.
    guess
        Whether copies that no pixel shows emit, of a shape of which more pieces emit than are seen dark.
    """
    pieces = _ConnectedPieces.of(mesh)
    barred = decided.rejected | (decided.emitter >= 0)
    judged = np.bincount(pieces.part, mesh.areas * seen.alone) > _SEEN_ALONE * pieces.area
    emits = np.bincount(pieces.part[found.triangle], minlength=len(judged)) > 0
    source = _source_of_copies(mesh, pieces, found, ~np.isin(found.triangle, doubtful))
    copies = np.flatnonzero((source >= 0) & ~judged & ~emits & (np.bincount(pieces.part, barred) == 0))
    if len(copies) == 0:
        return found
    row = np.full(len(mesh.triangles), -1)
    row[found.triangle] = np.arange(len(found.triangle))
    number = np.full(len(source), -1)
    number[copies] = np.arange(len(copies))
    rows = [row[pieces.triangles[k]] for k in source[copies]]
    level = np.array([found.radiance[own[own >= 0]].mean() for own in rows], np.float64)
    said = as_expected(shards, known_light(found, seen.radiance), number[pieces.part], level)
    off = judged & ~emits
    off[copies] = said.shown & ~said.emits
    count = len(off)
    mostly = np.bincount(pieces.shape[emits], minlength=count) > np.bincount(pieces.shape[off], minlength=count)
    result, areas = found, mesh.areas
    for k in np.flatnonzero(np.where(said.shown, said.emits, guess & mostly[pieces.shape[copies]])):
        own, triangles = rows[k] >= 0, pieces.triangles[copies[k]]
        copy = _copy(found.chosen(rows[k][own]), triangles[own], areas[triangles[own]], said.views[k])
        result = result.joined(replace(copy, emitter=copy.emitter + np.int32(int(result.emitter.max()) + 1)))
    return result


def copied(mesh: Mesh, emitters: Emitters) -> np.ndarray:
    """(E,) bool: guessed triangles of pieces that have the shape of another piece, which views show to emit.

    A scan is one piece, of which views show some to emit: what is guessed of the rest is no copy.
    """
    if not emitters.guessed.any():
        return emitters.guessed
    pieces = _ConnectedPieces.of(mesh)
    part = pieces.part[emitters.triangle]
    shown = part[~emitters.guessed]
    return emitters.guessed & np.isin(pieces.shape[part], pieces.shape[shown]) & ~np.isin(part, shown)


def _copy(like: Emitters, triangles: np.ndarray, areas: np.ndarray, views: int) -> Emitters:
    """One emitter of triangles (N,), each like one of N of another; guessed where no view shows it."""
    guessed = np.full(len(triangles), views == 0)
    unsure = np.float32(guess_confidence(_SAME_RADIANCE))
    return replace(
        like,
        triangle=triangles.astype(np.int32),
        area=areas.astype(np.float32),
        emitter=np.zeros(len(triangles), np.int32),
        views=np.full(len(triangles), views, np.int32),
        confidence=np.where(guessed, np.minimum(like.confidence, unsure), like.confidence),
        error=np.maximum(like.error, np.float32(_SAME_RADIANCE) * like.radiance),
        guessed=guessed,
        spread=(_SAME_RADIANCE * guessed).astype(np.float32),
    )


def _source_of_copies(mesh: Mesh, pieces: _ConnectedPieces, found: Emitters, certain: np.ndarray) -> np.ndarray:
    """(P,) the nearest piece that emits as a whole, of which each piece is a copy; -1 for none."""
    count, proved, bright = len(pieces.triangles), np.zeros(len(mesh.triangles)), np.zeros(len(mesh.triangles))
    proved[found.triangle] = certain
    bright[found.triangle] = found.radiance.mean(axis=1)
    whole = np.bincount(pieces.part, mesh.areas * proved, count) > _WHOLE * pieces.area
    level = np.bincount(pieces.part, mesh.areas * bright, count) / pieces.area
    result = np.full(count, -1)
    for shape in np.unique(pieces.shape[whole]):
        sources = np.flatnonzero(whole & (pieces.shape == shape))
        if np.ptp(level[sources]) > _SAME_RADIANCE * level[sources].max():
            continue
        for copy in np.flatnonzero(~whole & (pieces.shape == shape)):
            near = sources[pieces.same_way(int(copy), sources)]
            if len(near):
                distance = np.linalg.norm(pieces.center[near] - pieces.center[copy], axis=1)
                result[copy] = near[int(np.argmin(distance))]
    return result


def copies_in_words(mesh: Mesh, emitters: Emitters, copies: np.ndarray) -> tuple[str, ...]:
    """What to say of emitters of some triangles (N,), guessed since others of their shape emit."""
    numbers = np.unique(emitters.emitter[np.isin(emitters.triangle, copies)])
    if len(numbers) == 0:
        return ()
    power = np.bincount(emitters.emitter, emitters.power)
    strongest = emitters.triangle[emitters.emitter == numbers[power[numbers].argmax()]]
    place = ", ".join(f"{v:.2f}" for v in np.average(mesh.corners[strongest].mean(1), 0, mesh.areas[strongest]))
    share = 100 * power[numbers].sum() / power.sum()
    return (
        f"no view shows {len(numbers)} of what has the shape of an emitter, the brightest near ({place}): taken to "
        f"shine alike, with {share:.0f} % of the power; photograph them, or reject them in emitters_review.yaml",
    )
