"""Why no view fits the others: one mistake that all cameras share, found by trying which correction makes them fit.

A wrong convention makes every view fail, and no view is to blame. Each mistake that sources make is undone for a few
small views; the correction under which they agree is the diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fipt.errors import FiptError
from fipt.progress import progress
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.check_poses.compare import STRUCTURE, compare
from fipt.stages.check_poses.settings import CheckPosesSettings
from fipt.stages.check_poses.surface import reduced, shared_pixels, surface_shown
from fipt.stages.check_poses.verdict import Verdict

SUSPECT = 0.65
"""Median correlation below which all cameras are suspected together.

That of good ones is 0.74 or more in seven rooms, also on scans; with a focal length that is off by 5 % it is 0.64, by
10 % 0.42."""

_BETTER = 0.15
"""Correlation that a correction must win: more than chance among so many."""

_VIEWS = 10
"""Views that are tried; a common mistake shows in any."""

_WIDTH = 96
"""Columns of these."""

_FEWEST = 4
"""Views that must tell: of fewer, one of two dozen corrections fits better by chance."""

_PARTNERS = 3
"""Others that each is compared with."""

_MET = 0.2
"""Share of a view's pixels that must meet the mesh: in a room nearly all do, but for windows."""

_FACTORS = (0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.05, 1.1, 1.15, 1.2, 1.25, 1.35, 1.5)
"""Focal lengths and sizes that are tried, over the stated ones; between two of them windows still correlate."""


@dataclass(frozen=True)
class Correction:
    """A mistake, undone.

    Attributes
    ----------
    wrong
        The mistake, as the end of "fits if".
    camera
        Camera as stated -> as it then is.
    image
        (H, W) values of a view -> as they then are.
    """

    wrong: str
    camera: Callable[[Camera], Camera]
    image: Callable[[np.ndarray], np.ndarray] = lambda values: values


def explain(dataset: Dataset, verdicts: Sequence[Verdict], settings: CheckPosesSettings) -> None:
    """Refuse cameras that a common correction makes fit, where so many views fail that no single one is to blame.

    Raises
    ------
    FiptError
        One line with the correction, and how well views agree with it and without.
    """
    scores = [verdict.score for verdict in verdicts if verdict.score is not None]
    failed = sum(not verdict.accepted for verdict in verdicts)
    judged = 2 * len(scores) >= len(verdicts)  # cameras that look away from the room share nothing
    if len(verdicts) < _FEWEST:
        return
    if judged and np.median(scores) >= SUSPECT and failed <= (1 - settings.keep) * len(verdicts):
        return
    every = dataset.cameras
    chosen = every[:: -(-len(every) // _VIEWS)]
    views = [reduced(dataset, camera, _WIDTH) for camera in chosen]
    mesh = dataset.mesh()
    bounds = np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
    scene, tried = RayScene(mesh), list(corrections(chosen, bounds))
    before = agreement(scene, views, Correction("", lambda camera: camera))
    found: list[tuple[float, Correction]] = []
    with progress("check poses: what all cameras may have in common", len(tried), " corrections") as bar:
        for correction in tried:
            found.append((agreement(scene, views, correction), correction))
            bar.advance()
    best, correction = max(found, key=lambda pair: pair[0])
    if best >= max(SUSPECT, before + _BETTER):
        raise FiptError(
            f"cameras, images and mesh must fit; views agree by {before:.2f} (median correlation), and by {best:.2f} "
            f"if {correction.wrong}",
            "correct the source or its format, or set check_poses.enabled: false",
        )


def doubt(verdicts: Sequence[Verdict]) -> list[RoomFinding]:
    """Say that views hardly agree, though no common mistake was found; nothing where they do."""
    scores = [verdict.score for verdict in verdicts if verdict.score is not None]
    if len(verdicts) < _FEWEST or 2 * len(scores) < len(verdicts) or np.median(scores) >= SUSPECT:
        return []
    agreement = float(np.median(scores))
    return [
        RoomFinding(
            "views-disagree",
            "warning",
            f"Cameras, images and mesh hardly fit: views agree by {agreement:.2f} (median correlation; sound rooms "
            "have 0.74 or more), and no mistake that all share explains it.",
            Measure("disagreement of views, 1 less their correlation", 1 - agreement, 1 - SUSPECT, ""),
            "Look at overlay.png: is the mesh of this room, are images undistorted, without borders and noise?",
        )
    ]


def agreement(
    scene: RayScene, views: Sequence[tuple[Camera, *tuple[np.ndarray, ...]]], correction: Correction
) -> float:
    """Median correlation of views with their partners once a correction is applied; 0 where few of them tell.

    Parameters
    ----------
    views
        Of each what `fipt.stages.check_poses.surface.reduced` gives: camera, (H, W) log luminance, mask and colour.
    """
    shown = [
        surface_shown(scene, correction.camera(camera), *map(correction.image, images)) for camera, *images in views
    ]
    shared, _ = shared_pixels(scene, shown)
    scores = []
    for i, row in enumerate(shared):
        if shown[i].hit.mean() < _MET:
            continue  # a room from outside
        partners = [j for j in np.argsort(-row, kind="stable")[:_PARTNERS] if row[j] > 0]
        found = [compare(scene, shown[i], shown[j]) for j in partners]
        telling = [each.score for each in found if each.structure >= STRUCTURE]
        if telling:
            scores.append(float(np.median(telling)))
    return float(np.median(scores)) if 2 * len(scores) >= len(views) else 0.0


def corrections(cameras: Sequence[Camera], bounds: np.ndarray) -> Iterator[Correction]:
    """Every mistake that is tried; ``bounds`` (2, 3) are those of the mesh."""
    for wrong, flip in (
        ("camera axes are those of OpenCV (y down, looks along +z)", (1, -1, -1)),
        ("camera axes are x left, y up, z ahead (format fipt-synthetic)", (-1, 1, -1)),
        ("cameras are turned by 180 degrees about their axis", (-1, -1, 1)),
    ):
        yield Correction(wrong, _turned(np.diag(flip)))
    yield Correction("poses are world to camera (inverted)", lambda c: replace(c, world_from_camera=_inverse(c)))
    yield Correction(
        "poses are world to camera in OpenCV's axes",
        lambda c: replace(c, world_from_camera=_inverse(_turned(np.diag((1, -1, -1)), left=True)(c))),
    )
    yield Correction("rotations are transposed", _transposed)
    yield Correction("images are mirrored", lambda c: c, np.fliplr)
    yield Correction("images are upside down", lambda c: c, np.flipud)
    for number, axis in enumerate("xyz"):
        mirrored = _mirrored(number)
        if _inside([mirrored(c) for c in cameras], bounds):
            yield Correction(f"the mesh is mirrored, {axis} for -{axis}", mirrored, np.fliplr)
    up = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    yield Correction("z is up for the cameras and y for the mesh", _turned(up, left=True))
    yield Correction("y is up for the cameras and z for the mesh", _turned(up.T, left=True))
    if any(abs(c.cx / c.width - 0.5) > 0.02 or abs(c.cy / c.height - 0.5) > 0.02 for c in cameras):
        yield Correction(
            "the principal point is in the middle of the image", lambda c: replace(c, cx=c.width / 2, cy=c.height / 2)
        )
    if any(abs(c.fx / c.fy - 1) > 0.02 for c in cameras):
        yield Correction("the focal length of rows is that of columns", lambda c: replace(c, fy=c.fx))
        yield Correction("the focal length of columns is that of rows", lambda c: replace(c, fx=c.fy))
    for factor in _FACTORS:
        yield Correction(f"the focal length is about {factor:g} times the stated one", _zoomed(factor))
        yield Correction(f"the cameras' positions are about {factor:g} times the stated ones", _scaled(factor))


def _zoomed(factor: float) -> Callable[[Camera], Camera]:
    return lambda c: replace(c, fx=c.fx * factor, fy=c.fy * factor)


def _scaled(factor: float) -> Callable[[Camera], Camera]:
    return lambda c: replace(c, world_from_camera=np.column_stack([c.world_from_camera[:, :3], _place(c, factor)]))


def _place(camera: Camera, factor: float) -> np.ndarray:
    return np.append(factor * camera.center, 1.0)


def _turned(rotation: np.ndarray, left: bool = False) -> Callable[[Camera], Camera]:
    """A camera whose own axes are turned by a (3, 3) rotation, or, from the ``left``, the world around it."""
    turn = np.eye(4)
    turn[:3, :3] = rotation
    return lambda c: replace(c, world_from_camera=turn @ c.world_from_camera if left else c.world_from_camera @ turn)


def _inside(cameras: Sequence[Camera], bounds: np.ndarray) -> bool:
    """Whether most cameras stand within bounds (2, 3)."""
    centers = np.array([camera.center for camera in cameras]).reshape(-1, 3)
    return bool(((centers > bounds[0]) & (centers < bounds[1])).all(axis=1).mean() > 0.5)


def _mirrored(axis: int) -> Callable[[Camera], Camera]:
    """A camera in the world mirrored along an axis: it sees the mirrored image."""
    world, own = np.eye(4), np.diag([-1.0, 1, 1, 1])
    world[axis, axis] = -1
    return lambda c: replace(c, world_from_camera=world @ c.world_from_camera @ own, cx=c.width - c.cx)


def _inverse(camera: Camera) -> np.ndarray:
    return np.linalg.inv(camera.world_from_camera)


def _transposed(camera: Camera) -> Camera:
    pose = camera.world_from_camera.copy()
    pose[:3, :3] = pose[:3, :3].T
    return replace(camera, world_from_camera=pose)
