"""The fusion: every view votes on the cells that it sees, and every cell takes the segment with the most votes.

The supplement's way (A, "Semantic segmentation acquisition") is a plain count of pixels by triangle: `vote: count`,
`associate: classes`, and no splitting, speckles, filling or cleaning.
"""

import json
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from fipt.errors import FiptError
from fipt.formats.manifests import Stats
from fipt.formats.text import MALFORMED
from fipt.progress import progress
from fipt.scene.dataset import Dataset
from fipt.scene.segments import LARGEST_ID
from fipt.stages.segment.associate import Masks, associated
from fipt.stages.segment.settings import FuseSettings
from fipt.stages.segment.split import Cells, split, whole
from fipt.stages.segment.surface import CellSurface, filled, near_pieces, surface_of, tidied
from fipt.stages.segment.views import observe
from fipt.stages.segment.votes import VoteMasks, believed, disputed, most_votes, share_of, votes_of
from fipt.stages.segment.write import Fused, FusionResult, write_fused

_CELL = 2.0
"""Longest side of a cell in pixel widths, where settings do not say."""
_EDGE = 1.5
"""Edges in images are this many cells uncertain."""


def fuse(cells: Cells, surface: CellSurface | None, vote_masks: VoteMasks, settings: FuseSettings) -> Fused:
    """Fuse the votes of all views on cells.

    Parameters
    ----------
    surface
        Of the cells; None where settings ask for nothing that needs neighbours.
    """
    masks, views = vote_masks.masks, len(vote_masks.observations.cameras)
    segment = associated(masks, vote_masks.cells_of, len(cells), settings)
    kind = _classes(segment, masks)
    smooth = None if surface is None else surface.bend >= np.cos(np.radians(settings.crease))
    region = None if surface is None or smooth is None else surface.pieces(smooth)
    votes = _counted(vote_masks, segment, region, (len(cells), len(kind)), settings.sharpen)
    ids, share, total = most_votes(votes)
    if surface is not None and smooth is not None:
        if settings.split:
            ids = settled(cells, surface, votes, ids)
        if settings.island > 0:
            ids = tidied(surface, ids, share, settings.island)
        if settings.fill:
            ids = filled(surface, ids, smooth)
        share = share_of(votes, ids)  # what was cleaned may have the id that fewer views gave it
        ids, kind = _cut_into_pieces(surface, ids, kind, _cut_classes(masks, kind, settings), settings.gap)
    ids, kind = numbered(ids, kind, cells.area)
    return Fused(ids, kind[ids], share, total, kind, _views_of(ids, vote_masks, views))


def _counted(
    vote_masks: VoteMasks, segment: np.ndarray, region: np.ndarray | None, shape: tuple[int, int], sharpen: int
) -> csr_matrix:
    """Votes (C, S + 1) of all views, counted ``sharpen`` times more with what each count says of edges."""
    votes = csr_matrix(shape)
    views = len(vote_masks.observations.cameras)
    with progress("counting votes", views * (1 + sharpen), " views") as bar:
        for turn in range(1 + sharpen):
            belief = believed(votes, region) if turn and region is not None else None
            votes = csr_matrix(shape)
            for number in range(views):
                votes = votes + votes_of(vote_masks, number, segment, belief, shape)
                bar.advance()
    return votes


def settled(cells: Cells, surface: CellSurface, votes: csr_matrix, ids: np.ndarray) -> np.ndarray:
    """(C,) ids (C,) with triangles whole again where their cells do not disagree clearly.

    A segment that is nowhere in a triangle thicker than edges in images are uncertain is taken for such an edge: its
    cells take the id of the triangle, which is that of the segments that are thicker, or else of most votes.
    """
    a, b = surface.pairs.T
    alike = (cells.parent[a] == cells.parent[b]) & (ids[a] == ids[b])
    neighbours = np.bincount(surface.pairs[alike].ravel(), minlength=len(ids))
    edge = np.flatnonzero(neighbours < 3)
    far = np.linalg.norm(surface.center[a] - surface.center[b], axis=1)
    graph = surface.graph(alike, np.maximum(far, 1e-9))
    depth = (
        dijkstra(graph, indices=edge, min_only=True, limit=_EDGE * cells.size)
        if len(edge)
        else np.full(len(ids), np.inf)
    )
    piece = surface.pieces(alike)
    thick = np.zeros(piece.max() + 1, bool)
    thick[piece[np.isinf(depth)]] = True
    # the id of each triangle by votes, those of thick pieces counting far more
    count = int(cells.parent[-1]) + 1
    row = np.repeat(np.arange(len(ids)), np.diff(votes.indptr))
    lead = np.where(thick[piece] & (ids > 0), 1e9 * surface.area, 0.0)
    rows, columns = np.concatenate([cells.parent[row], cells.parent]), np.concatenate([votes.indices, ids])
    # As many columns as any vote or id needs: a column without votes never wins.
    shape = (count, int(columns.max(initial=0)) + 1)
    main = most_votes(csr_matrix((np.concatenate([votes.data, lead]), (rows, columns)), shape=shape))[0]
    return np.where(thick[piece] | (ids == 0), ids, main[cells.parent])


def numbered(ids: np.ndarray, kind: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ids (C,) renumbered from 1 by falling area, and their classes (S + 1,); FiptError where they exceed 16 bits."""
    total = np.bincount(ids, area, len(kind))
    present = np.unique(ids[ids > 0])
    order = present[np.argsort(-total[present], kind="stable")]
    if len(order) > LARGEST_ID:
        raise FiptError(
            f"there may be {LARGEST_ID} segments; the fusion found {len(order)}",
            "raise fuse.island or fuse.gap, or for --geometry fuse.smallest",
        )
    new = np.zeros(len(kind), np.int64)
    new[order] = np.arange(1, len(order) + 1)
    return new[ids], np.concatenate([[0], kind[order]])


def _classes(segment: np.ndarray, masks: Masks) -> np.ndarray:
    """(S + 1,) class that most pixels of each segment have."""
    count = int(segment.max(initial=0)) + 1
    pairs, place = np.unique(segment << 32 | masks.kind, return_inverse=True)
    pixels = np.bincount(place.reshape(-1), masks.pixels)
    order = np.argsort(pixels, kind="stable")
    kind = np.zeros(count, np.int64)
    kind[pairs[order] >> 32] = pairs[order] & 0xFFFFFFFF
    kind[0] = 0
    return kind


def _cut_classes(masks: Masks, kind: np.ndarray, settings: FuseSettings) -> np.ndarray:
    """(S,) bool: segments that are cut where they do not hang together.

    By default those of classes that no view tells apart: a network that knows instances has done so already.
    """
    if settings.pieces != "auto":
        return np.full(len(kind), settings.pieces == "all")
    pairs, count = np.unique(masks.view << 32 | masks.kind, return_counts=True)
    distinguished = np.unique((pairs & 0xFFFFFFFF)[count > 1])
    return (kind > 0) & ~np.isin(kind, distinguished)


def _cut_into_pieces(
    surface: CellSurface, ids: np.ndarray, kind: np.ndarray, cut: np.ndarray, gap: float
) -> tuple[np.ndarray, np.ndarray]:
    """Ids (C,) and their classes, with the segments marked in ``cut`` (S,) as one segment a piece."""
    chosen = cut[ids] & (ids > 0)
    if not chosen.any():
        return ids, kind
    piece = near_pieces(surface, np.where(chosen, ids, 0), gap)
    result = ids.copy()
    result[chosen] = len(kind) + piece[chosen]
    new = np.zeros(len(kind) + int(piece.max()) + 1, np.int64)
    new[: len(kind)] = kind
    new[result[chosen]] = kind[ids[chosen]]
    return result, new


def _views_of(ids: np.ndarray, vote_masks: VoteMasks, views: int) -> np.ndarray:
    """(S + 1,) number of views that show each segment."""
    seen = np.zeros(int(ids.max(initial=0)) + 1, np.int64)
    for number in range(views):
        cell, _ = vote_masks.observations.of(number)
        seen[np.unique(ids[cell[cell >= 0]])] += 1
    return seen


# --- files ----------------------------------------------------------------------------------------


def fuse_views(dataset: Path, segments: Path, settings: FuseSettings) -> Stats:
    """Fuse ``segments``/views of the training views and write ``segments``/fused and fusion.npz, .json."""
    data = Dataset(dataset)
    names = class_names(segments / "classes.json")
    voting = [data.camera(view) for view in data.views("train")]
    mesh = data.mesh()
    observations, cells = observe(mesh, voting, segments), whole(mesh)
    vote_masks = VoteMasks(segments / "views", observations, settings)
    if settings.split:
        size = settings.cell or _CELL * observations.pixel
        cells = split(mesh, disputed(vote_masks, len(mesh.triangles)), size, settings.most_cells)
        observations = vote_masks.observations = observe(cells.mesh, voting, segments)
    alone = not (settings.split or settings.sharpen or settings.fill or settings.island) and settings.pieces == "none"
    surface = None if alone else surface_of(cells.mesh)
    found = fuse(cells, surface, vote_masks, settings)
    about = {
        "source": "views",
        "views": len(voting),
        "views_without_segments": vote_masks.without_segments,
        "masks": len(vote_masks.masks),
    }
    kinds = ["semantic"] if found.kind.any() else []
    if settings.associate != "classes" or settings.pieces != "none":
        kinds.append("part")
    return write_fused(segments, data, FusionResult(cells, found, kinds, about, observations, names), settings)


def class_names(path: Path) -> dict[int, str]:
    """Names of classes; none where there is no such file."""
    if not path.is_file():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {int(number): str(name) for number, name in content.items()}
    except MALFORMED as error:
        raise FiptError(f"{path} must map class numbers to names ({error!r})", "correct or remove it") from error
