"""Which way the walls of a room face: the direction that most horizontal edges of its images have, up to 90 degrees.

The plane through a camera and a straight edge in its image holds the edge in space; its normal is n. A level edge has
the direction n x up, whatever its distance: every edge votes for one angle about the up axis, modulo 90 degrees, and
those that are not level vote at random. Where images have too few edges, the points do: seen along a wall,
they gather.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from fipt.scene.cameras import Camera
from fipt.stages.poses.room_boards import toned

_WIDTH = 1600
"""Images are reduced to this width for the search for edges."""

_SHORTEST = 0.03
"""Edges shorter than this share of the image's diagonal are left out."""

_UPRIGHT = np.sin(np.radians(3.0))
"""An edge whose plane comes this close to holding the up axis may be upright: it does not vote."""

_BINS = 900
"""Angles that are told apart: a tenth of a degree."""

_ENOUGH = 40
"""Edges below which the points decide."""

_RIVAL = 0.6
"""A second direction with this share of the best one's votes makes the walls ambiguous."""


@dataclass(frozen=True)
class Walls:
    """Direction of the walls.

    Attributes
    ----------
    angle
        Degrees in [0, 90) about the up axis, from the first of the two level axes given towards the second.
    source
        ``edges`` or ``points``.
    votes
        Edges or points that were asked.
    agreement
        Share of the votes within 2 degrees of the angle; 4.4 % of random ones are.
    deviation
        Standard deviation of the angle that the spread of the agreeing edges implies, degrees; of points, half a bin.
    rival
        Votes of the best other angle, more than 8 degrees away, over those of the best.
    """

    angle: float
    source: str
    votes: int
    agreement: float
    deviation: float
    rival: float

    @property
    def ambiguous(self) -> bool:
        """Whether another direction has nearly as many votes."""
        return self.rival > _RIVAL


def edge_votes(
    camera: Camera, radiance: np.ndarray, up: np.ndarray, level: np.ndarray, boards: Sequence[np.ndarray] = ()
) -> tuple[np.ndarray, ...]:
    """Angles modulo 90 degrees that the straight edges of an image vote for, and the weight of each vote.

    Parameters
    ----------
    camera, radiance
        A view and its (H, W, 3) image.
    up
        (3,) unit vector.
    level
        (2, 3) unit vectors that complete it to a right-handed frame (first, up, second x ...): angles count from the
        first towards the second.
    boards
        (K, 3) corners of each board in the room, whose own edges do not vote: it may lie anyhow.
    """
    grey = toned(radiance)[0]
    step = max(camera.width / _WIDTH, 1.0)
    if step > 1:
        size = (round(camera.width / step), round(camera.height / step))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    found = cv2.createLineSegmentDetector().detect(grey)[0]
    if found is None:
        return np.zeros(0), np.zeros(0)
    ends = (found.reshape(-1, 2, 2).astype(np.float64) + 0.5) * [camera.width / grey.shape[1],
                                                                 camera.height / grey.shape[0]]  # fmt: skip
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / np.hypot(camera.width, camera.height)
    keep = length > _SHORTEST
    for corners in boards:
        pixels, depth = camera.project(corners)
        if (depth > 0).all():
            middle, half = (pixels.max(axis=0) + pixels.min(axis=0)) / 2, np.ptp(pixels, axis=0)
            keep &= (np.abs(ends.mean(axis=1) - middle) > half).any(axis=1)
    ends, length = ends[keep], length[keep]
    rays = camera.directions(ends[..., 0], ends[..., 1]).astype(np.float64)
    normals = np.cross(rays[:, 0], rays[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    along = np.cross(normals, up)
    certain = np.linalg.norm(along, axis=1)  # an edge on the horizon may have any direction
    keep = (np.abs(normals @ up) > _UPRIGHT) & (certain > 0.1)
    angle = np.degrees(np.arctan2(along @ level[1], along @ level[0])) % 90.0
    return angle[keep], (length * certain)[keep]


def find_walls(
    cameras: Sequence[Camera],
    read_image: Callable[[str], np.ndarray],
    points: np.ndarray,
    up: np.ndarray,
    level: np.ndarray,
    boards: Sequence[np.ndarray],
    advance: Callable[[str], None],
) -> Walls | None:
    """Find the walls' direction from the edges of all views, else from (P, 3) points; None where neither tells.

    The other parameters are those of `edge_votes`; ``advance`` is told of every view that is done.
    """
    votes = []
    for camera in cameras:
        votes.append(edge_votes(camera, read_image(camera.name), up, level, boards))
        advance(camera.name)
    angle, weight = (np.concatenate(part) for part in zip(*votes, strict=True))
    if len(angle) >= _ENOUGH:
        return _of_edges(angle, weight)
    return _of_points(points @ level.T) if len(points) >= _ENOUGH else None


def _of_edges(angle: np.ndarray, weight: np.ndarray) -> Walls:
    share, rival = _peak(np.bincount((angle * _BINS / 90).astype(int) % _BINS, weight, _BINS), width=1.0)
    for reach in (2.0, 1.0, 1.0):  # the mean of the votes near the peak, which moves with them
        away = (angle - share + 45) % 90 - 45
        near = np.abs(away) < reach
        share = (share + np.average(away[near], weights=weight[near])) % 90
    away = (angle - share + 45) % 90 - 45
    near = np.abs(away) < 2
    spread = np.sqrt(np.average(away[near] ** 2, weights=weight[near]))
    effective = weight[near].sum() ** 2 / (weight[near] ** 2).sum()
    agreement = weight[near].sum() / weight.sum()
    return Walls(float(share), "edges", len(angle), float(agreement), float(spread / np.sqrt(effective)), rival)


def _of_points(plan: np.ndarray) -> Walls:
    """Angle at which points seen from above, (P, 2), gather most along both axes."""
    low, high = np.percentile(plan, [2, 98], axis=0)
    plan = plan[((plan >= low) & (plan <= high)).all(axis=1)]
    cell = np.linalg.norm(high - low) / 200
    gathered = np.zeros(_BINS)
    for index in range(_BINS):
        turn = np.radians(index * 90 / _BINS)
        c, s = np.cos(turn), np.sin(turn)
        for line in (plan @ [c, s], plan @ [-s, c]):
            counts = np.bincount(((line - line.min()) / cell).astype(int))
            gathered[index] += (counts.astype(float) ** 2).sum()
    angle, rival = _peak(gathered - np.median(gathered), width=0.5)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    near = []
    for line in (plan @ [c, s], plan @ [-s, c]):
        counts = np.bincount(((line - line.min()) / cell).astype(int))
        near.append(np.sort(counts)[-2:].sum() / len(line))
    return Walls(angle, "points", len(plan), float(np.mean(near)), 0.25, rival)


def _peak(votes: np.ndarray, width: float) -> tuple[float, float]:
    """Angle in degrees of the highest place of a closed histogram smoothed by ``width`` degrees; share of the next."""
    from scipy.ndimage import gaussian_filter1d

    smooth = gaussian_filter1d(votes, width * _BINS / 90, mode="wrap")
    best = int(smooth.argmax())
    away = np.abs((np.arange(_BINS) - best + _BINS // 2) % _BINS - _BINS // 2) * 90 / _BINS
    return (best + 0.5) * 90 / _BINS % 90, float(max(smooth[away > 8].max(), 0.0) / smooth[best])
