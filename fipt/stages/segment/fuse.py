"""The fusion: every view votes on the cells that it sees, and every cell takes the segment with the most votes.

The supplement's way (A, "Semantic segmentation acquisition") is a plain count of pixels by triangle: `vote: count`,
`associate: classes`, and no splitting, speckles, filling or cleaning.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra

from fipt.errors import FiptError
from fipt.formats.arrays import on_disk
from fipt.formats.files import atomic_folder, write_text
from fipt.formats.images import write_png
from fipt.formats.manifests import Stats, write_manifest
from fipt.progress import progress
from fipt.scene.dataset import Dataset
from fipt.scene.fusion import Fusion, write_fusion
from fipt.scene.segments import LARGEST_ID
from fipt.settings import dumped
from fipt.stages.segment.associate import Masks, associated
from fipt.stages.segment.settings import FuseSettings
from fipt.stages.segment.split import Cells, split, whole
from fipt.stages.segment.surface import Surface, filled, near_pieces, surface_of, tidied
from fipt.stages.segment.views import Looks, look, view_ids, without_speckles

_CELL = 2.0
"""Longest side of a cell in pixel widths, where settings do not say."""
_EDGE = 1.5
"""Edges in pictures are this many cells uncertain."""
_STEPS, _REACH = (-2, 0, 2), 2
"""Rows and columns beside a pixel where its id may be from, and the furthest."""
_TRUST = 10.0
"""Votes of a cell that count as much as what its region says."""
_STAYS = 0.01
"""Least share of a segment that a pixel's own cell is taken to have."""
_FEWEST_PIXELS = 4
"""Pixels that two segments must each have on a triangle in a view before it is cut."""


@dataclass(frozen=True)
class Fused:
    """Segments of C cells.

    Attributes
    ----------
    part, semantic
        (C,) int64 ids, 0 = unknown; parts are numbered by falling area.
    agreement
        (C,) float64 share of the votes that the cell's id got; 0 where none voted.
    votes
        (C,) float64 votes.
    kind
        (S + 1,) int64 class of each part, 0 = unknown.
    views
        (S + 1,) int64 views that voted for each part where it is.
    """

    part: np.ndarray
    semantic: np.ndarray
    agreement: np.ndarray
    votes: np.ndarray
    kind: np.ndarray
    views: np.ndarray


class Ballot:
    """The ids that views give to pixels; read once, and kept on the disk beside ``folder``.

    Parameters
    ----------
    folder
        Of VIEW.npz.
    looks
        What the voting views show; may be exchanged for finer cells of the same views.

    Attributes
    ----------
    masks
        Of all views.
    silent
        Names of views without any segment.
    """

    def __init__(self, folder: Path, looks: Looks, settings: FuseSettings) -> None:
        self.looks, self.settings = looks, settings
        self._mask = on_disk(folder.parent)(looks.cell.shape, np.int32)
        view, ids, kinds, pixels = [], [], [], []
        self.silent = []
        count = 0
        for number, camera in enumerate(looks.cameras):
            labels, classes = view_ids(folder, camera, settings.other_size)
            if settings.speckles:
                labels = without_speckles(labels)
            labels = labels.reshape(-1)
            present, size = np.unique(labels[labels > 0], return_counts=True)
            if len(present) == 0:
                self.silent.append(camera.name)
            table = np.full(LARGEST_ID + 1, -1, np.int32)
            table[present] = count + np.arange(len(present))
            self._mask[looks.pixels(number)] = table[labels]
            count += len(present)
            view.append(np.full(len(present), number))
            ids.append(present.astype(np.int64))
            kinds.append(classes[present].astype(np.int64))
            pixels.append(size)
        if len(self.silent) == len(looks.cameras):
            raise FiptError(f"no view of {folder} has a segment", "check what wrote the ids")
        if self.silent:
            print(f"warning: views without any segment: {', '.join(self.silent)}")
        self.masks = Masks(*(np.concatenate(arrays) for arrays in (view, ids, kinds, pixels)))

    def of(self, number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pixel (N,), its mask (N,) and weight (N,) of all pixels of a view that vote."""
        cell, cosine = self.looks.of(number)
        mask = np.asarray(self._mask[self.looks.pixels(number)])
        pixel = np.flatnonzero((cell >= 0) & (mask >= 0))
        weight = np.ones(len(pixel)) if self.settings.vote == "count" else cosine[pixel].astype(np.float64)
        return pixel, mask[pixel].astype(np.int64), weight

    def look(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Cell (N,) and mask (N,) of all pixels of a view that vote."""
        pixel, mask, _ = self.of(number)
        return self.looks.of(number)[0][pixel], mask


def fuse(cells: Cells, surface: Surface | None, ballot: Ballot, settings: FuseSettings) -> Fused:
    """Fuse the votes of all views on cells.

    Parameters
    ----------
    surface
        Of the cells; None where settings ask for nothing that needs neighbours.
    """
    masks, count, views = ballot.masks, len(cells), len(ballot.looks.cameras)
    segment = associated(masks, ballot.look, count, settings)
    kind = _classes(segment, masks)
    smooth = None if surface is None else surface.bend >= np.cos(np.radians(settings.crease))
    region = None if smooth is None else surface.pieces(smooth)
    votes = csr_matrix((count, len(kind)))
    with progress("counting votes", views * (1 + settings.sharpen), " views") as bar:
        for turn in range(1 + settings.sharpen):
            belief, votes = _belief(votes, region) if turn else None, csr_matrix(votes.shape)
            for number in range(views):
                votes = votes + _votes_of(ballot, number, segment, belief, votes.shape)
                bar.advance()
    ids, share, total = most_votes(votes)
    if surface is not None:
        if settings.split:
            ids = settled(cells, surface, votes, ids)
        if settings.island > 0:
            ids = tidied(surface, ids, share, settings.island)
        if settings.fill:
            ids = filled(surface, ids, smooth)
        share = share_of(votes, ids)  # what was cleaned may have the id that fewer views gave it
        ids, kind = _cut_into_pieces(surface, ids, kind, _cut_classes(masks, kind, settings), settings.gap)
    ids, kind = numbered(ids, kind, cells.area)
    return Fused(ids, kind[ids], share, total, kind, _views_of(ids, ballot, views))


def _votes_of(
    ballot: Ballot, number: int, segment: np.ndarray, belief: "_Belief | None", shape: tuple[int, int]
) -> csr_matrix:
    """Votes (C, S + 1) of a view.

    A pixel votes for the cell that it shows. Where a ``belief`` is known, pixels near edges vote for the cells around,
    in proportion to how much those are believed to have its segment: edges of masks are uncertain by some pixels, and
    what is said of a window frame is not for the pane beside it (expectation maximisation over where the id is from).
    """
    pixel, mask, weight = ballot.of(number)
    label = segment[mask]
    pixel, label, weight = pixel[label > 0], label[label > 0], weight[label > 0]
    camera, cell = ballot.looks.cameras[number], ballot.looks.of(number)[0]
    if belief is None:
        return coo_matrix((weight, (cell[pixel], label)), shape=shape).tocsr()
    picture = np.pad(cell.reshape(camera.height, camera.width), _REACH, constant_values=-1).ravel()
    place = (pixel // camera.width + _REACH) * (camera.width + 2 * _REACH) + pixel % camera.width + _REACH
    steps = [y * (camera.width + 2 * _REACH) + x for y in _STEPS for x in _STEPS]
    won = np.where(picture >= 0, belief.label[picture, 0], -1)
    inside = np.ones(len(place), bool)
    for step in steps:
        inside &= won[place + step] == label
    edge = ~inside
    around = np.stack([picture[place[edge] + step] for step in steps], axis=1)
    share = np.where(around >= 0, belief.of(around, label[edge, None]), 0)
    share[:, len(steps) // 2] += _STAYS
    share *= (weight[edge] / share.sum(axis=1))[:, None]
    values = np.concatenate([weight[inside], share.ravel()])
    rows = np.concatenate([cell[pixel[inside]], np.maximum(around, 0).ravel()])
    columns = np.concatenate([label[inside], np.repeat(label[edge], len(steps))])
    return coo_matrix((values, (rows, columns)), shape=shape).tocsr()


@dataclass(frozen=True)
class _Belief:
    """What cells were given so far: of each cell, and of the region that it lies in, the two most voted segments.

    Attributes
    ----------
    region
        (C,) region of each cell.
    label, share
        Of cells (C, 2): the segments and their share of the votes; -1 where there is none.
    region_label, region_share
        The same of regions (R, 2).
    own
        (C,) weight of the cell's share against its region's: the more votes, the more.
    """

    region: np.ndarray
    label: np.ndarray
    share: np.ndarray
    region_label: np.ndarray
    region_share: np.ndarray
    own: np.ndarray

    def of(self, cell: np.ndarray, label: np.ndarray) -> np.ndarray:
        """Belief that cells have a segment; arrays of one shape."""
        region, own = self.region[cell], self.own[cell]
        result = np.zeros(cell.shape, np.float32)
        for k in (0, 1):
            result += np.where(self.label[cell, k] == label, own * self.share[cell, k], 0)
            result += np.where(self.region_label[region, k] == label, (1 - own) * self.region_share[region, k], 0)
        return result


def _belief(votes: csr_matrix, region: np.ndarray) -> _Belief:
    count = votes.shape[0]
    cells = csr_matrix((np.ones(count), (region, np.arange(count))), shape=(int(region.max()) + 1, count))
    total = np.asarray(votes.sum(axis=1)).reshape(-1)
    return _Belief(
        region, *_two_best(votes), *_two_best((cells @ votes).tocsr()), (total / (total + _TRUST)).astype(np.float32)
    )


def _two_best(votes: csr_matrix) -> tuple[np.ndarray, np.ndarray]:
    """The two columns with the most votes of each row (N, 2) int32, -1 where there is none, and their shares (N, 2)."""
    first, share, _ = most_votes(votes)
    others = votes.copy()
    others.data[others.indices == np.repeat(first, np.diff(votes.indptr))] = 0
    second, _, _ = most_votes(others)
    shares = np.stack([share, share_of(others, second) * (1 - share)], axis=1).astype(np.float32)
    return np.where(shares > 0, np.stack([first, second], axis=1), -1).astype(np.int32), shares


def disputed(ballot: Ballot, count: int) -> np.ndarray:
    """(count,) bool: triangles of which a view shows two segments."""
    found = np.zeros(count, bool)
    for number in range(len(ballot.looks.cameras)):
        cell, mask = ballot.look(number)
        keys, pixels = np.unique(cell.astype(np.int64) << 32 | mask, return_counts=True)
        triangle = keys[pixels >= _FEWEST_PIXELS] >> 32
        found[triangle[1:][triangle[1:] == triangle[:-1]]] = True
    return found


def settled(cells: Cells, surface: Surface, votes: csr_matrix, ids: np.ndarray) -> np.ndarray:
    """(C,) ids (C,) with triangles whole again where their cells do not disagree clearly.

    A segment that is nowhere in a triangle thicker than edges in pictures are uncertain is taken for such an edge: its
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
    shape = (count, votes.shape[1])
    main = most_votes(coo_matrix((np.concatenate([votes.data, lead]), (rows, columns)), shape=shape).tocsr())[0]
    return np.where(thick[piece] | (ids == 0), ids, main[cells.parent])


def most_votes(votes: csr_matrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Winner of each row of votes (C, S): its column (the first of equals), its share of the votes, and all votes.

    Rows without votes have winner and share 0.
    """
    votes.sort_indices()
    rows = np.flatnonzero(np.diff(votes.indptr))
    winner, share = np.zeros(votes.shape[0], np.int64), np.zeros(votes.shape[0])
    total = np.asarray(votes.sum(axis=1)).reshape(-1)
    if len(rows):
        most = np.maximum.reduceat(votes.data, votes.indptr[rows])
        owner = np.repeat(np.arange(len(rows)), np.diff(votes.indptr)[rows])
        best = np.flatnonzero(votes.data == most[owner])[::-1]
        winner[rows[owner[best]]] = votes.indices[best]  # the last write, the first of equals, stays
        share[rows] = most / np.maximum(total[rows], 1e-30)
    return winner, share, total


def share_of(votes: csr_matrix, ids: np.ndarray) -> np.ndarray:
    """(C,) share that the column ``ids`` (C,) has of the votes (C, S) in each row; 0 where there are none."""
    row = np.repeat(np.arange(len(ids)), np.diff(votes.indptr))
    own = votes.indices == ids[row]
    got = np.bincount(row[own], votes.data[own], len(ids))
    total = np.asarray(votes.sum(axis=1)).reshape(-1)
    return got / np.where(total > 0, total, 1)


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
    apart = np.unique((pairs & 0xFFFFFFFF)[count > 1])
    return (kind > 0) & ~np.isin(kind, apart)


def _cut_into_pieces(
    surface: Surface, ids: np.ndarray, kind: np.ndarray, cut: np.ndarray, gap: float
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


def _views_of(ids: np.ndarray, ballot: Ballot, views: int) -> np.ndarray:
    """(S + 1,) number of views that show each segment."""
    seen = np.zeros(int(ids.max(initial=0)) + 1, np.int64)
    for number in range(views):
        cell, _ = ballot.looks.of(number)
        seen[np.unique(ids[cell[cell >= 0]])] += 1
    return seen


# --- files ----------------------------------------------------------------------------------------


def fuse_views(dataset: Path, segments: Path, settings: FuseSettings, stats: Stats) -> None:
    """Fuse ``segments``/views of the training views and write ``segments``/fused and fusion.npz, .json."""
    data = Dataset(dataset)
    names = class_names(segments / "classes.json")
    voting = [data.camera(view) for view in data.views("train")]
    mesh = data.mesh()
    looks, cells = look(mesh, voting, segments), whole(mesh)
    ballot = Ballot(segments / "views", looks, settings)
    if settings.split:
        size = settings.cell or _CELL * looks.pixel
        cells = split(mesh, disputed(ballot, len(mesh.triangles)), size, settings.most_cells)
        looks = ballot.looks = look(cells.mesh, voting, segments)
    alone = not (settings.split or settings.sharpen or settings.fill or settings.island) and settings.pieces == "none"
    surface = None if alone else surface_of(cells.mesh)
    found = fuse(cells, surface, ballot, settings)
    about = {"source": "views", "views": len(voting), "silent_views": ballot.silent, "masks": len(ballot.masks)}
    kinds = ["semantic"] if found.kind.any() else []
    if settings.associate != "classes" or settings.pieces != "none":
        kinds.append("part")
    write_fused(segments, data, cells, found, kinds, names, about, settings, stats, looks)


def class_names(path: Path) -> dict[int, str]:
    """Names of classes; none where there is no such file."""
    if not path.is_file():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return {int(number): str(name) for number, name in content.items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise FiptError(f"{path} must map class numbers to names ({error!r})", "correct or remove it") from error


def write_fused(
    out: Path,
    data: Dataset,
    cells: Cells,
    found: Fused,
    kinds: list[str],
    names: dict[int, str],
    about: dict[str, Any],
    settings: FuseSettings,
    stats: Stats,
    looks: Looks | None = None,
) -> None:
    """Write the ids of every view below ``out``/fused, fusion.npz and .json, and the manifest, which comes last.

    Parameters
    ----------
    kinds
        Of ids to write for the views: part, semantic.
    names
        Of classes.
    about
        What to say in fusion.json beside segments and figures.
    looks
        Of some views, where they are known already; the others are traced.
    """
    manifest = out / "fused.manifest.json"
    manifest.unlink(missing_ok=True)
    known = {camera.name: (looks, number) for number, camera in enumerate(looks.cameras)} if looks else {}
    others = [camera for camera in data.cameras if camera.name not in known]
    if others:
        traced = look(cells.mesh, others, out)
        known |= {camera.name: (traced, number) for number, camera in enumerate(others)}
    with atomic_folder(out / "fused") as folder:
        for camera in data.cameras:
            views, number = known[camera.name]
            cell, _ = views.of(number)
            shape, seen = (camera.height, camera.width), cell >= 0
            for kind in kinds:
                ids = np.where(seen, getattr(found, kind)[cell], 0).astype(np.uint16)
                write_png(folder / kind / f"{camera.name}.png", ids.reshape(shape))
            agreement = np.where(seen, found.agreement[cell], 0)
            write_png(folder / "agreement" / f"{camera.name}.png", np.uint8(agreement * 255 + 0.5).reshape(shape))
        segments = _segments(cells, found, names)
        parts = {str(segment["id"]): segment["name"] for segment in segments}
        classes = {str(number): _named(number, names) for number in np.unique(found.kind[1:]).tolist() if number}
        for kind, ids in (("part", parts), ("semantic", classes)):
            if kind in kinds:
                write_text(folder / f"{kind}.json", json.dumps({"ids": ids}, indent=1) + "\n")
    fusion = on_triangles(cells, found)
    voted = found.votes > 0
    overall = float((found.agreement * found.votes).sum() / max(found.votes.sum(), 1e-30))
    figures = {
        "cells": len(cells),
        "triangles": len(fusion.part),
        "split_triangles": int(fusion.split.sum()),
        "agreement": round(overall, 4),
        "cells_below_half": round(float((found.agreement[voted] < 0.5).mean()) if voted.any() else 0.0, 4),
        "seen_area": round(float(cells.area[voted].sum()), 4),
        "area_without_id": round(float(cells.area[found.part == 0].sum()), 4),
    }
    content = about | figures | {"kinds": kinds, "segments": segments, "settings": dumped(settings)}
    write_fusion(out / "fusion.npz", fusion, content)
    files = [*(out / "fused").rglob("*"), out / "fusion.npz", out / "fusion.json"]
    write_manifest(manifest, "fuse", [file for file in files if file.is_file()], dumped(settings))
    stats["parts"] = len(segments)
    for name, value in figures.items():
        stats[name] = value
    print(f"fuse: {len(segments)} segments on {len(cells)} cells; {overall:.1%} of the votes agree")


def on_triangles(cells: Cells, found: Fused) -> Fusion:
    """What the room's triangles get from their cells."""
    count, area = int(cells.parent[-1]) + 1, cells.area
    part = most_votes(coo_matrix((area + 1e-12, (cells.parent, found.part))).tocsr())[0]
    votes = np.bincount(cells.parent, found.votes, count)
    agreement = np.bincount(cells.parent, found.votes * found.agreement, count) / np.where(votes > 0, votes, 1)
    low, high = np.full(count, found.part.max(initial=0) + 1), np.zeros(count, np.int64)
    np.minimum.at(low, cells.parent, found.part)
    np.maximum.at(high, cells.parent, found.part)
    return Fusion(
        part.astype(np.uint16),
        found.kind[part].astype(np.uint16),
        agreement.astype(np.float32),
        np.bincount(cells.parent, area * (found.votes > 0), count).astype(np.float32),
        low < high,
    )


def _named(kind: int, names: dict[int, str]) -> str:
    return names.get(kind, f"class {kind}") if kind else "segment"


def _segments(cells: Cells, found: Fused, names: dict[int, str]) -> list[dict[str, Any]]:
    """What fusion.json says of each part."""
    count, area = len(found.kind), cells.area
    whole = np.bincount(found.part, area, count)
    seen = np.bincount(found.part, area * (found.votes > 0), count)
    votes = np.bincount(found.part, found.votes, count)
    agreed = np.bincount(found.part, found.votes * found.agreement, count) / np.where(votes > 0, votes, 1)
    return [
        {
            "id": number,
            "class": int(found.kind[number]),
            "name": f"{_named(int(found.kind[number]), names)} {number}",
            "area": round(float(whole[number]), 5),
            "seen_area": round(float(seen[number]), 5),
            "views": int(found.views[number]),
            "agreement": round(float(agreed[number]), 4),
        }
        for number in range(1, count)
    ]
