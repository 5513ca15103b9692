"""What the fusion leaves on disk: ids of every view, ids of every triangle, and what each segment is."""

import json
import logging
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from fipt.formats.files import atomic_folder, write_text
from fipt.formats.images import write_png
from fipt.formats.manifests import Stats, withdraw_manifest, write_manifest
from fipt.scene.dataset import Dataset
from fipt.scene.fusion import Fusion, write_fusion
from fipt.settings import dumped
from fipt.stages.segment.settings import FuseSettings
from fipt.stages.segment.split import Cells
from fipt.stages.segment.views import CellObservations, observe
from fipt.stages.segment.votes import most_votes

log = logging.getLogger(__name__)


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


@dataclass(frozen=True)
class FusionResult:
    """What the fusion found, and what is known of it besides.

    Attributes
    ----------
    cells, fused
        The C cells and their segments.
    kinds
        Of ids to write for the views: part, semantic.
    about
        What to say in fusion.json beside segments and figures.
    observations
        Of some views on these cells; the others are traced.
    names
        Of classes.
    """

    cells: Cells
    fused: Fused
    kinds: list[str]
    about: dict[str, Any]
    observations: CellObservations
    names: dict[int, str] = field(default_factory=dict)


def write_fused(out: Path, data: Dataset, result: FusionResult, settings: FuseSettings) -> Stats:
    """Write the ids of every view below ``out``/fused, fusion.npz and .json, the manifest last; return figures."""
    manifest = out / "fused.manifest.json"
    withdraw_manifest(manifest)
    segments = _segments(result)
    with atomic_folder(out / "fused", r"part|semantic|agreement|\w+\.json") as folder:
        _write_views(folder, out, data, result)
        _write_names(folder, segments, result)
    fusion = on_triangles(result.cells, result.fused)
    figures = _figures(result, fusion)
    content = result.about | figures | {"kinds": result.kinds, "segments": segments, "settings": dumped(settings)}
    write_fusion(out / "fusion.npz", fusion, content)
    files = [*(out / "fused").rglob("*"), out / "fusion.npz", out / "fusion.json"]
    write_manifest(manifest, "fuse", [file for file in files if file.is_file()], dumped(settings))
    log.info(
        "fuse: %d segments on %d cells; %.1f%% of the votes agree",
        len(segments),
        len(result.cells),
        100 * _agreement(result.fused),
    )
    return {"parts": len(segments), **figures}


def _write_views(folder: Path, scratch: Path, data: Dataset, result: FusionResult) -> None:
    """Write the ids and the agreement of every view to ``folder``; cells lie on the disk of ``scratch`` meanwhile."""
    known = {camera.name: (result.observations, k) for k, camera in enumerate(result.observations.cameras)}
    others = [camera for camera in data.cameras if camera.name not in known]
    if others:
        traced = observe(result.cells.mesh, others, scratch)
        known |= {camera.name: (traced, number) for number, camera in enumerate(others)}
    for camera in data.cameras:
        views, number = known[camera.name]
        cell, _ = views.of(number)
        shape, seen = (camera.height, camera.width), cell >= 0
        for kind in result.kinds:
            ids = np.where(seen, getattr(result.fused, kind)[cell], 0).astype(np.uint16)
            write_png(folder / kind / f"{camera.name}.png", ids.reshape(shape))
        agreement = np.where(seen, result.fused.agreement[cell], 0)
        write_png(folder / "agreement" / f"{camera.name}.png", (agreement * 255 + 0.5).astype(np.uint8).reshape(shape))


def _write_names(folder: Path, segments: list[dict[str, Any]], result: FusionResult) -> None:
    """Write the names of ids beside the views, of each kind that is written."""
    parts = {str(segment["id"]): segment["name"] for segment in segments}
    present = np.unique(result.fused.kind[1:]).tolist()
    classes = {str(number): _named(number, result.names) for number in present if number}
    for kind, ids in (("part", parts), ("semantic", classes)):
        if kind in result.kinds:
            write_text(folder / f"{kind}.json", json.dumps({"ids": ids}, indent=1) + "\n")


def _agreement(found: Fused) -> float:
    """Share of all votes that the cells' ids got."""
    return float((found.agreement * found.votes).sum() / max(found.votes.sum(), 1e-30))


def _figures(result: FusionResult, fusion: Fusion) -> dict[str, Any]:
    """What statistics and fusion.json say of the whole fusion."""
    found, area = result.fused, result.cells.area
    voted = found.votes > 0
    return {
        "cells": len(result.cells),
        "triangles": len(fusion.part),
        "split_triangles": int(fusion.split.sum()),
        "agreement": round(_agreement(found), 4),
        "cells_below_half": round(float((found.agreement[voted] < 0.5).mean()) if voted.any() else 0.0, 4),
        "seen_area": round(float(area[voted].sum()), 4),
        "area_without_id": round(float(area[found.part == 0].sum()), 4),
    }


def on_triangles(cells: Cells, found: Fused) -> Fusion:
    """What the room's triangles get from their cells."""
    count, area = int(cells.parent[-1]) + 1, cells.area
    part = most_votes(csr_matrix((area + 1e-12, (cells.parent, found.part))))[0]
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


def _segments(result: FusionResult) -> list[dict[str, Any]]:
    """What fusion.json says of each part."""
    found, names = result.fused, result.names
    count, area = len(found.kind), result.cells.area
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
