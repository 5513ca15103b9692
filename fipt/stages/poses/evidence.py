"""Why a camera is believed: two mappings that agree, points that hold it, links to the other views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix

from fipt.groups import connected_groups
from fipt.stages.poses.matching import Link
from fipt.stages.poses.model import Reconstruction, Tracks
from fipt.stages.poses.settings import PosesSettings
from fipt.stages.poses.similarity import camera_similarity, distances, rotation_angles

FEW_FEATURES = 100
"""Features below which an image has no texture."""

_TURN = 0.5
"""Distance of matches from a mere turn of the camera, below which they show no parallax, pixels."""
_MOSTLY = 0.9
"""Share of the links without parallax from which all images are of one place."""


@dataclass(frozen=True)
class Agreement:
    """How far two reconstructions have a camera apart, after the similarity that fits most cameras.

    Attributes
    ----------
    shift
        Distance of its two places over the extent of the points.
    turn
        Angle between its two directions, degrees.
    """

    shift: float
    turn: float


@dataclass(frozen=True)
class Evidence:
    """What speaks for a view's pose.

    Attributes
    ----------
    features
        Of its image.
    neighbours
        Views that share at least ``min_shared`` points with it, or, without a pose, that it is matched with.
    points
        Points that it sees.
    track_length
        Mean number of views that see these points.
    error
        Mean reprojection error, pixels.
    agreement
        Of incremental and global mapping; None where one of them has not placed the camera.
    spread
        Largest shift against what the other thresholds for matches gave; None where only one gave a model.
    reason
        Why it is rejected; None: it is not.
    """

    features: int
    neighbours: tuple[str, ...]
    points: int = 0
    track_length: float = 0.0
    error: float = 0.0
    agreement: Agreement | None = None
    spread: float | None = None
    reason: str | None = None

    def plain(self) -> dict[str, Any]:
        """As JSON types."""
        return asdict(self)


def extent(reconstruction: Reconstruction) -> float:
    """Size of the scene, in the reconstruction's units: diagonal of the box of all points but the outermost."""
    if len(reconstruction.points) < 2:
        return 0.0
    low, high = np.percentile(reconstruction.points, (2, 98), axis=0)
    return float(np.linalg.norm(high - low))


def agreement(model: Reconstruction, other: Reconstruction | None, settings: PosesSettings) -> dict[str, Agreement]:
    """Compare the cameras that two reconstructions share, by name; {} where they share fewer than three."""
    theirs = {} if other is None else {camera.name: camera.world_from_camera for camera in other.cameras}
    names = [camera.name for camera in model.cameras if camera.name in theirs]
    if len(names) < 3:
        return {}
    size = extent(model)
    ours = np.array([camera.world_from_camera for camera in model.cameras if camera.name in theirs])
    found = np.array([theirs[name] for name in names])
    similarity = camera_similarity(found, ours, settings.max_shift * size, settings.seed)
    shift = distances(similarity, found[:, :3, 3], ours[:, :3, 3]) / max(size, 1e-12)
    rotation = similarity[:3, :3] / np.cbrt(np.linalg.det(similarity[:3, :3]))
    turn = rotation_angles(rotation @ found[:, :3, :3], ours[:, :3, :3])
    return {name: Agreement(float(s), float(t)) for name, s, t in zip(names, shift, turn, strict=True)}


def agrees(found: Agreement | None, settings: PosesSettings) -> bool:
    """Whether a camera's two places and directions are the same within the settings."""
    return found is not None and found.shift <= settings.max_shift and found.turn <= settings.max_turn


def shared_points(tracks: Tracks, views: int) -> np.ndarray:
    """(V, V) int number of points that each pair of views shares; the diagonal is what each sees."""
    seen = coo_matrix((np.ones(len(tracks.view), np.int64), (tracks.view, tracks.point))).tocsr()
    seen.resize((views, seen.shape[1]))
    seen.data[:] = 1  # a view may see a point twice
    return np.asarray((seen @ seen.T).todense())


def groups(strength: np.ndarray, least: int) -> list[np.ndarray]:
    """Views that hold together, (n,) indices each, largest first: linked by entries of (V, V) of at least ``least``."""
    labels = connected_groups(np.nonzero(strength >= least), len(strength))
    found = [np.flatnonzero(labels == label) for label in range(labels.max(initial=-1) + 1)]
    return sorted(found, key=lambda group: (-len(group), group[0]))


def link_strength(links: Sequence[Link], views: int) -> np.ndarray:
    """(V, V) int verified matches of each pair of views."""
    strength = np.zeros((views, views), np.int64)
    for link in links:
        a, b = link.views
        strength[a, b] = strength[b, a] = link.matches
    return strength


def of_one_place(links: Sequence[Link], pixel: float) -> bool:
    """Whether nearly all links are explained by turns of a camera that stands still.

    Parameters
    ----------
    links
        Verified pairs.
    pixel
        Pixels of the view for one of the images in which features were found.
    """
    still = [float(np.median(link.turn)) < _TURN * pixel for link in links]
    return bool(still) and sum(still) >= _MOSTLY * len(still)


def judged(
    names: Sequence[str],
    features: np.ndarray,
    links: Sequence[Link],
    models: Sequence[Reconstruction],
    agreements: dict[str, Agreement],
    others: Sequence[Reconstruction],
    settings: PosesSettings,
) -> dict[str, Evidence]:
    """Judge every view.

    Parameters
    ----------
    names
        Of all views.
    features
        (V,) of their images.
    links
        Verified pairs of ``names``.
    models
        Those of the chosen run, the one to use first.
    agreements
        Of the first with an independent mapping.
    others
        The first models of runs with other thresholds.

    Returns
    -------
    View -> evidence, in the order of ``names``.
    """
    model = models[0]
    shared = shared_points(model.tracks, len(model.cameras))
    lengths = np.bincount(model.tracks.point, minlength=len(model.points))
    spreads = [agreement(model, other, settings) for other in others]
    held = groups(shared, settings.min_shared)
    matched = link_strength(links, len(names))
    placed = [camera.name for camera in model.cameras]
    found = {}
    for number, name in enumerate(names):
        if name not in placed:
            partners = [names[int(i)] for i in np.argsort(-matched[number], kind="stable") if matched[number, i]]
            reason = _unplaced(name, int(features[number]), partners, models)
            found[name] = Evidence(int(features[number]), tuple(partners), reason=reason)
            continue
        index = placed.index(name)
        points = model.tracks.point[model.tracks.view == index]
        near = np.flatnonzero((shared[index] >= settings.min_shared) & (np.arange(len(placed)) != index))
        away = [spread[name].shift for spread in spreads if name in spread]
        evidence = Evidence(
            features=int(features[number]),
            neighbours=tuple(placed[other] for other in near),
            points=int(shared[index, index]),
            track_length=float(lengths[points].mean()) if len(points) else 0.0,
            error=float(model.errors[points].mean()) if len(points) else 0.0,
            agreement=agreements.get(name),
            spread=max(away, default=None),
        )
        reason = _weak(evidence, settings) or _of_other_group(index, held, placed, shared, settings)
        found[name] = replace(evidence, reason=reason)
    return found


def _unplaced(name: str, features: int, partners: Sequence[str], models: Sequence[Reconstruction]) -> str:
    """Why a view has no camera in the first model."""
    if features < FEW_FEATURES:
        return f"no pose: only {features} features, its image shows too little texture"
    if not partners:
        return "no pose: no other view shows enough of the same; take photographs between it and its neighbours"
    for other in models[1:]:
        group = [camera.name for camera in other.cameras]
        if name in group:
            return f"no pose: part of a group of {len(group)} views that is not linked with the others"
    return f"no pose: its matches with {', '.join(partners[:3])} do not determine it"


def _weak(evidence: Evidence, settings: PosesSettings) -> str | None:
    if evidence.points < settings.min_points:
        return f"only {evidence.points} points hold its pose; {settings.min_points} are needed"
    if evidence.error > settings.max_error:
        return f"reprojection error {evidence.error:.2f} pixels; at most {settings.max_error:g} is allowed"
    if evidence.agreement is None:
        return "only one of two mappings has placed it"
    if not agrees(evidence.agreement, settings):
        return (
            f"two mappings disagree: {evidence.agreement.shift:.1%} of the scene's extent, "
            f"{evidence.agreement.turn:.2f} degrees apart"
        )
    return None


def _of_other_group(
    index: int, held: Sequence[np.ndarray], placed: Sequence[str], shared: np.ndarray, settings: PosesSettings
) -> str | None:
    """Why a camera of a smaller group is not believed: too few points hold its group to the others."""
    group = next(group for group in held if index in group)
    if group is held[0]:
        return None
    rest = np.setdiff1d(np.arange(len(placed)), group)
    most = int(shared[np.ix_(group, rest)].max(initial=0))
    members = f"its group of {len(group)} views" if len(group) > 1 else "it"
    return f"weakly linked: no other view shares {settings.min_shared} points with {members}; the most is {most}"
