"""Views to cameras: match, map twice, compare, judge, bring to metres, write."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.progress import progress
from fipt.scene.cameras import Camera, write_transforms
from fipt.scene.dataset import write_views
from fipt.scene.mesh import Mesh, write_ply
from fipt.scene.sources import read_poses
from fipt.stages.poses.align import align
from fipt.stages.poses.diagram import draw
from fipt.stages.poses.evidence import (
    FEW_FEATURES,
    Agreement,
    Evidence,
    agreement,
    agrees,
    groups,
    judged,
    link_strength,
    of_one_place,
    shared_points,
)
from fipt.stages.poses.mapping import mapped
from fipt.stages.poses.matching import FEWEST_MATCHES, Link, counts, database, links
from fipt.stages.poses.model import Reconstruction, Tracks, transformed
from fipt.stages.poses.reference import to_reference
from fipt.stages.poses.settings import PosesSettings
from fipt.stages.poses.views import FEWEST, UnposedViews

_STEPS = "take photographs in steps of 15 degrees and half a metre"
_NAMED = 12
"""Views that a message names."""


@dataclass(frozen=True)
class Run:
    """One attempt: a threshold for matches, and what both mappings made of it.

    Attributes
    ----------
    min_matches
        The threshold.
    models
        Of incremental mapping, largest first; at least one.
    agreements
        Camera of the first model -> how far global mapping has it elsewhere.
    sizes
        Cameras of every model: incremental, global.
    """

    min_matches: int
    models: Sequence[Reconstruction]
    agreements: dict[str, Agreement]
    sizes: tuple[Sequence[int], Sequence[int]]


@dataclass(frozen=True)
class Estimate:
    """Poses and what speaks for them.

    Attributes
    ----------
    reconstruction
        Of the accepted cameras, in metres; the points that two of them see.
    refused
        Cameras that were placed and rejected, same frame.
    evidence
        View -> evidence; every view that had an image.
    pairs
        (view, view, matches, shared points) of every verified pair.
    groups
        Names of the placed views that hold together, largest group first.
    runs
        What each threshold gave, plain JSON types; ``chosen`` is the threshold used.
    align
        How metres, up and axes were found.
    """

    reconstruction: Reconstruction
    refused: Sequence[Camera]
    evidence: dict[str, Evidence]
    pairs: Sequence[tuple[str, str, int, int]]
    groups: Sequence[Sequence[str]]
    runs: Sequence[dict[str, Any]]
    chosen: int
    align: dict[str, Any]


def estimate(views: UnposedViews, work: Path, settings: PosesSettings) -> Estimate:
    """Estimate the poses of views.

    Parameters
    ----------
    views
        At least three.
    work
        Folder of images, features, matches and models; what lies there is used again.

    Raises
    ------
    FiptError
        Images without texture, of one place, without links, or too few cameras that can be believed.
    """
    if settings.align.reference is not None:
        read_poses(settings.align.reference)  # a file that is missing or damaged says so before the long work
    found = database(views, work, settings)
    features, pairs = counts(found, views.cameras), links(found, views.cameras)
    names = [camera.name for camera in views.cameras]
    _check_images(names, features, pairs, views.cameras, settings)
    runs = _runs(found, views.cameras, pairs, work, settings)
    if not runs:
        raise FiptError(
            f"no three of the {len(names)} views could be placed together: {_grouped(names, pairs)}", _STEPS
        )
    judgements = [
        judged(
            names, features, pairs, run.models, run.agreements, [o.models[0] for o in runs if o is not run], settings
        )
        for run in runs
    ]
    believed = [sum(e.reason is None for e in judgement.values()) for judgement in judgements]
    # Among equals the first, which has the lowest threshold and so the most matches to hold its cameras.
    best = int(np.argmax(believed))
    model, evidence = runs[best].models[0], judgements[best]
    if believed[best] < max(settings.min_share * len(names), FEWEST):
        raise FiptError(_too_few(names, runs[best], evidence), f"link them: {_STEPS}, with texture in view")
    kept = _of(model, [evidence[camera.name].reason is None for camera in model.cameras])
    similarity, report = _aligned(kept, views, settings)
    model, kept = transformed(model, similarity), transformed(kept, similarity)
    shared = shared_points(model.tracks, len(model.cameras))
    index = {camera.name: i for i, camera in enumerate(model.cameras)}
    linked = [(*(names[view] for view in link.views), link.matches) for link in pairs]
    return Estimate(
        reconstruction=kept,
        refused=[camera for camera in model.cameras if evidence[camera.name].reason is not None],
        evidence=evidence,
        pairs=[
            (a, b, matches, int(shared[index[a], index[b]]) if a in index and b in index else 0)
            for a, b, matches in linked
        ],
        groups=[[model.cameras[i].name for i in group] for group in groups(shared, settings.min_shared)],
        runs=[_plain(run, count, settings) for run, count in zip(runs, believed, strict=True)],
        chosen=runs[best].min_matches,
        align=report,
    )


def write(out: Path, views: UnposedViews, found: Estimate) -> None:
    """Write transforms.json, views.json, poses.json, points.ply and poses.png."""
    order = {camera.name: number for number, camera in enumerate(views.cameras)}
    cameras = sorted(found.reconstruction.cameras, key=lambda camera: order[camera.name])
    reasons = dict(views.rejected)
    reasons |= {name: evidence.reason for name, evidence in found.evidence.items() if evidence.reason is not None}
    write_text(out / "poses.json", json.dumps(content(views, found), indent=1, allow_nan=False) + "\n")
    points = found.reconstruction.points.astype(np.float32)
    write_ply(out / "points.ply", Mesh(points, np.zeros((0, 3), np.int32)))
    draw(out / "poses.png", found.reconstruction, found.refused, found.evidence, found.pairs)
    write_views(out / "views.json", [*order, *views.rejected], reasons)
    write_transforms(out / "transforms.json", cameras)


def content(views: UnposedViews, found: Estimate) -> dict[str, Any]:
    """What poses.json holds: evidence of every view, the view graph, the runs, the alignment."""
    earlier = {name: {"accepted": False, "reason": reason} for name, reason in views.rejected.items()}
    return {
        "views": {name: {"accepted": e.reason is None, **e.plain()} for name, e in found.evidence.items()} | earlier,
        "graph": [
            {"views": [a, b], "matches": matches, "shared_points": shared} for a, b, matches, shared in found.pairs
        ],
        "groups": found.groups,
        "runs": list(found.runs),
        "min_matches": found.chosen,
        "points": len(found.reconstruction.points),
        "error": float(found.reconstruction.errors.mean()),
        "align": found.align,
    }


# ------------------------------------------------------------------------------------------------------------- steps


def _runs(
    found: Path, cameras: Sequence[Camera], pairs: Sequence[Link], work: Path, settings: PosesSettings
) -> list[Run]:
    """Map with every threshold that leaves other pairs than the one before; runs without a model are left out."""
    left = {least: sum(link.matches >= least for link in pairs) for least in sorted(set(settings.min_matches))}
    thresholds = [
        least for number, least in enumerate(left) if left[least] and left[least] not in list(left.values())[:number]
    ]
    runs = []
    with progress("mapping", 2 * len(thresholds), " runs") as bar:
        for least in thresholds:
            models = mapped(found, cameras, "incremental", least, work, settings)
            bar.advance(note=f"incremental, {least} matches")
            others = mapped(found, cameras, "global", least, work, settings)
            bar.advance(note=f"global, {least} matches")
            if models:
                names = {camera.name for camera in models[0].cameras}
                # Of the others, the one that shares most cameras with the largest.
                twin = max(others, key=lambda o: sum(c.name in names for c in o.cameras), default=None)
                sizes = [len(model.cameras) for model in models], [len(model.cameras) for model in others]
                runs.append(Run(least, models, agreement(models[0], twin, settings), sizes))
    return runs


def _plain(run: Run, believed: int, settings: PosesSettings) -> dict[str, Any]:
    """What poses.json says of a run, of whose cameras so many are believed."""
    return {
        "min_matches": run.min_matches,
        "incremental": list(run.sizes[0]),
        "global": list(run.sizes[1]),
        "agreeing": sum(agrees(found, settings) for found in run.agreements.values()),
        "believed": believed,
    }


def _aligned(model: Reconstruction, views: UnposedViews, settings: PosesSettings) -> tuple[np.ndarray, dict[str, Any]]:
    """Similarity that brings a reconstruction to metres, and what it was found from."""
    if settings.align.reference is not None:
        similarity, report = to_reference(model, settings.align.reference, settings.seed)
        return similarity, {"from": "reference", **asdict(report)}
    similarity, report = align(model, views.radiance, settings.align, views.orientation)
    return similarity, {"from": "the room", **report.plain()}


def _of(model: Reconstruction, kept: Sequence[bool]) -> Reconstruction:
    """The cameras that are kept, and the points that at least two of them see."""
    tracks, cameras = model.tracks, np.flatnonzero(kept)
    place = np.full(len(kept), -1)
    place[cameras] = np.arange(len(cameras))
    mine = place[tracks.view] >= 0
    pairs = np.unique(np.stack([tracks.view[mine], tracks.point[mine]]), axis=1)
    seen = np.bincount(pairs[1], minlength=len(model.points)) >= 2
    mine &= seen[tracks.point]
    number = np.cumsum(seen) - 1
    return replace(
        model,
        cameras=tuple(model.cameras[i] for i in cameras),
        points=model.points[seen],
        errors=model.errors[seen],
        tracks=Tracks(place[tracks.view[mine]], number[tracks.point[mine]], tracks.pixel[mine]),
    )


# ---------------------------------------------------------------------------------------------------- what goes wrong


def _check_images(
    names: Sequence[str],
    features: np.ndarray,
    pairs: Sequence[Link],
    cameras: Sequence[Camera],
    settings: PosesSettings,
) -> None:
    """Refuse images that cannot give poses, before any mapping."""
    plain = [name for name, count in zip(names, features, strict=True) if count < FEW_FEATURES]
    if len(names) - len(plain) < max(settings.min_share * len(names), FEWEST):
        raise FiptError(
            f"{len(plain)} of {len(names)} views show too little texture (fewer than {FEW_FEATURES} features: "
            f"{_listed(plain)})",
            "take photographs with texture in view, or put posters or boards on bare walls",
        )
    pixel = max(1.0, *(max(camera.width, camera.height) / settings.max_size for camera in cameras))
    if of_one_place(pairs, pixel):
        raise FiptError(
            f"all {len(names)} images are of one place: turning the camera explains the matches between them, "
            "and without translation there is no depth",
            "move the camera between photographs, half a metre to a metre each time",
        )
    if not pairs:
        raise FiptError(f"no two of the {len(names)} views show the same: each is isolated ({_listed(names)})", _STEPS)


def _grouped(names: Sequence[str], pairs: Sequence[Link]) -> str:
    """Which views are linked by matches, in words."""
    found = groups(link_strength(pairs, len(names)), FEWEST_MATCHES)
    linked = [
        f"matches link {_listed([names[int(i)] for i in group])}, too weakly" for group in found if len(group) > 1
    ]
    alone = [names[int(group[0])] for group in found if len(group) == 1]
    return "; ".join([*linked[:3], *([f"isolated are {_listed(alone)}"] if alone else [])])


def _too_few(names: Sequence[str], run: Run, evidence: dict[str, Evidence]) -> str:
    """Say what the views fall into, where too few have a pose."""
    parts: list[list[str]] = []
    for model in run.models:
        part = sorted(camera.name for camera in model.cameras)
        if not any(set(part) & set(other) for other in parts):
            parts.append(part)
    if len(parts) > 1:
        text = "; ".join(f"group {number}: {_listed(part)}" for number, part in enumerate(parts, 1))
        return f"the views fall into {len(parts)} groups that are not linked with each other ({text})"
    lost = [f"{name}: {evidence[name].reason}" for name in names if evidence[name].reason is not None]
    good = len(names) - len(lost)
    return f"only {good} of {len(names)} views have a pose that can be believed ({'; '.join(lost[:4])})"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
